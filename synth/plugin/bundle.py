"""Plugins as hosts look for them: a file or a folder for each format, and where a user's lie.

format  what                                               where (Linux)
clap    NAME.clap, a shared object                         ~/.clap
vst3    NAME.vst3/Contents/x86_64-linux/NAME.so            ~/.vst3
lv2     NAME.lv2/ with ID.so, manifest.ttl, ID.ttl and more  ~/.lv2
"""

from __future__ import annotations

import os
import platform
import sys
from pathlib import Path

from synth.files.folders import write_folder
from synth.files.targets import check_folder, write_whole
from synth.plugin import turtle
from synth.plugin.description import Description

FORMATS = ("clap", "vst3", "lv2")
#: what a folder of each format may hold, relative to it; {} stands for any name
_HOLDS = {"vst3": ("Contents/{}/{}.so",), "lv2": ("manifest.ttl", "{}.ttl", "{}.so")}


def format_of(path: str | os.PathLike[str]) -> str | None:
    """The format that a file's name ends with, None where it is none."""
    ending = Path(path).suffix.lower().removeprefix(".")
    return ending if ending in FORMATS else None


def require_system() -> None:
    """ValueError where plugins cannot be made: so far they are for Linux on x86-64."""
    if not (sys.platform.startswith("linux") and platform.machine() in ("x86_64", "AMD64")):
        raise ValueError(
            f"plugins can be made only on Linux on x86-64, and this is {platform.system()} on {platform.machine()}: "
            "`synth render` and `synth play` work here"
        )


def users_folder(kind: str) -> Path:
    """Where hosts look for a user's plugins of a format. Raises OSError where there is no home directory."""
    try:
        return Path.home() / f".{kind}"
    except RuntimeError as error:
        raise FileNotFoundError(f"{error}; give the place with -o") from None


def check(kind: str, path: Path) -> None:
    """What can be judged before anything is made. Raises OSError, ValueError: a folder that is there and holds something
    else, a file in the place of a folder and the other way round, no folder to write into."""
    check_folder(path, path.parent)
    if kind == "clap":
        if path.is_dir():
            raise IsADirectoryError(f"{path}: is a directory; give a file name")
        return
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        raise FileExistsError(f"{path}: is a file, and a plugin of the format {kind} is a folder; give another name")
    if path.is_dir() and (other := _foreign(kind, path)) is not None:
        raise FileExistsError(f"{path}: holds {other}, which does not belong to a plugin of this program; give another name")


def write(kind: str, path: Path, library: bytes, description: Description, same: Path | None = None) -> Path:
    """A plugin of a format at `path`: whole, or what was there before. The path of the library in it.

    library: the native library with its bank behind it. same: a file with these bytes, of which the library in a folder
    becomes another name where the file system allows. Raises OSError that names what could not be written.
    """
    check(kind, path)
    if kind == "clap":
        write_whole(path, lambda file: file.write(library), 0o777)
        return path
    if kind == "vst3":  # which wants the folder's name again
        stem = path.name.removesuffix(f".{kind}") or description.id
        name = f"Contents/{platform.machine()}-linux/{stem}.so"
        files = {name: library}
    else:  # whose texts name the library by an IRI: an id needs no escapes
        name = f"{description.id}.so"
        files = {name: library, **{each: text.encode() for each, text in turtle.texts(description, name).items()}}
    write_folder(path, files, programs=".so", same=same)
    return path / name


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
