"""What the browser is given on its command line, which every user of the machine can read, is no secret."""

from __future__ import annotations

import asyncio
import os
import shlex
import socket
import stat
import sys
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest

from synth.author import door
from synth.author.door import Door, owner_of
from tests.patience import until

from .conftest import Serve
from .serverkit import Server

#: a browser that leaves what others see of it, and asks for nothing
BROWSER = """import os, sys
with open({seen!r} + ".part", "wb") as file:
    for name in ("cmdline", "environ", "comm"):
        with open("/proc/self/" + name, "rb") as source:
            file.write(source.read() + b"\\n")
os.rename({seen!r} + ".part", {seen!r})
"""


@pytest.fixture
def browser(tmp_path: Path) -> tuple[dict[str, str], Path]:
    """(environment with a browser, the file that says what others see of it)."""
    program, seen = tmp_path / "browser", tmp_path / "seen"
    (tmp_path / "browser.py").write_text(BROWSER.format(seen=str(seen)))
    # a shell, since the first line of a script takes no path with a space
    words = " ".join(shlex.quote(str(word)) for word in (sys.executable, tmp_path / "browser.py"))
    program.write_text(f'#!/bin/sh\nexec {words} "$@"\n')
    program.chmod(0o700)
    return {**os.environ, "BROWSER": str(program)}, seen


def page_address(server: Server, seen: Path) -> str:
    until(seen.exists)
    shown = seen.read_bytes()
    assert server.token.encode() not in shown
    words = shown.split(b"\0")
    return next(word.decode() for word in words if word.startswith(b"http://"))


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="this system shows no command lines in /proc")
def test_the_browser_is_not_given_the_token(serve: Serve, browser: tuple[dict[str, str], Path]) -> None:
    env, seen = browser
    server = serve("mine.toml", env=env, browser=True)
    address = page_address(server, seen)
    parts = urlsplit(address)
    assert parts.hostname == "127.0.0.1" and parts.port == server.port and parts.path == "/"
    (code,) = parse_qs(parts.query)["door"]
    with httpx.Client() as first, httpx.Client() as second:
        # it is no token, opens the page only, and is not used up by those who look whether it is there
        assert first.get(address, headers={"Host": "example.org"}).status_code == 403
        assert first.head(address).status_code == 403
        session = f"http://127.0.0.1:{server.port}/api/session"
        assert first.get(session, params={"door": code}).status_code == 403
        assert first.get(session, headers={"Authorization": f"Bearer {code}"}).status_code == 403
        assert first.get(f"http://127.0.0.1:{server.port}/", params={"door": code + "x"}).status_code == 403
        answer = first.get(address)
        assert answer.status_code == 200 and "<title>jawari</title>" in answer.text
        assert "HttpOnly" in answer.headers["set-cookie"] and code not in answer.headers["set-cookie"]
        own = {"Sec-Fetch-Site": "same-origin"}
        assert first.get(session, headers=own).status_code == 200
        # whoever reads it later is refused, and whoever was let in goes on
        refused = second.get(address)
        assert refused.status_code == 403 and "works once" in refused.text and "set-cookie" not in refused.headers
        assert first.get(address, headers={"Sec-Fetch-Site": "none"}).status_code == 200  # loaded again
        assert first.get(session, headers=own).status_code == 200
    assert server.token.encode() not in Path(f"/proc/{server.pid}/cmdline").read_bytes()


