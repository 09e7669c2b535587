"""The folder of a data set: what lies where, which recipe it is of, and whose turn it is.

dataset.json        format, fingerprints of recipe and sources, versions; written first
recipe.toml         the recipe, byte for byte; sources/: copies of presets and MIDI files that it names
train/ validation/ test/   shards;  labels/   in the same order
parts/              an index of each shard that is whole, until all are
index.parquet       the index; README.md: the card. With them the data set is whole
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import shutil
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, BinaryIO

from synth._version import __version__
from synth.dataset.items import Items
from synth.dataset.recipefile import SAID, Written, read_recipe
from synth.files import locks
from synth.files.code_version import SOUNDING, code_version
from synth.files.targets import check_folder, naming, write_text, write_whole
from synth.instrument.planfile import path_of
from synth.instrument.preset import preset_folder, preset_path
from synth.jit import prebuilt

FORMAT = 1
STATE, RECIPE, INDEX, CARD, LOCK = "dataset.json", "recipe.toml", "index.parquet", "README.md", ".lock"
PARTS, SOURCES = "parts", "sources"
#: packages whose version may show in the numbers
_PACKAGES = ("numpy", "numba", "llvmlite", "scipy", "soundfile")
#: rooms whose sources make an item
CODE = (*SOUNDING, "dataset")


def code() -> str:
    """Of the sources that make items."""
    return code_version(CODE)


def versions() -> dict[str, str]:
    """Program, code, packages, processor's kind; its bits, where they are those of every processor."""
    found = {"jawari": __version__, "code": code(), "python": platform.python_version(), "machine": platform.machine()}
    if prebuilt.bits() == "portable":
        found["bits"] = "portable"
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    import soundfile

    return found | {"libsndfile": soundfile.__libsndfile_version__}


def source_files(written: Written, items: Items) -> dict[str, tuple[Path, ...]]:
    """Names in the recipe → the files that they mean, a preset's plan behind it."""
    found: dict[str, tuple[Path, ...]] = {}
    for source in items.sources:
        for name in source.table.preset.values or source.table.preset.one_of:
            if name:
                path = preset_path(items.presets.path(name))
                found[name] = (path, path_of(path)) if path_of(path).is_file() else (path,)
        for name in source.files:
            found[name] = (written.path(name),)
    return found


