"""A long computation in a process of its own: told of, ended at once, and behind the sound all the while."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import signal
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Any

from synth.author.jobs import Progress
from synth.author.worker import NICE

#: interval between checks whether it is to end [s]
LOOK_S = 0.1


class Stopped(Exception):
    """It was ended before it was done."""


def compute_beside(module: str, function: str, arguments: Sequence[Any], progress: Progress) -> Any:
    """What a function by module and name returns, called in another process with the arguments and with `told`, which it
    calls with how many parts are done and how many there are. Raises what it raises, Stopped where `progress` says so, and
    OSError where the process ends."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(
        target=_work, args=(theirs, module, function, tuple(arguments)), name="author-long", daemon=True
    )
    process.start()
    theirs.close()
    share = 0.0
    try:
        while progress(share):
            if not ours.poll(LOOK_S):
                continue
            try:
                kind, value = ours.recv()
            except (EOFError, OSError):
                raise OSError("the process that computes this has ended; try again") from None
            if kind == "made":
                return value
            if kind == "failed":
                raise value
            share = value
        raise Stopped
    finally:
        process.kill()
        process.join()
        ours.close()


def _work(pipe: Connection, module: str, function: str, arguments: tuple[Any, ...]) -> None:
    """The process. Where the server has gone, telling it of the next part ends this."""
    for each in ("SIGINT", "SIGHUP"):  # a terminal sends them to the server as well, which then ends this
        if hasattr(signal, each):
            signal.signal(getattr(signal, each), signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(NICE)

    def told(done: int, total: int) -> None:
        pipe.send(("share", done / max(1, total)))

    try:
        answer = ("made", getattr(importlib.import_module(module), function)(*arguments, told=told))
    except Exception as error:
        answer = ("failed", error)
    pipe.send(answer)
