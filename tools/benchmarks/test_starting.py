"""Start-up, compile time and memory: each in a process of its own, wall-clock time."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import REPOSITORY, TOOLS, cold
from benchmarks.conftest import noted


def _run(*arguments: str, **variables: str) -> tuple[float, str]:
    """Seconds and standard output of a Python program with the package's own place for kernels."""
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"} | variables
    started = time.perf_counter()
    done = subprocess.run(
        [sys.executable, *arguments], cwd=REPOSITORY, env=environment, capture_output=True, text=True, check=True
    )
    return time.perf_counter() - started, done.stdout


def _note(benchmark: Any, what: str, unit: str, values: list[float]) -> None:
    noted(benchmark, "start", what=what, unit=unit, median=float(np.median(values)), best=min(values))


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
    arguments = ("-m", "synth", "render", song, "-p", "tanpura-light", "--end", "0.1", "-o", str(folder / "out.wav"))
    return _run(*arguments, XDG_CACHE_HOME=str(cache))[0]


def test_first_render(benchmark: Any, tmp_path: Path, short: bool) -> None:
    """A tenth of a second of the drone with kernels compiled before."""
    cache = tmp_path / "cache"
    if short:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    _render(tmp_path, cache)
    warm: list[float] = []
    benchmark.pedantic(lambda: warm.append(_render(tmp_path, cache)), rounds=2 if short else 3, iterations=1)
    _note(benchmark, "synth render, a tenth of a second of the drone, kernels compiled before", "s", warm)


@pytest.mark.full
@pytest.mark.parametrize("command", cold.COMMANDS)
def test_cold(benchmark: Any, request: pytest.FixtureRequest, all_cores: Any, command: str) -> None:
    """With nothing compiled, in turn with the same at `--against`."""
    all_cores()
    against = request.config.getoption("--against")
    with cold.tree_of(against) if against else nullcontext() as other:
        trees = {"this tree": REPOSITORY} | ({against: other} if other is not None else {})
        found: dict[str, list[cold.Cold]] = {name: [] for name in trees}

        def in_turn() -> None:
            for name, tree in trees.items():
                found[name].append(cold.start(tree, command))

        benchmark.pedantic(in_turn, rounds=2 if against else 1, iterations=1)
    noted(benchmark, "cold", what=command, processors=os.cpu_count(), trees=found)


def test_memory(benchmark: Any, short: bool) -> None:
    found: dict[str, float] = {}

    def play() -> None:
        found.update(json.loads(_run("-m", "benchmarks.memory", "10" if short else "60", PYTHONPATH=str(TOOLS))[1]))

    benchmark.pedantic(play, rounds=1, iterations=1)
    noted(benchmark, "memory", seconds_played=10 if short else 60, **found)
