"""A static server for what `synth export -f web` writes, and pages of it in Chromium."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from selenium.webdriver.remote.webelement import WebElement

from tests.author.browser.running import FLAGS, Page

#: as a person has it: a page sounds only once it is played
AS_COMES = tuple(flag for flag in FLAGS if "autoplay" not in flag)
INSTRUMENT = "document.getElementById('instrument')"
#: `sent` is what goes to the audio thread from now on
LISTEN = """
window.sent = [];
const engine = instrument.engine;
const send = engine.send;
engine.send = (message) => {
  sent.push(message.midi ? { midi: [...message.midi] } : message);
  send.call(engine, message);
};
"""


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Log of requests: none is kept."""


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a folder: nothing but files, no header that isolates a page."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


class InstrumentPage(Page):
    """A page with an instrument; what is in it lies in the shadow of an element."""

    def ready(self) -> None:
        """It can be played, or says why not."""
        self.until(lambda: self.state() in ("ready", "failed"))

    def play_on(self, address: str) -> None:
        """Open a page that is to be played, which measures, and listen to what it sends."""
        self.open(f"{address}?measure")
        assert self.state() == "ready", self.said()
        self.script(LISTEN)

    def state(self) -> str | None:
        return self.script(f"return {INSTRUMENT}?.dataset.state")

    def said(self) -> str:
        """What it says of itself in words."""
        return self.script(f"return {INSTRUMENT}.shadowRoot.querySelector('.status').textContent")

    def inside(self, selector: str) -> WebElement:
        """An element of the instrument."""
        return self.until(lambda: self.script(f"return {INSTRUMENT}.shadowRoot.querySelector(arguments[0])", selector))

    def key(self, note: int) -> WebElement:
        return self.inside(f'[data-note="{note}"]')

    def down(self) -> list[int]:
        """Notes whose keys are shown as pressed."""
        pressed = "[...instrument.root.querySelectorAll('.key[aria-pressed=true]')]"
        return self.script(f"return {pressed}.map((key) => Number(key.dataset.note))")

    def figures(self) -> dict[str, Any]:
        """What the audio thread has measured."""
        return self.result("return instrument.engine.figures()")

    def sent(self, kind: int | None = None) -> list[dict[str, Any]]:
        """What has gone to the audio thread, of a kind of event or all."""
        return [each for each in self.script("return sent") if kind is None or each.get("kind") == kind]

    def set_slider(self, name: str, place: float) -> None:
        """Move a slider as a hand does: to a place 0 … 1 of its range."""
        self.script(
            """arguments[0].value = Number(arguments[0].min) + arguments[1] * (arguments[0].max - arguments[0].min);
            arguments[0].dispatchEvent(new Event("input", { bubbles: true }));""",
            self.inside(f'[data-id="{name}"]'),
            place,
        )
