"""Locks of open files: flock where there is one, the first byte's lock on Windows."""

from __future__ import annotations

import errno
import os
import sys
from typing import Any

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


def taken(handle: int) -> bool:
    """Take the lock of an open file, without waiting; whether it is ours. A file system that knows no locks has nobody else
    who could have it. It goes with the handle."""
    try:
        if fcntl is not None:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        elif sys.platform == "win32":
            _take_first_byte(handle)
    except BlockingIOError:
        return False
    except OSError as error:
        return not (fcntl is None and error.errno in (errno.EACCES, errno.EDEADLK))
    return True


def _take_first_byte(handle: int) -> None:
    import msvcrt

    system: Any = msvcrt  # its functions exist on Windows only
    os.lseek(handle, 0, os.SEEK_SET)
    system.locking(handle, system.LK_NBLCK, 1)
