"""The program from outside, without the seconds that its imports take: a process that has imported all forks one that runs a
command line with standard streams, limits and a directory of its own, as a new interpreter would find them.

Run as a program it reads requests, a line of JSON each, and answers with the child's process id, then with its exit status.
"""

from __future__ import annotations

import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.patience import patience_s

ROOT = Path(__file__).resolve().parents[1]
#: what a quiet machine may take for a command, kernels compiled [s]
COMMAND_QUIET_S = 120.0


@dataclass
class Done:
    """How a command ended: exit code (negative: by a signal), what it said."""

    code: int
    out: bytes
    err: bytes


class ForkServer:
    """To be used with `with`. `warm`: command lines that are run first, in the server itself."""

    def __init__(self, env: dict[str, str], warm: list[list[str]], folder: Path) -> None:
        command = [sys.executable, "-m", "tests.forkserver", json.dumps(warm), str(folder)]
        self._process = subprocess.Popen(
            command, cwd=ROOT, env=env, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        assert self._process.stdout is not None
        if self._process.stdout.readline() != '"ready"\n':
            self.__exit__()
            raise RuntimeError("the fork server does not start: what it ran first is said above")

    def __enter__(self) -> ForkServer:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(patience_s())
        finally:
            self._process.kill()
            self._process.wait()
            assert self._process.stdout is not None
            self._process.stdout.close()

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        return json.loads(self._process.stdout.readline())

    def run(
        self,
        arguments: list[str],
        cwd: Path,
        told: Path,
        *,
        gone: bool = False,
        encoding: str = "utf-8",
        closed: tuple[int, ...] = (),
        out: str | None = None,
        largest: int | None = None,
        meanwhile: Callable[[int], None] | None = None,
    ) -> Done:
        """Run `synth` with `arguments`. told: a folder for what it says, in files `out` and `err`; gone: `cwd` is deleted
        before; closed: streams that are; out: file or device as standard output; largest: bytes of a file that it may write;
        meanwhile: is called with its process id."""
        assert self._process.stdin is not None
        paths = [os.devnull, out or str(told / "out"), str(told / "err")]
        request = {
            "arguments": [os.fsencode(each).hex() for each in arguments],
            "cwd": str(cwd),
            "gone": gone,
            "encoding": encoding,
            "streams": [None if number in closed else path for number, path in enumerate(paths)],
            "largest": largest,
        }
        for name in ("out", "err"):
            (told / name).touch()
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        pid = self._answer()
        try:
            if meanwhile is not None:
                meanwhile(pid)
        finally:
            code = self._answer()
        return Done(code, (told / "out").read_bytes(), (told / "err").read_bytes())


def ended(pid: int) -> bool:
    """Whether a process is no more, or waits for nobody but its parent."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


def writes(pid: int, number: int) -> bool:
    """Whether a process stands in a write to a file descriptor."""
    try:
        said = Path(f"/proc/{pid}/syscall").read_text().split()
    except OSError:
        return False
    return said[:2] == ["1", f"{number:#x}"]


def _serve() -> None:
    from synth import cli

    warm, folder = json.loads(sys.argv[1]), sys.argv[2]
    requests, answers = os.dup(0), os.dup(1)
    os.dup2(2, 1)
    os.chdir(folder)
    for arguments in warm:
        if cli.main(arguments):
            sys.exit(f"{arguments}: failed")
    _say(answers, "ready")
    with open(requests, "rb", buffering=0) as lines:
        while line := lines.readline():
            request = json.loads(line)
            pid = os.fork()
            if not pid:
                _become(request)
            _say(answers, pid)
            _say(answers, os.waitstatus_to_exitcode(_waited(pid)))


def _say(handle: int, what: Any) -> None:
    os.write(handle, (json.dumps(what) + "\n").encode())


def _waited(pid: int) -> int:
    """Its status; one that does not end is killed."""
    begun = time.monotonic()
    while time.monotonic() - begun < patience_s(COMMAND_QUIET_S):
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return status
        time.sleep(0.005)
    os.kill(pid, signal.SIGKILL)
    return os.waitpid(pid, 0)[1]


def _become(request: dict[str, Any]) -> None:
    """The child: never returns."""
    code = 70
    try:
        os.chdir(request["cwd"])
        if request["gone"]:
            os.rmdir(request["cwd"])
        os.closerange(3, 256)
        for number, (path, name) in enumerate(zip(request["streams"], ("stdin", "stdout", "stderr"), strict=True)):
            if path is None:
                os.close(number)
                setattr(sys, name, None)
                continue
            handle = os.open(path, os.O_RDWR | os.O_CREAT if number else os.O_RDONLY)
            if handle != number:
                os.dup2(handle, number)
                os.close(handle)
            setattr(sys, name, open(number, "w" if number else "r", encoding=request["encoding"], closefd=False))
            if number == 2:
                sys.stderr.reconfigure(line_buffering=True, errors="backslashreplace")  # type: ignore[union-attr]
        if request["largest"] is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (request["largest"], resource.RLIM_INFINITY))
        from synth import cli

        try:
            code = cli.main([os.fsdecode(bytes.fromhex(each)) for each in request["arguments"]])
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()  # as the interpreter does, which says so where it cannot
    except BaseException:
        import traceback

        with contextlib.suppress(Exception):
            traceback.print_exc()
        code = 70
    finally:
        os._exit(code)


@contextlib.contextmanager
def full_pipe(folder: Path) -> Iterator[str]:
    """A pipe that takes nothing more and that nobody reads."""
    path = folder / "full"
    os.mkfifo(path)
    handle = os.open(path, os.O_RDWR | os.O_NONBLOCK)
    try:
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(handle, bytes(65536))
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(handle, b"\0")
        yield str(path)
    finally:
        os.close(handle)
        path.unlink()


if __name__ == "__main__":
    _serve()
