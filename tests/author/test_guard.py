"""Nobody else gets in: other names, other pages, no token or a wrong one, on every path."""

from __future__ import annotations

import socket
from collections.abc import Iterator

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from synth.author.app import NO_DOCUMENT
from tests.patience import patience_s

from .serverkit import Server

PATHS = ("/", "/page/index.html", "/api/session", "/api/docs/x", "/nothing", "/ws/x")


@pytest.fixture
def bare(server: Server) -> Iterator[httpx.Client]:
    """A client that shows nothing."""
    with httpx.Client(base_url=f"http://127.0.0.1:{server.port}") as client:
        yield client


def refused(answer: httpx.Response, words: str) -> bool:
    assert answer.status_code == 403, answer.text
    assert answer.text.startswith("403: ") and answer.text.count("\n") == 1
    assert "set-cookie" not in answer.headers
    return words in answer.text


@pytest.mark.parametrize("path", PATHS)
def test_without_the_token_nothing_is_given(bare: httpx.Client, path: str) -> None:
    assert refused(bare.get(path), "no token")


@pytest.mark.parametrize("wrong", ["", "x", "é", "{}x", "x{}"])
def test_a_wrong_token(bare: httpx.Client, server: Server, wrong: str) -> None:
    token = wrong.format(server.token)
    if token:
        assert refused(bare.get("/", params={"token": token}), "wrong token")
        assert refused(bare.get("/api/session", headers={"Authorization": f"Bearer {token}".encode()}), "wrong token")
    assert refused(bare.get("/api/session", headers={"Cookie": f"jawari-{server.port}={token}".encode()}), "token")


def test_the_token_in_the_address_opens_the_page_only(bare: httpx.Client, server: Server) -> None:
    assert refused(bare.get("/api/session", params={"token": server.token}), "no token")
    assert refused(bare.get("/page/index.html", params={"token": server.token}), "no token")
    assert refused(bare.post("/", params={"token": server.token}), "no token")
    answer = bare.get("/", params={"token": server.token})
    assert answer.status_code == 200
    cookie = answer.headers["set-cookie"]
    assert cookie.startswith(f"jawari-{server.port}=") and server.token not in cookie
    assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
    # from now on the cookie does, in a browser
    for word in ({"Sec-Fetch-Site": "same-origin"}, {"Sec-Fetch-Site": "none"}, {"Origin": str(bare.base_url).rstrip("/")}):
        assert bare.get("/", headers=word).status_code == 200
        assert bare.get("/api/session", headers=word).status_code == 200
    assert refused(bare.get("/api/session"), "browser says")
    assert refused(bare.get("/api/session", headers={"Sec-Fetch-Site": "cross-site"}), "other pages")
    # the two secrets do not stand for each other
    secret = cookie.split("=", 1)[1].split(";")[0]
    bare.cookies.clear()
    own = {"Sec-Fetch-Site": "same-origin"}
    assert refused(bare.get("/", params={"token": secret}, headers=own), "wrong token")
    assert refused(bare.get("/api/session", headers={**own, "Authorization": f"Bearer {secret}"}), "wrong token")
    assert refused(
        bare.get("/api/session", headers={**own, "Cookie": f"jawari-{server.port}={server.token}"}), "wrong token"
    )


@pytest.mark.parametrize(
    "host", ["example.org", "127.0.0.1", "localhost", "127.0.0.1:1", "127.0.0.1.example.org:{}", "[::1]:{}"]
)
def test_another_name_for_this_machine(server: Server, host: str) -> None:
    answer = server.client.get("/api/session", headers={"Host": host.format(server.port)})
    assert refused(answer, "answers to 127.0.0.1:")


def test_localhost_is_a_name_of_this_machine(server: Server) -> None:
    assert server.client.get("/api/session", headers={"Host": f"localhost:{server.port}"}).status_code == 200


def test_two_names_at_once(server: Server) -> None:
    with socket.create_connection(("127.0.0.1", server.port)) as plain:
        own = f"Host: 127.0.0.1:{server.port}\r\n"
        plain.sendall(
            f"GET /api/session HTTP/1.1\r\n{own}Host: example.org\r\nConnection: close\r\n"
            f"Authorization: Bearer {server.token}\r\n\r\n".encode()
        )
        answer = b""
        while piece := plain.recv(4096):
            answer += piece
    assert answer.split()[1] in (b"400", b"403")


