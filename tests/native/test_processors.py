"""What Numba compiles for."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from llvmlite import binding

from synth.native.processors import level

V2 = ("cx16", "popcnt", "sse3", "ssse3", "sse4.1", "sse4.2")
V3 = ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
V4 = ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")


@pytest.mark.parametrize(
    ("features", "name"),
    [
        (V2, None),
        (V2 + V3, "x86-64-v3"),
        (V2 + V3[1:], None),
        (V2 + V3 + V4[1:], "x86-64-v3"),
        (V2 + V3 + V4, "x86-64-v4"),
        (V2 + V4, None),
    ],
)
def test_a_level_is_had_with_all_that_it_asks_for(monkeypatch, features: tuple[str, ...], name: str | None) -> None:
    monkeypatch.setattr(binding, "get_process_triple", lambda: "x86_64-unknown-linux-gnu")
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: dict.fromkeys(features, True))
    assert level() == name


def test_other_processors_have_none(monkeypatch) -> None:
    monkeypatch.setattr(binding, "get_process_triple", lambda: "aarch64-apple-darwin")
    assert level() is None


def compiled_for(program: str, **more: str) -> list[str]:
    """Numba's target and how many lanes there are, after a program."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_CPU", "JAWARI_LANES"))}
    look = "\nfrom numba.core.registry import cpu_target\nfrom synth.native.simd import LANES\n"
    look += "print(cpu_target.target_context.codegen().magic_tuple()[1], LANES)"
    done = subprocess.run(
        [sys.executable, "-c", program + look], env=environment | more, capture_output=True, text=True, check=True
    )
    return done.stdout.split()


@pytest.mark.skipif(level() is None, reason="this processor has no level")
def test_kernels_are_compiled_for_the_level_unless_another_target_is_asked_for_or_numba_was_there_before() -> None:
    host = binding.get_host_cpu_name()
    lanes = {"x86-64-v3": "4", "x86-64-v4": "8"}
    here = str(level())
    assert compiled_for("import synth") == [here, lanes[here]]
    asked = compiled_for("import synth", NUMBA_CPU_NAME="x86-64-v3", NUMBA_CPU_FEATURES="")
    assert asked == ["x86-64-v3", "4"]
    assert compiled_for("import numba, synth")[0] == host
