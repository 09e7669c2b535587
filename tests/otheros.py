"""A process in which Python looks as on Windows: modules and functions of POSIX are not there, and files that are open are
neither renamed nor removed. Libraries are loaded before that, as they are here. What it shows is that nothing of POSIX is
needed, not that Windows does the rest.

    python -c "from tests import otheros; otheros.begin(); …"
"""

from __future__ import annotations

import ctypes
import importlib
import os
import sys
from pathlib import Path
from typing import Any

MODULES = ("fcntl", "termios", "tty", "pty", "resource", "pwd", "grp", "syslog", "posix")
FUNCTIONS = (
    "chown", "chroot", "ctermid", "eventfd", "fchdir", "fchmod", "fchown", "fork", "forkpty", "fpathconf", "getegid",
    "geteuid", "getgid", "getgroups", "getloadavg", "getpgid", "getpgrp", "getpriority", "getsid", "getuid", "killpg",
    "lchown", "mkfifo", "mknod", "nice", "openpty", "pathconf", "posix_spawn", "pread", "pwrite", "register_at_fork",
    "sched_getaffinity", "sched_setaffinity", "sched_yield", "setsid", "setpriority", "statvfs", "sync", "sysconf",
    "tcgetpgrp", "tcsetpgrp", "ttyname", "uname",
    "O_CLOEXEC", "O_DIRECTORY", "O_NOCTTY", "O_NOFOLLOW", "O_NONBLOCK", "O_SYNC",
)  # fmt: skip
SIGNALS = ("SIGHUP", "SIGQUIT", "SIGTSTP", "SIGCONT", "SIGPIPE", "SIGTTIN", "SIGTTOU", "SIGUSR1", "SIGKILL")
_LIBRARIES = (
    "asyncio", "concurrent.futures", "ctypes.util", "distributed", "http.client", "jack", "llvmlite.binding", "mido",
    "multiprocessing", "multiprocessing.spawn", "numba", "numba.core.caching", "numba.core.ccallback", "numba.extending",
    "numba.typed",
    "numpy", "platform", "pydantic", "pydantic.functional_validators", "rtmidi", "scipy.interpolate", "scipy.linalg",
    "scipy.optimize", "scipy.signal", "scipy.special", "select", "shtab", "shutil", "socket", "sounddevice", "soundfile",
    "starlette.applications", "starlette.responses", "starlette.routing", "starlette.websockets", "subprocess", "tempfile",
    "threadpoolctl", "tomlkit", "uvicorn", "uvicorn.protocols.http.auto", "webbrowser", "websockets", "zipfile",
)  # fmt: skip


def load() -> None:
    """Load the libraries, those that are there."""
    import synth.jit.kernel_cache  # so that Numba is mended

    del synth
    for name in _LIBRARIES:
        try:
            importlib.import_module(name)
        except (ImportError, OSError):
            continue


def begin() -> None:
    """From now on it looks as on Windows, but to the libraries."""
    load()
    import signal

    for name in [name for name in sys.modules if name.partition(".")[0] == "synth" and name != "synth.native"]:
        if name.startswith(("synth.files", "synth.jit.kernel_claims", "synth.host", "synth.live")):
            del sys.modules[name]
    for name in MODULES:
        sys.modules[name] = None  # type: ignore[assignment]
    for name in FUNCTIONS:
        if hasattr(os, name):
            delattr(os, name)
    for name in SIGNALS:
        if hasattr(signal, name):
            delattr(signal, name)
    for name in ("pthread_sigmask", "pthread_kill", "alarm", "setitimer"):
        if hasattr(signal, name):
            delattr(signal, name)
    from synth.jit import kernel_helpers

    kernel_helpers.MOST = 0  # there are none on Windows, and `subprocess` is that of this system
    _keep_open_files()


def pretend(platform: str = "win32") -> None:
    """…and says so. Compiled code cannot be had any more."""

    class Library:
        def __init__(self, name: str) -> None:
            self._name = name

        def __getattr__(self, name: str) -> Any:
            return ctypes.CFUNCTYPE(None)(lambda: None)

    ctypes.WinDLL = Library  # type: ignore[attr-defined]
    sys.platform = platform


def _keep_open_files() -> None:
    """Renaming and removing fail for files that this process has open."""

    def checked(function: Any) -> Any:
        def run(path: Any, *arguments: Any, **named: Any) -> Any:
            for each in Path("/proc/self/fd").iterdir():
                try:
                    if os.path.samestat(each.stat(), os.lstat(path)):
                        raise PermissionError(13, "The process cannot access the file", os.fspath(path))
                except FileNotFoundError:
                    continue
            return function(path, *arguments, **named)

        return run

    for name in ("replace", "rename", "unlink", "remove"):
        setattr(os, name, checked(getattr(os, name)))
