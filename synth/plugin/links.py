"""How C is compiled and linked for a target: flags, and the source that tells the library of what it is made.

    flags = compiling(target)
    text = made(["x86-64-v3"], version="0.12.0", kernels="…", sources="…")     # of `struct core_made`, c/core.h

A target's are those that its system takes (`platforms`); what they link needs the C library and nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from synth.plugin.c_sources import Kind
from synth.plugin.emit import table_symbol
from synth.plugin.platforms import Target

#: what is seen from outside: the core's interface, and where hosts enter
EXPORTED = ("jawari_*", "clap_entry", "GetPluginFactory", "ModuleEntry", "ModuleExit", "lv2_descriptor")
#: by which a library is known without being loaded
KERNELS_MARK, SOURCES_MARK = "jawari-kernels:", "jawari-sources:"
#: least level of processor (c/processor.h) that kernels run on, where not every one will do
_LEAST: Mapping[str, int] = {"x86-64-v3": 3, "x86-64-v4": 4}

# sums and products are rounded as they are written, on processors that could do both at once too
_FLAGS = ("-std=c11", "-fPIC", "-fvisibility=hidden", "-ffp-contract=off", "-Wall", "-Wextra", "-Wshadow", "-Wconversion")
_SPEED: Mapping[str, tuple[str, ...]] = {"web": ("-O3", "-msimd128")}
#: a plugin's calls within itself stay there, also where a host loads several for all to see (-Bsymbolic)
_BOUND = ("-shared", "-Wl,-Bsymbolic", "-Wl,-z,defs", "-Wl,-z,relro", "-Wl,-z,now", "-Wl,--gc-sections")
_LINUX = (*_BOUND, "-lm", "-lpthread", "-ldl")
_WINDOWS = ("-shared", "-Wl,--gc-sections")
#: with room in its head for a signature to be named
_MACOS = ("-shared", "-Wl,-dead_strip", "-Wl,-headerpad,0x400")
_WEB = ("-mexec-model=reactor", "-Wl,--gc-sections", "-Wl,-z,stack-size=1048576", "-Wl,--export-dynamic")
#: what a host of CLAPs in WebAssembly writes into: memory for its own records, and the table of functions
_WEB_CLAP = ("-Wl,--export=malloc", "-Wl,--export=free", "-Wl,--export-table", "-Wl,--growable-table")


def compiling(target: Target) -> tuple[str, ...]:
    """Flags of the compiler."""
    return (*_FLAGS, *_SPEED.get(target.system, ("-O2",)))


def linking(target: Target, kind: Kind, place: Path) -> tuple[str, ...]:
    """Flags of the linker, behind the objects. Files that it needs are written to a folder. Raises OSError."""
    if target.system == "linux":
        script = place / "exported.map"
        script.write_text("{ global: " + " ".join(f"{name};" for name in EXPORTED) + " local: *; };\n", encoding="ascii")
        return (*_LINUX, f"-Wl,--version-script={script}")
    if target.system == "macos":
        return (*_MACOS, f"-Wl,-install_name,@rpath/{target.library}")
    if target.system == "windows":
        return _WINDOWS
    return _WEB if kind == "engine" else (*_WEB, *_WEB_CLAP)


def made(levels: Sequence[str], *, version: str, kernels: str, sources: str) -> str:
    """A C source: what a library of these levels is made of."""
    ordered = sorted(levels, key=lambda level: (_LEAST.get(level, 0), level != "portable"))
    declared = [
        f'extern const struct kernels {table_symbol(level)} __attribute__((visibility("hidden")));' for level in ordered
    ]
    rows = [f'{{"{level}", {_LEAST.get(level, 0)}, &{table_symbol(level)}}}' for level in ordered]
    marks = f'"{KERNELS_MARK}{kernels}\\0" "{SOURCES_MARK}{sources}"'
    lines = ['#include "core.h"', *declared, "const struct core_made core_made = {"]
    lines += [f'    "{version}", {marks}, {len(ordered)}, {{{", ".join(rows)}}}', "};"]
    return "\n".join(lines) + "\n"
