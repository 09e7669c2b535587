"""A headless Firefox and a page in it, told what to do by WebDriver BiDi (W3C), which Firefox speaks without a driver; and
a sound card for it that is none, because without one it plays nothing."""

from __future__ import annotations

import base64
import itertools
import json
import os
import re
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

from tests import pipewirekit
from tests.author.browser.running import SETTLED
from tests.patience import QUIET_S, patience_s, until

NAMES = ("firefox-esr", "firefox")
PREFERENCES = {
    "app.update.enabled": False,
    "browser.shell.checkDefaultBrowser": False,
    "datareporting.policy.dataSubmissionEnabled": False,
    "media.autoplay.default": 0,
    "toolkit.telemetry.server": "",
}
CONTROL, ENTER = "\ue009", "\ue007"
_LISTENS = re.compile(r"WebDriver BiDi listening on (ws://\S+)")


def why_not() -> str:
    """Why no page can be opened and heard here; empty if one can."""
    if _program() is None:
        return "firefox-esr not installed (apt-get install firefox-esr)"
    return pipewirekit.why_not(pulse=True)


def _program() -> str | None:
    return next((found for name in NAMES if (found := shutil.which(name))), None)


@contextmanager
def null_sink(rate_hz: int = 44100) -> Iterator[str]:
    """A sound server of its own whose only output is paced and goes nowhere: what PULSE_SERVER must be to use it."""
    with pipewirekit.PipeWire(rate_hz=rate_hz, pulse=True) as server:
        yield server.env["PULSE_SERVER"]


