"""What compiled kernels are made of, and where a user's are kept."""

from __future__ import annotations

import hashlib
import os
import sys
from functools import cache
from pathlib import Path

#: rooms whose constants and plain functions kernels are made of
_COMPILED_IN = ("dsp", "engine", "midi", "native", "solver", "units.py")


@cache
def sources_id() -> str:
    """(16 hexadecimal digits) what tells the sources of kernels from others, as they were when it was asked for first."""
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.blake2b(digest_size=8)
    for path in sorted(package.rglob("*.py")):
        content = path.read_bytes()
        # their constants are compiled in, what intrinsics emit, and how arrays and events are declared
        own = path.relative_to(package).parts[0] in _COMPILED_IN or path.name == "excitations.py"
        if own or b"njit" in content or b"intrinsic" in content:
            digest.update(str(path.relative_to(package)).encode())
            digest.update(content)
    return digest.hexdigest()


def users_cache() -> Path:
    """The user's folder for what can be made again (not created). Raises RuntimeError where there is no home directory."""
    if asked := os.environ.get("XDG_CACHE_HOME"):
        base = Path(asked)
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    elif sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    else:
        base = Path.home() / ".cache"
    return base / "jawari"
