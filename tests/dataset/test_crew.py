"""Workers of a data set: whom they listen to, and how long they live."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import psutil

from tests.dataset.kit import NOTES, written
from tests.patience import COMPILING_QUIET_S, until

#: makes a data set of which no item is ever done; a worker that is at one says so by a file of its process's number
ENDLESS = """
import os, sys, time
from pathlib import Path
from synth.dataset import crew

def make(self, key, notes=()):
    (Path(sys.argv[1]) / str(os.getpid())).touch()
    while True:
        time.sleep(0.05)

crew.Maker.make = make
if __name__ == "__main__":
    from synth.dataset.filling import fill
    from synth.dataset.recipefile import read_recipe
    fill(read_recipe(sys.argv[2]), Path(sys.argv[3]), workers=2)
"""


def running(pid: int) -> bool:
    """Whether a process is there and not only waiting to be collected."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_workers_end_with_a_parent_that_is_killed_and_listen_nowhere(tmp_path: Path) -> None:
    script, said = tmp_path / "endless.py", tmp_path / "said"
    script.write_text(ENDLESS)
    said.mkdir()
    written(tmp_path, NOTES)
    command = [sys.executable, str(script), str(said), str(tmp_path / "recipe.toml"), str(tmp_path / "set")]
    here = str(Path(__file__).resolve().parents[2])
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([here, os.environ.get("PYTHONPATH", "")])}
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    workers: list[int] = []
    try:
        until(lambda: len(list(said.iterdir())) == 2 or process.poll() is not None, "no item begun", COMPILING_QUIET_S)
        workers = [int(path.name) for path in said.iterdir()]
        assert len(workers) == 2 and all(map(running, workers))
        ports = [each for pid in (process.pid, *workers) for each in psutil.Process(pid).net_connections("inet")]
        assert ports == []
        process.send_signal(signal.SIGKILL)
        process.wait()
        until(lambda: not any(map(running, workers)), "workers outlive the process that began them")
    finally:
        process.kill()
        process.wait()
        for pid in workers:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
