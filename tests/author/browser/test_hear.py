"""What the page plays is, sample for sample, what `synth render` writes."""

import base64

import numpy as np
import pytest
import soundfile
from selenium.webdriver.common.keys import Keys

from tests.author.browser.listening import FRAMES, LISTEN, RATE_HZ, heard, is_beginning_of, rendered, silence
from tests.author.browser.running import set_value

HEARD_S = 1.0


@pytest.fixture
def page(page_of_mine):
    page_of_mine.script(LISTEN)
    return page_of_mine


def test_note_is_what_render_writes(page, mine, tmp_path):
    frames = round(HEARD_S * RATE_HZ)
    note, velocity = 48, 90
    page.script("document.querySelector('[data-key=\"48\"]').scrollIntoView()")
    page.find("[data-key='48']").click()
    page.until(lambda: page.text(".key-note") == "C3")
    silence(page)
    page.find("[data-phrase='note']").click()
    page.until(lambda: page.script(FRAMES) >= frames)
    received, played = heard(page, "received"), heard(page, "played")
    want = rendered(mine, note, velocity, tmp_path)
    assert np.abs(want[:frames]).max() > 0.01
    assert is_beginning_of(received, want) and is_beginning_of(played, want)


def test_changed_preset_is_heard_at_once_as_it_would_be_rendered(page, mine, tmp_path):
    frames = round(HEARD_S * RATE_HZ)
    set_value(page, "pluck.position", 0.2)
    page.until(lambda: page.script(FRAMES) >= frames)
    played = heard(page, "played")
    page.find("#save").click()
    page.until(lambda: "0.2" in mine.read_text(encoding="utf-8"))
    page.until(lambda: page.text("#doc-status") == mine.name)
    note = int(page.script("return document.querySelector('.keys').getAttribute('aria-valuenow')"))
    assert is_beginning_of(played, rendered(mine, note, 90, tmp_path))


def test_wav_of_the_server_is_the_same_sound(page, mine, tmp_path):
    name = page.script("return location.hash.slice(1)")
    values = page.result(
        """const answer = await fetch(`/api/docs/${given[0]}/sound.wav?phrase=note&note=48&velocity=90&which=current`);
        const bytes = new Uint8Array(await answer.arrayBuffer());
        let text = "";
        for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
        return btoa(text);""",
        name,
    )
    (tmp_path / "page.wav").write_bytes(base64.b64decode(values))
    samples, _ = soundfile.read(tmp_path / "page.wav", dtype="float32", always_2d=True)
    want = rendered(mine, 48, 90, tmp_path)
    frames = min(len(samples), len(want))
    assert frames > 2 * RATE_HZ
    np.testing.assert_array_equal(samples[:frames], want[:frames])


def test_keys_of_the_computer_and_the_mouse_sound(page):
    page.script("document.activeElement.blur()")
    page.find("body").send_keys("a")
    page.until(lambda: page.script(FRAMES) > 0)
    assert page.text(".key-note") == "C2"
    silence(page)
    page.find("[data-key='43']").click()
    page.until(lambda: page.script(FRAMES) > 0)
    assert all(np.isfinite(samples).all() for _, samples in heard(page, "played"))
    assert page.text(".key-note") == "G2"


def test_saved_version_is_heard_beside_the_edited_one(page, mine, tmp_path):
    frames = RATE_HZ // 2
    set_value(page, "pluck.position", 0.2)
    page.until(lambda: page.script(FRAMES) >= frames)
    edited = heard(page, "played")
    silence(page)
    page.find("#ab [data-which='saved']").click()
    page.until(lambda: page.script(FRAMES) >= frames)
    saved = heard(page, "played")
    note = int(page.script("return document.querySelector('.keys').getAttribute('aria-valuenow')"))
    want = rendered(mine, note, 90, tmp_path)
    assert is_beginning_of(saved, want) and not is_beginning_of(edited, want)


