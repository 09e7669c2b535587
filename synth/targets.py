"""Where results are written: files, which are made beside their place and renamed, and devices and pipes, which are not."""

from __future__ import annotations

import os
import stat
from pathlib import Path


def is_special(path: str | os.PathLike[str]) -> bool:
    """Whether the path is there and is a device or a pipe, which cannot be replaced by a file."""
    try:
        mode = os.stat(path).st_mode
    except OSError:
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


def check_target(path: str | os.PathLike[str]) -> None:
    """OSError, which says why, where nothing can be written at `path`."""
    if is_special(path):
        return
    target = Path(path)
    if target.is_dir():
        raise IsADirectoryError(f"{target}: is a directory; give a file name")
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{target}: there is no directory {target.parent}; make it first")
    if not os.access(target.parent, os.W_OK):
        raise PermissionError(f"{target}: the directory {target.parent} cannot be written to; choose another")
