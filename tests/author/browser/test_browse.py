"""The presets that come with the program: by family, found by words and tags, heard and opened, all by keyboard too."""

import io

import numpy as np
import soundfile
from selenium.webdriver.common.keys import Keys

from synth.instrument.preset import list_presets

NAMES = {preset.name for preset in list_presets()}


def names(page):
    return [each.get_attribute("data-preset") for each in page.all("dialog .browse-list [data-preset]")]


def begin(page):
    page.find("#open").click()
    page.until(lambda: set(names(page)) == NAMES)


def press(page, *keys):
    page.hand().send_keys(*keys).perform()


def focused(page):
    element = page.driver.switch_to.active_element
    return element.get_attribute("data-preset") or element.get_attribute("data-listen")


def test_found_by_words_families_and_tags(page):
    begin(page)
    assert page.script("return document.activeElement.className") == "browse-search"
    press(page, "slides")
    page.until(
        lambda: (
            names(page)
            == [preset.name for preset in list_presets() if "slides" in preset.description or "slides" in preset.tags]
        )
    )
    assert f"of {len(NAMES)}" in page.text("dialog .browse-count")
    press(page, " nothing")
    page.until(lambda: "No preset matches" in page.text("dialog .browse-count"))
    page.find("dialog .browse-search").clear()
    press(page, Keys.BACKSPACE)
    page.find('dialog .chip[data-family="bass"]').click()
    basses = {preset.name for preset in list_presets() if preset.family == "bass"}
    page.until(lambda: set(names(page)) == basses)
    page.find('dialog .chip[data-tag="fretted"]').click()
    page.until(lambda: set(names(page)) == {p.name for p in list_presets() if p.family == "bass" and "fretted" in p.tags})
    page.find('dialog .chip[data-family="bass"]').click()
    page.find('dialog .chip[data-tag="fretted"]').click()
    page.until(lambda: set(names(page)) == NAMES)
    assert page.errors() == []


def test_by_keyboard_to_a_preset_and_open_it(page):
    begin(page)
    press(page, "jawari-harp", Keys.ARROW_DOWN)
    assert focused(page) == "jawari-harp"
    press(page, Keys.ARROW_LEFT)
    assert page.driver.switch_to.active_element.get_attribute("aria-label") == "Listen to Jawari harp"
    press(page, Keys.ARROW_RIGHT, Keys.ARROW_UP)
    assert page.script("return document.activeElement.className") == "browse-search"
    press(page, Keys.ARROW_DOWN, Keys.ENTER)
    page.until(lambda: page.text("#title") == "Jawari harp")
    assert page.all("dialog[open]") == []
    assert page.errors() == []


def test_a_few_seconds_are_heard_and_stopped(page):
    begin(page)
    listen = page.find('dialog [data-listen="jawari-harp"]')
    listen.click()
    page.until(lambda: listen.get_attribute("data-state") == "playing")
    page.find('dialog [data-listen="tanpura-light"]').click()  # one at a time
    page.until(lambda: listen.get_attribute("data-state") == "idle")
    tanpura = page.find('dialog [data-listen="tanpura-light"]')
    page.until(lambda: tanpura.get_attribute("data-state") == "playing")
    tanpura.click()
    page.until(lambda: tanpura.get_attribute("data-state") == "idle")
    assert page.errors() == []


def test_the_sound_that_is_sent(page):
    fetched = page.result(
        "const answer = await fetch('/api/presets/jawari-harp/sample.wav');"
        "return [answer.status, [...new Uint8Array(await answer.arrayBuffer())]]"
    )
    sound, rate_hz = soundfile.read(io.BytesIO(bytes(fetched[1])))
    assert fetched[0] == 200 and 2.0 < len(sound) / rate_hz <= 6.0
    assert 0.05 < np.abs(sound).max() <= 1.0
    status = page.result("const answer = await fetch('/api/presets/..%2Fmine/sample.wav'); return answer.status")
    assert status == 404
