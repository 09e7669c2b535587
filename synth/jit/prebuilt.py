"""Kernels from the native library, where there is one that fits: nobody waits for a compiler then.

The library (`synth.plugin.library`) holds what an engine is made of, compiled from the same sources for the same level of
processor, and computes the same bits. It is taken where it comes with the package or lies in the user's cache, if it was
made from the sources as they are and nothing asks for another target; else Numba compiles, as without it. JAWARI_NATIVE=0
leaves it out, JAWARI_NATIVE=PATH takes that one, if it fits.

With JAWARI_BITS=portable (`synth render --bits portable`) the portable library of JAWARI_NATIVE is the only one that will
do: kernels that Numba compiles round otherwise.
"""

from __future__ import annotations

import ctypes
import functools
import os
import struct
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from synth.jit.kernel_sources import sources_id, users_cache
from synth.native.processors import level

NAME = {"win32": "jawari.dll", "darwin": "libjawari.dylib"}.get(sys.platform, "libjawari.so")
_PACKAGE = __name__.partition(".")[0] + "."
#: bytes in which a shared object says how long it is
_HEAD = 4096


def name_of(function: Callable[..., Any]) -> str:
    """What a plain function is called in the library: module:function, modules of this package from below it."""
    return f"{function.__module__.removeprefix(_PACKAGE)}:{function.__qualname__}"


def compiled_for() -> str | None:
    """The name of what a library holds for this processor: its level, or that of every 64-bit ARM; None: nothing."""
    from llvmlite import binding

    if bits() == "portable":
        return "portable"
    return "aarch64" if binding.get_process_triple().startswith(("aarch64", "arm64")) else level()


def bits() -> str:
    """The arithmetic of this process: "fast", or "portable", the same on every processor."""
    return "portable" if os.environ.get("JAWARI_BITS") == "portable" else "fast"


def folders() -> list[Path]:
    """Where libraries may lie: with the package, and in the user's cache."""
    with_package = Path(__file__).resolve().parents[1] / "plugin" / "lib"
    try:
        return [with_package, users_cache() / f"native-{sources_id()}"]
    except RuntimeError:  # no home
        return [with_package]


def places() -> list[Path]:
    """Where this machine's library may lie: where JAWARI_NATIVE says, or else in `folders`."""
    if (asked := os.environ.get("JAWARI_NATIVE", "")) not in ("", "0"):
        return [Path(asked)]
    return [folder / NAME for folder in folders()]


def _another_kind_asked() -> str:
    """What of the environment asks for other kernels than a library has, in a sentence; empty: nothing."""
    if os.environ.get("JAWARI_NATIVE") == "0":
        return "JAWARI_NATIVE=0 leaves it out"
    if bits() == "portable":  # whose settings are for what Numba compiles besides
        return ""
    for name in ("JAWARI_LANES", "NUMBA_DISABLE_JIT", "NUMBA_BOUNDSCHECK", "NUMBA_CPU_FEATURES"):
        if os.environ.get(name, "") not in ("", "0"):
            return f"{name} asks for kernels of another kind"
    if (name := os.environ.get("NUMBA_CPU_NAME", "")) not in ("", compiled_for()):
        return f"NUMBA_CPU_NAME asks for {name}"
    return ""


def unfit(path: Path) -> str:
    """Why a file is not to be run, in a sentence; empty: it may be. Raises OSError.

    It must be what the user names, root's, their own, or of whoever owns this code, which runs already; and it must have its
    end: a process that loads a shared object without one is killed.
    """
    with open(path, "rb") as file:
        about, head = os.fstat(file.fileno()), file.read(_HEAD)
    if not os.environ.get("JAWARI_NATIVE") and hasattr(os, "getuid"):  # on Windows modes do not tell who may write
        if about.st_uid not in (0, os.getuid(), Path(__file__).stat().st_uid):
            return f"{path} belongs to another user"
        if (about.st_mode | path.parent.stat().st_mode) & 0o002:
            return f"{path} can be written by anybody"
    if _end(head) > about.st_size:
        return f"{path} has lost its end"
    return ""


def _end(head: bytes) -> int:
    """How long a shared object must be at least, by its beginning; 0: it is none, or has lost more than its end."""
    try:
        if head[:6] == b"\x7fELF\x02\x01":  # its sections are described at its end
            (begin,), (each, count) = struct.unpack_from("<Q", head, 0x28), struct.unpack_from("<HH", head, 0x3A)
            return begin + each * count
        if head[:4] == b"\xcf\xfa\xed\xfe":
            return max(_segment_ends(head), default=0)
        if head[:2] == b"MZ":
            return max(_section_ends(head), default=0)
    except struct.error:  # so short that its loader refuses it
        return 0
    return 0


def _segment_ends(head: bytes) -> Iterator[int]:
    """Where the segments of a Mach-O file of one processor end."""
    (count,), at = struct.unpack_from("<I", head, 16), 32
    for _ in range(count):
        kind, size = struct.unpack_from("<2I", head, at)
        if kind == 0x19:  # LC_SEGMENT_64
            yield sum(struct.unpack_from("<2Q", head, at + 40))
        at += size


def _section_ends(head: bytes) -> Iterator[int]:
    """Where the sections of a DLL end."""
    (at,) = struct.unpack_from("<I", head, 0x3C)
    (count,), (optional,) = struct.unpack_from("<H", head, at + 6), struct.unpack_from("<H", head, at + 20)
    for number in range(count):
        yield sum(struct.unpack_from("<2I", head, at + 24 + optional + 40 * number + 16))


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
        if uses is None or uses.decode() != compiled_for():
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
    """What is there; looked for once. Raises ValueError where there is none and bits are to be portable."""
    made = Found()
    if made.path is None and bits() == "portable":
        raise ValueError(f"JAWARI_BITS=portable: there is no portable library ({made.why}); use --bits portable instead")
    return made
