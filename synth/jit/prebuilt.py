"""Kernels from the native library, where there is one that fits: nobody waits for a compiler then.

The library (`synth.plugin.library`) holds what an engine is made of, compiled from the same sources for the same level of
processor, and computes the same bits. It is taken where it comes with the package or lies in the user's cache, if it was
made from the sources as they are and nothing asks for another target; else Numba compiles, as without it. JAWARI_NATIVE=0
leaves it out, JAWARI_NATIVE=PATH takes that one, if it fits.
"""

from __future__ import annotations

import ctypes
import functools
import os
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

from synth.jit.kernel_sources import sources_id, users_cache
from synth.native.processors import level

NAME = "libjawari.so"
_PACKAGE = __name__.partition(".")[0] + "."


def name_of(function: Callable[..., Any]) -> str:
    """What a plain function is called in the library: module:function, modules of this package from below it."""
    return f"{function.__module__.removeprefix(_PACKAGE)}:{function.__qualname__}"


def places() -> list[Path]:
    """Where a library may lie: where JAWARI_NATIVE says, or else with the package, and in the user's cache."""
    if (asked := os.environ.get("JAWARI_NATIVE", "")) not in ("", "0"):
        return [Path(asked)]
    with_package = Path(__file__).resolve().parents[1] / "plugin" / "lib" / NAME
    try:
        return [with_package, users_cache() / f"native-{sources_id()}" / NAME]
    except RuntimeError:  # no home
        return [with_package]


def _another_kind_asked() -> str:
    """What of the environment asks for other kernels than a library has, in a sentence; empty: nothing."""
    if os.environ.get("JAWARI_NATIVE") == "0":
        return "JAWARI_NATIVE=0 leaves it out"
    for name in ("JAWARI_LANES", "NUMBA_DISABLE_JIT", "NUMBA_BOUNDSCHECK", "NUMBA_CPU_FEATURES"):
        if os.environ.get(name, "") not in ("", "0"):
            return f"{name} asks for kernels of another kind"
    if (name := os.environ.get("NUMBA_CPU_NAME", "")) not in ("", level()):
        return f"NUMBA_CPU_NAME asks for {name}"
    return ""


def unfit(path: Path) -> str:
    """Why a file is not to be run, in a sentence; empty: it may be. Raises OSError.

    It must be what the user names, root's, their own, or of whoever owns this code, which runs already; and it must have its
    end, where its sections are described: a process that loads a shared object without one is killed.
    """
    with open(path, "rb") as file:
        about, head = os.fstat(file.fileno()), file.read(64)
    trusted = (0, os.getuid() if hasattr(os, "getuid") else 0, Path(__file__).stat().st_uid)
    if not os.environ.get("JAWARI_NATIVE") and about.st_uid not in trusted:
        return f"{path} belongs to another user"
    if not os.environ.get("JAWARI_NATIVE") and (about.st_mode | path.parent.stat().st_mode) & 0o002:
        return f"{path} can be written by anybody"
    if len(head) == 64 and head[:6] == b"\x7fELF\x02\x01":
        (begin,), (each, count) = struct.unpack_from("<Q", head, 0x28), struct.unpack_from("<HH", head, 0x3A)
        if begin + each * count > about.st_size:
            return f"{path} has lost its end"
    return ""


class Found:
    """The library that is used, or `why` none is."""

    def __init__(self) -> None:
        self.path: Path | None = None
        self._library: Any = None
        self.why = _another_kind_asked()
        if self.why:
            return
        for path in places():
            try:
                why = self._take(path)
            except (OSError, AttributeError) as error:
                why = f"{path} cannot be loaded: {error}"
            if self.path is not None:
                self.why = ""
                return
            self.why = self.why or why
        if not self.why:
            self.why = f"{places()[0]}: there is no such file" if os.environ.get("JAWARI_NATIVE") else "there is none"

    def _take(self, path: Path) -> str:
        """Use the library of this place, or say why not; nothing, if nothing is there. Raises OSError, AttributeError."""
        if not path.is_file():
            return ""
        if why := unfit(path):
            return why
        library = ctypes.CDLL(str(path))
        library.jawari_kernels_version.restype = ctypes.c_char_p
        library.jawari_processor.restype = ctypes.c_char_p
        library.jawari_kernel.restype = ctypes.c_void_p
        if library.jawari_kernels_version().decode() != sources_id():
            return f"{path} was made from other sources"
        refused = ctypes.create_string_buffer(512)
        uses = library.jawari_processor(refused)
        if uses is None or uses.decode() != level():
            return refused.value.decode() or f"{path} has no code for this processor"
        self.path, self._library = path, library
        return ""

    def address(self, function: Callable[..., Any]) -> int | None:
        """Of a plain function as compiled there, None: it is not in there."""
        if self._library is None or not function.__module__.startswith(_PACKAGE):
            return None
        return self._library.jawari_kernel(name_of(function).encode())


@functools.cache
def found() -> Found:
    """What is there; looked for once."""
    return Found()
