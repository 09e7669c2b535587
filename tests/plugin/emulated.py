"""Programs of other systems and processors: how they are made and started here."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from synth.plugin import library
from synth.plugin.c_sources import SOURCES
from synth.plugin.platforms import Target

HERE = Path(__file__).parent


def started(target: Target, processor: str = "") -> list[str]:
    """How a program of another system or processor is started here."""
    if target.system == "windows":
        wine = shutil.which("wine64") or shutil.which("wine64", path="/usr/lib/wine")
        if wine is None:
            pytest.skip("Wine is not installed (apt-get install wine64)")
        return [wine]
    if target.processor == "x86-64":
        if shutil.which("qemu-x86_64") is None:
            pytest.skip("there is no other x86-64 here (apt-get install qemu-user)")
        return ["qemu-x86_64", "-cpu", processor]
    folder = Path("/usr/aarch64-linux-gnu")
    if shutil.which("qemu-aarch64") is None or not folder.is_dir():
        pytest.skip("there is no AArch64 here (apt-get install qemu-user libc6-arm64-cross)")
    return ["qemu-aarch64", "-L", str(folder)]


def compiled(source: str, target: Target, folder: Path) -> Path:
    """A program of the tests for a target; stripped, as libraries are: zig compiles its C library for either kind anew, for
    Windows in a minute."""
    program = folder / f"{Path(source).stem}-{target.name}.exe"
    command = library.zig(target)
    if command is None:
        pytest.skip("there is no compiler for other systems (pip install ziglang)")
    more = ["-ldl"] if target.system == "linux" else []
    flags = ["-std=c11", "-O1", "-s", "-Wall", "-Wextra", "-Werror", f"-I{SOURCES}"]
    run([*command, *flags, "-o", str(program), str(HERE / source), *more])
    return program


def run(command: Sequence[str], **more: Any) -> str:
    """What a program says. Raises AssertionError where it fails."""
    done = subprocess.run(command, capture_output=True, text=True, check=False, **more)
    assert done.returncode == 0, done.stderr or f"exit code {done.returncode}"
    return done.stdout
