"""The pictures of the analysis show what the server has computed; the reference runs and is stopped; keys by hand."""

import numpy as np
import pytest
from selenium.webdriver.common.keys import Keys

from tests.author.browser.running import Author, Page, set_value


@pytest.fixture(scope="module")
def author(tmp_path_factory):
    with Author(tmp_path_factory.mktemp("presets"), "fretted-bass") as author:
        yield author


@pytest.fixture
def page(driver, author):
    page = Page(driver)
    page.open(author.address)
    settled(page)
    page.errors()
    yield page
    page.open_nothing()


def settled(page):
    """The analysis of what is to be seen has been drawn."""
    page.until(lambda: page.script("return !document.getElementById('analysis').hasAttribute('aria-busy')"))
    page.until(lambda: page.text(".analysis-head .muted") != "")


def analysis(page):
    """What the server says of the note that is chosen."""
    return page.result(
        """const about = {note: document.querySelector(".keys").getAttribute("aria-valuenow"), velocity: 90, seconds: 3};
        return (await fetch(`/api/docs/${location.hash.slice(1)}/analysis?${new URLSearchParams(about)}`)).json()"""
    )


def test_table_has_the_partials(page):
    partials = analysis(page)["partials"]
    page.find(".fold summary").click()
    rows = [[cell.text for cell in row.find_elements("css selector", "th, td")] for row in page.all(".partials tbody tr")]
    assert [int(row[0]) for row in rows] == [p["number"] for p in partials]
    for row, p in zip(rows, partials, strict=True):
        for text, value in zip(row[1:], [p["model_hz"], p["measured_hz"], p["cents"], p["model_t60_s"]], strict=False):
            if value is None:
                assert text == "–"
            else:
                assert float(text.replace("−", "-")) == pytest.approx(value, rel=6e-3)
    page.find(".fold summary").click()


LEVELS = """
const { levelRamp, differenceRamp, toOklab } = await import("/page/colour.js");
const lab = (ramp) => Array.from({length: 256}, (_, i) => toOklab([...ramp.slice(3 * i, 3 * i + 3)].map((c) => c / 255)));
return [levelRamp(true), levelRamp(false), differenceRamp(true), differenceRamp(false)].map(lab);
"""


def test_equal_steps_of_level_look_equal(page):
    dark, light, *differences = np.array(page.result(LEVELS))
    halves = [half for ramp in differences for half in (ramp[:128], ramp[128:])]  # the path turns in the middle
    for ramp in (dark, light, *halves):
        # over 8 steps at a time, which eight bits a colour resolve
        steps = np.linalg.norm(np.diff(ramp[::8], axis=0), axis=1)
        assert steps.max() < 1.25 * steps.min()
    assert (np.diff(dark[:, 0]) > -2e-3).all() and dark[-1, 0] - dark[0, 0] > 0.75
    assert (np.diff(light[:, 0]) < 2e-3).all() and light[0, 0] - light[-1, 0] > 0.75
    for ramp in differences:  # the paper lies in the middle: least colour
        assert np.hypot(ramp[:, 1], ramp[:, 2]).argmin() in range(124, 132)


def test_reading_under_the_pointer_is_the_level_there(page):
    data = analysis(page)["spectrogram"]
    figure = page.script("return document.querySelectorAll('.analysis .plot')[1]")
    page.script("arguments[0].scrollIntoView({block: 'center'})", figure)
    said = page.script(
        """const canvas = arguments[0].querySelector("canvas");
        const {left, top} = canvas.getBoundingClientRect();
        canvas.dispatchEvent(new PointerEvent("pointermove", {clientX: left + 200, clientY: top + 120}));
        return arguments[0].querySelector(".plot-reading").textContent;""",
        figure,
    )
    time, frequency, level = (part.strip() for part in said.replace(":", ",").split(","))
    t_s = float(time.split()[0]) * (1e-3 if time.endswith("ms") else 1.0)
    hz = float(frequency.split()[0]) * (1e3 if "kHz" in frequency else 1.0)
    column = round((t_s - data["start_s"]) / data["step_s"])
    row = int(np.abs(np.log(np.array(data["hz"]) / hz)).argmin())
    near = np.array(data["rows"])[max(0, row - 1) : row + 2, max(0, column - 2) : column + 3]
    span = data["top_db"] - data["floor_db"]
    shown = float(level.removesuffix(" dB").replace("−", "-"))
    assert data["floor_db"] + near.min() / 255 * span - 0.5 <= shown <= data["floor_db"] + near.max() / 255 * span + 0.5


