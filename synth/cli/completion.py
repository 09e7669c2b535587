"""`synth completion`: commands, options, presets and files completed by the shell (the library shtab writes the scripts)."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

#: how each shell is told; the rest of what shtab knows is not tried here
SHELLS = {
    "bash": 'add to ~/.bashrc:  eval "$(synth completion bash)"',
    "zsh": 'add to ~/.zshrc, behind compinit:  eval "$(synth completion zsh)"',
    "fish": "synth completion fish > ~/.config/fish/completions/synth.fish",
}
#: endings of what a value that is called so may be
_ENDINGS = {
    "IN.mid": ("mid", "midi"),
    "SONG.mid": ("mid", "midi"),
    "REC.wav": ("wav", "flac"),
    "OTHER.wav": ("wav", "flac"),
    "FILE.scl": ("scl",),
    "FILE.sf2": ("sf2", "sf3"),
    "FILE.kbm": ("kbm",),
    "RUN.npz": ("npz",),
    "MOBILITY.csv": ("csv",),
}
#: …and what is written, or of any kind
_FILES = ("FILE", "PATH", "OUT", "TAKE.wav", "NEW.toml", "BODY.toml", "FILE.csv", "FILE.png")
_FOLDERS = ("DIR", "FOLDER")

#: a function of each shell that offers {names}, the values of an option (the {kind})
_VALUES = {
    "bash": """
_synth_{kind}() {
  compgen -W "{names}" -- "$1"
}
""",
    "zsh": """
_synth_{kind}() {
  _values '{kind}' {names}
}
""",
    "fish": """
function _synth_{kind}
  string split ' ' -- "{names}"
end
""",
}

#: a function of each shell that offers {names} of presets, cases, recipes or studies (the {kind}), and files of one's own
_FUNCTIONS = {
    "bash": """
_synth_{kind}() {
  compgen -W "{names}" -- "$1"
  compgen -f -X '!*.toml' -- "$1"
  compgen -d -- "$1"
}
""",
    "zsh": """
_synth_{kind}() {
  _alternative '{kind}:{kind}:({names})' 'files:file:_files -g "*.toml"'
}
""",
    "fish": """
function _synth_{kind}
  string split ' ' -- "{names}"
  for candidate in (__fish_complete_path (commandline -ct))
    string match -q -r '(\\.toml|/)(\\t|$)' -- "$candidate"; and printf '%s\\n' "$candidate"
  end
end
""",
}


def add(commands: Any, root: argparse.ArgumentParser) -> None:
    """root: the parser of all commands."""
    told = "; ".join(f"{shell}: {how}" for shell, how in SHELLS.items())
    parser = commands.add_parser(
        "completion",
        help="print a completion script for bash, zsh or fish: commands, options and presets",
        allow_abbrev=False,
        description=f"Prints the script. {told}.",
    )
    parser.add_argument("shell", choices=tuple(SHELLS), metavar="SHELL", help=", ".join(SHELLS))
    parser.set_defaults(run=lambda options: _complete(options, root))


def _complete(options: argparse.Namespace, root: argparse.ArgumentParser) -> int:
    print(script(root, options.shell))
    return 0


def script(root: argparse.ArgumentParser, shell: str) -> str:
    """What the shell is to read."""
    import shtab

    from synth.drone.swara import RATIOS, name_of
    from synth.instrument.preset import list_presets, preset_folder
    from synth.instrument.shipped import shipped_names
    from synth.plugin.platforms import TARGETS

    own = preset_folder()
    cases = own / "cases"
    words = {
        "presets": sorted(path.stem for path in own.glob("*.toml")),
        "cases": sorted(path.relative_to(cases).with_suffix("").as_posix() for path in cases.rglob("*.toml")),
        "recipes": shipped_names("recipes"),
        "studies": shipped_names("studies"),
    }
    shipped = list_presets()
    values = {
        "families": sorted({preset.family for preset in shipped if preset.family}),
        "tags": sorted({tag for preset in shipped for tag in preset.tags}),
        "swaras": [*(name_of(float(ratio)).replace(" ", "-") for ratio in RATIOS.values()), "none"],
        "targets": [*TARGETS, "all"],
    }
    of_metavar = {
        "PRESET": "presets", "CASE": "cases", "RECIPE": "recipes", "STUDY": "studies",
        "FAMILY": "families", "TAG": "tags", "SWARA": "swaras", "TARGET": "targets",
    }  # fmt: skip
    for action in _actions(root):
        kind = action.metavar if isinstance(action.metavar, str) else ""
        if kind == "NAME" and not action.option_strings:
            kind = "PRESET"
        what: Any = None
        if kind in _ENDINGS:
            what = shtab.glob(*(f"*.{ending}" for ending in _ENDINGS[kind]))
        elif kind in of_metavar:
            function = f"_synth_{of_metavar[kind]}"
            what = {"bash": function, "zsh": function, "fish": f"({function})"}
        elif kind in _FOLDERS:
            what = shtab.DIRECTORY
        elif kind in _FILES:
            what = shtab.FILE
        if what is not None:
            action.complete = what  # type: ignore[attr-defined]
    functions = [
        _FUNCTIONS[shell].replace("{kind}", kind).replace("{names}", " ".join(names)) for kind, names in words.items()
    ]
    functions += [
        _VALUES[shell].replace("{kind}", kind).replace("{names}", " ".join(names)) for kind, names in values.items()
    ]
    preamble: Any = {shell: "".join(functions)}
    return shtab.complete(root, shell, preamble=preamble)


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for each in dict.fromkeys(action.choices.values()):
                yield from _actions(each)
        else:
            yield action
