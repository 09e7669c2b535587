"""Which process compiles what, where several do: a claim is a locked byte of a file that they share.

It goes with the process that holds it, however that ends, and a process that claims twice has it. Without a file everything
is everybody's.
"""

from __future__ import annotations

import os
import time
import zlib
from contextlib import suppress

try:
    import fcntl
except ImportError:  # Windows, where no helpers are started
    fcntl = None  # type: ignore[assignment]

#: how long another process is waited for; then what it has claimed is done once more [s]
PATIENCE_S = 600.0
_LOOK_S = 0.02

_file: int | None = None


def share(file: int | None) -> None:
    """Claim in the open file from now on; None: no more."""
    global _file
    _file = file


def take(name: str) -> bool:
    """Claim it; False: another process has."""
    if _file is None or fcntl is None:
        return True
    try:
        fcntl.lockf(_file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _place(name), os.SEEK_SET)
    except (BlockingIOError, PermissionError):
        return False
    except OSError:  # a file system that knows no locks
        return True
    return True


def wait_for(name: str) -> bool:
    """Claim it, after the other process that has; whether it was waited for."""
    end = time.monotonic() + PATIENCE_S
    waited = False
    while not take(name) and time.monotonic() < end:
        waited = True
        time.sleep(_LOOK_S)
    return waited


def leave(name: str) -> None:
    """Let others claim it."""
    if _file is not None and fcntl is not None:
        with suppress(OSError):
            fcntl.lockf(_file, fcntl.LOCK_UN, 1, _place(name), os.SEEK_SET)


def _place(name: str) -> int:
    return zlib.crc32(name.encode())
