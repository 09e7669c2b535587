"""A real `synth author` in a process of its own, and real Chromium pages on it."""

from __future__ import annotations

import base64
import re
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException, TimeoutException
from selenium.webdriver import ActionChains
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

from tests.author.serverkit import ROOT, Server
from tests.patience import patience_s

#: on a folder: Author(folder, preset)
Author = Server
PRESETS = ROOT / "presets"
#: where the number of a path's control is typed
FIELD = '[data-path="{}"] input[type="text"]'
SETTLED = """
const [controls, instrument] = ["controls", "instrument"].map((id) => document.getElementById(id).dataset);
return controls.shows === instrument.shows && controls.shows?.startsWith(`${decodeURIComponent(location.hash.slice(1))} `);
"""
# of many elements those that the driver need be asked of one by one, which takes its time
DRAWN = """
return [...document.querySelectorAll(arguments[0])].filter((each) => each.tagName === "OPTION" || each.checkVisibility());
"""
WITH_WORDS = """
return [...document.querySelectorAll(arguments[0])].filter((each) => each.innerText.trim().startsWith(arguments[1]));
"""
# Chromium asks for a page's icon late: where that page has been left for an empty one by then, it refuses itself the icon.
ICON_OF_BEFORE = re.compile(r"about:blank - Access to resource at '\S+/icon\.svg'|\S+/icon\.svg - .*net::ERR_FAILED")
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


def why_not() -> str:
    """Why no page can be opened here; empty if one can."""
    missing = [name for name in ("chromium", "chromedriver") if shutil.which(name) is None]
    return f"{' and '.join(missing)} not installed (apt-get install chromium chromium-driver)" if missing else ""


