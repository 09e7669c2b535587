"""However it is ended, and in the middle of whatever: exit code 0, nothing lost, nothing said."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import threading
import time
from pathlib import Path

import httpx
import pytest

from tests.patience import patience_s, until

from .conftest import Serve
from .serverkit import Doc


def autosaved(folder: Path) -> str:
    found = [path.read_text(encoding="utf-8") for path in folder.glob(".mine.toml*.autosave*")]
    return found[0] if found else ""


def ask_for_views(doc: Doc) -> list[threading.Thread]:
    """Let many views be computed, one after the other."""

    def ask(velocity: int) -> None:
        with contextlib.suppress(httpx.HTTPError):  # cut off
            httpx.get(
                f"http://127.0.0.1:{doc.server.port}{doc.path}/analysis?note=36&velocity={velocity}&seconds=10",
                headers=doc.server.headers,
                timeout=patience_s(),
            )

    threads = [threading.Thread(target=ask, args=(velocity,)) for velocity in range(60, 90)]
    for thread in threads:
        thread.start()
    return threads


@pytest.mark.parametrize("times", [1, 2])
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_ended_while_views_are_computed(serve: Serve, folder: Path, sign: signal.Signals, times: int) -> None:
    server = serve("mine.toml", as_it_is=True)
    doc = server.open("mine.toml")
    until(lambda: server.get("/api/session")["kernels"] == "ready")
    with doc.connect() as page:
        page.send("note_on", key=48, velocity=100)
        page.until("audio")
        asking = ask_for_views(doc)
        time.sleep(0.5)  # they are under way
        doc.set("remarks", "the last word")
        for _ in range(times - 1):
            os.kill(server.pid, sign)
        code, said = server.end(sign)
    for thread in asking:
        thread.join()
    assert (code, said) == (0, "")
    assert "the last word" in autosaved(folder)


def test_the_first_start_says_what_it_does(serve: Serve, tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    server = serve("mine.toml", env=environment | {"XDG_CACHE_HOME": str(tmp_path / "cache")})
    with server.open("mine.toml").connect() as page:
        first = page.until("kernels", lambda message: message["compiling"] and message["compiling"]["total"] > 1)[
            "compiling"
        ]
        assert 0 <= first["done"] < first["total"] > 50 and 0 <= first["share"] < 1
        later = page.until("kernels", lambda message: message["compiling"]["done"] > first["done"])["compiling"]
        assert later["share"] > first["share"] and later["seconds"] > first["seconds"]
    now = server.get("/api/kernels")
    assert now["kernels"] == "loading" and now["compiling"]["total"] >= first["total"]
    code, said = server.end()
    assert code == 0
    begun, ended = said.splitlines()
    assert begun == "synth: compiling kernels, once on this machine; takes ½ to 2 minutes"
    assert re.fullmatch(r"synth: \d+ of \d+ kernels compiled in \d+ s", ended)


#: `synth` with something in it that never ends; {marker} is there once it waits
STUCK = """
import pathlib, sys, time
from synth.author.app import App
from synth.author.documents import Documents

def wait(*_):
    pathlib.Path({marker!r}).touch()
    while True:
        time.sleep(1000)

async def wait_in_the_loop(*_):
    wait()

{what}
from synth.cli import main
sys.exit(main())
"""


REQUEST, LOOP = ("Documents.presets = wait", "/api/session"), ("App._index = wait_in_the_loop", "/")


@pytest.mark.parametrize(
    ("sign", "what", "path"),
    [
        (signal.SIGTERM, *REQUEST),
        (signal.SIGHUP, *REQUEST),
        (signal.SIGTERM, *LOOP),
    ],
)
def test_ended_while_something_never_ends(
    serve: Serve, folder: Path, tmp_path: Path, sign: signal.Signals, what: str, path: str
) -> None:
    marker = tmp_path / "waits"
    server = serve("mine.toml", program=("-c", STUCK.format(marker=str(marker), what=what)))
    doc = server.open("mine.toml")
    doc.set("remarks", "the last word")
    asking = threading.Thread(target=_ask, args=(f"http://127.0.0.1:{server.port}{path}", server.headers))
    asking.start()
    until(marker.exists)
    assert server.end(sign) == (0, "")
    asking.join()
    assert "the last word" in autosaved(folder)


def test_ended_while_the_disk_does_not_answer(serve: Serve, tmp_path: Path) -> None:
    server = serve("mine.toml", program=("-c", STUCK.format(marker=str(tmp_path / "waits"), what="App.end = wait")))
    code, said = server.end(signal.SIGTERM)
    assert code == 1 and "ended by force" in said and said.count("\n") == 1


def _ask(url: str, headers: dict[str, str]) -> None:
    with contextlib.suppress(httpx.HTTPError):  # cut off
        httpx.get(url, headers=headers, timeout=patience_s())
