"""Many kernels are compiled by several processes where there are several processors.

`compile_all` takes the name of a function that lists kernels. Whoever calls it compiles from the list, and helpers do too:
processes of their own, each of which takes what nobody has taken and keeps it on disk, where the others find it. A kernel
that both need is compiled by the one that came first, and the other waits (`kernel_claims`). What becomes of the helpers
costs time and nothing else: what they have not kept, the caller compiles. They end with the list, and with the caller,
however it ends: they read from a pipe that closes then.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

from synth.jit import compiling, kernel_cache, kernel_claims
from synth.native.processors import cores

#: helpers at most; more would wait for each other
MOST = 3
#: what a helper takes while it compiles [bytes]
NEEDS = 700e6
_BEGIN = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from synth.jit import kernel_helpers as k; k.help(sys.argv)"
)
_at_it = threading.Lock()


class Task(NamedTuple):
    """A kernel and the types of its arguments."""

    kernel: Any
    arguments: tuple[Any, ...]

    @property
    def name(self) -> str:
        return f"task {self.kernel.py_func.__module__}:{self.kernel.py_func.__qualname__}{self.arguments}"


def compile_all(listed: str) -> None:
    """Have the kernels compiled that the function `module:function` lists (as `Task`s, those that take longest first), if
    several are missing and several processes may run; else whoever calls them compiles them."""
    if not _at_it.acquire(blocking=False):  # another thread has helpers
        return
    try:
        _compile_all(listed)
    finally:
        _at_it.release()


def _compile_all(listed: str) -> None:
    tasks = _tasks(listed)
    missing = [task for task in tasks if not compiling.is_kept(task.kernel.py_func)]
    count = min(len(missing) - 1, _may_run())
    if count <= 0 or kernel_cache.trouble() is not None:
        return
    with compiling.expecting([task.kernel.py_func for task in missing]), _helpers(count, listed):
        _work_off(missing)
        for task in missing:  # until the helpers have done theirs
            kernel_claims.wait_for(task.name)
            kernel_claims.leave(task.name)
        _work_off([task for task in missing if not compiling.is_kept(task.kernel.py_func)])  # of one that has died


def help(arguments: Sequence[str]) -> None:
    """The life of a helper: arguments as in _BEGIN."""
    threading.Thread(target=_end_with_the_caller, daemon=True).start()
    listed = arguments[-1]
    _work_off(_tasks(listed))


def _tasks(listed: str) -> list[Task]:
    module, _, function = listed.partition(":")
    tasks = [Task(*each) for each in getattr(importlib.import_module(module), function)()]
    return [task for task in tasks if hasattr(task.kernel, "py_func")]  # without the JIT they are functions


def _work_off(tasks: Sequence[Task]) -> None:
    for task in tasks:
        if kernel_cache.trouble() is not None:  # nobody would find it
            return
        if kernel_claims.take(task.name):
            try:
                task.kernel.compile(task.arguments)
            finally:
                kernel_claims.leave(task.name)


def _end_with_the_caller() -> None:
    with suppress(OSError):
        while os.read(0, 1024):
            pass
    os._exit(0)


@contextmanager
def _helpers(count: int, listed: str) -> Iterator[None]:
    """So many helpers, or fewer; none is left afterwards."""
    running: list[subprocess.Popen[bytes]] = []
    try:
        with suppress(OSError):  # no more processes to be had: then with those that run
            for _ in range(count):
                running.append(
                    subprocess.Popen(
                        [sys.executable, "-c", _BEGIN, json.dumps([str(each) for each in sys.path]), listed],
                        stdin=subprocess.PIPE,
                        stdout=subprocess.DEVNULL,
                        stderr=subprocess.DEVNULL,
                        start_new_session=True,  # what the terminal sends is the caller's to hear
                    )
                )
        yield
    finally:
        _end(running)


def _end(running: Sequence[subprocess.Popen[bytes]]) -> None:
    for process in running:
        process.kill()
        process.communicate()


def _may_run() -> int:
    """How many helpers there is room for."""
    if sys.platform == "win32":  # whose files know no claims
        return 0
    if getattr(sys, "frozen", False) or not os.path.basename(sys.executable or "").startswith(("python", "pypy")):
        return 0  # what is started by that name is another program
    return max(0, min(MOST, cores() - 1, int(free_memory() / NEEDS) - 1))


def free_memory() -> float:
    """Bytes of memory that are free, as far as the system says so."""
    with suppress(OSError, ValueError, IndexError):
        with open("/proc/meminfo", encoding="ascii") as lines:
            for line in lines:
                if line.startswith("MemAvailable:"):
                    return min(1024.0 * float(line.split()[1]), _left_of_a_limit())
    return float("inf")


def _left_of_a_limit() -> float:
    """…and of a limit that the control group sets."""
    with suppress(OSError, ValueError):
        with (
            open("/sys/fs/cgroup/memory.max", encoding="ascii") as limit,
            open("/sys/fs/cgroup/memory.current", encoding="ascii") as used,
        ):
            return float(limit.read()) - float(used.read())  # "max" is no number
    return float("inf")
