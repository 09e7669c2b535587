"""A real `synth author` in a process of its own, and real Chromium pages on it."""

from __future__ import annotations

import base64
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

import numpy as np
from selenium import webdriver
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

ROOT = Path(__file__).resolve().parents[3]
PATIENCE_S = 90.0
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--autoplay-policy=no-user-gesture-required",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-default-apps",
    "--disable-sync",
    "--no-first-run",
    "--password-store=basic",
)


class Author:
    """`synth author` on a folder. address: what it printed; port: where it listens."""

    def __init__(self, folder: Path, preset: str | None = None, *, port: int = 0) -> None:
        self.folder = folder
        command = [sys.executable, "-m", "synth", "author", *([preset] if preset else [])]
        command += ["--folder", str(folder), "--port", str(port), "--no-browser"]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        self._process = subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        self.address = self._process.stdout.readline().strip()
        if not self.address:
            raise RuntimeError(f"synth author ended with {self._process.wait()}")
        self.port = int(urlsplit(self.address).port or 0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end(signal.SIGTERM)

    def end(self, by: signal.Signals) -> int:
        """Send a signal and wait: the exit code."""
        if self._process.poll() is None:
            self._process.send_signal(by)
        try:
            return self._process.wait(30.0)
        finally:
            self._process.kill()
            self._process.wait()
            if self._process.stdout is not None:
                self._process.stdout.close()


class Page:
    """A window of Chromium with the page in it."""

    def __init__(self, driver: webdriver.Chrome) -> None:
        self.driver = driver

    def open(self, address: str) -> None:
        self.driver.get(address)
        self.ready()

    def ready(self) -> None:
        self.until(lambda: self.script("return document.documentElement.dataset.ready === 'yes'"))

    def reload(self) -> None:
        self.driver.refresh()
        self.ready()

    def open_nothing(self) -> None:
        """Leave the page, whatever is unsaved in it."""
        self.script("window.addEventListener('beforeunload', (event) => event.stopImmediatePropagation(), true)")
        self.driver.get("about:blank")

    def field(self, path: str) -> WebElement:
        """Where the number of a control is typed."""
        return self.find(f'[data-path="{path}"] input[type="text"]')

    def script(self, source: str, *arguments: Any) -> Any:
        return self.driver.execute_script(source, *arguments)  # type: ignore[no-untyped-call]

    def await_script(self, source: str, *arguments: Any) -> Any:
        """The result of the body of an async function."""
        self.driver.set_script_timeout(PATIENCE_S)
        return self.driver.execute_async_script(  # type: ignore[no-untyped-call]
            "const done = arguments[arguments.length - 1];"
            f"(async (...given) => {{ {source} }})(...[...arguments].slice(0, -1)).then((value) => done([value, null]),"
            " (error) => done([null, String(error)]));",
            *arguments,
        )

    def result(self, source: str, *arguments: Any) -> Any:
        value, error = self.await_script(source, *arguments)
        if error is not None:
            raise RuntimeError(error)
        return value

    def until(self, holds: Callable[[], Any], patience_s: float = PATIENCE_S) -> Any:
        """Wait for it: its value."""
        return WebDriverWait(self.driver, patience_s, poll_frequency=0.05).until(lambda _: holds())

    def find(self, selector: str) -> WebElement:
        """The first such element that is to be seen, as soon as there is one."""
        return self.until(lambda: next((e for e in self.all(selector) if e.is_displayed()), None))

    def all(self, selector: str) -> list[WebElement]:
        return self.driver.find_elements("css selector", selector)

    def button(self, words: str, within: str = "body") -> WebElement:
        """The first button to be seen whose text begins so."""

        def found() -> WebElement | None:
            return next((e for e in self.all(f"{within} button") if e.is_displayed() and e.text.startswith(words)), None)

        return self.until(found)

    def text(self, selector: str) -> str:
        return self.find(selector).text

    def errors(self) -> list[str]:
        """What the browser has complained of, without what is expected of a server that is gone."""
        entries = self.driver.get_log("browser")  # type: ignore[no-untyped-call]
        return [e["message"] for e in entries if e["level"] == "SEVERE"]


@contextmanager
def chromium(width: int = 1280, height: int = 900) -> Iterator[webdriver.Chrome]:
    """A Chromium of its own."""
    options = webdriver.ChromeOptions()
    options.binary_location = "/usr/bin/chromium"
    for flag in (*FLAGS, f"--window-size={width},{height}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService("/usr/bin/chromedriver"))
    try:
        yield driver
    finally:
        driver.quit()


def set_value(page: Page, path: str, value: float) -> None:
    """Type a number into the control of a path, as a person does."""
    field = page.field(path)
    field.send_keys(Keys.CONTROL, "a", Keys.NULL, f"{value}\n")


def floats(text: str) -> np.ndarray:
    """Samples from base64 of float32."""
    return np.frombuffer(base64.b64decode(text), "<f4")
