"""Where results are written: files, which are made beside their place and renamed, and devices and pipes, which are not.

What is made beside its place is locked and named so that what a killed process leaves is found and goes (`unfinished`).
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import stat
import sys
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from io import FileIO
from itertools import count
from pathlib import Path
from typing import BinaryIO, NamedTuple

from synth.files import unfinished

_REMEDIES = {
    errno.ENOSPC: "make room there or write elsewhere",
    errno.EDQUOT: "your quota is used up: make room or write elsewhere",
    errno.EFBIG: "it has reached a size limit of the file system or the shell (ulimit -f)",
    errno.ENAMETOOLONG: "give it a shorter name",
}

#: Windows renames and removes no file that is open
_CLOSED_FIRST = os.name == "nt"


class Named(NamedTuple):
    """A file by what it is on the command line ('--tuning', '-o') and its path; '-' is standard output."""

    what: str
    path: str | os.PathLike[str]


def is_special(path: str | os.PathLike[str]) -> bool:
    """Whether the path is there and is a device or a pipe, which cannot be replaced by a file."""
    try:
        mode = os.stat(path).st_mode
    except OSError:
        return False
    return not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)


def open_special(path: str | os.PathLike[str]) -> FileIO:
    """A device or a pipe, open for writing. A pipe that nobody reads yet is waited for, which standard error says.

    Raises OSError.
    """
    if hasattr(os, "O_NONBLOCK") and stat.S_ISFIFO(os.stat(path).st_mode):
        try:
            handle = os.open(path, os.O_WRONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            if error.errno != errno.ENXIO:
                raise
            print(f"synth: {os.fspath(path)}: waiting for a program to read this pipe; Ctrl-C stops", file=sys.stderr)
        else:
            os.set_blocking(handle, True)
            return FileIO(handle, "wb")  # closed and opened again, the reader would see the end between
    return FileIO(path, "wb")


def check_target(path: str | os.PathLike[str]) -> None:
    """OSError, which says why, where nothing can be written at `path`."""
    if is_special(path):
        return
    target = Path(path)
    with naming(target):
        try:
            mode = os.stat(target).st_mode
        except FileNotFoundError:
            mode = None
    if mode is not None and stat.S_ISDIR(mode):
        raise IsADirectoryError(f"{target}: is a directory; give a file name")
    check_folder(target, target.parent)
    if mode is not None and not os.access(target, os.W_OK):
        raise PermissionError(f"{target}: is write-protected; choose another name, or chmod u+w it")


def check_folder(target: Path, folder: Path) -> None:
    """OSError where `folder`, in which `target` is to be made, is not there or cannot be written to."""
    if not folder.is_dir():
        raise FileNotFoundError(f"{target}: there is no directory {folder}; make it first")
    if os.stat(folder).st_nlink == 0:
        raise FileNotFoundError(f"{target}: the directory {folder} has been deleted; change to another")
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"{target}: the directory {folder} cannot be written to; choose another")


def check_apart(inputs: Iterable[Named], outputs: Iterable[Named]) -> None:
    """ValueError where an output is a file that is read, or two outputs are one file: after links are followed, through hard
    links, and where a folder does not tell capitals from small letters. Devices and pipes are not looked at."""
    read = [(each, _identities(each.path)) for each in inputs if str(each.path) != "-"]
    written: list[tuple[Named, set[object]]] = []
    for each in outputs:
        mine = _identities(each.path)
        for other, theirs in read:
            if mine & theirs:
                raise ValueError(
                    f"{_titled(each)} would overwrite {_titled(other)}, which is an input: give the output another name"
                )
        for other, theirs in written:
            if mine & theirs:
                raise ValueError(f"{_titled(other)} and {_titled(each)} are the same file: give one of them another name")
        written.append((each, mine))


def _titled(each: Named) -> str:
    return "standard output" if str(each.path) == "-" else f"{each.what} {os.fspath(each.path)}"


def _identities(path: str | os.PathLike[str]) -> set[object]:
    """What a file can be known by; nothing for what is no file to be replaced."""
    try:
        found = os.fstat(1) if str(path) == "-" else os.stat(path)
    except OSError:
        found = None
    if found is not None:
        return {(found.st_dev, found.st_ino)} if stat.S_ISREG(found.st_mode) else set()
    if str(path) == "-":
        return set()
    try:
        real = os.path.realpath(path)
    except OSError:  # the current directory has been deleted
        return {os.fspath(path)}
    folder, name = os.path.split(real)
    try:
        place: object = (os.stat(folder).st_dev, os.stat(folder).st_ino)
    except OSError:
        place = folder
    return {(place, unicodedata.normalize("NFC", name).casefold() if _knows_no_case(folder) else name)}


def _knows_no_case(folder: str) -> bool:
    """Whether names in a folder that differ in capitals are one file there, as far as what lies in it shows."""
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                other = os.path.join(folder, entry.name.swapcase())
                if entry.name.swapcase() != entry.name:
                    return os.path.lexists(other) and os.path.samestat(os.lstat(other), os.lstat(entry.path))
    except OSError:
        pass
    return False


@contextlib.contextmanager
def naming(path: str | os.PathLike[str]) -> Iterator[None]:
    """An OSError from within tells of `path`, which the user knows, and of what can be done."""
    try:
        yield
    except OSError as error:
        if error.errno is None:
            raise
        raise told(error, path) from None


def told(error: OSError, path: str | os.PathLike[str]) -> OSError:
    """`error`, which has an errno, as one that names `path`."""
    assert error.errno is not None
    why = os.strerror(error.errno)
    if error.errno == errno.ENOENT and not os.path.isdir(os.path.dirname(path) or os.curdir):
        why = "its directory no longer exists; make it again and retry"
    elif error.errno in _REMEDIES:
        why = f"{why}; {_REMEDIES[error.errno]}"
    return OSError(error.errno, why, "standard output" if str(path) == "-" else os.fspath(path))


class Whole:
    """A file that is made beside its place: `open`, write to `handle`, then `settle` and `commit`, or `discard`.

    path    its place; a link there is replaced, and not what it leads to
    beside  where it lies until then, on the same file system (its own folder)
    mode    of a file that is not there yet, less what the umask takes; otherwise it stays as it is
    kept    what has been written is worth having after a crash: it is called `.NAME.PID.part`, and nobody takes it away
    partial  where it lies
    handle   to read and write; −1 while it is not open
    Every method raises OSError that names `path`.
    """

    def __init__(
        self, path: str | os.PathLike[str], *, beside: Path | None = None, kept: bool = False, mode: int = 0o666
    ) -> None:
        self.path = os.fspath(path)
        self.handle = -1
        self.partial: Path | None = None
        self._beside = Path(path).parent if beside is None else beside
        self._kept = kept
        self._mode = mode

    def open(self) -> int:
        """Makes the file; returns `handle`. What killed processes left in the folder goes."""
        with naming(self.path):
            unfinished.tidy(self._beside)
            mode = _mode_of(self.path)
            flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
            for number in count(1):
                partial = self._beside / self._name(number)
                if not self._kept:
                    self.partial = partial
                    unfinished.begun.add(self)
                try:
                    self.handle = os.open(partial, flags, self._mode if mode is None else mode)
                except FileExistsError:  # of a process before, which had the same number
                    continue
                self.partial = partial
                if self._is_mine():
                    break
                os.close(self.handle)
            if mode is not None and hasattr(os, "fchmod"):
                with contextlib.suppress(OSError):  # of a file system that has no such modes
                    os.fchmod(self.handle, mode)
        return self.handle

    def _name(self, number: int) -> str:
        kept = f"{os.getpid()}" if number == 1 else f"{os.getpid()}-{number}"
        behind = kept if self._kept else unfinished.mark()
        return unfinished.partial_name(self._beside, os.path.basename(self.path), behind)

    def _is_mine(self) -> bool:
        assert self.partial is not None
        return self._kept or unfinished.lock(self.handle, self.partial)

    def settle(self) -> None:
        """What has been written is on the disk: an error that the system keeps back comes now."""
        with naming(self.path):
            try:
                os.fsync(self.handle)
            except OSError as error:
                if error.errno not in (errno.EINVAL, errno.ENOTSUP, errno.EROFS):
                    raise

    def commit(self) -> None:
        """Gives the file its name and closes it; where that fails, it is removed, or stays where it lies if it is `kept`."""
        if self.partial is None:
            return
        try:
            with naming(self.path):
                if _CLOSED_FIRST:
                    self._close()
                os.replace(self.partial, self.path)
            self.partial = None
        except OSError as error:
            if self._kept:
                left, self.partial = self.partial, None
                if left is not None and left.exists():
                    raise OSError(error.errno, f"{error.strerror}; the data are kept in {left}", self.path) from None
            raise
        finally:
            self.discard()
        _settle_folder(os.path.dirname(self.path) or os.curdir)

    def discard(self) -> None:
        """Closes and removes what has not got its name; raises nothing."""
        if _CLOSED_FIRST:
            self._close()
        partial, self.partial = self.partial, None
        if partial is not None:
            with contextlib.suppress(OSError):
                partial.unlink(missing_ok=True)
        self._close()  # last: with its lock, nobody else takes it for left behind
        unfinished.begun.discard(self)

    def _close(self) -> None:
        handle, self.handle = self.handle, -1
        if handle >= 0:
            with contextlib.suppress(OSError):
                os.close(handle)


def write_whole(path: str | os.PathLike[str], write: Callable[[BinaryIO], object], mode: int = 0o666) -> None:
    """`write` a file beside its place, then rename it: it is whole whatever happens, and what was there before stays until
    then. mode: see `Whole`. A device or a pipe is written to as it is. Raises OSError that names `path`."""
    if is_special(path):
        with naming(path), io.BufferedWriter(open_special(path)) as file:
            write(file)
        return
    whole = Whole(path, mode=mode)
    try:
        handle = whole.open()
        with naming(path), os.fdopen(os.dup(handle), "w+b") as file:
            write(file)
        whole.settle()
        whole.commit()
    finally:
        whole.discard()


def write_text(path: str | os.PathLike[str], text: str, mode: int = 0o666) -> None:
    """`write_whole` of text in UTF-8."""
    data = text.encode("utf-8")
    write_whole(path, lambda file: file.write(data), mode)


def _mode_of(path: str) -> int | None:
    """Permissions of the file that is there; None if none is."""
    try:
        return os.stat(path).st_mode & 0o777
    except FileNotFoundError:
        return None


def _settle_folder(folder: str) -> None:
    """The file has its name; that the name is on the disk is what a power cut would ask for, and no reason to fail."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
