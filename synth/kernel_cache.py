"""Where compiled kernels are kept between runs.

Numba keeps them beside the source and looks only at the file that holds the kernel: after an update of another file
that it calls, the old machine code would go on being used. So the cache is a folder of the user's, named by a hash over
all sources that kernels are made of; a changed source is another folder, and the oldest folders go.
NUMBA_CACHE_DIR, if set, is left alone.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import sys
from contextlib import suppress
from pathlib import Path

KEEP = 8


def cache_folder() -> Path:
    """The folder for the sources as they are now (not created)."""
    package = Path(__file__).resolve().parent
    digest = hashlib.blake2b(os.environ.get("JAWARI_LANES", "").encode(), digest_size=8)
    for path in sorted(package.rglob("*.py")):
        content = path.read_bytes()
        # the engine's constants are compiled in, and so is what intrinsics emit
        if b"njit" in content or b"intrinsic" in content or path.parent.name == "engine":
            digest.update(str(path.relative_to(package)).encode())
            digest.update(content)
    if sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "jawari" / f"kernels-{digest.hexdigest()}"


def use() -> None:
    """Point numba there; to be called before numba is imported."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    with suppress(OSError, RuntimeError):  # no home or unreadable source: numba falls back to its own place
        folder = cache_folder()
        if not folder.is_dir():
            folder.mkdir(parents=True)
            kept = sorted(folder.parent.glob("kernels-*"), key=lambda path: path.stat().st_mtime)
            for old in kept[:-KEEP]:
                shutil.rmtree(old, ignore_errors=True)
        os.environ["NUMBA_CACHE_DIR"] = str(folder)
