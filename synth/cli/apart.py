"""Checkups in processes of their own: what a library of the system does there, hang, crash or print, is borne.

with Patients(["audio", "MIDI"], 30.0) as patients:
    finding = patients.finding("audio")
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from synth.cli.checkups import NOT_TRIED, Finding, broken, look
from synth.jit import kernel_cache

_BEGIN = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from synth.cli.apart import tell; tell(sys.argv[2])"
#: begins the line in which a finding stands, whatever libraries print
_MARK = "jawari finding "


def tell(name: str) -> None:
    """The life of such a process: print a finding, and end at once, whatever libraries want to do at the end."""
    print(f"\n{_MARK}{json.dumps(look(name))}", flush=True)
    kernel_cache.leave(0)


class Patients:
    """The checkups of these names, all begun at once; each answers within so many seconds of that, or is given up."""

    def __init__(self, names: Sequence[str], seconds: float) -> None:
        self._names, self._seconds = names, seconds
        self._running: dict[str, subprocess.Popen[str] | OSError] = {}
        self._end = 0.0

    def __enter__(self) -> Patients:
        self._end = time.monotonic() + self._seconds
        for name in self._names:
            self._running[name] = _begun(name)
        return self

    def finding(self, name: str) -> Finding:
        """How it is; waits."""
        process = self._running[name]
        if isinstance(process, OSError):
            return broken(process)
        try:
            said, _ = process.communicate(timeout=max(0.0, self._end - time.monotonic()))
        except subprocess.TimeoutExpired:
            return Finding(
                NOT_TRIED,
                f"no answer within {self._seconds:g} s",
                "try again with --timeout 300; if that is no better, restart the machine or its sound server",
            )
        for line in reversed(said.splitlines()):
            if line.startswith(_MARK):
                return Finding(*json.loads(line.removeprefix(_MARK)))
        code = process.returncode
        how = f"signal {-code}" if code < 0 else f"code {code}"
        return Finding(NOT_TRIED, f"a system library crashed during the check ({how})", "reinstall that library")

    def __exit__(self, *_: Any) -> None:
        for process in self._running.values():
            if not isinstance(process, OSError) and process.poll() is None:
                with suppress(OSError):
                    process.kill()
                with suppress(subprocess.TimeoutExpired):  # one that even that does not end is left to itself
                    process.communicate(timeout=2.0)


def _begun(name: str) -> subprocess.Popen[str] | OSError:
    command = [sys.executable, "-c", _BEGIN, json.dumps([str(each) for each in sys.path]), name]
    try:
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**kernel_cache.environment(), "PYTHONDONTWRITEBYTECODE": "1", "PYTHONIOENCODING": "utf-8"},
            encoding="utf-8",
            errors="replace",
        )
    except OSError as error:  # no more processes are to be had
        return error
