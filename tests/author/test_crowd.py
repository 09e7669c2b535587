"""Connections without a request: they take no room from the owner of the page, for long, or on the terminal."""

from __future__ import annotations

import contextlib
import resource
import socket
from collections.abc import Iterator

import httpx
import pytest

from tests.patience import patience_s

from .conftest import Serve
from .serverkit import Server

DESCRIPTORS = 256
HALF = b"GET / HTTP/1.1\r\nHost: "


@contextlib.contextmanager
def half_sent(server: Server, count: int, what: bytes = HALF) -> Iterator[list[socket.socket]]:
    """So many connections with half a request on each, or with something else."""
    with contextlib.ExitStack() as held:
        opened = []
        for _ in range(count):
            each = held.enter_context(socket.create_connection(("127.0.0.1", server.port), timeout=patience_s()))
            with contextlib.suppress(ConnectionError):
                each.sendall(what)
            opened.append(each)
        yield opened


def answer(server: Server) -> int:
    """The status that the owner gets over a connection of its own."""
    with httpx.Client(headers=server.headers, timeout=patience_s()) as client:
        return client.get(f"http://127.0.0.1:{server.port}/api/session").status_code


@pytest.mark.parametrize("what", [HALF, b"", b"no request at all\r\n\r\n"])
def test_connections_of_others_leave_the_owner_an_answer_and_the_terminal_quiet(serve: Serve, what: bytes) -> None:
    server = serve()
    resource.prlimit(server.pid, resource.RLIMIT_NOFILE, (DESCRIPTORS, DESCRIPTORS))
    with half_sent(server, 400, what):
        for _ in range(3):
            assert answer(server) == 200
        with server.open("tanpura-light").connect() as page:
            assert page.until("state")["state"]["name"] == "tanpura-light"
    code, said = server.end()
    assert code == 0 and len(said.splitlines()) <= 2, said[-2000:]


def test_half_a_request_is_not_waited_for(serve: Serve) -> None:
    """Neither the first on a connection nor one after another's answer."""
    server = serve()
    with half_sent(server, 2) as (first, second):
        own = f"127.0.0.1:{server.port}\r\nAuthorization: Bearer {server.token}\r\n\r\n"
        second.sendall(own.encode())
        assert second.recv(64).split()[1] == b"200"
        second.sendall(HALF)
        for each in (first, second):
            with contextlib.suppress(ConnectionError):
                while each.recv(1 << 16):
                    pass


def test_a_page_that_is_connected_is_not_waiting(serve: Serve) -> None:
    server = serve()
    with server.open("tanpura-light").connect() as page, half_sent(server, 200):
        assert answer(server) == 200
        page.send("nonsense")
        assert page.until("error")
