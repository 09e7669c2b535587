"""Instruments for web pages in the other browser: they come, sound and say what is wrong there as they do in Chromium."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.author.browser.firefox import Firefox, null_sink, why_not
from tests.plugin.webserved import INSTRUMENT, served

if why_not():
    pytest.skip(why_not(), allow_module_level=True)

STATE = f"return {INSTRUMENT}?.dataset.state"
SAID = f"return {INSTRUMENT}.shadowRoot.querySelector('.status').textContent"
PLACE = """
const box = instrument.keyboard.key(arguments[0]).getBoundingClientRect();
return [Math.round(box.x + box.width / 2), Math.round(box.y + 0.9 * box.height)];
"""


@pytest.fixture(scope="module")
def firefox() -> Iterator[Firefox]:
    with null_sink(48000) as sink, Firefox(sink) as firefox:
        yield firefox


def come(firefox: Firefox, address: str) -> str:
    """Open a page; how it stands."""
    firefox.call("browsingContext.navigate", context=firefox.tab, url=address, wait="complete")
    return firefox.until(lambda: (state := firefox.script(STATE)) in ("ready", "failed") and state)


def press(firefox: Firefox, note: int) -> None:
    x, y = firefox.script(PLACE, note)
    hand = [{"type": "pointerMove", "x": x, "y": y}, *({"type": each, "button": 0} for each in ("pointerDown", "pointerUp"))]
    firefox.call("input.performActions", context=firefox.tab, actions=[{"type": "pointer", "id": "mouse", "actions": hand}])


def sounds(firefox: Firefox) -> None:
    firefox.until(lambda: firefox.script("return (await instrument.engine.figures()).peak > 1e-3"))


@pytest.mark.slow
def test_it_sounds_under_the_mouse(firefox: Firefox, web_folders: dict[str, Path]) -> None:
    with served(web_folders["two"]) as address:
        assert come(firefox, f"{address}?measure") == "ready", firefox.script(SAID)
        press(firefox, 48)
        sounds(firefox)
        assert firefox.script("return (await instrument.engine.figures()).notes") == 1
        assert firefox.errors() == []
        firefox.open_nothing()


@pytest.mark.slow
def test_the_one_file_plays_from_a_disk(firefox: Firefox, web_folders: dict[str, Path]) -> None:
    address = (web_folders["tanpura-light"] / "tanpura-light.html").as_uri()
    assert come(firefox, f"{address}?measure") == "ready", firefox.script(SAID)
    press(firefox, 48)
    sounds(firefox)
    firefox.open_nothing()


@pytest.mark.slow
def test_a_damaged_bank_is_refused_with_a_reason(firefox: Firefox, web_folders: dict[str, Path], tmp_path: Path) -> None:
    for path in web_folders["tanpura-light"].iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    bank = tmp_path / "tanpura-light.jawari"
    bank.write_bytes(bank.read_bytes()[:5000])
    with served(tmp_path) as address:
        assert come(firefox, address) == "failed"
        assert "cut off" in firefox.script(SAID)
        firefox.open_nothing()
