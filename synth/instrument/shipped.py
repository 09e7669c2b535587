"""Files that come with the program beside its presets, by name: studies, recipes."""

from __future__ import annotations

import os
from pathlib import Path

from synth.instrument.preset import preset_folder
from synth.spelling import perhaps


def shipped_names(folder: str) -> list[str]:
    """Names of the files in a folder beside the presets; ".": of the presets themselves."""
    return sorted(path.stem for path in (preset_folder() / folder).glob("*.toml"))


def shipped_file(
    name_or_path: str | os.PathLike[str], kind: str, folder: str, error: type[ValueError], also: str = ""
) -> Path:
    """The file of a name in a folder beside the presets, or the file that is given; it may be a pipe.

    kind: what messages call it; also: what else may be given, for the message. Raises `error` where there is none.
    """
    path, name = Path(name_or_path), os.fspath(name_or_path)
    if path.suffix == ".toml" or (path.exists() and not path.is_dir()):
        return path
    names = shipped_names(folder)
    if name not in names:
        instead = f"give a file that ends in .toml, {also}or one of {', '.join(names)}"
        raise error(f"there is no {kind} {name!r}{perhaps(name, names)}: {instead}")
    return preset_folder() / folder / f"{name}.toml"
