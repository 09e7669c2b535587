"""One page's WebSocket: what it is told of its document, and its sound."""

from __future__ import annotations

import asyncio
import contextlib
import json
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from synth.author.document import Document
from synth.author.errors import one_line
from synth.author.sound import PagePlayer


class Stage:
    """The connections of a server; only the one that played last sounds."""

    def __init__(self) -> None:
        self.connections: set[Connection] = set()

    def begins(self, playing: Connection) -> None:
        for connection in list(self.connections):
            if connection is not playing:
                connection.player.stop()

    @property
    def uses_device(self) -> bool:
        """Whether one of them sounds through this machine's output."""
        return any(connection.player.uses_device for connection in self.connections)

    def tell(self, document: Document, kind: str) -> None:
        """Tell the pages that show a document; in the event loop's thread."""
        listening = [connection for connection in self.connections if connection.document is document]
        if not listening:
            return
        state = document.state()
        for connection in listening:
            if kind == "disk":
                connection.post({"type": "disk", "disk": document.disk, "file": state["file"]})
            connection.post({"type": "state", "state": state})


class Connection:
    """Messages to and from one page."""

    def __init__(self, socket: WebSocket, document: Document, stage: Stage, *, rate_hz: int, quality: str) -> None:
        self.document = document
        self._socket = socket
        self._stage = stage
        self._loop = asyncio.get_running_loop()
        self._waiting: asyncio.Queue[dict[str, Any] | bytes] = asyncio.Queue()
        self.player = PagePlayer(
            document,
            self._post_from_player,
            rate_hz=rate_hz,
            quality=quality,
            backlog=self._waiting.qsize,
            begins=lambda: stage.begins(self),
        )

    def post(self, message: dict[str, Any] | bytes) -> None:
        """Send, in the event loop's thread."""
        self._waiting.put_nowait(message)

    def _post_from_player(self, message: dict[str, Any] | bytes) -> None:
        with contextlib.suppress(RuntimeError):  # the server has ended
            self._loop.call_soon_threadsafe(self.post, message)

    async def run(self) -> None:
        """Until the page goes."""
        await self._socket.accept()
        self._stage.connections.add(self)
        sending = asyncio.create_task(self._send())
        self.post({"type": "state", "state": self.document.state()})
        try:
            while True:
                self._hear(await self._socket.receive_text())
        except (WebSocketDisconnect, KeyError):  # KeyError: a binary frame, which no page sends
            pass
        finally:
            self._stage.connections.discard(self)
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                await sending
            await asyncio.to_thread(self.player.close)

    async def _send(self) -> None:
        while True:
            message = await self._waiting.get()
            if isinstance(message, bytes):
                await self._socket.send_bytes(message)
            else:
                await self._socket.send_text(json.dumps(message))

    def _hear(self, text: str) -> None:
        try:
            message = json.loads(text)
        except (ValueError, RecursionError):
            message = None
        if not isinstance(message, dict):
            self.post({"type": "error", "message": "a message must be a JSON object"})
            return
        try:
            self.player.ask(message)
        except ValueError as error:
            self.post({"type": "error", "message": one_line(error)})
