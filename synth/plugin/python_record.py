"""Where plugins find this Python: a file in the user's cache that names its interpreter and the folder of this package.

Plugins of the same kernels read it (c/plugin_python.c) to change a preset's setup. A plugin itself names no path: it may be
copied to others.
"""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

from synth.files.targets import write_text
from synth.jit.kernel_sources import sources_id, users_cache


def path() -> Path:
    """The file. Raises RuntimeError where there is no home directory."""
    return users_cache() / f"python-{sources_id()}"


def write() -> None:
    """Write it, unless JAWARI_PYTHON tells plugins otherwise; where that cannot be, they only show the setup, which is no
    reason to fail."""
    packages = Path(__file__).resolve().parents[2]
    if os.environ.get("JAWARI_PYTHON") or not sys.executable or "\n" in f"{sys.executable}{packages}":
        return
    with contextlib.suppress(OSError, RuntimeError):
        path().parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_text(path(), f"{sys.executable}\n{packages}\n", 0o600)
