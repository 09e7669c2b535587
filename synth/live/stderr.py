"""Standard error without what ALSA, JACK and PortAudio print on it by themselves.

The process has one standard error, and devices are looked for in several threads: the first who wants silence redirects
it, the last gives it back.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_lock = threading.Lock()
_quiet: set[object] = set()
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


def give_back() -> None:
    """Standard error is as it was, even if somebody who wanted silence does not come back."""
    with _lock:
        waiting = set(_quiet)
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
