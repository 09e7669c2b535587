"""The page in the other browser: it opens, edits, drags, sounds and saves there as it does in Chromium."""

import numpy as np
import pytest

from synth.instrument.preset import load_preset
from tests.author.browser.firefox import CONTROL, ENTER, Firefox, null_sink, why_not
from tests.author.browser.listening import FRAMES, LISTEN, RATE_HZ, heard, is_beginning_of, rendered, silence
from tests.author.browser.running import FIELD, Author, state

if why_not():
    pytest.skip(why_not(), allow_module_level=True)


@pytest.fixture(scope="module")
def firefox():
    with null_sink(RATE_HZ) as sink, Firefox(sink) as firefox:
        yield firefox


@pytest.fixture
def page(firefox, folder):
    """A Firefox with the preset mine.toml open."""
    with Author(folder, "mine.toml") as author:
        firefox.open(author.address)
        yield firefox
        firefox.open_nothing()


def value_of(page, path):
    return float(page.script("return document.querySelector(arguments[0]).value", FIELD.format(path)))


def type_over(page, path, text):
    """Over what stands in a field; a click might miss what a busy page still moves."""
    at = "const at = document.querySelector(arguments[0]); at.focus(); at.select(); return document.activeElement === at"
    page.until(lambda: page.script(at, FIELD.format(path)))
    page.keys(*text, ENTER)


def set_value(page, path, value):
    type_over(page, path, str(value))
    page.until(lambda: str(value) in state(page)["text"])


def test_what_is_typed_is_taken_undone_and_saved(page, folder):
    set_value(page, "pluck.position", 0.31)
    page.script("document.activeElement.blur()")
    page.keys("z", held=CONTROL)
    page.until(lambda: not state(page)["dirty"])
    page.until(lambda: value_of(page, "pluck.position") == 0.42)
    set_value(page, "pluck.width_mm", 13.25)  # a text that stands nowhere else in the file
    page.keys("s", held=CONTROL)
    page.until(lambda: not state(page)["dirty"])
    assert load_preset(str(folder / "mine.toml")).pluck.width_mm == 13.25
    assert page.errors() == []


def test_a_wrong_value_is_refused_at_the_field(page):
    type_over(page, "pluck.position", "1.5")
    error = "return document.querySelector('.control[data-path=\"pluck.position\"] .control-error').textContent"
    page.until(lambda: "less than 1" in page.script(error))
    assert not state(page)["dirty"]


def test_a_slider_is_dragged_finer_with_shift_and_goes_back_by_a_double_click(page):
    path = "pluck.width_mm"
    slider = f'.control[data-path="{path}"] .control-slider'
    page.drag(slider, -40)
    page.until(lambda: value_of(page, path) < 13)
    page.until(lambda: state(page)["data"]["pluck"]["width_mm"] == value_of(page, path))
    before = value_of(page, path)
    page.script("document.querySelector(arguments[0]).focus()", slider)
    page.keys("\ue014")  # arrow right
    page.until(lambda: value_of(page, path) > before)
    coarse = value_of(page, path) - before
    page.keys("\ue014", held="\ue008")  # with Shift
    page.until(lambda: value_of(page, path) > before + coarse)
    assert value_of(page, path) - before - coarse == pytest.approx(0.1 * coarse, rel=0.25)
    page.double_click(slider)
    page.until(lambda: state(page)["data"]["pluck"]["width_mm"] == 18)
    page.until(lambda: value_of(page, path) == 18)
    assert page.errors() == []


def test_a_unit_is_taken_and_a_wrong_one_refused(page):
    page.click(FIELD.format("obstacle.jiva_um"))
    page.keys("a", held=CONTROL)
    page.keys(*"0.02 mm", ENTER)
    page.until(lambda: state(page)["data"]["obstacle"]["jiva_um"] == 20)
    page.keys("a", held=CONTROL)
    page.keys(*"3 s", ENTER)
    error = "return document.querySelector('.control[data-path=\"obstacle.jiva_um\"] .control-error').textContent"
    page.until(lambda: page.script(error).startswith("must be a length in µm"))
    assert state(page)["data"]["obstacle"]["jiva_um"] == 20


