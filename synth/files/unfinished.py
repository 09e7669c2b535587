"""What is being made beside its place, a file or a folder, until it gets its name.

It is called `.NAME.jawari-PID-MACHINE-RANDOM.part` and locked by the process that makes it. What a killed process leaves has
the name but not the lock: the next that writes into the folder takes it away, and nothing else. In a folder that is being
made there is the NAME in full (`PLACE`), what is new, and for a moment what was there before (`OLD`), which then comes
back.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import secrets
import shutil
import stat
from pathlib import Path
from typing import Protocol

try:
    import fcntl
except ImportError:  # a system without such locks: nothing is taken away there
    fcntl = None  # type: ignore[assignment]

_LEFT = re.compile(r"\..*\.jawari-\d+-([0-9a-f]{8})-[0-9a-f]{8}\.part", re.DOTALL)
_MARK_BYTES = 48  # of what stands behind the name
_SHORTEST_LIMIT = 143  # bytes of a file's name, of the file systems that allow the least
#: in a folder that is being made
PLACE, NEW, OLD = "place", "new", "old"


class Unfinished(Protocol):
    """What has been begun and has not got its name yet."""

    def discard(self) -> None:
        """Closes and removes it; raises nothing."""


#: all of this process: a signal may come where nobody holds them yet, or holds them no more
begun: set[Unfinished] = set()


def discard_unfinished() -> None:
    """Removes all that has been begun and not ended, for a program that a signal ends."""
    for each in list(begun):
        each.discard()


def mark() -> str:
    """What a process of this machine calls what it makes; another one each time."""
    return f"jawari-{os.getpid()}-{_machine()}-{secrets.token_hex(4)}"


def partial_name(folder: Path, name: str, behind: str) -> str:
    """.NAME.BEHIND.part, cut in the name to what a file system allows."""
    most = _longest_name(folder) - _MARK_BYTES - 2
    return f".{os.fsdecode(os.fsencode(name)[:most])}.{behind}.part"


def lock(handle: int, path: Path) -> bool:
    """Locks what lies at `path`; false: between its making and the lock another has taken it for left behind."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
    except OSError:  # a file system without locks, where nobody can lock it and take it away
        return True
    return is_at(handle, path)


def tidy(folder: str | os.PathLike[str]) -> None:
    """Takes away what processes of this machine that were killed have left: files and folders that are called so and that
    nobody has locked. Raises nothing."""
    if fcntl is None:
        return
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            found = _LEFT.fullmatch(entry.name)
            if found is not None and found[1] == _machine():
                _take_away(Path(folder) / entry.name)


def _take_away(path: Path) -> None:
    with contextlib.suppress(OSError):
        kind = os.O_RDONLY | os.O_DIRECTORY if stat.S_ISDIR(os.lstat(path).st_mode) else os.O_RDWR
        handle = os.open(path, kind | os.O_NOFOLLOW | os.O_NONBLOCK)
        try:
            mode = os.fstat(handle).st_mode
            folder = stat.S_ISDIR(mode) and (path / PLACE).is_file()
            if stat.S_ISREG(mode) or folder:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if is_at(handle, path) and folder:
                    remove_folder(path)
                elif is_at(handle, path):
                    path.unlink()
        finally:
            os.close(handle)


def remove_folder(made: Path) -> None:
    """A folder that was to be made; what was in its place before comes back, where nothing else has. Raises OSError where
    that cannot be, and nothing is then removed."""
    with contextlib.suppress(FileNotFoundError):
        name = (made / PLACE).read_text(encoding="utf-8", errors="surrogateescape")
        place = made.parent / os.path.basename(name)
        if (made / OLD).exists() and not place.exists():
            os.rename(made / OLD, place)
    shutil.rmtree(made, ignore_errors=True)


def is_at(handle: int, path: Path) -> bool:
    """Whether an open file or folder is the one at `path`."""
    try:
        return os.path.samestat(os.fstat(handle), os.lstat(path))
    except FileNotFoundError:
        return False


def _machine() -> str:
    """Locks hold on one machine: files of others, in a folder that several share, are left alone."""
    node = os.uname().nodename if hasattr(os, "uname") else ""
    return hashlib.blake2b(os.fsencode(node), digest_size=4).hexdigest()


def _longest_name(folder: Path) -> int:
    try:
        return os.pathconf(folder, "PC_NAME_MAX")
    except (OSError, ValueError, AttributeError):
        return _SHORTEST_LIMIT
