"""The native library: kernels for the levels of processors, the C sources, one shared object.

    path = build(Path("native"))              # native/libjawari.so
    plugin = with_bank(path, bank(presets))   # its bytes with a bank behind them

It is made with the machine's C compiler, or with zig's of the package `ziglang` where there is none; it needs the C library
and libm, nothing else.
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
from synth.plugin.emit import LEVELS, EmitError, emit

#: the folder of the C sources
SOURCES = Path(__file__).resolve().parent / "c"
NAME = "libjawari.so"
#: what is seen from outside: the core's interface, and where hosts enter
EXPORTED = ("jawari_*", "clap_entry", "GetPluginFactory", "ModuleEntry", "ModuleExit", "lv2_descriptor")
#: oldest C library that what zig links runs with
ZIG_TARGET = "x86_64-linux-gnu.2.17"
#: behind a bank: where it begins (8 bytes), and this
FOOT = b"JAWARIFT"
_KERNELS_MARK, _SOURCES_MARK = b"jawari-kernels:", b"jawari-sources:"
_PAGE = 4096
#: what packed banks are made of again (bank_predict.c) must round as it stands
_FLAGS = (
    "-std=c11",
    "-O2",
    "-ffp-contract=off",
    "-fPIC",
    "-fvisibility=hidden",
    "-Wall",
    "-Wextra",
    "-Wshadow",
    "-Wconversion",
)
#: a plugin's calls within itself stay there, also where a host loads several for all to see (-Bsymbolic)
_LINK = ("-shared", "-Wl,-Bsymbolic", "-Wl,-z,defs", "-Wl,-z,relro", "-Wl,-z,now", "-Wl,--gc-sections")

__all__ = [
    "EXPORTED",
    "LEVELS",
    "NAME",
    "BuildError",
    "EmitError",
    "build",
    "kernels_version",
    "sources_of",
    "sources_version",
    "version_of",
    "with_bank",
]


class BuildError(ValueError):
    """The library could not be made."""


def kernels_version() -> str:
    """What tells the kernels of these sources from others' (`jawari_kernels_version`)."""
    return sources_id()


def sources_version() -> str:
    """As `kernels_version`, of the C sources and of how they are put together too: a library of another is out of date."""
    digest = hashlib.blake2b(sources_id().encode(), digest_size=8)
    for path in (Path(__file__), Path(__file__).with_name("emit.py"), *sorted(SOURCES.glob("*.[ch]"))):
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


def zig() -> list[str] | None:
    """The command of the C compiler in the package `ziglang`, which links for an old C library; None: it is not there."""
    if importlib.util.find_spec("ziglang") is None:
        return None
    return [sys.executable, "-m", "ziglang", "cc", "-target", ZIG_TARGET]


def build(
    folder: Path,
    levels: Sequence[str] = LEVELS,
    say: Callable[[str], None] | None = None,
    *,
    flags: Sequence[str] = (),
    command: Sequence[str] | None = None,
) -> Path:
    """Make the library in a folder, which is made too; where it is then.

    levels: of processors that it is for. say: told what is being done. flags: more for compiler and linker.
    command: of the C compiler, if not `compiler()`'s.
    Raises ValueError for a level that there is not, EmitError or BuildError where kernels or C cannot be compiled, OSError.
    """
    say = say or (lambda text: None)
    command = command or compiler()
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix=".building-") as temporary:
        place = Path(temporary)
        script = place / "exported.map"
        script.write_text("{ global: " + " ".join(f"{name};" for name in EXPORTED) + " local: *; };\n", encoding="ascii")
        defined = [f"-DJAWARI_HAS_{level.replace('-', '_')}=1" for level in levels]
        defined += [f'-DJAWARI_VERSION="{synth.__version__}"', f'-DJAWARI_KERNELS="{kernels_version()}"']
        defined += [f'-DJAWARI_SOURCES="{sources_version()}"']
        objects = []
        for source in sorted(SOURCES.glob("*.c")):  # first: a compiler that fails does so at once
            objects.append(place / f"{source.stem}.o")
            _run([*command, *_FLAGS, *flags, *defined, "-c", str(source), "-o", str(objects[-1])])
        for level in levels:
            say(f"kernels for {level}")
            objects.append(place / f"{level}.o")
            emit(level, objects[-1])
        say("the library")
        made = place / NAME
        stripped = [] if flags else ["-s"]
        linked = [*_LINK, f"-Wl,--version-script={script}", "-lm", "-lpthread", "-ldl"]
        _run([*command, "-fPIC", *flags, *stripped, "-o", str(made), *map(str, objects), *linked])
        made.replace(folder / NAME)
    return folder / NAME


def with_bank(library: Path, bank: bytes) -> bytes:
    """The bytes of a library or plugin with a bank behind them, instead of the one that it may have. Raises OSError."""
    own = _without_bank(library.read_bytes())
    begin = -(-len(own) // _PAGE) * _PAGE
    return own.ljust(begin, b"\0") + bank + begin.to_bytes(8, "little") + FOOT


def version_of(library: Path) -> str | None:
    """The `kernels_version` that a library was built with; None: it is none. Raises OSError."""
    return _marked(library, _KERNELS_MARK)


def sources_of(library: Path) -> str | None:
    """The `sources_version` that a library was built from; None: it is none. Raises OSError."""
    return _marked(library, _SOURCES_MARK)


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
