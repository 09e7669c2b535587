"""Plugins as hosts look for them: a file or a folder for each format, and where a user's lie.

format  what                                               where (Linux)
clap    NAME.clap, a shared object                         ~/.clap
vst3    NAME.vst3/Contents/x86_64-linux/NAME.so            ~/.vst3
lv2     NAME.lv2/ with ID.so, manifest.ttl, ID.ttl and more  ~/.lv2
"""

from __future__ import annotations

import glob
import os
import platform
import shutil
import stat
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from synth.files.targets import check_folder, naming, write_whole
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
            f"plugins are made on and for Linux on x86-64, and this is {platform.system()} on {platform.machine()}: "
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
        raise FileExistsError(f"{path}: holds {other}, which belongs to no plugin of ours; give another name")


def write(kind: str, path: Path, library: bytes, description: Description) -> None:
    """A plugin of a format at `path`: whole, or what was there before.

    library: the native library with its bank behind it. Raises OSError that names what could not be written.
    """
    check(kind, path)
    if kind == "clap":
        write_whole(path, lambda file: file.write(library), 0o777)
        return
    if kind == "vst3":  # which wants the folder's name again
        stem = path.name.removesuffix(f".{kind}") or description.id
        files: dict[str, bytes] = {f"Contents/{platform.machine()}-linux/{stem}.so": library}
    else:  # whose texts name the library by an IRI: an id needs no escapes
        name = f"{description.id}.so"
        files = {name: library, **{each: text.encode() for each, text in turtle.texts(description, name).items()}}
    _write_folder(path, files)


def _write_folder(path: Path, files: Mapping[str, bytes]) -> None:
    """A folder with these files in the place of whatever folder is there."""
    with naming(path):
        _tidy(path)
        made = Path(tempfile.mkdtemp(prefix=_prefix(path) + f"{os.getpid()}.", suffix=".part", dir=path.parent))
        try:
            new = made / "new"
            for name, data in files.items():
                file = new / name
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_bytes(data)
                if name.endswith(".so"):
                    file.chmod(file.stat().st_mode | (stat.S_IXUSR | stat.S_IXGRP | stat.S_IXOTH) & ~_umask())
            if path.exists():
                os.rename(path, made / "old")
            os.rename(new, path)
        finally:  # also where it was interrupted between the two
            _put_back(made, path)
            shutil.rmtree(made, ignore_errors=True)


def _prefix(path: Path) -> str:
    return f".{path.name[:100]}.jawari-{platform.node()[:50]}-"


def _put_back(made: Path, path: Path) -> None:
    """What was there before, where nothing has come into its place."""
    if not path.exists() and (made / "old").exists():
        os.rename(made / "old", path)


def _tidy(path: Path) -> None:
    """Take away what killed processes of this machine have left of this folder; what was there before comes back."""
    for left in path.parent.glob(f"{glob.escape(_prefix(path))}*.part"):
        number = left.name.removeprefix(_prefix(path)).partition(".")[0]
        if number.isdecimal() and not _runs(int(number)):
            _put_back(left, path)
            shutil.rmtree(left, ignore_errors=True)


def _runs(process_id: int) -> bool:
    try:
        os.kill(process_id, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


def _umask() -> int:
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


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
