"""Connections on which nothing is asked: no more than some of them, none for long, and few words about them.

Every user of the machine can connect to the page's port. A connection waits until a whole request stands on it, and again
after its answer. Of those that wait the oldest is closed as soon as there are more than MOST_WAITING, and each after
WAITING_S: so half a request, sent slowly or never ended, takes no descriptor from the page for long. The server takes
connections in batches of `BATCH`, each time it comes round: a new one is read long before it is the oldest.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
import time
from typing import Any

from uvicorn.protocols.http.auto import AutoHTTPProtocol

LOG = logging.getLogger(__name__)
MOST_WAITING = 64
#: for how long a connection may wait [s]
WAITING_S = 10.0
#: how many connections are taken before those that have come are read
BATCH = 16
#: how many the system may keep until they are taken
QUEUE = 128
#: the same is said again after [s]
SAID_AGAIN_S = 60.0
_NO_ROOM = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


class Seldom(logging.Filter):
    """Passes a warning once in SAID_AGAIN_S: what others send must not fill the terminal. Errors it passes always."""

    def __init__(self) -> None:
        super().__init__()
        self._said: dict[str, float] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        if record.levelno > logging.WARNING:
            return True
        now = time.monotonic()
        news = now - self._said.get(str(record.msg), -SAID_AGAIN_S) >= SAID_AGAIN_S
        if news:
            self._said[str(record.msg)] = now
        return news


class Waiting:
    """The connections that wait, the one that has waited longest first. In the event loop's thread."""

    def __init__(self) -> None:
        self._ends: dict[asyncio.BaseTransport, asyncio.TimerHandle] = {}

    def begins(self, transport: asyncio.BaseTransport) -> None:
        if transport in self._ends or transport.is_closing():
            return
        self._ends[transport] = asyncio.get_running_loop().call_later(WAITING_S, self._close, transport)
        if len(self._ends) > MOST_WAITING:
            LOG.warning(
                "more than %d connections wait without a request: the oldest are closed; another user of this machine "
                "may be opening them",
                MOST_WAITING,
            )
            self._close(next(iter(self._ends)))

    def ends(self, transport: asyncio.BaseTransport) -> None:
        timer = self._ends.pop(transport, None)
        if timer is not None:
            timer.cancel()

    def _close(self, transport: asyncio.BaseTransport) -> None:
        self.ends(transport)
        assert isinstance(transport, asyncio.WriteTransport)
        transport.abort()


def protocol_of(waiting: Waiting) -> type[asyncio.Protocol]:
    """uvicorn's protocol, which keeps `waiting` true of its connection."""

    class Protocol(AutoHTTPProtocol):  # type: ignore[misc, valid-type]
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            waiting.begins(transport)

        def connection_lost(self, exc: Exception | None) -> None:
            waiting.ends(self.transport)
            super().connection_lost(exc)

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            self._follow()

        def on_response_complete(self) -> None:
            super().on_response_complete()
            self._follow()

        def handle_websocket_upgrade(self, *given: Any) -> None:
            waiting.ends(self.transport)
            self._upgraded = True
            super().handle_websocket_upgrade(*given)

        def _follow(self) -> None:
            if getattr(self, "_upgraded", False) or (self.cycle is not None and not self.cycle.response_complete):
                waiting.ends(self.transport)
            else:
                waiting.begins(self.transport)

    return Protocol


def be_brief() -> None:
    """Have what others send be told of in few words; in a running event loop."""
    for logger in (LOG, logging.getLogger("uvicorn.error")):
        logger.addFilter(Seldom())
    asyncio.get_running_loop().set_exception_handler(_told)


def lengthen_queue(listening: list[socket.socket]) -> None:
    """The event loop takes its batch's size for the system's queue as well."""
    for each in listening:
        each.listen(QUEUE)


def _told(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    error = context.get("exception")
    if isinstance(error, OSError) and error.errno in _NO_ROOM:
        LOG.warning("a connection cannot be taken: %s", error.strerror)
    else:
        loop.default_exception_handler(context)
