"""Where results are written: files, which are made beside their place and renamed, and devices and pipes, which are not."""

from __future__ import annotations

import os
import stat
import tempfile
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


def write_text(path: Path, text: str) -> None:
    """Write a file beside its place and rename it, so that it is whole whatever happens. Raises OSError."""
    handle, beside = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(text.encode("utf-8"))
            file.flush()
            os.fsync(file.fileno())
        try:
            mode = path.stat().st_mode & 0o777
        except FileNotFoundError:
            mask = os.umask(0)
            os.umask(mask)
            mode = 0o666 & ~mask
        os.chmod(beside, mode)
        os.replace(beside, path)
    except BaseException:
        Path(beside).unlink(missing_ok=True)
        raise
    directory = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
