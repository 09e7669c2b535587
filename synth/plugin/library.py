"""The native library: kernels for the levels of processors, the C sources, one shared object.

    path = build(Path("native"))                                    # native/libjawari.so, for this machine
    path = build(Path("native"), target=TARGETS["windows-x86-64"])  # native/jawari.dll
    plugin = with_bank(path, bank(presets))                         # its bytes with a bank behind them

For this machine it is made with its C compiler, or with zig's of the package `ziglang` where there is none; for others
always with zig's. It needs the C library and libm, nothing else (`links`).
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import synth
from synth.jit.kernel_sources import sources_id
from synth.plugin.c_sources import SOURCES, Kind, sources
from synth.plugin.emit import LEVELS, EmitError, emit
from synth.plugin.links import EXPORTED, KERNELS_MARK, SOURCES_MARK, compiling, linking, made
from synth.plugin.platforms import TARGETS, Target, host

NAME = TARGETS["linux-x86-64"].library
#: behind a bank: where it begins (8 bytes), and this
FOOT = b"JAWARIFT"
_PAGE = 4096
#: modules that say how a library is put together
_PUT_TOGETHER = ("library", "links", "c_sources", "emit", "retarget", "one_rounding", "wasm_memory")
#: makes the object of a level at a path
Kernels = Callable[[str, Path, Target], None]

__all__ = [
    "EXPORTED",
    "LEVELS",
    "NAME",
    "SOURCES",
    "BuildError",
    "EmitError",
    "build",
    "compiler",
    "kernels_version",
    "sources_of",
    "sources_version",
    "version_of",
    "with_bank",
    "zig",
]


class BuildError(ValueError):
    """The library could not be made."""


def kernels_version() -> str:
    """What tells the kernels of these sources from others' (`jawari_kernels_version`)."""
    return sources_id()


def sources_version() -> str:
    """As `kernels_version`, of the C sources and of how they are put together too: a library of another is out of date."""
    digest = hashlib.blake2b(sources_id().encode(), digest_size=8)
    for path in (*(Path(__file__).with_name(f"{name}.py") for name in _PUT_TOGETHER), *sorted(SOURCES.glob("*.[ch]"))):
        digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()


def compiler() -> list[str]:
    """The command of a C compiler. Raises BuildError where there is none."""
    chosen = os.environ.get("CC") or shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if chosen:
        return chosen.split()
    if (found := zig()) is not None:
        return found
    raise BuildError("there is no C compiler; install one (Debian: apt-get install gcc), or: pip install ziglang")


def zig(target: Target = TARGETS["linux-x86-64"]) -> list[str] | None:
    """The command of the C compiler in the package `ziglang`, which links for old systems; None: it is not there."""
    if importlib.util.find_spec("ziglang") is None:
        return None
    return [sys.executable, "-m", "ziglang", "cc", "-target", target.zig]


def build(
    folder: Path,
    levels: Sequence[str] | None = None,
    say: Callable[[str], None] | None = None,
    *,
    target: Target | None = None,
    kind: Kind | None = None,
    flags: Sequence[str] = (),
    command: Sequence[str] | None = None,
    kernels: Kernels | None = None,
) -> Path:
    """Make the library in a folder, which is made too; where it is then.

    levels: of processors that it is for, if not all of the target. say: told what is being done. target: the system that
    it is for, if not this one. kind: of what it is made; None: of all formats, for pages of the engine. flags: more for
    compiler and linker. command: of the C compiler, if not `compiler()`'s, or zig's for another target. kernels: makes the
    objects of levels, if not `emit`.
    Raises ValueError for a level that there is not, EmitError or BuildError where kernels or C cannot be compiled, OSError.
    """
    say = say or (lambda text: None)
    here = host() or TARGETS["linux-x86-64"]
    target = target or here
    kind = kind or ("engine" if target.system == "web" else "plugin")
    levels = target.levels if levels is None else levels
    command = command or (compiler() if target == here else _cross_compiler(target))
    kernels = kernels or emit
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".building-") as temporary:
        place = Path(temporary)
        told = made(levels, version=synth.__version__, kernels=kernels_version(), sources=sources_version())
        (place / "levels.c").write_text(told, encoding="utf-8")
        objects = []
        for source in (place / "levels.c", *sources(target, kind)):  # first: a compiler that fails does so at once
            objects.append(place / f"{source.stem}.o")
            _run([*command, *compiling(target), *flags, f"-I{SOURCES}", "-c", str(source), "-o", str(objects[-1])])
        for level in levels:
            say(f"kernels for {level}")
            objects.append(place / f"{level}.o")
            kernels(level, objects[-1], target)
        say("the library")
        whole = place / target.library
        stripped = [] if flags else ["-s"]
        linked = linking(target, kind, place)
        _run([*command, "-fPIC", *flags, *stripped, "-o", str(whole), *map(str, objects), *linked])
        whole.replace(folder / target.library)
    return folder / target.library


def _cross_compiler(target: Target) -> list[str]:
    command = zig(target)
    if command is None:
        raise BuildError(f"{target.name} needs a compiler for other systems: pip install ziglang")
    return command


def with_bank(library: Path, bank: bytes) -> bytes:
    """The bytes of a library or plugin with a bank behind them, instead of the one that it may have. Raises OSError."""
    own = _without_bank(library.read_bytes())
    begin = -(-len(own) // _PAGE) * _PAGE
    return own.ljust(begin, b"\0") + bank + begin.to_bytes(8, "little") + FOOT


def version_of(library: Path) -> str | None:
    """The `kernels_version` that a library was built with; None: it is none. Raises OSError."""
    return _marked(library, KERNELS_MARK.encode())


def sources_of(library: Path) -> str | None:
    """The `sources_version` that a library was built from; None: it is none. Raises OSError."""
    return _marked(library, SOURCES_MARK.encode())


def _marked(library: Path, mark: bytes) -> str | None:
    data = library.read_bytes()
    at = data.find(mark)
    if at < 0:
        return None
    end = data.find(b"\0", at)
    return data[at + len(mark) : end].decode("ascii", errors="replace")


def _without_bank(data: bytes) -> bytes:
    if data[-len(FOOT) :] != FOOT:
        return data
    begin = int.from_bytes(data[-len(FOOT) - 8 : -len(FOOT)], "little")
    return data[:begin]


def _run(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        wrong = (
            [line for line in done.stderr.splitlines() if "error" in line]
            or done.stderr.splitlines()
            or ["it gave no reason"]
        )
        raise BuildError(f"{command[0]} could not make the library: {wrong[0].strip()}")
