"""Studies that are killed: workers, the process that began them, a scheduler."""

from __future__ import annotations

import hashlib
import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

TOOLS = Path(__file__).resolve().parents[1]
_QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


def study_text(rows: int, seconds: float) -> str:
    """A study of naps."""
    return f"""
base = {{ call = "sweep_check.rows:nap", path = [{json.dumps(str(TOOLS))}], set = {{ seconds = {seconds} }} }}
grid.x = {{ from = 0, to = {rows - 1}, step = 1 }}
"""


def environment() -> dict[str, str]:
    """For processes that find this checkout."""
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(TOOLS.parent), str(TOOLS)])}


def digest(folder: Path) -> str:
    """Of the finished table's file."""
    return hashlib.sha256((folder / "table.parquet").read_bytes()).hexdigest()


def sweep(study: Path, folder: Path, *options: str) -> subprocess.Popen[bytes]:
    """`synth sweep` as a process."""
    command = [sys.executable, "-m", "synth", "sweep", str(study), "-o", str(folder), "--quiet", *options]
    return subprocess.Popen(command, env=environment(), **_QUIET)  # type: ignore[call-overload]


def children(pid: int) -> list[int]:
    """Processes that a process began, without multiprocessing's helper."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = path.read_text()
            command = (path.parent / "cmdline").read_bytes()
        except OSError:
            continue
        if int(text.rpartition(")")[2].split()[1]) == pid and b"spawn_main" in command:
            found.append(int(path.parent.name))
    return sorted(found)


def kill(pid: int) -> bool:
    """kill -9; whether it was there."""
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


def stored(folder: Path) -> int:
    """Rows in journals and parts: what would outlive everything."""
    from synth.study.keeping import Folder, journalled

    try:
        return sum(part.num_rows for part in Folder(folder).tables(["key"])) + journalled(folder)
    except OSError:
        return 0


def local(folder: Path, rows: int, seconds: float, rounds: int, patience_s: float = 600.0) -> dict[str, Any]:
    """2 workers of this machine: both killed `rounds` times, then the process that began them, once; against a run that
    nobody disturbs. Returns what happened."""
    study = folder / "naps.toml"
    study.write_text(study_text(rows, seconds))
    calm = sweep(study, folder / "calm", "--workers", "2")
    assert calm.wait() == 0
    wild, killed, chance = folder / "wild", 0, random.Random(1)
    process = sweep(study, wild, "--workers", "2")
    ended = time.monotonic() + patience_s
    for number in range(rounds):
        wanted = rows * (number + 1) // (rounds + 3)
        while stored(wild) < wanted and process.poll() is None and time.monotonic() < ended:
            time.sleep(0.05)
        killed += sum(kill(each) for each in children(process.pid))
    while stored(wild) < rows * (rounds + 1) // (rounds + 3) and process.poll() is None and time.monotonic() < ended:
        time.sleep(0.05 + 0.1 * chance.random())
    there = process.poll() is None
    orphans = children(process.pid)
    process.kill()
    process.wait()
    before = stored(wild)
    time.sleep(3.0)
    left = [each for each in orphans if Path(f"/proc/{each}").exists()]
    again = sweep(study, wild, "--workers", "2")
    assert again.wait() == 0
    said = json.loads((wild / "study.json").read_text())
    return {
        "workers killed": killed, "scheduler killed": there, "rows there when it was": before, "rows": rows,
        "computed after it": said["computed"], "workers left behind": len(left),
        "equal": digest(folder / "calm") == digest(wild),
    }  # fmt: skip


def free_port() -> int:
    """One that nobody listens at."""
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@contextmanager
def cluster(port: int, workers: int, folder: Path, threads: int = 1) -> Iterator[list[subprocess.Popen[bytes]]]:
    """`dask scheduler` and so many `dask worker`, processes of their own, over TCP on loopback: the scheduler first."""
    dask = [sys.executable, "-m", "dask"]
    address = f"tcp://127.0.0.1:{port}"
    begun = [
        subprocess.Popen(
            [*dask, "scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"],
            env=environment(),
            cwd=folder,
            **_QUIET,
        )  # type: ignore[call-overload]
    ]
    try:
        begun += [worker(address, folder, threads) for _ in range(workers)]
        yield begun
    finally:
        for each in begun:
            each.kill()
        for each in begun:
            each.wait()


def worker(address: str, folder: Path, threads: int = 1) -> subprocess.Popen[bytes]:
    """A `dask worker` without a nanny: nobody starts it again."""
    command = [sys.executable, "-m", "dask", "worker", address, "--nthreads", str(threads), "--no-nanny", "--no-dashboard"]
    return subprocess.Popen([*command, "--death-timeout", "60"], env=environment(), cwd=folder, **_QUIET)  # type: ignore[call-overload]


def over_tcp(folder: Path, rows: int, seconds: float, rounds: int) -> dict[str, Any]:
    """Three workers and a scheduler, each a process, over TCP: workers killed one by one and replaced, then the scheduler;
    the study ends with an error, and goes on with a new scheduler. Against the table of `local`'s calm run."""
    study = folder / "naps.toml"
    wild, killed = folder / "tcp", 0
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    with cluster(port, 3, folder) as begun:
        process = sweep(study, wild, "--scheduler", address)
        for number in range(rounds):
            while stored(wild) < rows * (number + 1) // (rounds + 3) and process.poll() is None:
                time.sleep(0.05)
            for _ in range(3):
                killed += kill(begun.pop(1).pid)
            begun += [worker(address, folder) for _ in range(3)]
        while stored(wild) < rows * (rounds + 1) // (rounds + 3) and process.poll() is None:
            time.sleep(0.05)
        there = process.poll() is None
        begun[0].kill()
        code = process.wait()
        before = stored(wild)
    port = free_port()
    with cluster(port, 3, folder):
        assert sweep(study, wild, "--scheduler", f"tcp://127.0.0.1:{port}").wait() == 0
    said = json.loads((wild / "study.json").read_text())
    return {
        "workers killed": killed, "scheduler killed": there, "exit code then": code, "rows there when it was": before,
        "rows": rows, "computed after it": said["computed"], "equal": digest(folder / "calm") == digest(wild),
    }  # fmt: skip
