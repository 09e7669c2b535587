"""The server: on the loopback only, until it is asked to end."""

from __future__ import annotations

import asyncio
import contextlib
import importlib.util
import logging
import secrets
import signal
import socket
import webbrowser
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import uvicorn

from synth.author.app import App
from synth.author.crowd import BATCH, Waiting, be_brief, lengthen_queue, protocol_of
from synth.author.documents import Documents
from synth.author.ending import Ending
from synth.author.guard import Guard
from synth.author.workspace import SUFFIX, Workspace
from synth.files.sources import kind_of

LOOPBACK = "127.0.0.1"
ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))


class _Server(uvicorn.Server):
    """Says when it listens, and lets what requests wait for end before it waits for them."""

    def __init__(self, config: uvicorn.Config, ready: Callable[[], None], ending: Ending) -> None:
        super().__init__(config)
        self._ready = ready
        self._ending = ending

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        be_brief()
        await super().startup(sockets)
        lengthen_queue(sockets or [])
        if self.started:
            self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        logging.getLogger("uvicorn.error").addFilter(_is_news)
        self._ending.put_in_order()
        await super().shutdown(sockets)

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield  # see `signals_go_here`

    def handle_exit(self, sig: int, frame: Any) -> None:
        self.should_exit = True  # again and again: it ends soon, and in order
        self._ending.begin()

    @contextlib.contextmanager
    def signals_go_here(self) -> Iterator[None]:
        """Signals ask it to end, however often they come: nothing that is done meanwhile is interrupted."""
        before = {each: signal.signal(each, self.handle_exit) for each in ENDING}
        try:
            yield
        finally:
            for each, handler in before.items():
                signal.signal(each, handler)


def _is_news(record: logging.LogRecord) -> bool:
    """Not that requests are cut off by the end, which was asked for."""
    cut_off = record.exc_info is not None and isinstance(record.exc_info[1], asyncio.CancelledError)
    return not cut_off and not str(record.msg).startswith("Cancel ")


def workspace_of(preset: str | None, folder: str | None) -> tuple[Workspace, str | None]:
    """The workspace, and what to open in it: a file lies in its own folder. Raises ValueError."""
    if preset is not None and (preset.endswith(SUFFIX) or Path(preset).is_file()):
        file = Path(preset)
        if file.exists() and (kind := kind_of(file.stat().st_mode)) is not None:
            raise ValueError(f"{preset}: is {kind}, not a regular file; copy its contents into one")
        if not file.is_file():
            raise ValueError(f"preset file {preset} does not exist")
        if folder is not None and Path(folder).resolve() != file.resolve().parent:
            raise ValueError(f"--folder {folder}: {preset} lies in another folder; leave --folder out")
        if file.suffix != SUFFIX:
            raise ValueError(f"{preset}: a preset's file ends in .toml; rename it")
        return Workspace(file.resolve().parent), file.resolve().name
    return Workspace(folder or "."), preset


def serve(
    preset: str | None,
    *,
    folder: str | None = None,
    port: int = 0,
    rate_hz: int = 44100,
    quality: str = "standard",
    browser: bool = True,
    say: Callable[[str], None] = print,
) -> None:
    """Serve the page until a signal asks to end. `say` is given the page's address. Raises ValueError, OSError."""
    workspace, wanted = workspace_of(preset, folder)
    token = secrets.token_urlsafe(32)
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    with contextlib.closing(listening), contextlib.ExitStack() as opened:
        _keep_to_ourselves(listening)
        try:
            listening.bind((LOOPBACK, port))
        except OSError as error:
            raise OSError(f"--port {port}: {error.strerror}; give another, or 0 for any free port") from None
        port = listening.getsockname()[1]
        opened.enter_context(workspace.alone())
        documents = Documents(workspace)
        if wanted is not None:
            documents.opened = documents.open(wanted)
        app = App(documents, rate_hz=rate_hz, quality=quality)
        guard = Guard(app.asgi(), port, token)
        url = f"http://{LOOPBACK}:{port}/"

        def ready() -> None:
            say(f"{url}?token={token}")
            if browser:
                Thread(target=_open_browser, args=(f"{url}?door={guard.door().code}",), daemon=True).start()

        config = uvicorn.Config(
            guard,
            http=protocol_of(Waiting()),
            backlog=BATCH,
            log_level="warning",
            access_log=False,
            ws=_websockets(),
            ws_max_size=1 << 16,
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=2,
            server_header=False,
        )
        ending = Ending(app.end)
        server = _Server(config, ready, ending)
        with server.signals_go_here():
            try:
                asyncio.run(server.serve(sockets=[listening]))
            finally:  # whatever has gone wrong
                app.end()


def _keep_to_ourselves(listening: socket.socket) -> None:
    """A port that was left just now may be taken again; but Windows would let others take it from us by the same word."""
    alone = getattr(socket, "SO_EXCLUSIVEADDRUSE", None)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR if alone is None else alone, 1)


def _websockets() -> Any:
    """uvicorn's WebSocket protocol: the one that websockets has not declared outdated, where there is a choice."""
    has = importlib.util.find_spec("uvicorn.protocols.websockets.websockets_sansio_impl") is not None
    return "websockets-sansio" if has else "websockets"


def _open_browser(url: str) -> None:
    try:
        webbrowser.open(url)
    except webbrowser.Error as error:
        logging.getLogger(__name__).warning("no browser could be opened: %s", error)
