"""A start with nothing compiled: a process with a cache of its own, all processors, what it and its children take."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from benchmarks import REPOSITORY

#: what is started, without the output's name
COMMANDS = {
    "synth render": ("render", "presets/demos/drone.mid", "-p", "tanpura-light", "--end", "0.1", "--quiet", "-o", "out.wav"),
    "synth simulate": ("simulate", "tanpura", "--duration", "0.001", "--modes", "20", "--quiet", "-o", "out.npz"),
}


class Cold(NamedTuple):
    """CPU and wall-clock time [s], and how many kernels were kept."""

    cpu_s: float
    wall_s: float
    kernels: int


@contextmanager
def tree_of(commit: str) -> Iterator[Path]:
    """A folder with the repository as it was at a commit. Raises subprocess.CalledProcessError for one that is none."""
    with tempfile.TemporaryDirectory() as folder:
        whole = Path(folder) / "whole.tar"
        subprocess.run(["git", "archive", "-o", str(whole), commit], cwd=REPOSITORY, check=True)
        with tarfile.open(whole) as archive:
            archive.extractall(Path(folder) / "tree", filter="data")
        yield Path(folder) / "tree"


def start(tree: Path, command: str) -> Cold:
    """One of COMMANDS by the package in `tree`, with an empty cache."""
    with tempfile.TemporaryDirectory() as folder:
        environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
        environment |= {"XDG_CACHE_HOME": folder, "PYTHONPATH": str(tree)}
        *arguments, output = COMMANDS[command]
        arguments = [str(tree / each) if "/" in each else each for each in arguments]
        began = time.monotonic()
        process = subprocess.Popen(
            [sys.executable, "-m", "synth", *arguments, str(Path(folder) / output)], cwd=tree, env=environment
        )
        _, status, used = os.wait4(process.pid, 0)
        wall = time.monotonic() - began
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise RuntimeError(f"{command} of {tree} ended with {process.returncode}")
        return Cold(used.ru_utime + used.ru_stime, wall, len(list(Path(folder).rglob("*.nbi"))))
