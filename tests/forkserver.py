"""The program from outside, without the seconds that its imports take: a process that has imported all forks one that runs a
command line with standard streams, environment, limits and a directory of its own, as a new interpreter would find them.

Run as a program it reads requests from the socket that is its standard input, each with the descriptors that go with it: the
standard streams, and a socket by which it says the child's process id and then how it ended.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import json
import os
import resource
import runpy
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Self

from tests.patience import compiling_s, patience_s

ROOT = Path(__file__).resolve().parents[1]
#: what every command imports that is heavy; not what opens devices, which a fork does not inherit well
MODULES = (
    "synth.live.session",
    "synth.live.recorder",
    "synth.live.jackcallback",
    "synth.author.serve",
    "synth.author.views.analysis",
    "synth.author.views.cost",
    "synth.author.views.instrument",
    "synth.author.views.motion",
)


@dataclass
class Done:
    """How a command ended: exit code (negative: by a signal), what it said."""

    code: int
    out: bytes
    err: bytes


class Forked:
    """A command that runs, to be used as a subprocess.Popen whose pipes carry text."""

    def __init__(self, args: list[str], pid: int, end: socket.socket, pipes: list[int | None]) -> None:
        self.args, self.pid = args, pid
        self._end, self._lock = end, threading.Lock()
        self.stdin, self.stdout, self.stderr = (
            None if pipe is None else open(pipe, how, encoding="utf-8") for pipe, how in zip(pipes, "wrr", strict=True)
        )
        self.returncode: int | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, error: object, *_: object) -> None:
        if error is not None:  # nobody knows whether it would end
            self.kill()
        for pipe in (self.stdin, self.stdout, self.stderr):
            if pipe is not None:
                pipe.close()
        self.wait()

    def wait(self, timeout: float | None = None) -> int:
        with self._lock:
            if self.returncode is None:
                if not select.select([self._end], [], [], timeout)[0]:
                    raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
                self.returncode = int(self._end.makefile().readline())
                self._end.close()
            return self.returncode

    def poll(self) -> int | None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0.0)
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def communicate(self, given: str | None = None, timeout: float | None = None) -> tuple[str, str]:
        """All that it says, once it has ended. Raises subprocess.TimeoutExpired, after which it can be called again."""
        if self.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self.stdin.write(given or "")
                self.stdin.close()
            self.stdin = None
        if not hasattr(self, "_said"):
            self._said: dict[IO[str], str] = {}
            pipes = [pipe for pipe in (self.stdout, self.stderr) if pipe is not None]
            self._readers = [threading.Thread(target=self._read, args=(pipe,), daemon=True) for pipe in pipes]
            for reader in self._readers:
                reader.start()
        deadline = None if timeout is None else time.monotonic() + timeout
        for reader in self._readers:
            reader.join(None if deadline is None else max(0.0, deadline - time.monotonic()))
            if reader.is_alive():
                raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        self.wait(None if deadline is None else max(0.0, deadline - time.monotonic()))
        out, err = ("" if pipe is None else self._said.get(pipe, "") for pipe in (self.stdout, self.stderr))
        return out, err

    def done(self, timeout: float) -> subprocess.CompletedProcess[str]:
        """How it has ended, as of subprocess.run: it is killed if that takes longer than `timeout` [s]."""
        with self:
            out, err = self.communicate(timeout=timeout)
        return subprocess.CompletedProcess(self.args, self.returncode or 0, out, err)

    def _read(self, pipe: IO[str]) -> None:
        with contextlib.suppress(ValueError), pipe:  # what was closed says no more
            self._said[pipe] = pipe.read()


class ForkServer:
    """To be used with `with`. `warm`: command lines that are run first, in the server itself, in `folder`; modules: to be
    imported as well."""

    def __init__(self, env: dict[str, str], warm: list[list[str]], folder: Path, modules: tuple[str, ...] = ()) -> None:
        self._ours, theirs = socket.socketpair()
        command = [sys.executable, "-m", "tests.forkserver", json.dumps(warm), str(folder), *modules]
        self._lock = threading.Lock()
        self._process = subprocess.Popen(
            command, cwd=ROOT, env=env, stdin=theirs, stdout=subprocess.PIPE, text=True, start_new_session=True
        )
        theirs.close()
        assert self._process.stdout is not None
        with self._process.stdout as said:
            if said.readline() != "ready\n":
                self.__exit__()
                raise RuntimeError("the fork server does not start: what it ran first is said above")

    def __enter__(self) -> ForkServer:
        return self

    def __exit__(self, *_: object) -> None:
        self._ours.close()
        try:
            self._process.wait(patience_s())
        finally:
            self._process.kill()
            self._process.wait()

    def start(
        self,
        arguments: list[str],
        cwd: Path | str,
        *,
        stdin: int | None = None,
        stdout: int | None = None,
        stderr: int | None = None,
        env: dict[str, str] | None = None,
        module: str | None = "synth",
        before: str = "",
        terminal: bool = False,
        closed: tuple[int, ...] = (),
        **more: Any,
    ) -> Forked:
        """Run `synth`, or another module, with `arguments`. stdin, stdout, stderr, env: as of subprocess.Popen; before:
        Python that is run first, or, where there is no module, as a program of its own; terminal: standard input becomes the
        controlling terminal; closed: streams that are; more: see `_become`."""
        theirs: list[int] = []
        ours: list[int | None] = []
        given: list[int] = []
        for number, stream in enumerate((stdin, stdout, stderr)):
            ours.append(None)
            if stream == subprocess.PIPE:
                ends = os.pipe()
                ours[number], stream = (ends[0], ends[1]) if number else (ends[1], ends[0])
                theirs.append(stream)
            elif stream == subprocess.DEVNULL:
                stream = os.open(os.devnull, os.O_RDWR)
                theirs.append(stream)
            elif stream is None:
                stream = number
            if number not in closed:
                given.append(stream)
        told, tells = socket.socketpair()
        request = {
            "arguments": [os.fsencode(each).hex() for each in arguments],
            "cwd": str(cwd),
            "env": {name: os.fsencode(value).hex() for name, value in (os.environ if env is None else env).items()},
            "module": module,
            "before": before,
            "terminal": terminal,
            "closed": closed,
            **more,
        }
        data = json.dumps(request).encode()
        with self._lock:
            socket.send_fds(self._ours, [f"{len(data):8}".encode()], [*given, tells.fileno()])
            self._ours.sendall(data)
        tells.close()
        for each in theirs:
            os.close(each)
        pid = b""
        while not pid.endswith(b"\n"):
            pid += told.recv(1)
        return Forked(arguments, int(pid), told, ours)

    def run(
        self,
        arguments: list[str],
        cwd: Path,
        told: Path,
        *,
        closed: tuple[int, ...] = (),
        out: str | None = None,
        meanwhile: Callable[[int], None] | None = None,
        **more: Any,
    ) -> Done:
        """Run it to its end. told: a folder for what it says, in files `out` and `err`; out: file or device as standard
        output; meanwhile: is called with its process id."""
        for name in ("out", "err"):
            (told / name).touch()
        paths = [os.devnull, out or str(told / "out"), str(told / "err")]
        handles = [os.open(path, os.O_RDWR | os.O_CREAT if number else os.O_RDONLY) for number, path in enumerate(paths)]
        try:
            running = self.start(
                arguments, cwd, stdin=handles[0], stdout=handles[1], stderr=handles[2], closed=closed, **more
            )
        finally:
            for handle in handles:
                os.close(handle)
        try:
            if meanwhile is not None:
                meanwhile(running.pid)
        finally:
            try:
                code = running.wait(compiling_s())
            except subprocess.TimeoutExpired:
                running.kill()
                code = running.wait()
        return Done(code, (told / "out").read_bytes(), (told / "err").read_bytes())


@functools.cache
def prepared() -> ForkServer:
    """One for the commands of all tests of this process that need no interpreter of their own."""
    folder = Path(tempfile.mkdtemp(prefix="jawari-prepared-"))
    song = str(ROOT / "presets" / "demos" / "bassline.mid")
    render = [
        "render",
        song,
        "--end",
        "0.05",
        "--tail",
        "0",
        "--quality",
        "draft",
        "--threads",
        "1",
        "--quiet",
        "-o",
        "x.wav",
    ]
    server = ForkServer({**os.environ, "PYTHONPATH": str(ROOT)}, [render], folder, MODULES)
    atexit.register(server.__exit__)
    for left in folder.iterdir():
        left.unlink()
    folder.rmdir()
    return server


@functools.cache
def compiler() -> ForkServer:
    """One for programs that compile kernels of their own: Numba is loaded and has compiled something, this package is
    not."""
    env = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    server = ForkServer({**env, "PYTHONPATH": str(ROOT)}, [], ROOT, ("tests.compiled",))
    atexit.register(server.__exit__)
    return server


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
    import gc
    import importlib

    warm, folder, *modules = sys.argv[1:]
    requests = socket.socket(fileno=os.dup(0))
    out = os.dup(1)
    os.dup2(2, 1)
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.chdir(folder)
    for name in modules:
        importlib.import_module(name)
    if "synth.live.session" in modules:
        from synth.live.callback import portaudio_callback
        from synth.live.jackcallback import callbacks

        kept = portaudio_callback(), callbacks()  # noqa: F841
    for arguments in json.loads(warm):
        if importlib.import_module("synth.cli").main(arguments):
            sys.exit(f"{arguments}: failed")
    os.chdir("/")
    os.write(out, b"ready\n")
    os.close(out)
    woken, wakes = os.pipe()
    os.set_blocking(wakes, False)
    signal.set_wakeup_fd(wakes)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    children: dict[int, socket.socket] = {}
    gc.collect()
    gc.freeze()
    while True:
        for pid in list(children):
            done, status = os.waitpid(pid, os.WNOHANG)
            if done:
                with children.pop(pid) as told, contextlib.suppress(OSError):
                    told.sendall(f"{os.waitstatus_to_exitcode(status)}\n".encode())
        ready = select.select([requests, woken], [], [])[0]
        if woken in ready:
            os.read(woken, 4096)
        if requests in ready:
            head, handles, _, _ = socket.recv_fds(requests, 8, 4)
            if not head:
                return
            with requests.makefile("rb", buffering=0) as file:
                size, data = int(head), b""
                while len(data) < size:
                    data += file.read(size - len(data)) or b""
            pid = os.fork()
            if not pid:
                _become(json.loads(data), handles[:-1])
            for handle in handles[:-1]:
                os.close(handle)
            children[pid] = socket.socket(fileno=handles[-1])
            children[pid].sendall(f"{pid}\n".encode())


def _become(request: dict[str, Any], handles: list[int]) -> None:
    """The child: never returns. Of a request, besides what `ForkServer.start` says: gone: `cwd` is deleted before; encoding
    of the streams; largest: bytes of a file that it may write."""
    code = 70
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.environ.clear()
        os.environ.update({name: os.fsdecode(bytes.fromhex(value)) for name, value in request["env"].items()})
        os.chdir(request["cwd"])
        if request.get("gone"):
            os.rmdir(request["cwd"])
        encoding, left = request.get("encoding", "utf-8"), list(handles)
        for number, name in enumerate(("stdin", "stdout", "stderr")):
            if number in request["closed"]:
                os.close(number)
                setattr(sys, name, None)
                continue
            os.dup2(left.pop(0), number)
        os.closerange(3, 256)
        for number, name in enumerate(("stdin", "stdout", "stderr")):
            if number not in request["closed"]:
                setattr(sys, name, open(number, "w" if number else "r", encoding=encoding, closefd=False))
        if sys.stderr is not None:
            sys.stderr.reconfigure(line_buffering=True, errors="backslashreplace")  # type: ignore[union-attr]
        if request["terminal"]:
            import fcntl
            import termios

            os.setsid()
            fcntl.ioctl(0, termios.TIOCSCTTY, 0)
        if request.get("largest") is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (request["largest"], resource.RLIM_INFINITY))
        tempfile.tempdir = None  # the environment may name another
        module = request["module"]
        sys.argv = [module or "-c", *(os.fsdecode(bytes.fromhex(each)) for each in request["arguments"])]
        try:
            exec(request["before"], {"__name__": "before" if module else "__main__"})
            if module:
                runpy.run_module(module, run_name="__main__")
            code = 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
        threading._shutdown()  # type: ignore[attr-defined]  # as the interpreter does: it waits for threads,
        atexit._run_exitfuncs()  # calls what wants to be,
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()  # and writes what is left, or says that it cannot
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
