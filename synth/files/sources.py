"""Where input is read: no more of it than such a file has, and where asked for, from files only.

A pipe that nobody writes to, or a device, would be waited for forever; a program that serves others must not.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

_KINDS = (
    (stat.S_ISDIR, "a directory"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISLNK, "a link"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
#: read at once [bytes]
_PIECE = 1 << 20
#: without waiting, not for processes that are started, bytes as they are: as far as the system has a word for it
_OPENING = 0
for _name in ("O_NONBLOCK", "O_CLOEXEC", "O_NOCTTY", "O_BINARY", "O_NOINHERIT"):
    _OPENING |= getattr(os, _name, 0)


def kind_of(mode: int) -> str | None:
    """What a file of this mode is, if it is no regular file."""
    if stat.S_ISREG(mode):
        return None
    return next((words for test, words in _KINDS if test(mode)), "a special file")


def read_bytes(path: str | os.PathLike[str], most: int, what: str) -> bytes:
    """What a file holds, or what comes through a pipe to its end. Raises OSError, and ValueError where it is more than
    `most` bytes, which no `what` is."""
    with open(path, "rb") as file:
        return _checked(_at_most(file, most + 1), str(path), most, what)


def read_file(path: str | os.PathLike[str], most: int, what: str, *, follow: bool = True) -> bytes:
    """As `read_bytes`, but of a regular file only, and without `follow` of no link to one; it never waits. Raises ValueError
    for anything else."""
    _refuse(os.stat(path, follow_symlinks=follow).st_mode, path)
    # what it is may have changed meanwhile: opened without waiting, and looked at again
    flags = os.O_RDONLY | _OPENING | (0 if follow else getattr(os, "O_NOFOLLOW", 0))
    with open(os.open(path, flags), "rb") as file:
        _refuse(os.fstat(file.fileno()).st_mode, path)
        return _checked(_at_most(file, most + 1), Path(path).name, most, what)


def _at_most(file: BinaryIO, count: int) -> bytes:
    """The first bytes of a file; memory is asked for as they come, not for all that there might be."""
    data = bytearray()
    while len(data) < count and (piece := file.read(min(_PIECE, count - len(data)))):
        data += piece
    return bytes(data)


def _refuse(mode: int, path: str | os.PathLike[str]) -> None:
    kind = kind_of(mode)
    if kind is not None:
        raise ValueError(f"{Path(path).name}: is {kind}, not a regular file; copy its contents into one")


def _checked(data: bytes, name: str, most: int, what: str) -> bytes:
    if len(data) > most:
        raise ValueError(f"{name}: larger than {most >> 20} MB, the limit for a {what}; check the name")
    return data
