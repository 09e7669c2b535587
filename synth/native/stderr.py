"""Standard error without what ALSA, JACK and PortAudio print on it by themselves.

The process has one standard error, and devices are looked for in several threads: the first who wants silence redirects
it, the last gives it back.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

_lock = threading.Lock()
_quiet: set[object] = set()
#: those of them under whom Python's own standard error is shown
_ours: set[object] = set()
_kept: int | None = None


@contextmanager
def silenced() -> Iterator[None]:
    """What is written to file descriptor 2 meanwhile is lost."""
    me = object()
    _begin(me)
    try:
        yield
    finally:
        _end({me})


@contextmanager
def only_ours(lasting: Callable[[], bool] = lambda: False) -> Iterator[None]:
    """Meanwhile standard error shows what Python writes on it, and nothing that libraries print from threads of their own
    (PortAudio's `Expression … failed`, libjack's and PipeWire's complaints): whoever plays says himself what has happened.

    lasting: whether it stays so afterwards, for there are threads that could not be ended.
    """
    try:
        shows = sys.stderr.fileno() == 2
        kept = os.dup(2) if shows else -1
    except (OSError, ValueError, AttributeError):
        shows = False
    if not shows:
        yield
        return
    before, me = sys.stderr, object()
    ours = open(kept, "w", encoding=before.encoding, errors=before.errors, buffering=1)
    sys.stderr = ours
    _begin(me)
    _ours.add(me)
    try:
        yield
    finally:
        if not lasting():
            _ours.discard(me)
            _end({me})
            sys.stderr = before
            with suppress(OSError, ValueError):  # the terminal has gone
                ours.close()


def give_back() -> None:
    """Standard error is as it was, even if somebody who wanted silence does not come back; but for `only_ours`, in which it
    is not missing."""
    with _lock:
        waiting = _quiet - _ours
    _end(waiting)


def _begin(me: object) -> None:
    global _kept
    with _lock:
        if not _quiet:
            try:
                sys.stderr.flush()
                _kept = os.dup(2)
            except (OSError, ValueError, AttributeError):  # there is no standard error
                return
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 2)
            os.close(nowhere)
        _quiet.add(me)


def _end(those: set[object]) -> None:
    global _kept
    with _lock:
        if not _quiet & those:
            return
        _quiet.difference_update(those)
        if not _quiet and _kept is not None:
            kept, _kept = _kept, None
            os.dup2(kept, 2)
            os.close(kept)
