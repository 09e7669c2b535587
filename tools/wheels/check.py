"""A wheel, installed into an environment of its own: does the first note sound without a compiler, and the same?"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

#: rendered twice with the library, then by Numba
SONG = ("drone.mid", "-p", "tanpura-light", "--end", "0.05")
#: a live session as far as it goes without a device: what PortAudio and JACK would call, and events in and out
LIVE = """
from synth import Engine, load_preset
from synth.live.callback import portaudio_callback
from synth.live.deck import Deck
from synth.live.jackcallback import callbacks
from synth.midi.events import NOTE_ON, make_events
engine = Engine([load_preset("tanpura-light")])
engine.prepare(44100.0, 512)
deck = Deck(engine, record=True, ahead=2)
assert portaudio_callback().address and all(each.address for each in callbacks())
assert deck.send(NOTE_ON, 0, 48, 100) and deck.schedule(make_events([(0, NOTE_ON, 0, 43, 100)])) == 1
deck.start_ahead()
deck.close()
assert len(deck.drain_events()) and deck.at(deck.now_ns()) > 0
"""
#: of the environment, what would lead to another package, library or kernels
_LEADS_AWAY = ("PYTHON", "JAWARI_", "NUMBA_", "XDG_", "VIRTUAL_ENV")


class Broken(Exception):
    """What does not work."""


@dataclass
class Installed:
    """A wheel in an environment of its own, with a home and a cache that are empty, and no compiler in sight."""

    folder: Path

    @property
    def environment(self) -> dict[str, str]:
        kept = {name: value for name, value in os.environ.items() if not name.startswith(_LEADS_AWAY)}
        home = self.folder / "home"
        home.mkdir(exist_ok=True)
        return {**kept, "HOME": str(home), "PATH": str(self.folder / "venv" / "bin")}

    def install(self, wheel: Path) -> None:
        """Raises CalledProcessError."""
        venv = self.folder / "venv"
        subprocess.run([sys.executable, "-m", "venv", str(venv)], check=True)
        pip = [str(venv / "bin" / "python"), "-m", "pip", "install", "-qq", "--disable-pip-version-check"]
        subprocess.run([*pip, str(wheel)], check=True)

    def synth(self, *arguments: str, **environment: str) -> tuple[str, float]:
        """What `synth` says, and how long it takes [s]. Raises Broken where it fails."""
        return self._run("synth", *arguments, **environment)

    def python(self, program: str) -> float:
        """How long a program takes [s]. Raises Broken where it fails."""
        return self._run("python", "-c", program)[1]

    def _run(self, name: str, *arguments: str, **environment: str) -> tuple[str, float]:
        command = [str(self.folder / "venv" / "bin" / name), *arguments]
        begin = time.perf_counter()
        done = subprocess.run(
            command, cwd=self.folder, env={**self.environment, **environment}, capture_output=True, text=True, check=False
        )
        taken = time.perf_counter() - begin
        if done.returncode != 0:
            raise Broken(f"{name} {' '.join(arguments)} ends with {done.returncode}:\n{done.stderr}")
        return done.stdout + done.stderr, taken

    def kernels(self) -> list[Path]:
        """What Numba has compiled."""
        return sorted(self.folder.joinpath("home").rglob("*.nbc"))


def check(wheel: Path, songs: Path, folder: Path) -> list[str]:
    """Sentences about what works and how long it takes. Raises Broken, CalledProcessError.

    songs: where `SONG` is. folder: an empty one.
    """
    installed = Installed(folder)
    begin = time.perf_counter()
    installed.install(wheel)
    told = [f"installed in {time.perf_counter() - begin:.0f} s"]
    installed.python("import pathlib, synth; assert pathlib.Path(synth.__file__).with_name('py.typed').is_file()")
    told.append("type checkers are told that it is typed (py.typed)")
    song = [str(songs / SONG[0]), *SONG[1:]]
    times = []
    for name in ("first", "second"):
        said, taken = installed.synth("render", *song, "--verbose", "-o", f"{name}.wav")
        if "the native library" not in said or "none compiled here" not in said or installed.kernels():
            raise Broken(f"the installed program compiles kernels:\n{said}")
        times.append(f"{taken:.2f} s")
    told.append(
        f"from the start of the process to the end of 0.05 s of sound: {times[0]}, then {times[1]}; nothing compiled"
    )
    taken = installed.python(LIVE)
    if installed.kernels():
        raise Broken("a live session compiles kernels")
    told.append(f"a live session is ready after {taken:.2f} s; nothing compiled")
    plugins = folder / "plugins"
    plugins.mkdir()
    installed.synth("export", "tanpura-light", "-f", "all", "-o", str(plugins / "tanpura-light"))
    formats = sorted(path.suffix for path in plugins.iterdir())
    if formats != [".clap", ".lv2", ".vst3"]:
        raise Broken(f"`synth export tanpura -f all` made {', '.join(formats) or 'nothing'}")
    if installed.kernels():
        raise Broken("`synth export` compiles kernels")
    told.append("`synth export tanpura -f all` works without a compiler")
    said, taken = installed.synth("render", *song, "--verbose", "-o", "numba.wav", JAWARI_NATIVE="0")
    if not installed.kernels():
        raise Broken(f"JAWARI_NATIVE=0 did not have Numba compile:\n{said}")
    sounds = {(folder / f"{name}.wav").read_bytes() for name in ("first", "second", "numba")}
    if len(sounds) != 1:
        raise Broken("the sound is another than that of Numba's kernels")
    told.append(f"the same bytes as with Numba's kernels (JAWARI_NATIVE=0), which take {taken:.0f} s at first")
    return told