def test_keys_play_the_version_that_is_shown(page, mine, tmp_path):
    """As it is, then as it was saved: where a string has another note its old key comes back."""
    page.script("document.querySelector('#player input[type=checkbox]').click()")  # keys alone sound
    row = page.find(".keys")
    page.script("arguments[0].focus()", row)
    row.send_keys(Keys.HOME)  # a note that both versions have
    page.until(lambda: row.get_attribute("aria-valuenow") == "36")
    page.result(
        """await fetch(`/api/docs/${location.hash.slice(1)}/edit`, {method: "POST", body: JSON.stringify({
          changes: [{path: "string.0.notes", value: ["A2", "A2"]}, {path: "pluck.position", value: 0.2}], merge: null
        })})"""
    )
    keys = "return [...document.querySelectorAll('.key:not(.mute)')].map((key) => Number(key.dataset.key))"
    page.until(lambda: page.script(keys) == [36, 45, 48])
    hold(page, 48)
    edited = heard(page, "played")
    silence(page)
    page.find("#ab [data-which='saved']").click()
    page.until(lambda: page.script(keys) == [36, 43, 48])
    hold(page, 48)
    saved = heard(page, "played")
    want = rendered(mine, 48, 90, tmp_path)
    assert is_beginning_of(saved, want) and not is_beginning_of(edited, want)


def hold(page, key):
    """Press a key of the piano and hold it until a while of it was heard."""
    chain = page.hand().move_to_element(page.find(f"[data-key='{key}']"))
    chain.click_and_hold().perform()
    page.until(lambda: page.script("return window.heard.played.length > 0") and page.script(FRAMES) >= RATE_HZ // 2)
    chain.release().perform()


def test_octaves_that_nothing_plays_are_left_out(page):
    runs = page.result("return (await import('/page/keyboard.js')).compass(given[0])", [36, 43, 48, 120])
    assert runs == [[36, 59], [120, 131]]
    for notes in ([0], [11, 3]):
        assert page.result("return (await import('/page/keyboard.js')).compass(given[0])", notes) == [[0, 23]]
    assert page.result("return (await import('/page/keyboard.js')).compass(given[0])", [50]) == [[36, 59]]


def test_keys_can_be_put_away(page):
    page.button("Hide keys").click()
    assert not page.all(".keys")[0].is_displayed()
    page.reload()
    assert not page.all(".keys")[0].is_displayed()
    page.button("Show keys").click()
    assert page.find("[data-key='48']").is_displayed()


@pytest.mark.parametrize("width", [1024, 1366])
def test_the_dock_has_one_row_of_phrases(page, width):
    size = page.driver.get_window_size()
    page.driver.set_window_size(width, 900)
    parts = [".player-phrases", ".player-volume", ".meter", ".player-output"]
    middles = (
        "return arguments[0].map((s) => document.querySelector(s).getBoundingClientRect()).map((r) => r.top + r.height / 2)"
    )
    page.until(lambda: page.script("return innerWidth") == width)
    found = page.script(middles, parts)
    page.driver.set_window_size(size["width"], size["height"])
    assert max(found) - min(found) < 4


def test_another_preset_sounds_after_the_first_was_stopped(page):
    page.find("[data-phrase='note']").click()
    page.until(lambda: page.script(FRAMES) > 0)
    silence(page)
    page.find("#open").click()
    page.find('dialog [data-preset="jawari-harp"]').click()
    page.until(lambda: page.text("#title") == "Jawari harp")
    page.until(lambda: page.find("[data-phrase='note']").is_enabled())
    page.find("[data-phrase='note']").click()
    page.until(lambda: page.script(FRAMES) >= RATE_HZ // 2)
    assert max(np.abs(samples).max() for _, samples in heard(page, "played")) > 0.01


def test_output_of_the_server_is_offered_or_says_why_not(page):
    session = page.result("return (await fetch('/api/session')).json()")
    for output in session["outputs"]:
        button = page.find(f"[data-output='{output['id']}']")
        assert button.is_enabled() == output["available"]
        if not output["available"]:
            page.find(".player-why").click()
            assert output["reason"] and output["reason"] == page.text("#tip")


def test_midi_that_is_refused_is_said(page):
    for name, words in (("NotAllowedError", "does not allow"), ("InvalidStateError", "no MIDI")):
        page.script(
            "navigator.requestMIDIAccess = () => Promise.reject(new DOMException('no', arguments[0]));"
            "const button = [...document.querySelectorAll('.keyboard-head button')].find((b) => b.textContent === 'MIDI');"
            "button.disabled = false; button.click();",
            name,
        )
        page.until(lambda words=words: words in page.text(".midi-text"))
    assert page.errors() == []
