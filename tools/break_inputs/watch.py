"""A worker under watch: a crash or a hang of one input is noted, and the next worker goes on behind it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

TOOLS = Path(__file__).resolve().parents[1]
#: longest silence of a worker by the clock [s]; its own time is limited by itself
MOST_SILENCE_S = 600.0


@dataclass
class Tally:
    """What came of the inputs of a kind."""

    kind: str
    taken: int = 0
    refused: int = 0
    longest_s: float = 0.0
    broke: list[tuple[int, str]] = field(default_factory=list)


def tried(kind: str, first: int, beyond: int, seed: int) -> Tally:
    """Try the inputs `first` to `beyond` − 1 of a kind in processes of their own."""
    tally = Tally(kind)
    while first < beyond:
        first = _one_worker(tally, first, beyond, seed)
    return tally


def _one_worker(tally: Tally, first: int, beyond: int, seed: int) -> int:
    """The number that the next worker begins with."""
    at = None
    # errors go to a file: nobody has to read them while the worker is at work
    with (
        tempfile.TemporaryFile("w+") as errors,
        start([tally.kind, str(first), str(beyond), str(seed)], errors) as worker,
    ):
        assert worker.stdout is not None
        watch = _killer(worker)
        for line in worker.stdout:
            watch.cancel()
            watch = _killer(worker)
            said = json.loads(line)
            if "warmed" in said:
                continue
            if "at" in said:
                at = said["at"]
                continue
            at, first = None, said["of"] + 1
            tally.longest_s = max(tally.longest_s, said["took"])
            if said["came"] == "taken":
                tally.taken += 1
            elif said["came"] == "refused":
                tally.refused += 1
            else:
                tally.broke.append((said["of"], said["came"]))
        code = worker.wait()
        watch.cancel()
        errors.seek(0)
        words = errors.read()[-2000:]
    name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    if at is not None:
        what = {"SIGPROF": "hung: no end of its processor time", "SIGKILL": "hung: no word for too long"}.get(
            name, f"died of {name}"
        )
        tally.broke.append((at, f"{what}\n{words}"))
        return at + 1
    if code:
        raise RuntimeError(f"the worker for {tally.kind} ended between two inputs, {name}:\n{words}")
    return first


def start(arguments: list[str], errors: IO[str]) -> subprocess.Popen[str]:
    """A worker in a new interpreter."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(TOOLS), str(TOOLS.parent)]), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "break_inputs.worker", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment)


def _killer(worker: subprocess.Popen[str]) -> threading.Timer:
    """What ends the worker unless it is cancelled in time."""
    timer = threading.Timer(MOST_SILENCE_S, worker.kill)
    timer.daemon = True
    timer.start()
    return timer
