"""Systems and processors that plugins are made for, each with what compilers, linkers and hosts call it.

    target = TARGETS["windows-x86-64"]
    host()                          # the target of this machine, None: it is none of them

`web` is the engine as WebAssembly, whose host is a page or another program: it has no formats of its own here.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Target:
    """A system on a kind of processor.

    name         as `synth export --target` takes it
    system       "linux", "windows", "macos" or "web": the C file of what differs between them, c/system_NAME.c
    processor    "x86-64", "arm64" or "wasm32"
    triple       LLVM's name
    zig          the name that `zig cc -target` takes, with the oldest system that the result runs on
    levels       of processors that a library holds kernels for, the plainest first (`emit`)
    library      file name of the native library
    suffix       of a shared object in a bundle
    vst3_folder  the folder below Contents in which a VST3 has it
    wheel        platform tag of a wheel; empty: it has none, or what its symbols need tells it
    """

    name: str
    system: str
    processor: str
    triple: str
    zig: str
    levels: tuple[str, ...]
    library: str
    suffix: str
    vst3_folder: str
    wheel: str = ""


_X86 = ("x86-64-v3", "x86-64-v4")

TARGETS: Mapping[str, Target] = {
    each.name: each
    for each in (
        Target(
            "linux-x86-64",
            "linux",
            "x86-64",
            "x86_64-unknown-linux-gnu",
            "x86_64-linux-gnu.2.17",
            _X86,
            "libjawari.so",
            ".so",
            "x86_64-linux",
        ),
        Target(
            "linux-arm64",
            "linux",
            "arm64",
            "aarch64-unknown-linux-gnu",
            "aarch64-linux-gnu.2.17",
            ("aarch64",),
            "libjawari.so",
            ".so",
            "aarch64-linux",
        ),
        Target(
            "windows-x86-64",
            "windows",
            "x86-64",
            "x86_64-pc-windows-gnu",
            "x86_64-windows-gnu",
            _X86,
            "jawari.dll",
            ".dll",
            "x86_64-win",
            "win_amd64",
        ),
        Target(
            "macos-arm64",
            "macos",
            "arm64",
            "arm64-apple-macosx11.0.0",
            "aarch64-macos.11.0",
            ("aarch64",),
            "libjawari.dylib",
            ".dylib",
            "MacOS",
            "macosx_11_0_arm64",
        ),
        Target(
            "macos-x86-64",
            "macos",
            "x86-64",
            "x86_64-apple-macosx11.0.0",
            "x86_64-macos.11.0",
            _X86,
            "libjawari.dylib",
            ".dylib",
            "MacOS",
            "macosx_11_0_x86_64",
        ),
    )
}
#: for pages: one thread, no files
WEB = Target("web", "web", "wasm32", "wasm32-unknown-wasi", "wasm32-wasi", ("portable",), "jawari.wasm", ".wasm", "")
#: the same with instructions that not every browser has yet, and that round as the processor likes
WEB_RELAXED = replace(WEB, name="web-relaxed", levels=("relaxed",), library="jawari-relaxed.wasm")
#: kinds of arithmetic: each processor's own instructions, or those that give the same bits on all
BITS = ("fast", "portable")
#: what stands in a library of one rounding everywhere, instead of the levels
PORTABLE = ("portable",)


def host() -> Target | None:
    """The target of this machine, None: it is none of them."""
    system = {"linux": "linux", "win32": "windows", "darwin": "macos"}.get(sys.platform, sys.platform)
    processor = {"x86_64": "x86-64", "AMD64": "x86-64", "aarch64": "arm64", "arm64": "arm64"}.get(platform.machine(), "")
    return TARGETS.get(f"{system}-{processor}")
