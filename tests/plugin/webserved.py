"""A static server for what `synth export -f web` writes, and pages of it in a browser."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from tests.author.browser.running import Page


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Says nothing."""


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a folder: nothing but files, no header that isolates a page."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


INSTRUMENT = "document.getElementById('instrument')"


class InstrumentPage(Page):
    """A page with an instrument; what is in it lies in the shadow of an element."""

    def ready(self) -> None:
        self.until(lambda: self.state() in ("ready", "failed"))

    def state(self) -> str | None:
        return self.script(f"return {INSTRUMENT}?.dataset.state")

    def inside(self, selector: str):
        """An element of the instrument."""
        return self.until(lambda: self.script(f"return {INSTRUMENT}.shadowRoot.querySelector(arguments[0])", selector))

    def key(self, note: int):
        return self.inside(f'[data-note="{note}"]')

    def figures(self) -> dict:
        return self.result("return instrument.engine.figures()")

    def clear(self) -> None:
        self.script("instrument.engine.clear()")