def test_fret_that_is_struck_is_in_the_timeline(page):
    points = analysis(page)["timeline"]["points"]
    label = page.script("return document.querySelectorAll('.analysis .plot canvas')[2].getAttribute('aria-label')")
    assert points and all(point["label"] in label for point in points)


def test_reference_runs_and_its_error_is_shown(page):
    page.script("document.querySelector('#analysis').scrollTop = 99999")
    page.find("#reference").click()
    tiles = page.text(".reference-result .tiles")
    assert tiles.startswith("e\n") and "kHz" in tiles and "dB" in tiles
    assert page.script("return !document.querySelector('.reference-result').classList.contains('stale')")
    set_value(page, "pluck.position", 0.3)
    page.until(lambda: page.script("return document.querySelector('.reference-result').classList.contains('stale')"))
    page.find("#undo").click()


def test_reference_is_stopped(page):
    page.script("document.querySelector('#analysis').scrollTop = 99999")
    page.script("document.querySelector('.reference-head select').selectedIndex = 2")
    page.script(
        """document.getElementById("reference").click();
        const cancel = [...document.querySelectorAll(".reference-head button")].at(-1);
        const timer = setInterval(() => cancel.checkVisibility() && cancel.click(), 5);
        setTimeout(() => clearInterval(timer), 20000);"""
    )
    page.until(lambda: page.find("#reference").is_enabled())
    assert page.text(".reference-head .unit") == "Cancelled"


def test_arrow_keys_choose_the_note(page):
    keys = page.find(".keys")
    before = int(keys.get_attribute("aria-valuenow"))
    page.script("arguments[0].focus()", keys)
    keys.send_keys(Keys.ARROW_RIGHT)
    page.until(lambda: int(keys.get_attribute("aria-valuenow")) == before + 1)
    keys.send_keys(Keys.HOME)
    page.until(lambda: keys.get_attribute("aria-valuetext") == "E1")
    keys.send_keys(Keys.END)
    page.until(lambda: keys.get_attribute("aria-valuetext") == "D♯4")


def test_neck_has_every_fret_of_every_string(page):
    page.button("Neck", ".keyboard-head").click()
    rows = page.all(".neck-row")
    assert [row.find_element("css selector", ".neck-name").text for row in rows] == ["G", "D", "A", "E"]
    keys = [[int(key.get_attribute("data-key")) for key in row.find_elements("css selector", ".key")] for row in rows]
    assert keys == [list(range(low, low + 21)) for low in (43, 38, 33, 28)]
    page.button("Piano", ".keyboard-head").click()


def test_bytes_of_midi_are_what_they_mean(page):
    said = page.result(
        """const { translate } = await import("/page/midi.js");
        return given[0].map((bytes) => translate(Uint8Array.from(bytes)));""",
        [
            [0x90, 60, 100],
            [0x93, 60, 0],
            [0x80, 60, 64],
            [0xB0, 64, 127],
            [0xB0, 1, 5],
            [0xE0, 0, 64],
            [0xE0, 127, 127],
            [0xF8],
        ],
    )
    assert said == [
        {"type": "note_on", "key": 60, "velocity": 100},
        {"type": "note_off", "key": 60},
        {"type": "note_off", "key": 60},
        {"type": "pedal", "down": True},
        {"type": "control", "controller": 1, "value": 5},
        {"type": "bend", "value": 0},
        {"type": "bend", "value": 8191},
        None,
    ]


def test_nothing_is_wider_than_a_narrow_screen(page):
    page.driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 400, "height": 860, "deviceScaleFactor": 1, "mobile": True}
    )
    try:
        page.until(lambda: page.script("return document.querySelector('.plot canvas').clientWidth") < 400)
        assert page.script("return document.scrollingElement.scrollWidth") <= 400
        page.find("#more").click()
        wide = page.script(
            """const parts = [...document.querySelectorAll(".plot, .menu, .cost, .dock, .bar button")];
            const wide = (each) => each.checkVisibility() && each.getBoundingClientRect().right > 401;
            return parts.filter(wide).map((each) => each.outerHTML.slice(0, 120));"""
        )
        assert wide == []
    finally:
        page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
