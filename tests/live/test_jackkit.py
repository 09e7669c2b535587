"""The harness itself: a server that runs, a recorder that misses no bit, a sender that keeps its frames."""

from __future__ import annotations

import fcntl
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.patience import patience_s

from .conftest import StartServer
from .jackkit import HERE, SHM, TURN, Capture, Sender


def test_what_is_sent_is_recorded_at_its_frames(jack_server: StartServer, tmp_path: Path) -> None:
    """A client that writes the bytes of MIDI messages into an audio port, each at its frame, stands for an instrument."""
    with jack_server(256, sync=True) as server:
        echo = subprocess.Popen(
            [sys.executable, str(HERE / "jack_echo.py"), server.name],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=server.env, text=True,
        )  # fmt: skip
        try:
            assert echo.stdout is not None and echo.stdout.readline().strip() == "ready"
            capture = Capture(server, ["echo:out"], tmp_path)
            capture.connected()
            rows = [(0, b"\x90\x30\x01"), (1, b"\x90\x30\x02"), (255, b"\x90\x30\x03"), (700, b"\x90\x30\x04")]
            times = Sender(server, "echo:in", rows, tmp_path).done()
            heard = capture.stop()
            assert all(later >= frame for (frame, _), later in zip(rows, np.subtract(times, times[0]), strict=True))
            assert np.flatnonzero(heard.samples[0]).tolist() == [heard.place(time) for time in times]
            assert heard.samples[0][heard.samples[0] != 0].tolist() == [1.0, 2.0, 3.0, 4.0]
        finally:
            echo.communicate("\n", timeout=patience_s())


def test_nothing_is_left_behind(jack_server: StartServer) -> None:
    with jack_server(64, 48000) as server:
        assert list(SHM.glob(f"*{server.name}*")) and server.alive
        server.kill()
        assert not server.alive
        assert not list(SHM.glob(f"*{server.name}*"))


def test_no_other_process_has_servers_until_the_last_of_this_one_has_ended(jack_server: StartServer) -> None:
    def is_ours() -> None:
        with TURN.open("w") as lock, pytest.raises(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)

    first, second = jack_server(), jack_server()
    is_ours()
    first.kill()
    first.kill()  # which ends nothing a second time
    is_ours()
    second.kill()
    with TURN.open("w") as lock:  # as soon as nobody else has it
        fcntl.flock(lock, fcntl.LOCK_EX)
