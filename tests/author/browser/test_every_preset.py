"""Every preset that comes with the program, opened one after the other: a picture of a note that players try first."""

import pytest

from synth.instrument.preset import list_presets, load_preset
from tests.author.browser.running import Page, state

PICTURE = """
const string = document.querySelector('.stage.whole .string-rest');
return {
  points: string?.points.length ?? 0,
  wide: string?.getBoundingClientRect().width ?? 0,
  pluck: document.querySelector('[data-handle="pluck"]') !== null,
  said: document.querySelector('.stage.whole figcaption')?.textContent,
};
"""
CHOOSE = """
const note = document.getElementById('note');
note.value = arguments[0];
note.dispatchEvent(new Event('change', {bubbles: true}));
"""
#: a note that says much of the rule: (preset, first note)
FIRST = {
    "veena": 52,
    "sitar": 54,
    "koto-hirajoshi": 67,
    "tanpura-light": 43,
    "fretted-bass": 33,
    "nylon-guitar": 50,
    "harp": 63,
}


@pytest.fixture
def page(driver, author):
    page = Page(driver)
    page.open(author.address)
    yield page
    page.open_nothing()


def open_(page, author, name):
    """A preset in place of what is open, by a new load of the page."""
    doc = author.open(name)
    page.script("location.hash = arguments[0]; location.reload()", doc.key)
    page.until(lambda: page.script("return document.documentElement.dataset.ready === 'yes'"))
    page.until(lambda: state(page)["name"] == name and page.script(PICTURE)["points"] > 0)


def test_every_preset_opens_with_a_picture(page, author):
    page.errors()
    wrong = {}
    for preset in list_presets():
        try:
            open_(page, author, preset.name)
        except Exception as error:
            wrong[preset.name] = (type(error).__name__, page.errors())
            continue
        seen = page.script(PICTURE)
        note = int(page.find("#note").get_property("value"))
        if errors := page.errors():
            wrong[preset.name] = errors
        elif not (seen["wide"] > 100 and seen["pluck"] and seen["said"]) or FIRST.get(preset.name, note) != note:
            wrong[preset.name] = (note, seen)
    assert wrong == {}


@pytest.mark.parametrize("name", ["veena", "sitar"])
def test_a_string_without_points_is_drawn(page, author, name):
    open_(page, author, name)
    page.errors()
    for table in load_preset(name).string:
        if table.sympathetic or table.frets != 0:
            continue
        page.script(CHOOSE, table.notes[0])
        page.until(lambda words=table.name: page.script(PICTURE)["said"].startswith(f"{words} string"))
        assert page.script(PICTURE)["points"] > 1
    assert page.errors() == []
