"""The native library as it is at hand: what came with the package, what was built before, or one that is built now."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from synth.files.targets import naming
from synth.jit import prebuilt
from synth.plugin import library
from synth.plugin.targets import WEB

#: libraries that were built for other sources, kept at most
KEEP = 3


def native_library(say: Callable[[str], None] | None = None) -> Path:
    """The library for these sources, for all levels of processors.

    say: told what takes time where it has to be built. Raises OSError where nothing can be written,
    `library.BuildError` (a ValueError) where there is no compiler, it fails, or JAWARI_NATIVE names something else.
    """
    for path in prebuilt.places():
        if path.is_file() and not prebuilt.unfit(path) and library.sources_of(path) == library.sources_version():
            return path
    if os.environ.get("JAWARI_NATIVE", "") not in ("", "0"):  # what lies there may be anything: it is not written over
        raise library.BuildError(
            f"JAWARI_NATIVE={path} is not a native library of these sources; unset it to have one built"
        )
    place = prebuilt.places()[-1]
    with naming(place.parent):
        place.parent.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=".native-", dir=place.parent.parent))
    try:
        about = None if say is None else lambda what: say(f"building the native library, once on this machine: {what}")
        built = library.build(made, say=about)
        with naming(place):
            place.parent.mkdir(mode=0o700, exist_ok=True)
            os.replace(built, place)
    finally:
        shutil.rmtree(made, ignore_errors=True)
    _clear(place.parent)
    return place


def web_library(say: Callable[[str], None] | None = None) -> Path:
    """The engine as WebAssembly, for these sources. say: told what takes time.

    Raises `library.BuildError` where there is none.
    """
    for path in prebuilt.places():
        if (found := path.with_name(WEB.library)).is_file():
            return found
    raise library.BuildError(f"this installation has no engine for web pages ({WEB.library})")


def _clear(mine: Path) -> None:
    """Take away the oldest of those that were built for other sources."""
    others = [each for each in mine.parent.glob("native-*") if each != mine]
    for old in sorted(others, key=lambda path: path.stat().st_mtime)[: -KEEP or None]:
        shutil.rmtree(old, ignore_errors=True)