def pair() -> tuple[socket.socket, socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        ours = socket.create_connection(listening.getsockname())
        return ours, listening.accept()[0]


linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux says whose a connection is")


@linux
def test_whose_a_connection_is() -> None:
    ours, theirs = pair()
    with ours, theirs:
        assert owner_of(ours.getsockname(), theirs.getsockname()) == os.getuid()
        assert owner_of(theirs.getsockname(), ours.getsockname()) == os.getuid()
        assert owner_of(("127.0.0.1", 1), theirs.getsockname()) is None
        ours.shutdown(socket.SHUT_WR)  # a socket on its way out may say it is root's
        assert owner_of(ours.getsockname(), theirs.getsockname()) is None


@linux
def test_whose_a_connection_from_a_socket_for_both_protocols_is() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        with socket.socket(socket.AF_INET6) as ours:
            try:
                ours.connect(("::ffff:127.0.0.1", listening.getsockname()[1]))
            except OSError:
                pytest.skip("this machine has no IPv6")
            theirs, client = listening.accept()
            with theirs:
                assert owner_of(client, theirs.getsockname()) == os.getuid()


@linux
def test_another_user_is_refused(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path) -> None:
    ours, theirs = pair()
    with ours, theirs:
        client, server = ours.getsockname(), theirs.getsockname()
        closed = Door()
        # the kernel's table with the connection as another user's
        rows = Path("/proc/net/tcp").read_text().splitlines(keepends=True)
        ends = f":{client[1]:04X}", f":{server[1]:04X}"
        mine = next(row for row in rows if row.split()[1].endswith(ends[0]) and row.split()[2].endswith(ends[1]))
        columns = mine.split()
        columns[7] = str(os.getuid() + 1)
        table = tmp_path / "tcp"
        table.write_text(rows[0] + " ".join(columns) + "\n")
        monkeypatch.setattr(door, "TABLES", (table,))
        assert closed.opens(closed.code, client, server) == "this page belongs to another user"
        assert "was refused" in caplog.text
        assert "is unknown" in str(closed.opens(closed.code, ("127.0.0.1", 1), server))
        monkeypatch.undo()
        assert closed.opens("", client, server) and closed.opens(closed.code + "x", client, server)
        assert closed.opens("é\udcff", client, server)
        assert closed.opens(closed.code, client, server) is None  # none of that has used it up
        assert "works once" in str(closed.opens(closed.code, client, server))


def test_it_does_not_stay_open(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = pair()
    with ours, theirs:
        late = Door()
        now = door.time.monotonic()
        monkeypatch.setattr(door.time, "monotonic", lambda: now + door.OPEN_S + 1)
        assert "works once" in str(late.opens(late.code, ours.getsockname(), theirs.getsockname()))


def test_where_nobody_says_whose_it_is_a_second_one_is_told(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    """…on the terminal, and what the first was given is worth nothing any more."""
    from starlette.applications import Starlette
    from starlette.responses import PlainTextResponse
    from starlette.routing import Route

    from synth.author.guard import Guard

    monkeypatch.setattr(door, "TABLES", (tmp_path / "nothing",))
    app = Starlette(routes=[Route("/", lambda _: PlainTextResponse("page")), Route("/x", lambda _: PlainTextResponse("x"))])
    guard = Guard(app, 8000, "token")
    code = guard.door().code
    own = {"Sec-Fetch-Site": "same-origin"}

    def client() -> httpx.AsyncClient:
        return httpx.AsyncClient(transport=httpx.ASGITransport(guard), base_url="http://127.0.0.1:8000")

    async def both() -> None:
        async with client() as first, client() as second:
            assert (await first.get("/", params={"door": code})).text == "page"
            assert (await first.get("/x", headers=own)).text == "x"
            assert (await second.get("/", params={"door": code})).status_code == 403
            assert "opened twice" in caplog.text
            assert (await first.get("/x", headers=own)).status_code == 403
            assert (await second.get("/", params={"door": code})).status_code == 403
            assert (await first.get("/", params={"token": "token"})).text == "page"  # the user's own address
            assert (await first.get("/x", headers=own)).text == "x"

    asyncio.run(both())


def test_nothing_is_left_for_others_to_read(serve: Serve, folder: Path) -> None:
    """What is written beside presets is as private as they are, and the lock is none that others could hold."""
    os.chmod(folder / "mine.toml", 0o600)
    server = serve("mine.toml")
    server.open("mine.toml").set("title", "Private")
    autosave = folder / ".mine.toml.autosave"
    until(autosave.exists)
    assert stat.S_IMODE(autosave.stat().st_mode) == 0o600
