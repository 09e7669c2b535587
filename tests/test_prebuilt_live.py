"""What is live has its kernels from the native library too: nothing is compiled, and nobody hears the difference."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from synth.native import processors
from tests.live import jackkit
from tests.patience import compiling_s
from tests.plugin import conftest

ROOT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.skipif(
    processors.level() is None or sys.platform != "linux", reason="no native library is for this machine"
)
library_file = conftest.library_file

#: a deck that records, asked by a card: what was scheduled, what its device was given, its log and its tape
PLAY = """
import hashlib, sys
import numpy as np
from synth import Engine, load_preset
from synth.jit import compiling, prebuilt
from synth.live.deck import Deck
from synth.live.jackcallback import callbacks
from synth.midi.events import NOTE_ON, NOTE_OFF, BEND, make_events
from tests.live.deckkit import Card
engine = Engine([load_preset("tanpura-light")], quality="draft")
engine.prepare(44100.0, 512)
callbacks()
deck = Deck(engine, record=True, ahead=int(sys.argv[1]), channels=1)
rows = [(40 * k, NOTE_ON if k % 3 else BEND, 0, (43, 48, 36)[k % 3] if k % 3 else 500 * k % 8000, 90) for k in range(60)]
assert deck.schedule(make_events(rows)) == 60
deck.start_ahead()
card, tape = Card(deck, 1), np.zeros((1 << 14, 2))
sound = hashlib.sha256()
for frames in [64, 256, 1, 999] * (0 if int(sys.argv[1]) else 4):
    sound.update(card.ask(frames).tobytes())
if int(sys.argv[1]):
    sound.update(card.ask(512).tobytes())
deck.close()
events = deck.drain_events()
events = events[events["frame"] < 768]  # what is ready for certain; the thread may be ahead of it
sound.update(events.tobytes())
count = deck.drain_audio(tape)
sound.update(tape[:512].tobytes())
assert np.abs(tape[:count]).max() > 0 and len(events) > 10
made = compiling.progress()
print(sound.hexdigest(), 0 if made is None else made.done, prebuilt.found().path)
"""


def in_a_process(program: str, native: str, cache: Path, *arguments: str) -> list[str]:
    """Words that a program prints, which is to use a library."""
    environment = {**os.environ, "JAWARI_NATIVE": native, "XDG_CACHE_HOME": str(cache)}
    command = [sys.executable, "-c", program, *arguments]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=compiling_s())
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.parametrize("ahead", ["0", "3"])
def test_a_session_compiles_nothing_and_sounds_the_same(library_file: Path, tmp_path: Path, ahead: str) -> None:
    sound, compiled, found = in_a_process(PLAY, str(library_file), tmp_path, ahead)
    assert (compiled, found) == ("0", str(library_file))
    assert list(tmp_path.rglob("*.nb?")) == []
    kept = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    numbas, _, none = in_a_process(PLAY, "0", kept, ahead)
    assert none == "None" and numbas == sound


@pytest.mark.skipif(jackkit.why_not() != "", reason=jackkit.why_not())
@pytest.mark.parametrize("command", [("drone",), ("play", "-p", "tanpura-light", "--midi-in=none")], ids=["drone", "play"])
def test_a_jack_client_compiles_nothing(library_file: Path, tmp_path: Path, command: tuple[str, ...]) -> None:
    with jackkit.JackServer() as server:
        environment = {**os.environ, **server.env, "JAWARI_NATIVE": str(library_file), "XDG_CACHE_HOME": str(tmp_path)}
        arguments = [*command, "--jack", "--verbose", "--duration", "0.5"]
        done = subprocess.run(
            [sys.executable, "-m", "synth", *arguments],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=compiling_s(),
            check=False,
        )
    assert done.returncode == 0, done.stderr
    assert f"the native library {library_file}; beside it none compiled here" in done.stderr
    assert list(tmp_path.rglob("*.nb?")) == []


#: what the page draws: a note on its tape, and a string that a bridge presses at rest
VIEW = """
import hashlib
import numpy as np
from synth.instrument.place import find
from synth.host.string_tape import Taped
from synth.instrument.compile import static_state
from synth.instrument.preset import load_preset
from synth.jit import compiling, prebuilt
drawn = hashlib.sha256()
for piece in Taped(find(load_preset("fretted-bass"), 40), "draft").play(120, 0.2):
    for each in (piece.force, piece.ends, piece.q, piece.out):
        drawn.update(np.ascontiguousarray(each).tobytes())
shapes = np.random.default_rng(1).normal(size=(6, 40))
rest = static_state(np.arange(1.0, 41.0), 0.01, shapes, np.linspace(-1e-3, 1e-3, 6), np.eye(6))
assert rest.any()
drawn.update(rest.tobytes())
made = compiling.progress()
print(drawn.hexdigest(), 0 if made is None else made.done, prebuilt.found().path)
"""


def test_the_pages_views_compile_nothing_and_show_the_same(library_file: Path, tmp_path: Path) -> None:
    drawn, compiled, found = in_a_process(VIEW, str(library_file), tmp_path)
    assert (compiled, found) == ("0", str(library_file))
    assert list(tmp_path.rglob("*.nb?")) == []
    kept = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    assert in_a_process(VIEW, "0", kept)[0] == drawn
