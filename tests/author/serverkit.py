"""A real `synth author` in a process of its own, and clients of it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

import httpx
from websockets.sync.client import ClientConnection, connect

from tests.forkserver import Forked, prepared
from tests.patience import patience_s

ROOT = Path(__file__).resolve().parents[2]

#: run before `synth author` in a forked process: the first process of the views is a fork as well, with its imports behind
#: it, and not a new interpreter
FORKED_VIEWS = """
import os, signal
from contextlib import suppress
from multiprocessing import Pipe
from synth import workers
from synth.author import beside

class Forked(workers.WorkerProcess):
    def __init__(self):
        self.pipe, theirs = Pipe()
        self.process, self.begun, self.pid = self, False, os.fork()
        if not self.pid:
            self.pipe.close()
            workers.work(theirs, beside.views, (), beside.NICE, None)
        theirs.close()

    def kill(self):
        with suppress(ProcessLookupError):
            os.kill(self.pid, signal.SIGKILL)

    def join(self):
        os.waitpid(self.pid, 0)

waiting, anew = [Forked()], beside.ComputeProcess._started

def started(self):
    if self._worker is None and not self._closed and waiting:
        self._worker = waiting.pop()
    return anew(self)

beside.ComputeProcess._started = started
"""


class Server:
    """`synth author` on a folder, without a browser unless told. `get` and `post` show the token; answers are checked unless
    a status is expected. `program`: what runs instead of the command; with it or `env` it is a new interpreter. `as_it_is`:
    the process of its views is a new interpreter, too."""

    def __init__(
        self,
        folder: Path,
        *arguments: str,
        env: dict[str, str] | None = None,
        browser: bool = False,
        program: Sequence[str] = (),
        as_it_is: bool = False,
    ) -> None:
        self.folder = folder
        self._process: subprocess.Popen[str] | Forked
        command = ["author", *([] if browser else ["--no-browser"]), *arguments]
        if env is None and not program:
            pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
            self._process = prepared().start(command, folder, before="" if as_it_is else FORKED_VIEWS, **pipes)
        else:
            self._process = subprocess.Popen(
                [sys.executable, *(program or ("-m", "synth")), *command],
                cwd=folder,
                env={**(env or os.environ), "PYTHONPATH": str(ROOT)},
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
        assert self._process.stdout is not None and self._process.stderr is not None
        self.address = self._process.stdout.readline().strip()
        if not self.address:
            _, said = self._process.communicate()
            raise RuntimeError(f"exit code {self._process.returncode}: {said}")
        parts = urlsplit(self.address)
        self.port = parts.port
        self.token = parts.query.removeprefix("token=")
        self.headers = {"Authorization": f"Bearer {self.token}"}
        self.client = httpx.Client(base_url=f"http://127.0.0.1:{self.port}", headers=self.headers, timeout=patience_s())

    @property
    def pid(self) -> int:
        return self._process.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self, by: signal.Signals = signal.SIGTERM) -> tuple[int, str]:
        """Exit code, and what it said on standard error."""
        self.client.close()
        if self._process.poll() is None:
            self._process.send_signal(by)
        _, said = self._process.communicate(timeout=patience_s())
        return self._process.returncode, said

    def get(self, path: str, status: int = 200) -> Any:
        answer = self.client.get(path)
        assert answer.status_code == status, answer.text
        return answer.json()

    def post(self, path: str, status: int = 200, **fields: Any) -> Any:
        answer = self.client.post(path, json=fields)
        assert answer.status_code == status, answer.text
        return answer.json()

    def open(self, preset: str) -> Doc:
        return Doc(self, self.post("/api/open", preset=preset)["doc"])


class Doc:
    """One document of a server."""

    def __init__(self, server: Server, key: str) -> None:
        self.server, self.key = server, key
        self.path = f"/api/docs/{key}"

    @property
    def state(self) -> Any:
        return self.server.get(self.path)

    def do(self, what: str, status: int = 200, **fields: Any) -> Any:
        return self.server.post(f"{self.path}/{what}", status, **fields)

    def set(self, path: str, value: Any, status: int = 200, merge: str | None = None) -> Any:
        return self.do("edit", status, changes=[{"path": path, "value": value}], merge=merge)

    def connect(self) -> Page:
        return Page(
            connect(
                f"ws://127.0.0.1:{self.server.port}/ws/{self.key}",
                additional_headers=self.server.headers,
                proxy=None,
                close_timeout=1,
            )
        )


class Page:
    """The WebSocket of a page, open within a `with`."""

    socket: ClientConnection

    def __init__(self, opening: connect) -> None:
        self._opening = opening

    def __enter__(self) -> Self:
        self.socket = self._opening.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._opening.__exit__(None, None, None)

    def send(self, kind: str, **fields: Any) -> None:
        self.socket.send(json.dumps({"type": kind, **fields}))

    def receive(self) -> dict[str, Any] | bytes:
        message = self.socket.recv(timeout=patience_s())
        return message if isinstance(message, bytes) else json.loads(message)

    def until(self, kind: str, holds: Callable[[dict[str, Any]], bool] = lambda _: True) -> dict[str, Any]:
        """The next text message of a type for which something holds."""
        while True:
            message = self.receive()
            if isinstance(message, dict) and message["type"] == kind and holds(message):
                return message
