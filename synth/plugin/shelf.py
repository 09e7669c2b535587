"""Native libraries as they are at hand: what came with the package, what was built before, or one that is built now."""

from __future__ import annotations

import importlib.util
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from synth.files.targets import naming
from synth.jit import prebuilt
from synth.plugin import library
from synth.plugin.c_sources import Kind
from synth.plugin.platforms import BITS, PORTABLE, WEB, Target, host

#: libraries that were built for other sources, kept at most
KEEP = 3


def native_library(say: Callable[[str], None] | None = None) -> Path:
    """`library_for` this machine; of Linux on another processor, the one that its compiler makes."""
    return _found_or_built(prebuilt.places(), None, BITS[0], say)


def library_for(target: Target, bits: str = BITS[0], say: Callable[[str], None] | None = None) -> Path:
    """The library of a target for these sources, of one of `BITS`.

    say: told what takes time where it has to be built. Raises OSError where nothing can be written,
    `library.BuildError` (a ValueError) where there is no compiler, it fails, or JAWARI_NATIVE names something else.
    """
    if target == host() and bits == BITS[0]:
        return native_library(say)
    kind = Path(target.name) if bits == BITS[0] else Path(bits, target.name)
    return _found_or_built([folder / kind / target.library for folder in prebuilt.folders()], target, bits, say)


def _found_or_built(
    places: list[Path],
    target: Target | None,
    bits: str,
    say: Callable[[str], None] | None,
    kind: Kind | None = None,
) -> Path:
    """target: another than this machine, or its portable one; None: this machine. kind: as `library.build` takes it."""
    for path in places:
        if path.is_file() and not prebuilt.unfit(path) and library.sources_of(path) == library.sources_version():
            return path
    if target is None and os.environ.get("JAWARI_NATIVE", "") not in ("", "0"):  # what lies there may be anything
        raise library.BuildError(
            f"JAWARI_NATIVE={path} is not a native library of these sources; unset it to have one built"
        )
    if target is not None and target != host() and importlib.util.find_spec("ziglang") is None:
        raise library.BuildError(
            f"the native library for {target.name} is built by the package ziglang, which is missing: "
            "pip install 'jawari[targets]'"
        )
    place = places[-1]
    base = prebuilt.folders()[-1].parent
    with naming(base):
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=".native-", dir=base))
    try:
        built = _build(made, target, bits, say, kind)
        with naming(place):
            place.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            os.replace(built, place)
    finally:
        shutil.rmtree(made, ignore_errors=True)
    _clear(prebuilt.folders()[-1])
    return place


def _build(folder: Path, target: Target | None, bits: str, say: Callable[[str], None] | None, kind: Kind | None) -> Path:
    whose = "" if target is None else f" for {target.name}"
    what = "native" if bits == BITS[0] else f"{bits} native"
    about = None if say is None else lambda step: say(f"building the {what} library{whose}, once on this machine: {step}")
    if target is None:
        return library.build(folder, say=about)
    levels = target.levels if bits == BITS[0] else PORTABLE
    return library.build(folder, target=target, kind=kind, levels=levels, say=about)


def web_library(kind: str, say: Callable[[str], None] | None = None, target: Target = WEB) -> Path:
    """The engine as WebAssembly for these sources: of pages ("web"), or with a CLAP ("wclap"); target: WEB or WEB_RELAXED.
    Else as `library_for`."""
    places = [folder / kind / target.library for folder in prebuilt.folders()]
    return _found_or_built(places, target, BITS[0], say, kind="engine" if kind == "web" else "clap")


def _clear(mine: Path) -> None:
    """Take away the oldest of those that were built for other sources."""
    others = [each for each in mine.parent.glob("native-*") if each != mine]
    for old in sorted(others, key=lambda path: path.stat().st_mtime)[: -KEEP or None]:
        shutil.rmtree(old, ignore_errors=True)
