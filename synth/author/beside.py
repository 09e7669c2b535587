"""What is computed in processes beside the server, whose interpreter stays free for edits and sound: views, one at a time,
and long computations, told of and ended at once."""

from __future__ import annotations

import importlib
import json
import multiprocessing
import threading
from collections.abc import Mapping, Sequence
from typing import Any

from synth.author.jobs import Progress
from synth.instrument.preset import Preset
from synth.workers import Answering, WorkerEnded, WorkerProcess

#: how much such a process stands back behind the sound
NICE = 5
#: interval between checks whether a long computation is to end [s]
LOOK_S = 0.1


def compute(module: str, function: str, preset: Preset, arguments: Mapping[str, Any]) -> bytes:
    """What a function of `synth.author.views` says of a preset, as JSON."""
    found = getattr(importlib.import_module(f"synth.author.views.{module}"), function)(preset, **arguments)
    return json.dumps(found, allow_nan=False, separators=(",", ":")).encode()


def views() -> Answering:
    """A worker that computes views."""
    return compute


class ComputeProcess:
    """One process, one view at a time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._worker: WorkerProcess | None = None
        self._closed = False

    def compute(self, module: str, function: str, preset: Preset, arguments: Mapping[str, Any]) -> bytes:
        """As `compute`, in the process, which is started when it is first needed. Raises what that raises."""
        with self._lock:
            worker = self._started()
            try:
                worker.ask(module, function, preset, arguments)
                (answer,) = worker.take()
            except WorkerEnded:
                worker.end()
                self._worker = None
                raise
            return answer

    def _started(self) -> WorkerProcess:
        if self._closed:
            raise OSError("the server ends")
        if self._worker is None:
            self._worker = WorkerProcess(views, name="author-views", nice=NICE)
        return self._worker

    def close(self) -> None:
        """Ends the process, also while it computes."""
        self._closed = True
        if self._worker is not None:
            self._worker.process.kill()


class Stopped(Exception):
    """It was ended before it was done."""


def compute_beside(module: str, function: str, arguments: Sequence[Any], progress: Progress) -> Any:
    """What a function by module and name returns, called in another process with the arguments and with `told`, which it
    calls with how many parts are done and how many there are. Raises what it raises, Stopped where `progress` says so, and
    OSError where the process ends."""
    share: Any = multiprocessing.get_context("spawn").Value("d", 0.0, lock=False)  # a lock could die with the process
    worker = WorkerProcess(_telling, share, name="author-long", nice=NICE)
    try:
        worker.ask(module, function, *arguments)
        while progress(share.value):
            if answer := worker.take(LOOK_S):
                return answer[0]
        raise Stopped
    finally:
        worker.end()


def _telling(share: Any) -> Answering:
    """A worker that says how much of its computation is done."""

    def told(done: int, total: int) -> None:
        share.value = done / max(1, total)

    def answer(module: str, function: str, *arguments: Any) -> Any:
        return getattr(importlib.import_module(module), function)(*arguments, told=told)

    return answer