def test_the_pluck_is_dragged(page):
    page.drag('[data-handle="pluck"] .reach', 120)
    page.until(lambda: state(page)["dirty"])
    page.until(lambda: page.script("return document.querySelector('.handle.held')") is None)
    page.until(lambda: state(page)["data"]["pluck"]["position"] == pytest.approx(value_of(page, "pluck.position")))
    assert 0.1 < value_of(page, "pluck.position") < 0.4
    page.click("#undo")
    page.until(lambda: not state(page)["dirty"])
    assert page.errors() == []


def test_what_sounds_is_what_render_writes(page, folder):
    page.script(LISTEN)
    page.click('[data-phrase="note"]')
    page.until(lambda: page.script(FRAMES) > 0)  # the device is open: it may take longer than a sound is kept
    silence(page)
    page.click('[data-phrase="note"]')
    page.until(lambda: page.script(FRAMES) >= RATE_HZ)
    played = heard(page, "played")
    note = int(page.script("return document.querySelector('.keys').getAttribute('aria-valuenow')"))
    want = rendered(folder / "mine.toml", note, 90, folder)
    assert np.abs(want[:RATE_HZ]).max() > 0.01
    assert is_beginning_of(heard(page, "received"), want) and is_beginning_of(played, want)
    silence(page)
    page.script("document.activeElement.blur()")
    page.keys("a")
    page.until(lambda: page.script(FRAMES) > 0)
    assert page.script("return document.querySelector('.key-note').textContent") == "C2"
    assert page.errors() == []


def test_without_a_sound_card_it_says_so(folder):
    with Firefox() as firefox, Author(folder, "mine.toml") as author:
        firefox.open(author.address)
        firefox.click('[data-phrase="drone"]')
        firefox.until(lambda: "this browser plays no sound" in firefox.script("return document.body.textContent"))
        firefox.open_nothing()


def test_pictures_are_drawn(page):
    """The string, its film, and every picture of the analysis have something on them."""
    page.until(lambda: page.script("return document.querySelector('.facts').textContent.startsWith('Pitch')"))
    painted = """return [...document.querySelectorAll('canvas')].filter((each) => each.checkVisibility()).map((each) =>
      new Set(new Uint32Array(each.getContext('2d').getImageData(0, 0, each.width, each.height).data.buffer)).size)"""
    page.until(lambda: page.script(painted) and min(page.script(painted)) > 1)
    assert page.script("return document.querySelectorAll('.stage svg path').length") > 3
    assert page.errors() == []


def test_on_400_pixels_nothing_is_cut_off(page):
    page.size(400, 800)
    try:
        page.until(lambda: page.script("return document.scrollingElement.scrollWidth") <= 400)
        set_value(page, "pluck.position", 0.25)
    finally:
        page.size(1280, 900)


SWITCHES = """
[articulations.normal]
key = "C0"
[articulations.mute]
key = "D0"
touch = { place = 0.05, resistance = 2.0 }
"""


def test_keys_that_switch_have_their_names_and_switch(firefox, folder):
    with (folder / "mine.toml").open("a", encoding="utf-8") as file:
        file.write(SWITCHES)
    with Author(folder, "mine.toml") as author:
        firefox.open(author.address)
        shown = "return [...document.querySelectorAll('.switch')].map((e) => e.textContent)"
        firefox.until(lambda: firefox.script(shown) == ["normalC0", "muteD0"])
        latched = "return document.querySelector('.switch.latched .switch-name')?.textContent"
        assert firefox.script(latched) == "normal"
        before = firefox.script("return document.querySelector('.keys').getAttribute('aria-valuenow')")
        firefox.click("[data-key='14']")
        firefox.until(lambda: firefox.script(latched) == "mute")
        assert firefox.script("return document.querySelector('.keys').getAttribute('aria-valuenow')") == before
        assert firefox.errors() == []
        firefox.open_nothing()
