"""A process beside the server that computes views: the interpreter of the server stays free for edits and sound."""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import signal
import threading
from collections.abc import Mapping
from multiprocessing.connection import Connection
from typing import Any

from synth.instrument.preset import Preset

#: how much it stands back behind the sound
NICE = 5


def compute(module: str, function: str, preset: Preset, arguments: Mapping[str, Any]) -> bytes:
    """What a function of `synth.author.views` says of a preset, as JSON."""
    found = getattr(importlib.import_module(f"synth.author.views.{module}"), function)(preset, **arguments)
    return json.dumps(found, allow_nan=False, separators=(",", ":")).encode()


class ComputeProcess:
    """One process, one computation at a time. It ends with the server, however that ends."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: Any = None
        self._closed = False
        self._pipe: Connection | None = None

    def compute(self, module: str, function: str, preset: Preset, arguments: Mapping[str, Any]) -> bytes:
        """As `compute`, in the process, which is started when it is first needed. Raises what that raises."""
        with self._lock:
            pipe = self._started()
            try:
                pipe.send((module, function, preset, arguments))
                fine, answer = pipe.recv()
            except (EOFError, OSError):
                self._pipe = None
                raise OSError("the process that computes views has ended; try again") from None
        if fine:
            return answer
        raise answer

    def _started(self) -> Connection:
        if self._closed:
            raise OSError("the server ends")
        if self._pipe is None:
            context = multiprocessing.get_context("spawn")
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=_serve, args=(theirs,), name="author-views", daemon=True)
            self._process.start()
            theirs.close()
        return self._pipe

    def close(self) -> None:
        self._closed = True
        if self._process is not None and self._process.pid is not None:  # where starting it failed there is none
            self._process.kill()


def _serve(pipe: Connection) -> None:
    """The process: answers until the server goes."""
    for each in ("SIGINT", "SIGHUP"):  # a terminal sends them to the server as well, which then ends this
        if hasattr(signal, each):
            signal.signal(getattr(signal, each), signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(NICE)
    while True:
        try:
            asked = pipe.recv()
        except (EOFError, OSError):
            return
        answer: tuple[bool, Any]
        try:
            answer = (True, compute(*asked))
        except Exception as error:
            answer = (False, error)
        try:
            pipe.send(answer)
        except OSError:
            return
