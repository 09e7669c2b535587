"""Runs every command of README and docs/install.md in an environment that has only what the page installs for it.

`commands` reads the commands off a page; `WAYS` says for each where it is run and what it must do. A checkout is a copy of
the files that git knows, without an environment; the home folder is empty; compiled kernels are kept where XDG_CACHE_HOME
says, since they hide no missing package.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = (ROOT / "README.md", ROOT / "docs" / "install.md")
#: an answer that says what is missing, or ends with what only a developer reads
BAD = re.compile(r"Traceback|ModuleNotFoundError|ImportError|No module named|command not found")
#: the longest that a command may take [s]
PATIENCE_S = 1800.0
_SPAN = re.compile(r"`([^`]+)`")
_COMMAND = re.compile(r"(\./)?tools/|synth |pip install|apt-get|eval ")
#: variables that would lend a command something of the calling environment
_LENT = (
    "VIRTUAL_ENV",
    "PYTHONPATH",
    "PYTHONHOME",
    "PYTHONDONTWRITEBYTECODE",
    "JAWARI_NATIVE",
    "NUMBA_CACHE_DIR",
    "NO_COLOR",
    "MPLBACKEND",
)
#: what --quick leaves out of an installation: bytecode of what no command imports ("no" says so, whatever the name)
_QUICK = {"PIP_NO_COMPILE": "no"}


@dataclass(frozen=True)
class Way:
    """How a command is run.

    place: extras installed by `pip install '.[…]'` into a new environment; "": `pip install .`; "checkout": the checkout
    alone. answer: what it must print (a regular expression). codes: exit codes. serves: address that it answers at until it
    is interrupted. slow: takes minutes, left out by --quick. instead: what --quick runs. not_run: why it is never run.
    """

    place: str = ""
    answer: str = ""
    codes: tuple[int, ...] = (0,)
    serves: str = ""
    slow: bool = False
    instead: str = ""
    not_run: str = ""


_NO_CARD = Way("live", r"audio output|needs the library PortAudio", (2,))
_FIGURE = Way(not_run="the source of a figure, minutes; tests of its own run it")
_NAME = Way(not_run="the name of a command")

#: command, as `commands` gives it → how it is run
WAYS: dict[str, Way] = {
    "./tools/demo": Way("checkout", "Listen to .*drone.wav"),
    "./tools/test": Way("checkout", "passed", slow=True),
    "./tools/docs": Way("checkout", "index.html", slow=True),
    "./tools/docs --serve": Way(
        "checkout", serves="http://127.0.0.1:8000/listen.html", instead="./tools/docs --no-sounds --serve"
    ),
    "synth render": _NAME,
    "synth render --rest": _NAME,
    "synth setup": _NAME,
    "synth simulate": _NAME,
    "tools/bench --publish": _FIGURE,
    "tools/bench --only cold": _FIGURE,
    "tools/speed-error": _FIGURE,
    "tools/wheel": _FIGURE,
    "tools/wheel --check": _FIGURE,
    "tools/wheel --target all": Way(not_run="minutes for each system; a test of its own runs it"),
    "apt-get install libportaudio2": Way(not_run="a package of the system"),
    "apt-get install libfluidsynth3": Way(not_run="a package of the system"),
    "pip install .": Way(""),
    "pip install '.[live]'": Way("live"),
    "pip install '.[author,fit]'": Way("author,fit"),
    "pip install '.[rest]'": Way("rest", slow=True),
    "pip install '.[study]'": Way("study", slow=True),
    "pip install '.[dataset]'": Way("dataset", slow=True),
    "synth render song.mid -o song.wav": Way("", "song.wav: "),
    "synth play -p tanpura": _NO_CARD,
    "synth drone": _NO_CARD,
    "synth author tanpura": Way("author,fit", serves=r"http://\S+"),
    "synth export tanpura --install": Way("", r"\.clap", slow=True),
    "synth doctor": Way("", "rendering"),
    "synth fit note.wav": Way("author,fit", "Hz"),
    "synth fit --contact note.wav -p tanpura-light": Way("author,fit", "µm", slow=True),
    "synth simulate bass --ledger -o out.npz": Way("", "out.npz", slow=True),
    "synth sweep STUDY.toml": Way("study", "rows", slow=True),
    "pip install '.[setup]'": Way("setup"),
    "pip install '.[targets]'": Way("targets"),
    "synth export tanpura -f clap --target windows-x86-64": Way("targets", "tanpura.clap", slow=True),
    "synth setup fretted-bass": Way("setup", "of 84 notes buzz"),
    "synth dataset RECIPE.toml -o sounds": Way("dataset", "items", slow=True),
    "synth plan tanpura-light C3": Way("", "tanpura-light at standard"),
    "synth body fit bridge.csv": Way("author,fit", r"\[\[body.mode\]\]"),
    "synth --help": Way("", "render"),
    "synth completion fish > ~/.config/fish/completions/synth.fish": Way(""),
    'eval "$(synth completion bash)"': Way(""),
    'eval "$(synth completion zsh)"': Way(not_run="another shell; tests of completion run it"),
}


def commands(page: str) -> list[str]:
    """The commands of a page, in order: lines of its blocks and pieces of code that begin like one; each once."""
    found: dict[str, None] = {}
    text = re.sub(r"^```\w*\n(.*?)^```", lambda block: re.sub("(?m)^", "    ", block[1]), page, flags=re.M | re.S)
    for paragraph in re.split(r"\n\s*\n", text):
        if paragraph.startswith("    "):
            pieces = [re.sub(r"\s+#.*", "", line).strip() for line in paragraph.splitlines()]
        else:
            pieces = [" ".join(span.split()) for span in _SPAN.findall(paragraph)]
        for piece in pieces:
            if _COMMAND.match(piece) and "COMMAND" not in piece:
                found[piece] = None
        for installed in re.findall(r"pip install '[^']+'", paragraph):
            found[installed] = None
    return list(found)


class Fresh:
    """A folder with checkouts and environments that are made when a command first needs them, and go with it."""

    def __init__(self, quick: bool) -> None:
        self.quick = quick
        self._folder = Path(tempfile.mkdtemp(prefix="jawari-fresh-"))
        self._made: set[str] = set()
        (self._folder / "home" / ".config" / "fish" / "completions").mkdir(parents=True)

    def close(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)

    def run(self, command: str) -> str | None:
        """Run a command of a page; what is wrong, None: nothing. Raises KeyError for one that `WAYS` does not know."""
        way = WAYS[command]
        if way.not_run or (self.quick and way.slow and not way.instead):
            return None
        place = self._place(way.place)
        if place is None:
            return f"pip install '.[{way.place}]' failed:\n{self._said}"
        if command.startswith("pip install"):
            return None
        typed = way.instead if self.quick and way.instead else command
        if way.serves:
            return self._serves(typed, way, place)
        try:
            done = subprocess.run(
                ["bash", "-c", typed],
                cwd=place,
                env=self._environment(place),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                timeout=PATIENCE_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return f"did not end within {PATIENCE_S:.0f} s"
        return _wrong(done.stdout, way, done.returncode)

    def _environment(self, place: Path) -> dict[str, str]:
        programs = place / ".venv" / "bin" if place.name != "checkout" else self._folder
        cache = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
        kept = {name: value for name, value in os.environ.items() if name not in _LENT}
        path = os.pathsep.join(
            [str(programs), *(each for each in os.environ["PATH"].split(os.pathsep) if ".venv" not in each)]
        )
        own = {"PATH": path, "HOME": str(self._folder / "home"), "XDG_CACHE_HOME": cache, "BROWSER": "true"}
        own |= _QUICK if self.quick else {}
        return kept | own | {"ALSA_CONFIG_PATH": str(self._folder / "no-card.conf"), "JACK_NO_START_SERVER": "1"}

    def _place(self, extras: str) -> Path | None:
        """A checkout of its own for the extras, installed there; None: that failed, and `_said` says how."""
        place = self._folder / (extras.replace(",", "-") or "plain")
        if extras in self._made:
            return place
        self._made.add(extras)
        (self._folder / "no-card.conf").write_text("pcm.default { type hw card 99 }\nctl.default { type hw card 99 }\n")
        for name in subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout.split("\0"):
            if name and (ROOT / name).is_file():
                (place / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, place / name)
        if extras == "checkout":
            return place
        what = f".[{extras}]" if extras else "."
        done = subprocess.run(
            ["bash", "-c", f"python3 -m venv .venv && .venv/bin/pip install -q {shlex.quote(what)} && {_MATERIAL}"],
            cwd=place,
            env=self._environment(place),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        self._said = done.stdout
        return place if done.returncode == 0 else None

    def _serves(self, typed: str, way: Way, place: Path) -> str | None:
        """Start a server, ask for its page and interrupt it; what is wrong."""
        with open(self._folder / "served.txt", "w+", encoding="utf-8") as said:
            server = subprocess.Popen(
                ["bash", "-c", f"exec {typed}"],
                cwd=place,
                env=self._environment(place),
                stdin=subprocess.DEVNULL,
                stdout=said,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
            answered = False
            end = time.monotonic() + PATIENCE_S
            while not answered and server.poll() is None and time.monotonic() < end:
                time.sleep(0.5)
                text = Path(said.name).read_text(encoding="utf-8")
                for address in re.findall(way.serves, text) or ([way.serves] if "\\" not in way.serves else []):
                    with suppress(OSError), urllib.request.urlopen(address, timeout=5.0) as page:
                        answered = page.status == 200
            with suppress(ProcessLookupError):
                os.killpg(server.pid, signal.SIGINT)
            code = server.wait(PATIENCE_S)
            text = Path(said.name).read_text(encoding="utf-8")
        if not answered:
            return f"no page at {way.serves}; exit code {code}:\n{text}"
        return _wrong(text, Way(codes=(0, 130, -signal.SIGINT)), code)


#: writes what the commands of the pages read, with what is installed
_MATERIAL = """.venv/bin/python - <<'END'
import mido
song, track = mido.MidiFile(), mido.MidiTrack()
track.append(mido.Message("note_on", note=48, velocity=90))
track.append(mido.Message("note_off", note=48, time=1920))
song.tracks.append(track)
song.save("song.mid")
END
.venv/bin/synth render song.mid -p tanpura-light --tail 1 -o note.wav >material.txt 2>&1
.venv/bin/python - <<'END'
from pathlib import Path
import numpy as np
f = np.arange(50.0, 1000.0, 0.5)
y = 2j * np.pi * f / (0.3 * ((2 * np.pi * 200) ** 2 - (2 * np.pi * f) ** 2 + 2j * np.pi * f * 2 * np.pi * 200 / 20))
rows = [f"{a},{b.real},{b.imag}" for a, b in zip(f, y)]
Path("bridge.csv").write_text("\\n".join(["frequency_hz,y11_re,y11_im", *rows]) + "\\n")
Path("STUDY.toml").write_text(Path("presets/studies/tanpura-jiva.toml").read_text())
Path("RECIPE.toml").write_text(next(Path("presets/recipes").glob("*.toml")).read_text())
END"""


def _wrong(said: str, way: Way, code: int) -> str | None:
    if code not in way.codes:
        return f"ended with {code}:\n{said}"
    if bad := BAD.search(said):
        return f"printed {bad[0]!r}:\n{said}"
    if way.answer and not re.search(way.answer, said):
        return f"did not print {way.answer!r}:\n{said}"
    return None


def follow_fresh(quick: bool, only: str = "") -> Iterator[tuple[str, str | None]]:
    """(command, what is wrong or None) for every command of `PAGES`; only: those that contain it."""
    fresh = Fresh(quick)
    try:
        for command in dict.fromkeys(each for page in PAGES for each in commands(page.read_text("utf-8"))):
            if only in command:
                yield command, fresh.run(command) if command in WAYS else "tools/fresh_pages.py has no rule for running it"
    finally:
        fresh.close()
