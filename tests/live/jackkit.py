"""A private JACK server with its dummy driver, and clients of it in processes of their own: one sends MIDI, one records."""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import IO

import numpy as np

from tests.nocard import hide_sound_card
from tests.patience import patience_s

HERE = Path(__file__).parent
SHM = Path("/dev/shm")
#: whoever has it locked may have servers
TURN = Path(tempfile.gettempdir()) / f"jawari-jackd-{os.getuid()}.lock"
_numbers = count()


def why_not() -> str:
    """Why no server can be started here; empty if one can."""
    if shutil.which("jackd") is None:
        return "jackd is not installed (apt-get install jackd2)"
    return ""


class JackServer:
    """A running jackd of its own name, to be used with `with`. Where another process has one, its end is waited for.

    name     for `servername`
    env      environment of a process whose clients are to find this server and to start none, nor another sound card
    frames, rate_hz   of the dummy driver
    sync     every period waits until all clients have done theirs, however late: on a busy machine JACK's time has gaps,
             and no client's samples have any. Otherwise, as JACK does by default, a client that is late loses its period.
    Raises RuntimeError, with what jackd said, where it does not start.
    """

    def __init__(self, frames: int = 256, rate_hz: int = 44100, sync: bool = False) -> None:
        self.name = f"jawari-{os.getpid()}-{next(_numbers)}"
        self.frames = frames
        self.rate_hz = rate_hz
        self.env = os.environ | {"JACK_DEFAULT_SERVER": self.name, "JACK_NO_START_SERVER": "1"} | hide_sound_card()
        self._ended = False
        waits = ["-S", "-t", str(int(1000 * patience_s()))] if sync else []
        _turn.begin()
        try:
            self._start(waits)
        except BaseException:
            _turn.end()
            raise

    def _start(self, waits: list[str]) -> None:
        begun = time.monotonic()
        while True:
            said = ""
            for realtime in (["-R", "-P", "70"], ["-r"]):  # the first needs a permission
                self._process = _jackd(self.name, *realtime, *waits, frames=self.frames, rate_hz=self.rate_hz)
                if _answers(self._process, self.name, self.env):
                    return
                said = _terminate(self._process)
            if "Too many servers" not in said or time.monotonic() - begun > patience_s():
                raise RuntimeError(f"jackd does not start: {said[:500]}")
            _free_places()
            time.sleep(0.5)

    def __enter__(self) -> JackServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def pause(self, seconds: float) -> None:
        """Hold the server for a while: it misses its periods."""
        self._process.send_signal(signal.SIGSTOP)
        time.sleep(seconds)
        self._process.send_signal(signal.SIGCONT)

    def kill(self, how: signal.Signals = signal.SIGTERM) -> None:
        """End the server and remove what it leaves behind. May be called again."""
        if self._ended:
            return
        self._ended = True
        try:
            self._kill(how)
        finally:
            _turn.end()

    def _kill(self, how: signal.Signals) -> None:
        segments = self._segments()
        self._process.send_signal(how)
        _terminate(self._process)
        for path in [*segments, *SHM.glob(f"jack_{self.name}_*"), *SHM.glob(f"jack_sem.*_{self.name}_*")]:
            with suppress(OSError):
                path.unlink()
        if how == signal.SIGKILL:
            _free_place(self.name)

    def _segments(self) -> set[Path]:
        """Shared memory that the server itself has mapped; numbered, not named after it."""
        try:
            maps = Path(f"/proc/{self._process.pid}/maps").read_text().splitlines()
        except OSError:
            return set()
        paths = {Path(line.split()[-1]) for line in maps if str(SHM) in line}
        return {path for path in paths if path.name.startswith(f"jack-{os.getuid()}-")}


class _Turn:
    """This process's turn to have servers, as many as it likes: no other process has any meanwhile. JACK keeps the shared
    memory of all servers of a user in one registry, and where another server starts or ends, a client that is beginning may
    be told of memory that is not there, whoever's client it is: it finds "JACK server not running"."""

    def __init__(self) -> None:
        self._servers = 0
        self._file: IO[str] | None = None

    def begin(self) -> None:
        """Wait for it; once for each server."""
        if self._file is None:
            file = TURN.open("w")
            fcntl.flock(file, fcntl.LOCK_EX)
            self._file = file
        self._servers += 1

    def end(self) -> None:
        self._servers -= 1
        if self._servers == 0 and self._file is not None:
            fcntl.flock(self._file, fcntl.LOCK_UN)  # whoever was forked off meanwhile still has the file open
            self._file.close()
            self._file = None


_turn = _Turn()


def _jackd(name: str, *more: str, frames: int = 256, rate_hz: int = 44100) -> subprocess.Popen:
    command = ["jackd", *more, "-n", name, "-p", "256", "-d", "dummy", "-r", str(rate_hz), "-p", str(frames)]
    env = dict(os.environ, JACK_NO_AUDIO_RESERVATION="1")
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=env, text=True)