@pytest.mark.parametrize(
    "origin",
    ["http://example.org", "null", "https://127.0.0.1:{}", "http://127.0.0.1:1", "http://localhost:{}", "http://127.0.0.1"],
)
@pytest.mark.parametrize("path", ["/api/session", "/page/index.html", "/"])
def test_requests_of_other_pages(server: Server, origin: str, path: str) -> None:
    headers = {"Origin": origin.format(server.port)}
    assert refused(server.client.get(path, headers=headers), "other pages")
    assert refused(server.client.post("/api/open", headers=headers, json={"preset": "tanpura-light"}), "other pages")


def test_what_a_browser_says_of_another_site(server: Server) -> None:
    for site in ("cross-site", "same-site"):
        assert refused(server.client.get("/api/session", headers={"Sec-Fetch-Site": site}), "other pages")
    for site in ("same-origin", "none"):
        assert server.client.get("/api/session", headers={"Sec-Fetch-Site": site}).status_code == 200


def test_requests_of_the_page_itself(server: Server) -> None:
    for name in ("127.0.0.1", "localhost"):
        own = f"{name}:{server.port}"
        answer = server.client.get("/api/session", headers={"Host": own, "Origin": f"http://{own}"})
        assert answer.status_code == 200


def test_a_websocket_needs_them_too(server: Server) -> None:
    doc = server.open("tanpura-light")
    url = f"ws://127.0.0.1:{server.port}/ws/{doc.key}"
    for headers in ({}, {"Authorization": "Bearer x"}, {**server.headers, "Origin": "http://example.org"}):
        with pytest.raises(InvalidStatus) as refusal, connect(url, additional_headers=headers, proxy=None):
            pass
        assert refusal.value.response.status_code == 403
    with pytest.raises(InvalidStatus) as refusal, connect(f"{url}?token={server.token}", proxy=None):
        pass
    assert refusal.value.response.status_code == 403
    with doc.connect() as page:
        assert page.until("state")["state"]["doc"] == doc.key


def test_a_websocket_of_a_document_that_is_gone(server: Server) -> None:
    """The page is told so in a way that a browser passes on."""
    url = f"ws://127.0.0.1:{server.port}/ws/nothing"
    with connect(url, additional_headers=server.headers, proxy=None) as page, pytest.raises(ConnectionClosed) as end:
        page.recv(timeout=patience_s())
    assert end.value.rcvd is not None and end.value.rcvd.code == NO_DOCUMENT == 4404


def test_what_every_answer_says(server: Server, bare: httpx.Client) -> None:
    for answer in (server.client.get("/"), server.client.get("/api/session"), bare.get("/"), server.client.get("/nothing")):
        assert answer.headers["cache-control"] == "no-store"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "no-referrer"
        policy = answer.headers["content-security-policy"]
        assert policy.startswith("default-src 'self';") and "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy


def test_it_listens_on_the_loopback_only(server: Server) -> None:
    name = socket.gethostbyname(socket.gethostname())
    if name.startswith("127."):
        pytest.skip("this machine has no other address")
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((name, server.port), timeout=patience_s()).close()


@pytest.mark.parametrize("name", ["..", "../app.py", "%2e%2e/app.py", "..%2fapp.py", "/etc/passwd", "%2fetc%2fpasswd"])
def test_no_file_beside_the_page(server: Server, name: str) -> None:
    with socket.create_connection(("127.0.0.1", server.port)) as plain:
        plain.sendall(
            f"GET /page/{name} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nConnection: close\r\n"
            f"Authorization: Bearer {server.token}\r\n\r\n".encode()
        )
        assert plain.recv(64).split()[1] == b"404"


def test_bodies_that_are_too_large(server: Server) -> None:
    doc = server.open("tanpura-light")
    assert server.client.post("/api/open", content=b" " * (3 << 20)).status_code == 413
    answer = server.client.post("/api/import", json={"filename": "x.toml", "text": "#" * ((1 << 20) + 1)})
    assert answer.status_code == 413 and "1 MB" in answer.json()["error"]
    answer = server.client.post(f"/api/fit?doc={doc.key}&string=0", content=bytes((100 << 20) + 1))
    assert answer.status_code == 413 and "100 MB" in answer.json()["error"]


@pytest.mark.parametrize("body", ["", "[]", "{", "nonsense", '{"preset": 3}', '{"preset": null}', "[" * 100000])
def test_bodies_that_make_no_sense(server: Server, body: str) -> None:
    answer = server.client.post("/api/open", content=body)
    assert answer.status_code == 400 and "\n" not in answer.json()["error"]