class Firefox:
    """A Firefox of its own with one tab, to be used with `with`; `pulse_server` is its sound card."""

    def __init__(self, pulse_server: str = "unix:/nowhere") -> None:
        self._env = os.environ | {"PULSE_SERVER": pulse_server}
        self._held = ExitStack()
        folder = Path(self._held.enter_context(tempfile.TemporaryDirectory(prefix="jawari-firefox-")))
        self._profile, self._said = folder, folder / "stderr"
        lines = [f"user_pref({json.dumps(name)}, {json.dumps(value)});\n" for name, value in PREFERENCES.items()]
        (folder / "user.js").write_text("".join(lines), encoding="utf-8")
        self._numbers = itertools.count(1)
        self._errors: list[str] = []

    def __enter__(self) -> Firefox:
        program = _program()
        assert program is not None
        command = [program, "--headless", "--no-remote", "--profile", str(self._profile), "--remote-debugging-port", "0"]
        with self._said.open("w") as said:
            self._process = subprocess.Popen(command, env=self._env, stdout=subprocess.DEVNULL, stderr=said)
        try:
            self._socket = self._held.enter_context(connect(f"{self._address()}/session", max_size=None))
            self.call("session.new", capabilities={})
            self.call("session.subscribe", events=["log.entryAdded"])
            self.tab = self.call("browsingContext.getTree")["contexts"][0]["context"]
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        try:
            self._process.wait(patience_s())
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._held.close()

    def _address(self) -> str:
        deadline = time.monotonic() + patience_s()
        while time.monotonic() < deadline and self._process.poll() is None:
            if found := _LISTENS.search(self._said.read_text(errors="replace")):
                return found[1]
            time.sleep(0.05)
        raise RuntimeError(f"Firefox does not start: {self._said.read_text(errors='replace')[-2000:]}")

    def call(self, method: str, *, quiet_s: float = QUIET_S, **params: Any) -> dict:
        """A command and its result, had in `quiet_s` [s] on a quiet machine. Raises RuntimeError for what is refused."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": params}))
        while True:
            answer = json.loads(self._socket.recv(timeout=patience_s(quiet_s)))
            if answer["type"] == "event":
                if answer["method"] == "log.entryAdded" and answer["params"]["level"] == "error":
                    self._errors.append(str(answer["params"]["text"]))
            elif answer["id"] == number:
                if answer["type"] == "error":
                    raise RuntimeError(f"{method}: {answer['error']}: {answer['message']}")
                return answer["result"]

    def errors(self) -> list[str]:
        """What pages have complained of since the last time."""
        self.script("return 0")  # what came before it is there
        errors, self._errors = self._errors, []
        return errors

    def open(self, address: str) -> None:
        self.call("browsingContext.navigate", context=self.tab, url=address, wait="complete")
        self.until(lambda: self.script("return document.documentElement.dataset.ready === 'yes'"))
        self.until(lambda: self.script(SETTLED))

    def open_nothing(self) -> None:
        """Leave the page, whatever is unsaved in it."""
        self.script("window.addEventListener('beforeunload', (event) => event.stopImmediatePropagation(), true)")
        self.call("browsingContext.navigate", context=self.tab, url="about:blank", wait="complete")

    def script(self, body: str, *given: Any, quiet_s: float = QUIET_S) -> Any:
        """The result, plain data, of the body of an async function; `given` are its arguments. Raises RuntimeError."""
        answer = self.call(
            "script.callFunction",
            quiet_s=quiet_s,
            functionDeclaration="async (text) => JSON.stringify(await"
            f" (async function () {{ {body} }}).apply(null, JSON.parse(text)) ?? null)",
            arguments=[{"type": "string", "value": json.dumps(given)}],
            awaitPromise=True,
            target={"context": self.tab},
            userActivation=False,
        )
        if answer["type"] == "exception":
            raise RuntimeError(answer["exceptionDetails"]["text"])
        return json.loads(answer["result"]["value"])

    result = script

    def until(self, holds: Callable[[], Any]) -> Any:
        """Wait for it: its value."""
        return until(holds)

    def place(self, selector: str) -> tuple[float, float]:
        """The middle of the first such element to be seen, scrolled into view, once it stays there [px]."""
        return tuple(
            self.until(
                lambda: self.script(
                    """const frame = () => new Promise((done) => requestAnimationFrame(done));
                    const middle = () => {
                      const seen = [...document.querySelectorAll(arguments[0])].find((each) => each.checkVisibility());
                      seen?.scrollIntoView({block: "nearest", inline: "nearest"});
                      const box = seen?.getBoundingClientRect();
                      return box && [box.x + box.width / 2, box.y + box.height / 2];
                    };
                    const before = middle();
                    await frame();
                    await frame();
                    const now = middle();
                    return before && now && before[0] === now[0] && before[1] === now[1] ? now : null;""",
                    selector,
                )
            )
        )

    def drag(self, selector: str, dx: float = 0, dy: float = 0, steps: int = 8) -> None:
        """Press the mouse on an element, move, let go; a click where it does not move."""
        x, y = self.place(selector)
        moves = range(1, steps + 1) if dx or dy else ()
        actions = [
            {"type": "pointerMove", "x": round(x), "y": round(y)},
            {"type": "pointerDown", "button": 0},
            *({"type": "pointerMove", "x": round(x + dx * i / steps), "y": round(y + dy * i / steps)} for i in moves),
            {"type": "pointerUp", "button": 0},
        ]
        self._act({"type": "pointer", "id": "mouse", "actions": actions})

    click = drag

    def double_click(self, selector: str) -> None:
        """Two clicks on an element, as fast as they go."""
        x, y = self.place(selector)
        click = [{"type": "pointerDown", "button": 0}, {"type": "pointerUp", "button": 0}]
        actions = [{"type": "pointerMove", "x": round(x), "y": round(y)}, *click, *click]
        self._act({"type": "pointer", "id": "mouse", "actions": actions})

    def keys(self, *keys: str, held: str = "") -> None:
        """Press keys one after the other while others are held; see WebDriver for names of keys that are no characters."""
        down = [{"type": "keyDown", "value": key} for key in held]
        strokes = [{"type": how, "value": key} for key in keys for how in ("keyDown", "keyUp")]
        up = [{"type": "keyUp", "value": key} for key in reversed(held)]
        self._act({"type": "key", "id": "keys", "actions": [*down, *strokes, *up]})

    def _act(self, source: dict) -> None:
        self.call("input.performActions", context=self.tab, actions=[source])

    def size(self, width: int, height: int) -> None:
        """The page's size [px]."""
        self.call("browsingContext.setViewport", context=self.tab, viewport={"width": width, "height": height})
        self.until(lambda: self.script("return innerWidth") == width)

    def picture(self) -> bytes:
        """The page as PNG."""
        return base64.b64decode(self.call("browsingContext.captureScreenshot", context=self.tab)["data"])
