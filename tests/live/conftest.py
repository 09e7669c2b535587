"""A real sound server for the tests of this folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from .jackkit import JackServer, why_not

StartServer = Callable[..., JackServer]


@pytest.fixture(scope="session")
def jack_server() -> Iterator[StartServer]:
    """jack_server(frames=256, rate_hz=44100, sync=False) -> JackServer that runs, the same one for the same arguments.

    fresh=True: one that nobody else gets, for who kills or alters it. All end with the session.
    """
    reason = why_not()
    if reason:
        pytest.skip(reason)
    started: list[JackServer] = []
    shared: dict[tuple, JackServer] = {}

    def start(frames: int = 256, rate_hz: int = 44100, *, sync: bool = False, fresh: bool = False) -> JackServer:
        key = (frames, rate_hz, sync)
        if not fresh and key in shared and shared[key].alive:
            return shared[key]
        server = JackServer(frames, rate_hz, sync=sync)
        started.append(server)
        if not fresh:
            shared[key] = server
        return server

    try:
        yield start
    finally:
        for server in started:
            server.kill()
