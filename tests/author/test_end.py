"""However it is ended, and in the middle of whatever: exit code 0, nothing lost, nothing said."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from pathlib import Path

import httpx
import pytest

from .conftest import Serve
from .serverkit import Doc, until


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
                timeout=60,
            )

    threads = [threading.Thread(target=ask, args=(velocity,)) for velocity in range(60, 90)]
    for thread in threads:
        thread.start()
    return threads


@pytest.mark.parametrize("times", [1, 2])
@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_ended_while_views_are_computed(serve: Serve, folder: Path, sign: signal.Signals, times: int) -> None:
    server = serve("mine.toml")
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
    server = serve(env=environment | {"XDG_CACHE_HOME": str(tmp_path / "cache")})
    assert server.get("/api/session")["kernels"] == "loading"
    code, said = server.end()
    assert code == 0
    assert said.startswith("Preparing the string engine") and said.count("\n") == 1
