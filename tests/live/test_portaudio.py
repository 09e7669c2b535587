"""Real PortAudio at a real server: what comes out of its ports is, bit for bit, the offline render of the same events."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from synth import Engine, load_preset
from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON
from tests.forkserver import prepared
from tests.patience import compiling_s, patience_s

from .conftest import StartServer
from .deckkit import offline
from .jackkit import Capture, JackServer

PORTS = ("PortAudio:out_0", "PortAudio:out_1")
SECONDS = 2.0
LEAD = 22050


@pytest.fixture(scope="module")
def engine() -> Engine:
    made = Engine([load_preset("tanpura-light")], quality="draft")
    made.prepare(44100, 512)
    return made


def _rows() -> list[list[int]]:
    rng = np.random.default_rng(7)
    rows: list[list[int]] = []
    for frame in np.sort(rng.integers(0, int(44100 * (SECONDS - 1.0)), 40)):
        note = int(rng.choice([36, 43, 48]))
        kind = int(rng.choice([NOTE_ON, NOTE_ON, NOTE_OFF, CONTROL]))
        a, b = (
            (int(rng.choice([10, 11, 64])), int(rng.integers(128))) if kind == CONTROL else (note, int(rng.integers(1, 128)))
        )
        rows.append([int(frame), kind, 0, a, b])
    # silence first: the recorder finds the ports when the stream has started
    return [[LEAD, NOTE_ON, 0, 48, 100], *([LEAD + frame, *rest] for frame, *rest in rows)]


def _play(server: JackServer, folder: Path, block: int, **job) -> tuple[np.ndarray, np.ndarray]:
    """Captured samples (2, frames), the events that the player's engine was given."""
    file = folder / "played.npz"
    settings = {"block": block, "rate": 44100, "rows": _rows(), "seconds": SECONDS, "busy": False, "send": False, "ahead": 0}
    arguments = [json.dumps({**settings, **job, "file": str(file)})]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    player = prepared().start(arguments, folder, module="tests.live.play_events", env=server.env, **pipes)
    assert player.stdout is not None
    assert player.stdout.readline().strip() == "open"
    capture = Capture(server, PORTS, folder)
    try:
        player.communicate("\n", timeout=patience_s())
        assert player.returncode == 0
    finally:
        player.kill()
        recorded = capture.stop()
    with np.load(file) as kept:
        return recorded.samples, kept["events"]


def _aligned(captured: np.ndarray, expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both from their first sound on, as long as both go."""
    begin = [int(np.argmax(np.any(x != 0.0, axis=0))) for x in (captured, expected)]
    length = min(captured.shape[1] - begin[0], expected.shape[1] - begin[1])
    return captured[:, begin[0] :][:, :length], expected[:, begin[1] :][:, :length]


def _check(server: JackServer, folder: Path, engine: Engine, block: int, **job) -> None:
    captured, events = _play(server, folder, block, **job)
    expected = offline(engine, events, captured.shape[1]).astype(np.float32).T
    heard, wanted = _aligned(captured, expected)
    sounding = np.flatnonzero(np.any(heard != 0.0, axis=0))
    assert sounding.size > 22050, "next to nothing was captured"
    last = sounding[-1]  # the player stops somewhere in a block
    differing = np.flatnonzero(np.any(heard[:, :last] != wanted[:, :last], axis=0))
    assert differing.size == 0, f"{differing.size} samples of {last} differ, the first is {differing[0]}"


@pytest.mark.parametrize("block", [64, 128, 256, 512])
def test_scheduled_events_are_heard_as_offline(jack_server: StartServer, engine: Engine, tmp_path: Path, block: int) -> None:
    _check(jack_server(block, sync=True), tmp_path, engine, block)


@pytest.mark.parametrize("job", [{"send": True}, {"send": True, "busy": True}, {"send": True, "busy": True, "ahead": 4}])
def test_what_is_played_is_heard_as_offline(jack_server: StartServer, engine: Engine, tmp_path: Path, job: dict) -> None:
    _check(jack_server(256, sync=True), tmp_path, engine, 256, **job)


def test_a_rate_that_the_server_does_not_run_at(jack_server: StartServer) -> None:
    program = (
        "from synth import Engine, load_preset\n"
        "from synth.live.deck import Deck\n"
        "from synth.live.portaudio import devices, open_output\n"
        "print([d['host_api'] for d in devices()])\n"
        "engine = Engine([load_preset('tanpura-light')], quality='draft', only_notes=[{48}])\n"
        "engine.prepare(48000, 256)\n"
        "for device in (None, 'nowhere', 99):\n"
        "    try:\n"
        "        open_output(Deck(engine), device, 48000, 256)\n"
        "    except ValueError as error:\n"
        "        print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=jack_server(256).env,
        capture_output=True,
        text=True,
        check=True,
        timeout=compiling_s(),
    )
    listed, rate, name, number = done.stdout.splitlines()
    assert "JACK" in listed
    assert "does not support 48000 Hz; use --rate 44100" in rate
    assert "'nowhere': no such audio output; there are: " in name and "system" in name
    assert "'99': no such audio output" in number
    assert done.stderr == ""