def _answers(process: subprocess.Popen, name: str, env: dict[str, str]) -> bool:
    """Wait until the server takes a client."""
    begun = time.monotonic()
    while time.monotonic() - begun < patience_s() and process.poll() is None:
        look = [sys.executable, str(HERE / "jack_look.py"), name]
        if subprocess.run(look, env=env, capture_output=True, timeout=patience_s()).returncode == 0:
            return True
    return False


def _terminate(process: subprocess.Popen) -> str:
    """End a process that we have started; what it said."""
    process.terminate()
    try:
        return process.communicate(timeout=patience_s(5.0))[0]
    except subprocess.TimeoutExpired:
        process.kill()
        return process.communicate()[0]


def _free_place(name: str) -> None:
    """JACK has places for eight servers of a user. One that was killed keeps its own until another of its name ends well."""
    again = _jackd(name, "-r")
    _answers(again, name, dict(os.environ, JACK_NO_START_SERVER="1"))
    _terminate(again)


def _free_places() -> None:
    """Free the places of servers that were killed with the tests that had started them."""
    try:
        registry = (SHM / "jack-shm-registry").read_bytes()
    except OSError:
        return
    for owner, number in set(re.findall(rb"\bjawari-(\d+)-(\d+)\b", registry)):
        if not Path(f"/proc/{int(owner)}").exists():
            _free_place(f"jawari-{int(owner)}-{int(number)}")  # where that one lives on, jackd refuses


def expect(process: subprocess.Popen[str], word: str) -> None:
    """Read a line, which must be that word. Raises RuntimeError, with what the process complained of, which is killed."""
    assert process.stdout is not None
    line = process.stdout.readline().strip()
    if line != word:
        process.kill()
        raise RuntimeError(f"said {line!r} instead of {word!r}: {process.communicate()[1][-2000:]}")


class _Helper:
    """A script of this folder in a process of its own, that says "ready" and does what it does until it reads a line."""

    def __init__(self, script: str, server: JackServer, arguments: dict) -> None:
        command = [sys.executable, str(HERE / script), json.dumps({"server": server.name, **arguments})]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        self._process = subprocess.Popen(command, **pipes, env=server.env, text=True)
        expect(self._process, "ready")

    def _end(self) -> None:
        """Tell it to end and wait until it has."""
        try:
            _, complaint = self._process.communicate("\n", timeout=patience_s())
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
            raise
        if self._process.returncode != 0:
            raise RuntimeError(complaint[-2000:])

    def kill(self) -> None:
        self._process.kill()
        self._process.communicate()


@dataclass(frozen=True)
class Recorded:
    """samples: (ports, frames) float32 as they came; times: JACK's frame time at the begin of each period (32 bits);
    places: where in `samples` it begins. JACK's time may have gaps where the samples have none."""

    samples: np.ndarray
    times: np.ndarray
    places: np.ndarray

    def place(self, time: int) -> int:
        """Where in `samples` a frame time of JACK lies. Raises ValueError for one that no period had."""
        since = (time - self.times) & 0xFFFFFFFF
        lengths = np.diff(self.places, append=self.samples.shape[1])
        (found,) = np.flatnonzero(since < lengths)
        return int(self.places[found] + since[found])


class Capture(_Helper):
    """Records ports bit for bit from now on. They need not exist yet: each is connected when it can be.

    ports     full names, like "jawari:out_left"
    seconds   the most that is kept
    """

    def __init__(self, server: JackServer, ports: Sequence[str], folder: Path, seconds: float = 60.0) -> None:
        self._file = folder / f"captured-{next(_numbers)}.npz"
        super().__init__("jack_record.py", server, {"ports": list(ports), "file": str(self._file), "seconds": seconds})

    def connected(self) -> None:
        """Wait until every port is connected."""
        expect(self._process, "connected")

    def stop(self) -> Recorded:
        self._end()
        with np.load(self._file) as file:
            return Recorded(file["samples"], file["times"], file["places"])


class Sender(_Helper):
    """Sends MIDI messages at given frames after a start that lies a little ahead, through JACK, to a port.

    rows: (frame, bytes), frames ascending, from the start on
    """

    def __init__(self, server: JackServer, port: str, rows: Iterable[tuple[int, bytes]], folder: Path) -> None:
        self._file = folder / f"sent-{next(_numbers)}.json"
        listed = [(frame, list(message)) for frame, message in rows]
        super().__init__("jack_send.py", server, {"port": port, "rows": listed, "file": str(self._file)})

    def done(self) -> list[int]:
        """Wait until all is sent; JACK's frame time of every message."""
        expect(self._process, "sent")
        self._end()
        return json.loads(self._file.read_text())
