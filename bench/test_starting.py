"""Start-up, compile time and memory: each in a process of its own, wall-clock time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench import REPOSITORY


def _run(*arguments: str, **variables: str) -> tuple[float, str]:
    """Seconds and standard output of a Python program with the package's own place for kernels."""
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"} | variables
    started = time.perf_counter()
    done = subprocess.run(
        [sys.executable, *arguments], cwd=REPOSITORY, env=environment, capture_output=True, text=True, check=True
    )
    return time.perf_counter() - started, done.stdout


def _note(benchmark: Any, what: str, unit: str, values: list[float]) -> None:
    benchmark.extra_info.update(section="start", what=what, unit=unit, median=float(np.median(values)), best=min(values))


@pytest.mark.parametrize(
    ("what", "program"),
    [
        ("Python alone", "pass"),
        ("import synth", "import synth"),
        ("import synth, its engine loaded", "import synth; synth.Engine"),
    ],
)
def test_import(benchmark: Any, what: str, program: str, short: bool) -> None:
    seconds: list[float] = []
    benchmark.pedantic(lambda: seconds.append(_run("-c", program)[0]), rounds=2 if short else 5, iterations=1)
    _note(benchmark, what, "s", seconds)


def _render(folder: Path, cache: Path) -> float:
    song = str(REPOSITORY / "presets" / "demos" / "drone.mid")
    arguments = ("-m", "synth", "render", song, "-p", "tanpura", "--end", "0.1", "-o", str(folder / "out.wav"))
    return _run(*arguments, XDG_CACHE_HOME=str(cache))[0]


def test_first_render(benchmark: Any, tmp_path: Path, short: bool) -> None:
    """A tenth of a second of the drone with kernels compiled before; unless short, with none first."""
    cache = tmp_path / "cache"
    if short:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        _render(tmp_path, cache)
    cold = None if short else _render(tmp_path, cache)
    warm: list[float] = []
    benchmark.pedantic(lambda: warm.append(_render(tmp_path, cache)), rounds=2 if short else 3, iterations=1)
    _note(benchmark, "synth render, a tenth of a second of the drone, kernels compiled before", "s", warm)
    if cold is not None:
        benchmark.extra_info.update(cold=cold, compiling=cold - float(np.median(warm)))


def test_memory(benchmark: Any, short: bool) -> None:
    found: dict[str, float] = {}

    def play() -> None:
        found.update(json.loads(_run("-m", "bench.memory", "10" if short else "60")[1]))

    benchmark.pedantic(play, rounds=1, iterations=1)
    benchmark.extra_info.update(section="memory", seconds_played=10 if short else 60, **found)