class Page:
    """A window of Chromium with the page in it."""

    def __init__(self, driver: webdriver.Chrome) -> None:
        self.driver = driver

    def open(self, address: str) -> None:
        self.load(address)
        self.ready()

    def load(self, address: str) -> None:
        """Go to an address. Beside other work the driver at times misses the end of a navigation (in two runs of some
        thousand pages, once each) and waits for it as long as it may: then the page is asked for once more."""
        self.driver.set_page_load_timeout(patience_s())
        try:
            self.driver.get(address)
        except TimeoutException:
            self.driver.get(address)

    def ready(self) -> None:
        """The page has come, with everything of the document that it was opened with."""
        self.until(lambda: self.script("return document.documentElement.dataset.ready === 'yes'"))
        if self.script("return !document.getElementById('work').hidden"):
            self.settle()

    def settle(self) -> None:
        """Controls and picture are there and show the same string: nothing is made anew under a hand but by an edit."""
        self.until(lambda: self.script(SETTLED))

    def reload(self) -> None:
        self.driver.refresh()
        self.ready()

    def open_nothing(self) -> None:
        """Leave the page, whatever is unsaved in it."""
        self.script("window.addEventListener('beforeunload', (event) => event.stopImmediatePropagation(), true)")
        self.load("about:blank")

    def choose(self, name: str) -> None:
        """Open a preset of the start page."""
        card = self.find(f'[data-preset="{name}"]')
        self.script("arguments[0].scrollIntoView()", card)
        card.click()
        self.settle()

    def hand(self) -> ActionChains:
        """What the mouse and the keys do next, each move within some 20 ms."""
        return ActionChains(self.driver, duration=20)  # 250 ms otherwise, in which the page draws for nobody

    def click(self, selector: str) -> None:
        self.find(selector).click()

    def field(self, path: str) -> WebElement:
        """Where the number of a control is typed; what folds it away is opened."""
        self.unfold(path)
        return self.find(FIELD.format(path))

    def unfold(self, path: str) -> None:
        """Open what folds a control away; the control of a string that is not shown: its tab first."""
        if string := re.match(r"string\.(\d+)\.", path):
            self.tab(int(string[1]))
        self._unfolded(f'.control[data-path="{path}"]')

    def tab(self, string: int) -> None:
        """Show the controls of a string, and with them its picture and its note."""
        found = self._unfolded(f'[role="tab"][data-tab="{string}"]')
        if found.get_attribute("aria-selected") != "true":
            found.click()
            self.until(lambda: self.all(f'[role="tab"][data-tab="{string}"][aria-selected="true"]'))

    def _unfolded(self, selector: str) -> WebElement:
        """An element, with the groups opened that it lies in."""
        found: WebElement = self.until(lambda: self.all(selector))[0]
        self.script("for (let e = arguments[0]; e; e = e.parentElement) if (e.matches('details')) e.open = true", found)
        return found

    def unfold_all(self) -> None:
        """Open all groups of controls."""
        self.script("for (const each of document.querySelectorAll('.group')) each.open = true")

    def script(self, source: str, *arguments: Any) -> Any:
        return self.driver.execute_script(source, *arguments)  # type: ignore[no-untyped-call]

    def await_script(self, source: str, *arguments: Any) -> Any:
        """The result of the body of an async function."""
        self.driver.set_script_timeout(patience_s())
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

    def until(self, holds: Callable[[], Any]) -> Any:
        """Wait for it: its value. What the page has replaced in between is looked for again."""
        gone = (StaleElementReferenceException,)
        wait = WebDriverWait(self.driver, patience_s(), poll_frequency=0.05, ignored_exceptions=gone)
        return wait.until(lambda _: holds())

    def find(self, selector: str) -> WebElement:
        """The first such element that is to be seen, as soon as there is one."""
        return self.until(lambda: next(self.shown(selector), None))

    def shown(self, selector: str) -> Iterator[WebElement]:
        """Those that are to be seen."""
        return (e for e in self.script(DRAWN, selector) if e.is_displayed())

    def all(self, selector: str) -> list[WebElement]:
        return self.driver.find_elements("css selector", selector)

    def button(self, words: str, within: str = "body") -> WebElement:
        """The first button to be seen whose text begins so."""

        def found() -> WebElement | None:
            some = self.script(WITH_WORDS, f"{within} button", words)
            return next((e for e in some if e.is_displayed() and e.text.startswith(words)), None)

        return self.until(found)

    def text(self, selector: str) -> str:
        return self.find(selector).text

    def errors(self) -> list[str]:
        """Complaints of the browser about this page."""
        entries = self.driver.get_log("browser")  # type: ignore[no-untyped-call]
        return [e["message"] for e in entries if e["level"] == "SEVERE" and not ICON_OF_BEFORE.match(e["message"])]


@contextmanager
def chromium(width: int = 1280, height: int = 900, flags: Sequence[str] = FLAGS) -> Iterator[webdriver.Chrome]:
    """A Chromium of its own."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for flag in (*flags, f"--window-size={width},{height}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
    # how long the driver may take to do a thing, loading a page among them; 120 s otherwise, however busy the machine
    driver.command_executor.client_config.timeout = patience_s(600.0)
    try:
        yield driver
    finally:
        driver.quit()


def copy_preset(preset: str, file: Path) -> None:
    """A preset of the program as a file of the user's."""
    file.write_text((PRESETS / f"{preset}.toml").read_text(encoding="utf-8"), encoding="utf-8")


def name_of(request: pytest.FixtureRequest) -> str:
    """A name for a file of the test's own."""
    return re.sub("[^a-z0-9]+", "-", request.node.name.lower()).strip("-")


def state(page: Page) -> Any:
    """What the server says of the page's document."""
    return page.result("return (await fetch('/api/docs/' + location.hash.slice(1))).json();")


def set_value(page: Page, path: str, value: float) -> None:
    """Type a number into the control of a path, as a person does; again where the page has replaced the field in between."""

    def typed() -> bool:
        page.field(path).send_keys(Keys.CONTROL, "a", Keys.NULL, f"{value}\n")
        return True

    page.until(typed)


def floats(text: str) -> np.ndarray:
    """Samples from base64 of float32."""
    return np.frombuffer(base64.b64decode(text), "<f4")
