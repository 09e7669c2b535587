"""Which process compiles what, where several do: a claim is a locked byte of a file in the folder of the kernels.

All processes that keep their kernels there share it. A claim goes with the process that holds it, however that ends, and a
process that claims twice has it. Without a file everything is everybody's.
"""

from __future__ import annotations

import os
import time
import zlib
from contextlib import suppress
from functools import cache

try:
    import fcntl
except ImportError:  # Windows, where no helpers are started
    fcntl = None  # type: ignore[assignment]

#: how long another process is waited for; then what it has claimed is done once more [s]
PATIENCE_S = 600.0
_LOOK_S = 0.02


def _file() -> int | None:
    return _opened(os.environ.get("NUMBA_CACHE_DIR", ""))


@cache
def _opened(folder: str) -> int | None:
    """The file of claims, open to the end of the process: closing it would end all locks that the process has on it."""
    if not folder or fcntl is None:
        return None
    try:
        return os.open(os.path.join(folder, "claims"), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError:
        return None


def take(name: str) -> bool:
    """Claim it; False: another process has."""
    file = _file()
    if file is None:
        return True
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _place(name), os.SEEK_SET)
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
    file = _file()
    if file is not None:
        with suppress(OSError):
            fcntl.lockf(file, fcntl.LOCK_UN, 1, _place(name), os.SEEK_SET)


def _place(name: str) -> int:
    return zlib.crc32(name.encode())
