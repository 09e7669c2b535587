"""A real sound server for the tests of this folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from .jackkit import JackServer, why_not

StartServer = Callable[..., JackServer]


@pytest.fixture
def jack_server() -> Iterator[StartServer]:
    """jack_server(frames=256, rate_hz=44100, sync=False) -> JackServer that runs until the end of the test, or of a
    `with`: a user can have but eight at a time."""
    reason = why_not()
    if reason:
        pytest.skip(reason)
    started: list[JackServer] = []

    def start(frames: int = 256, rate_hz: int = 44100, sync: bool = False) -> JackServer:
        started.append(JackServer(frames, rate_hz, sync))
        return started[-1]

    try:
        yield start
    finally:
        for server in started:
            server.kill()
