"""The folder that the tool works in: which files are its presets, and which names may be written."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import stat
import sys
import unicodedata
from collections.abc import Iterator
from pathlib import Path

from synth.files import locks
from synth.files.sources import kind_of, read_file
from synth.files.unfinished import tidy
from synth.instrument.preset import MOST_BYTES, preset_folder

SUFFIX = ".toml"
#: what an autosaved text's file is called, behind the name of the preset's own
AUTOSAVE = ".autosave"
#: longest name of a file without its ending [bytes]: its autosave's and what stands behind that fit as well
MOST_NAME = 200


class Workspace:
    """Preset files in `folder`, and the presets that come with the program."""

    def __init__(self, folder: str | Path) -> None:
        try:
            self.folder = Path(folder).resolve()
        except FileNotFoundError:
            raise ValueError("the current directory has been deleted: go to another, or give --folder") from None
        if not self.folder.is_dir():
            raise ValueError(f"--folder {folder}: there is no such directory; create it first")

    def file(self, name: str) -> Path:
        """The path of a preset file (`name` with or without .toml), there or not; of a new one a name is asked for that any
        system can write. Raises ValueError for a name that is none, or that leads out of the folder."""
        stem = name.removesuffix(SUFFIX)
        path = self.folder / f"{stem}{SUFFIX}"
        if not _readable(stem) or not (_writable(stem) or os.path.lexists(path)):
            raise ValueError(
                f"{name!r} is not a valid name of a preset file: use letters, digits, space, . _ - only, no folders, at "
                f"most {MOST_NAME} bytes"
            )
        if not os.path.lexists(path):
            path = path.with_name(unicodedata.normalize("NFC", path.name))
        target = path.resolve()
        if target.parent != self.folder:
            raise ValueError(f"{name}: leads out of {self.folder}; copy the file into it")
        if target.suffix != SUFFIX or not _readable(target.stem):
            raise ValueError(f"{name}: leads to {target.name}, which is not a preset file; rename that to end in {SUFFIX}")
        if target.exists() and (kind := kind_of(target.stat().st_mode)) is not None:
            raise ValueError(f"{name}: is {kind}, not a regular file; copy its contents into one")
        return target

    def files(self) -> Iterator[tuple[Path, str | None]]:
        """Preset files in the folder, by name, each with the reason why it cannot be opened, if it cannot."""
        for path in sorted(self.folder.glob(f"*{SUFFIX}")):
            if path.name.startswith("."):
                continue
            try:
                yield self.file(path.name), None
            except (ValueError, OSError) as error:
                yield path, str(error)

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Have the folder for this process, so that no other takes its autosaves for those of one that crashed. Raises
        OSError where another has it."""
        if sys.platform == "win32":  # where a folder cannot be opened
            tidy(self.folder)
            yield
            return
        handle = os.open(self.folder, os.O_RDONLY)
        try:
            if not locks.taken(handle):
                raise OSError(
                    f"{self.folder}: another `synth author` is using this folder; open the preset on its page, or quit it"
                )
            tidy(self.folder)
            yield
        finally:
            os.close(handle)

    def embedded(self, name: str) -> Path | None:
        """The file of a preset that comes with the program."""
        return {path.stem: path for path in preset_folder().glob(f"*{SUFFIX}")}.get(name)

    def autosave(self, label: str) -> Path:
        """Where an autosaved text lies: beside the file `label`, or that of a document that has none."""
        return self.folder / f".{label}{SUFFIX}{AUTOSAVE}"


def _readable(stem: str) -> bool:
    """Whether a file may be called so: one of the folder itself that is not hidden, with nothing that would not show."""
    try:
        size = len(stem.encode())
    except UnicodeEncodeError:
        return False
    shows = all(letter == " " or letter.isprintable() for letter in stem)
    return 0 < size <= MOST_NAME and shows and stem[0] != "." and not set(stem) & set("/\\")


def _writable(stem: str) -> bool:
    """Whether a new file may be called so: letters, marks and digits of any script, and a few signs between them."""
    kinds = [unicodedata.category(letter)[0] for letter in stem]
    return kinds[0] in "LN" and all(kind in "LMN" or letter in " ._-" for kind, letter in zip(kinds, stem, strict=True))


def stem_of(filename: str) -> str:
    """A name for a file made of one from elsewhere, perhaps with folders; what it cannot have becomes a hyphen."""
    stem = unicodedata.normalize("NFC", re.split(r"[/\\]", filename)[-1].removesuffix(SUFFIX))
    stem = "".join(letter if unicodedata.category(letter)[0] in "LMN" or letter in " ._-" else "-" for letter in stem)
    while stem and (unicodedata.category(stem[0])[0] not in "LN" or len(stem.encode()) > MOST_NAME // 2):
        stem = stem[:-1] if unicodedata.category(stem[0])[0] in "LN" else stem[1:]
    return stem.rstrip(" .-") or "preset"


def regular(path: Path) -> bool:
    """Whether it is a file, and no link to one."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def check_regular(path: Path) -> None:
    """Raises FileExistsError where something else than a file stands in the place of one that is to be written."""
    try:
        kind = kind_of(path.lstat().st_mode)
    except FileNotFoundError:
        return
    if kind is not None:
        why = f"is {kind}, not a regular file; move it away, or save under another name"
        raise FileExistsError(errno.EEXIST, why, str(path))


def read_text(path: Path, *, follow: bool = False) -> str:
    """A preset's text as it stands in a regular file; `follow`: or in one that a link leads to. Raises OSError,
    ValueError."""
    data = read_file(path, MOST_BYTES, "preset", follow=follow)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path.name}: not a text file in UTF-8") from None