class SetFolder:
    """A data set on the disk. Raises OSError where it cannot be read or written, ValueError where it is another's."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    def __truediv__(self, name: str) -> Path:
        return self.path / name

    @property
    def begun(self) -> bool:
        """Whether a data set lies here, whole or not."""
        return (self / STATE).is_file()

    @property
    def whole(self) -> bool:
        """Whether it is all there."""
        return self.begun and (self / INDEX).is_file() and (self / CARD).is_file()

    def state(self) -> dict[str, Any]:
        """What dataset.json holds. Raises ValueError."""
        try:
            found = json.loads((self / STATE).read_text(encoding="utf-8"))
            if found["format"] > FORMAT:
                raise ValueError(f"{self / STATE}: format {found['format']} is newer than what this program reads")
            return dict(found)
        except FileNotFoundError:
            raise ValueError(
                f"{self.path}: is not the folder of a data set ({STATE} is missing); give the folder of one"
            ) from None
        except (KeyError, TypeError, json.JSONDecodeError) as error:
            raise ValueError(f"{self / STATE}: cannot be read ({error}); make the data set again") from None

    def written(self) -> Written:
        """The recipe that it was made from, with its own copies of what that names."""
        state = self.state()
        return read_recipe(self / RECIPE, state["copies"], state["found"])

    def make(self) -> None:
        """The folder itself. Raises OSError, ValueError where something else is in its place."""
        if self.path.exists() and not self.path.is_dir():
            raise NotADirectoryError(f"{self.path}: is a file; a data set needs its own folder")
        if self.path.is_dir() and not self.begun:
            others = sorted(entry.name for entry in self.path.iterdir() if entry.name not in (LOCK, RECIPE, SOURCES))
            others = [name for name in others if not name.endswith(".part")]
            if others:
                raise ValueError(
                    f"{self.path}: contains other files ({others[0]}); name a folder that is empty or does not exist"
                )
        check_folder(self.path, self.path.parent)
        with naming(self.path):
            self.path.mkdir(exist_ok=True)

    def begin(self, written: Written, items: Items) -> None:
        """Says what is to lie here, or sees that it is of this recipe. Raises ValueError where it is not."""
        files = source_files(written, items)
        state = {
            "format": FORMAT,
            "recipe": written.fingerprint,
            "sources": {name: _digest(paths) for name, paths in sorted(files.items())},
            "items": items.size,
            "versions": versions(),
        }
        if self.begun:
            self._check(written, state)
            if (self / RECIPE).read_bytes() != written.text:  # of what is only said
                write_whole(self / RECIPE, lambda file: file.write(written.text))
            return
        copies = {}
        own = preset_folder().resolve()
        for number, (name, paths) in enumerate(sorted(files.items())):
            if paths[0].resolve().parent == own:
                continue
            copies[name] = f"{SOURCES}/{number:03d}-{re.sub(r'[^A-Za-z0-9.-]', '_', paths[0].name)}"
            for path in paths:
                copy = (self / copies[name]).with_suffix(path.suffix)
                with naming(copy):
                    copy.parent.mkdir(exist_ok=True)
                    data = path.read_bytes()
                write_whole(copy, partial(_put, data))
        found = {pattern: names for source in items.sources for pattern, names in source.patterns.items()}
        write_whole(self / RECIPE, lambda file: file.write(written.text))
        write_text(self / STATE, json.dumps(state | {"copies": copies, "found": found}, indent=1) + "\n")

    def _check(self, written: Written, state: dict[str, Any]) -> None:
        before = self.state()
        remedy = f"name another folder with -o, or remove {self.path}"
        if before["recipe"] != state["recipe"]:
            changed = _differences((self / RECIPE).read_bytes(), written.text)
            raise ValueError(f"{self.path}: contains a data set made from another recipe ({changed}); {remedy}")
        gone = [name for name, digest in state["sources"].items() if before["sources"].get(name) != digest]
        if gone or set(before["sources"]) != set(state["sources"]):
            names = ", ".join(gone or sorted(set(before["sources"]) ^ set(state["sources"])))
            raise ValueError(f"{self.path}: was started with another {names}; {remedy}")
        if not self.whole and before["versions"]["code"] != state["versions"]["code"]:
            raise ValueError(
                f"{self.path}: was started with other code (jawari {before['versions']['jawari']}, "
                f"{before['versions']['code'][:12]}; this is {__version__}, {state['versions']['code'][:12]}): the items "
                f"of one data set come from one version; go on with that one, {remedy}"
            )

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Only one at a time writes here. Raises ValueError where another does."""
        with naming(self.path):
            handle = os.open(self / LOCK, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            if not locks.taken(handle):
                raise ValueError(f"{self.path}: another run is writing there; wait for it, or end it")
            yield
        finally:
            os.close(handle)

    def part(self, split: str, number: int) -> Path:
        """The index of a shard: it is there when the shard is whole."""
        return self / f"{PARTS}/{split}-{number:06d}.parquet"

    def finish(self) -> None:
        """The parts of the index are not needed any more."""
        shutil.rmtree(self / PARTS, ignore_errors=True)


def _put(data: bytes, file: BinaryIO) -> None:
    file.write(data)


def _digest(paths: tuple[Path, ...]) -> str:
    digest = hashlib.sha256()
    for path in paths:
        data = path.read_bytes()
        digest.update(len(data).to_bytes(8, "little") + data)
    return digest.hexdigest()


def _differences(before: bytes, after: bytes) -> str:
    """Keys at which two recipes differ, in words."""
    old, new = (_flat(tomllib.loads(text.decode("utf-8-sig"))) for text in (before, after))
    keys = [key for key in sorted(old.keys() | new.keys()) if old.get(key) != new.get(key) and key.split(".")[0] not in SAID]
    first = keys[0] if keys else "file"
    more = f" and {len(keys) - 1} more" if len(keys) > 1 else ""
    return f"{first}{more} changed: {old.get(first, 'nothing')!r} there, {new.get(first, 'nothing')!r} here"


def _flat(data: Any, before: str = "") -> dict[str, Any]:
    pairs = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else None
    if pairs is None:
        return {before: data}
    found: dict[str, Any] = {}
    for key, value in pairs:
        found |= _flat(value, f"{before}.{key}" if before else str(key))
    return found
