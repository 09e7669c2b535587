"""Folders that appear whole or not at all, in the place of the one that is there."""

from __future__ import annotations

import contextlib
import os
import stat
from collections.abc import Mapping
from pathlib import Path

from synth.files import unfinished
from synth.files.targets import naming


def write_folder(path: Path, files: Mapping[str, bytes], programs: str = "", same: Mapping[str, Path] | None = None) -> None:
    """Write a folder beside its place, then rename it: whatever happens, what was there before is there, or this one.

    files: relative name -> content. programs: names with this ending may be run. same: names that become further names of
    the file there (hard links), if it has their content and the file system allows that. Raises OSError that names `path`.
    """
    whole = _WholeFolder(path)
    try:
        with naming(path):
            new = whole.open()
            for name, data in files.items():
                file = new / name
                file.parent.mkdir(parents=True, exist_ok=True)
                if same is not None and name in same and _linked(same[name], file, data):
                    continue
                mode = 0o777 if programs and name.endswith(programs) else 0o666
                with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as out:
                    out.write(data)
            whole.commit()
    finally:  # also where it was interrupted between the two names
        whole.discard()


def _linked(there: Path, name: Path, data: bytes) -> bool:
    """Give the file that is there another name if it holds `data`; False and no such name where that cannot be."""
    try:
        if not stat.S_ISREG(os.lstat(there).st_mode):  # to read a pipe would wait for ever
            return False
        os.link(there, name, follow_symlinks=False)
    except OSError:  # another file system, or one without hard links
        return False
    try:
        if stat.S_ISREG(os.lstat(name).st_mode) and name.read_bytes() == data:
            return True
    except OSError:
        pass
    name.unlink()  # another process has written there meanwhile
    return False


class _WholeFolder:
    """A folder that is made beside its place: `open`, fill what that gives, then `commit`; at last `discard`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._partial: Path | None = None
        self._handle = -1

    def open(self) -> Path:
        """Where the new folder is to be made. What killed processes left goes, and comes back. Raises OSError."""
        unfinished.tidy(self._path.parent)
        while self._handle < 0:
            name = unfinished.partial_name(self._path.parent, self._path.name, unfinished.mark())
            self._partial = self._path.parent / name
            unfinished.begun.add(self)
            self._partial.mkdir(mode=0o700)
            self._handle = os.open(self._partial, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
            if not unfinished.lock(self._handle, self._partial):
                os.close(self._handle)
                self._handle = -1
        assert self._partial is not None
        (self._partial / unfinished.PLACE).write_text(self._path.name, encoding="utf-8", errors="surrogateescape")
        return self._partial / unfinished.NEW

    def commit(self) -> None:
        """Gives the folder its name. Raises OSError."""
        assert self._partial is not None
        if self._path.exists():
            os.rename(self._path, self._partial / unfinished.OLD)
        os.rename(self._partial / unfinished.NEW, self._path)

    def discard(self) -> None:
        """Removes what has not got its name, and puts back what was there before; raises nothing."""
        partial, self._partial = self._partial, None
        if partial is not None:
            with contextlib.suppress(OSError):
                unfinished.remove_folder(partial)
        handle, self._handle = self._handle, -1
        if handle >= 0:
            with contextlib.suppress(OSError):
                os.close(handle)
        unfinished.begun.discard(self)
