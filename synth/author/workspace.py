"""The folder that the tool works in: which files are its presets, and which names may be written."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

from synth.preset import preset_folder

SUFFIX = ".toml"
#: what an autosaved text's file is called, behind the name of the preset's own
AUTOSAVE = ".autosave"
#: largest preset that is read [bytes]
MOST_BYTES = 1 << 20
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,99}")


class Workspace:
    """Preset files in `folder`, and the presets that come with the program."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder).resolve()
        if not self.folder.is_dir():
            raise ValueError(f"--folder {folder}: there is no such directory; make it first")

    def file(self, name: str) -> Path:
        """The path of a preset file (`name` with or without .toml), there or not. Raises ValueError for a name that is none,
        or that leads out of the folder."""
        stem = name.removesuffix(SUFFIX)
        if not _NAME.fullmatch(stem):
            raise ValueError(
                f"{name!r} is no name for a preset's file: letters, digits, space, . _ - only, and no folders, at most 100"
            )
        path = self.folder / f"{stem}{SUFFIX}"
        target = path.resolve()
        if target.parent != self.folder:
            raise ValueError(f"{name}: leads out of {self.folder}; copy the file into it")
        if target.exists() and not target.is_file():
            raise ValueError(f"{name}: is no regular file")
        return target

    def files(self) -> Iterator[Path]:
        """Preset files in the folder, by name; what is not one by its name is passed over."""
        for path in sorted(self.folder.glob(f"*{SUFFIX}")):
            try:
                yield self.file(path.name)
            except ValueError:
                continue

    def embedded(self, name: str) -> Path | None:
        """The file of a preset that comes with the program."""
        return {path.stem: path for path in preset_folder().glob(f"*{SUFFIX}")}.get(name)

    def autosave(self, label: str) -> Path:
        """Where an autosaved text lies: beside the file `label`, or that of a document that has none."""
        return self.folder / f".{label}{SUFFIX}{AUTOSAVE}"


def read_text(path: Path) -> str:
    """A preset's text as it stands. Raises OSError, ValueError."""
    with path.open("rb") as file:
        data = file.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise ValueError(f"{path.name}: larger than {MOST_BYTES >> 20} MB, which no preset is")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{path.name}: not a text file in UTF-8") from None


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
