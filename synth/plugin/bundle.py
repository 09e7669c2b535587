"""Plugins as hosts look for them: a file or a folder for each format and system, and where a user's lie.

format  what                                                    where (Linux)
clap    NAME.clap, a shared object                              ~/.clap
vst3    NAME.vst3/Contents/x86_64-linux/NAME.so                 ~/.vst3
lv2     NAME.lv2/ with ID.so, manifest.ttl, ID.ttl and more     ~/.lv2

On Windows the library of a VST3 is Contents/x86_64-win/NAME.vst3, that of an LV2 plugin ID.dll. On macOS CLAP and VST3 are
bundles (`macbundle`), and an LV2 plugin has ID.dylib with bank.jawari beside it.
"""

from __future__ import annotations

import os
import platform
import sys
from pathlib import Path

from synth.files.folders import write_folder
from synth.files.targets import check_folder, write_whole
from synth.plugin import macbundle, macsign, turtle
from synth.plugin.description import Description
from synth.plugin.library import with_bank
from synth.plugin.platforms import Target

FORMATS = ("clap", "vst3", "lv2")
#: what a folder of each format may hold, relative to it; {} stands for any name
_HOLDS = {
    "clap": macbundle.HOLDS,
    "vst3": ("Contents/{}/{}.so", "Contents/{}/{}.vst3", *macbundle.HOLDS),
    "lv2": ("manifest.ttl", "{}.ttl", "{}.so", "{}.dll", "{}.dylib", macbundle.BANK),
}


def format_of(path: str | os.PathLike[str]) -> str | None:
    """The format that a file's name ends with, None where it is none."""
    ending = Path(path).suffix.lower().removeprefix(".")
    return ending if ending in FORMATS else None


def require_system() -> None:
    """ValueError where plugins cannot be made: so far they are made on Linux, for that and for other systems."""
    if not sys.platform.startswith("linux"):
        raise ValueError(
            f"plugins can be made only on Linux, and this is {platform.system()} on {platform.machine()}: "
            "`synth render` and `synth play` work here"
        )


def users_folder(kind: str) -> Path:
    """Where hosts look for a user's plugins of a format. Raises OSError where there is no home directory."""
    try:
        return Path.home() / f".{kind}"
    except RuntimeError as error:
        raise FileNotFoundError(f"{error}; give the place with -o") from None


def is_folder(kind: str, target: Target) -> bool:
    """Whether a plugin of this format is a folder there."""
    return kind != "clap" or target.system == "macos"


def check(kind: str, path: Path, target: Target) -> None:
    """What can be judged before anything is made. Raises OSError, ValueError: a folder that is there and holds something
    else, a file in the place of a folder and the other way round, no folder to write into."""
    check_folder(path, path.parent)
    if not is_folder(kind, target):
        if path.is_dir():
            raise IsADirectoryError(f"{path}: is a directory; give a file name")
        return
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        where = " on macOS" if kind == "clap" else ""
        raise FileExistsError(f"{path}: is a file, and a plugin of the format {kind} is a folder{where}; give another name")
    if path.is_dir() and (other := _foreign(kind, path)) is not None:
        raise FileExistsError(f"{path}: holds {other}, which does not belong to a plugin of this program; give another name")


class Plugins:
    """The plugins of a target, made of one library and one bank: what is the same in several becomes one file of several
    names (hard links) where the file system allows."""

    def __init__(self, library: Path, bank: bytes, description: Description, target: Target) -> None:
        """library: the native one of the target. Raises OSError."""
        self._target = target
        self._library = library
        self._description = description
        self._bank = bank
        self._code = library.read_bytes() if target.system == "macos" else with_bank(library, bank)
        #: where what is large lies already
        self._there: dict[bytes, Path] = {}

    @property
    def library_bytes(self) -> int:
        """Of a plugin, what is not its bank."""
        return len(self._code) - (0 if self._target.system == "macos" else len(self._bank))

    def write(self, kind: str, path: Path) -> Path:
        """A plugin of a format at `path`: whole, or what was there before. The path of the library in it.

        Raises OSError that names what could not be written, what `check` does, and ValueError for a library that cannot be
        signed.
        """
        check(kind, path, self._target)
        if not is_folder(kind, self._target):
            write_whole(path, lambda file: file.write(self._code), 0o777)
            self._there.setdefault(self._code, path)
            return path
        try:
            name, files = self._files(kind, path.name.removesuffix(f".{kind}") or self._description.id)
        except macsign.Unsignable as error:
            raise ValueError(f"{self._library} {error}; delete it, and it is built again") from None
        large = [each for each in files if each == name or each.endswith(macbundle.BANK)]
        write_folder(path, files, name, {each: self._there[files[each]] for each in large if files[each] in self._there})
        for each in large:
            self._there.setdefault(files[each], path / each)
        return path / name

    def _files(self, kind: str, stem: str) -> tuple[str, dict[str, bytes]]:
        """What a folder called `stem` holds, and the name of the library in it."""
        target, about = self._target, self._description
        if kind == "lv2":  # whose texts name the library by an IRI: an id needs no escapes
            name = f"{about.id}{target.suffix}"
            texts = {each: text.encode() for each, text in turtle.texts(about, name).items()}
            if target.system == "macos":
                return name, {name: macbundle.alone(self._code, about), macbundle.BANK: self._bank, **texts}
            return name, {name: self._code, **texts}
        if target.system == "macos":
            return macbundle.CODE.format(stem), macbundle.files(stem, self._code, self._bank, about)
        suffix = f".{kind}" if target.system == "windows" else target.suffix
        name = f"Contents/{target.vst3_folder}/{stem}{suffix}"  # which wants the folder's name again
        return name, {name: self._code}


def _foreign(kind: str, path: Path) -> str | None:
    """Something in a folder that a plugin of this format does not have."""
    for found in sorted(path.rglob("*")):
        if found.is_dir() and not found.is_symlink():
            continue
        inside = found.relative_to(path)
        if not any(
            inside.match(each.replace("{}", "*")) for each in _HOLDS[kind] if len(Path(each).parts) == len(inside.parts)
        ):
            return str(inside)
    return None
