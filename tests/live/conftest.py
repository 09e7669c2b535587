"""A real sound server for the tests of this folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from .jackkit import JackServer, why_not

StartServer = Callable[..., JackServer]


@pytest.fixture(scope="session")
def jack_server() -> Iterator[StartServer]:
    """jack_server(frames=256, rate_hz=44100) -> JackServer that runs; end it soon (`with`), for a user can have but eight.
    What is left ends with the session."""
    reason = why_not()
    if reason:
        pytest.skip(reason)
    started: list[JackServer] = []

    def start(frames: int = 256, rate_hz: int = 44100) -> JackServer:
        started.append(JackServer(frames, rate_hz))
        return started[-1]

    try:
        yield start
    finally:
        for server in started:
            server.kill()
