"""The set-up tab: the buzz map over the neck, looked at and heard with mouse and keys; a wish that becomes edits."""

import numpy as np
import pytest
from selenium.webdriver.common.keys import Keys

from synth.author import buzz_maps
from synth.instrument.preset import load_preset
from tests.author.browser.listening import FRAMES, LISTEN, heard, silence
from tests.author.browser.running import Author, Page, copy_preset, set_value, state
from tests.patience import until

#: a map takes so long where nobody else computes [s]
MAP_S = 180.0
PHONE = {"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": True}
# {place: [what it hits, marks, colour]} of the cells
CELLS = """
return Object.fromEntries([...document.querySelectorAll(".neck-map-cell")].map((cell) => {
  const label = cell.getAttribute("aria-label");
  const [first, second] = cell.querySelectorAll("text");
  const fill = cell.querySelector("rect").getAttribute("fill");
  return [label.split(", ").slice(0, 2).join(", "), [first.textContent, second?.textContent ?? "", fill]];
}));
"""
SENT = """
window.sent = [];
const send = WebSocket.prototype.send;
WebSocket.prototype.send = function (text) {
  if (typeof text === "string" && text.includes("audition")) window.sent.push(JSON.parse(text));
  return send.call(this, text);
};
"""


@pytest.fixture(scope="module")
def bass():
    """What the server says of the bass at a medium stroke, by place."""
    found = buzz_maps.mapped(load_preset("fretted-bass"), "medium")
    return {place(note): note for note in found["notes"]}


def place(note):
    return f"{note['string']} string, {'open' if note['fret'] == 0 else 'fret ' + str(note['fret'])}"


@pytest.fixture(scope="module")
def shared(driver, tmp_path_factory):
    """The bass with its map computed."""
    folder = tmp_path_factory.mktemp("presets")
    copy_preset("fretted-bass", folder / "mine.toml")
    with Author(folder, "mine.toml", "--quality", "draft") as author:
        page = Page(driver)
        page.open(author.address)
        page.script(SENT)
        page.script(LISTEN)
        page.click('#sections [data-section="setup"]')
        compute(page)
        yield page
        page.open_nothing()


@pytest.fixture
def page(shared):
    """That page, as it was saved, and silent."""
    shared.result("await fetch('/api/docs/' + location.hash.slice(1) + '/revert', {method: 'POST', body: '{}'});")
    shared.until(lambda: not state(shared)["dirty"] and "edited" not in shared.text("#map-said"))
    silence(shared)
    shared.script("window.sent = []; document.activeElement.blur()")
    yield shared
    assert shared.errors() == []


def compute(page):
    page.click("#compute-map")
    done(page, "#compute-map")


def done(page, button):
    """What a button has begun has ended."""
    until(lambda: page.script("return !document.querySelector(arguments[0]).disabled", button), quiet_s=MAP_S)


def section(page, name):
    """Show a section; the dock does not lie over its button then."""
    page.script("document.getElementById('sections').scrollIntoView({block: 'center'})")
    page.click(f'#sections [data-section="{name}"]')


def cell(page, label):
    return page.find(f'.neck-map-cell[aria-label^="{label}, "]')


def numbers(page):
    return page.script(CELLS)


def test_the_neck_has_every_note_with_what_it_hits(page, bass):
    cells = numbers(page)
    assert cells.keys() == bass.keys() and len(cells) == 84
    for label, (first, second, colour) in cells.items():
        note = bass[label]
        hits = note["buzzes_on"]
        assert first == ("–" if hits is None else hits.removeprefix("fret "))
        assert second.removesuffix("~") == ("?" if note["uncertain"] else "*" if note["buzzes"] else "")
        assert (colour is None) == (hits is None)
    # warm below the stroke, cold above it
    ratio = {label: note["buzz_mm"] / note["stroke_mm"] for label, note in bass.items() if note["buzz_mm"] is not None}
    for label, wanted in ((min(ratio, key=ratio.get), True), (max(ratio, key=ratio.get), False)):
        red, _, blue = (int(part) for part in cells[label][2][4:-1].split())
        assert (red > blue) == wanted
    assert "notes buzz at this stroke" in page.text(".setup-lines")
    assert page.text("#map-said") == "medium stroke, velocity 80"


def test_strings_lie_as_on_a_neck(page):
    """The lowest at the bottom, the open string at the left, frets narrowing."""
    box = "const b = arguments[0].querySelector('rect').getBoundingClientRect(); return [b.left, b.top, b.width];"
    low, high = (page.script(box, cell(page, f"{name} string, open")) for name in "EG")
    assert low[0] == pytest.approx(high[0]) and low[1] > high[1]
    frets = [page.script(box, cell(page, f"A string, fret {n}")) for n in (1, 2, 12, 20)]
    assert high[0] < frets[0][0] < frets[1][0] < frets[2][0] < frets[3][0]
    assert frets[0][2] > frets[1][2] > frets[2][2] > frets[3][2] > 8


def test_the_mouse_tells_what_a_note_hits(page, bass):
    for label in ("E string, fret 3", "D string, open"):
        page.script("arguments[0].scrollIntoView({block: 'center'})", cell(page, label))
        page.hand().move_to_element(cell(page, label)).perform()
        page.until(lambda label=label: page.text("#map-reading").startswith(label))
        note = bass[label]
        told = page.text("#map-reading")
        assert f"buzzes on {note['buzzes_on']} from {note['buzz_mm']:.2f} mm on" in told
        assert f"({note['buzz_low_mm']:.2f} to {note['buzz_high_mm']:.2f})" in told
        assert f"about velocity {round(note['buzz_velocity'])}" in told
        assert f"touches {note['touches']} from {note['touch_mm']:.2f} mm on" in told


def test_the_keyboard_goes_from_note_to_note(page):
    """One stop of Tab, arrows along the string and from string to string; a screen reader has what is told."""

    def now():
        label = page.script("return document.activeElement.getAttribute('aria-label')")
        return ", ".join(label.split(", ")[:2])

    stops = page.all(".neck-map-cell[tabindex='0']")
    assert len(stops) == 1
    page.script("arguments[0].focus()", page.find("#compute-map"))
    page.find("#compute-map").send_keys(Keys.TAB)
    assert page.driver.switch_to.active_element == stops[0]
    page.script("arguments[0].focus()", cell(page, "A string, fret 5"))
    for key, wanted in (
        (Keys.ARROW_RIGHT, "A string, fret 6"),
        (Keys.ARROW_UP, "D string, fret 6"),
        (Keys.ARROW_LEFT, "D string, fret 5"),
        (Keys.ARROW_DOWN, "A string, fret 5"),
        (Keys.ARROW_DOWN, "E string, fret 5"),
        (Keys.ARROW_DOWN, "E string, fret 5"),
        (Keys.HOME, "E string, open"),
        (Keys.ARROW_LEFT, "E string, open"),
        (Keys.END, "E string, fret 20"),
    ):
        page.driver.switch_to.active_element.send_keys(key)
        assert now() == wanted
        assert page.text("#map-reading").startswith(wanted)
    assert page.script("return document.querySelectorAll('.neck-map-cell[tabindex=\"0\"]').length") == 1
    label = page.script("return document.activeElement.getAttribute('aria-label')")
    assert page.text("#map-reading p") == label


def test_notes_are_heard_at_the_stroke_and_at_the_threshold(page, bass):
    note = bass["E string, fret 5"]
    threshold = round(note["buzz_velocity"])
    where = {"type": "audition", "phrase": "note", "note": 33, "which": "current", "string": 0, "opened": 28}

    def sent():
        return page.script("return window.sent")

    cell(page, "E string, fret 5").click()
    page.until(lambda: page.script("return window.heard.played.length > 0") and page.script(FRAMES) > 4000)
    assert sent() == [{**where, "velocity": 80}]
    assert max(np.abs(samples).max() for _, samples in heard(page, "played")) > 0.01
    element = cell(page, "E string, fret 5")
    page.hand().key_down(Keys.SHIFT).click(element).key_up(Keys.SHIFT).perform()
    assert sent()[1:] == [{**where, "velocity": threshold}]
    element.send_keys(Keys.ENTER)
    page.hand().key_down(Keys.SHIFT).send_keys(Keys.ENTER).key_up(Keys.SHIFT).perform()
    page.click("#hear-threshold")
    assert [one["velocity"] for one in sent()[2:]] == [80, threshold, threshold]


def test_an_edit_makes_the_map_old_until_it_is_undone(page):
    old = "return document.getElementById('map-result').classList.contains('old')"
    assert not page.script(old)
    set_value(page, "pluck.position", 0.3)
    page.until(lambda: page.script(old))
    assert "the preset has been edited since; compute it again" in page.text("#map-said")
    page.find("#undo").click()
    page.until(lambda: not page.script(old))


def test_a_map_is_stopped_and_the_one_that_is_shown_stays(page):
    before = numbers(page)
    page.click("#compute-map")
    page.button("Cancel", "#setup").click()
    done(page, "#compute-map")
    assert page.text("#setup [role=alert]") == "Cancelled"
    assert numbers(page) == before


def test_a_map_is_stopped_before_the_server_has_said_that_it_began(page):
    page.script(
        """window.answered = window.fetch;
        window.fetch = async (...asked) => {
          const answer = await window.answered(...asked);
          await new Promise((after) => setTimeout(after, 1000));
          return answer;
        };"""
    )
    page.script("document.querySelector('#compute-map').click(); document.querySelector('#compute-map ~ button').click();")
    page.script("window.fetch = window.answered;")
    done(page, "#compute-map")
    assert page.text("#setup [role=alert]") == "Cancelled"


def test_what_touches_nothing_is_refused_with_the_reason(page):
    page.result(
        """await fetch('/api/docs/' + location.hash.slice(1) + '/edit', {method: 'POST',
        body: JSON.stringify({changes: [{path: 'obstacle', value: {kind: 'none'}}], merge: null})});"""
    )
    page.until(lambda: "edited" in page.text("#map-said"))
    compute(page)
    page.until(lambda: "nothing can buzz" in page.text("#setup [role=alert]"))
    page.errors()  # the browser's own line about the refused request


def test_a_wish_is_refused_or_becomes_edits_that_undo_reverts(page):
    field = page.find("#wish")
    assert field.get_property("value") == "no buzz at medium"

    def wish(text):
        field.send_keys(Keys.CONTROL, "a", Keys.NULL, f"{text}\n")
        done(page, "#propose")

    wish("no rattle")
    page.until(lambda: "the wish: must begin with" in page.text(".setup-wishes [role=alert]"))
    page.errors()  # the browser's own line about the refused request
    wish("no buzz at medium, except frets 1-20 may buzz")
    page.until(lambda: "proposed:" in page.text("#proposal"))
    assert not page.script("return document.querySelector('.setup-wishes [role=alert]').checkVisibility()")
    before = state(page)["text"]
    page.click("#apply-set-up")
    page.until(lambda: state(page)["text"] != before)
    page.until(lambda: "edited since" in page.text("#map-said"))
    page.find("#undo").click()
    page.until(lambda: state(page)["text"] == before)


def test_the_map_on_a_phone_scrolls_within_the_page(page):
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", PHONE)
    try:
        page.until(lambda: page.script("return innerWidth") == PHONE["width"])
        page.until(lambda: page.script("const r = document.querySelector('.neck-map-room'); return r.clientWidth < 400"))
        assert page.script("return document.scrollingElement.scrollWidth") <= PHONE["width"]
        assert page.script("const r = document.querySelector('.neck-map-room'); return r.scrollWidth > r.clientWidth")
        wide = page.script(
            """const all = [...document.querySelectorAll("#setup button, #setup input, #setup select, #setup p")];
            const wide = (each) => each.checkVisibility() && each.getBoundingClientRect().right > 401;
            return all.filter(wide).map((each) => each.outerHTML.slice(0, 90));"""
        )
        assert wide == []
        section(page, "controls")
        assert not page.all("#setup")[0].is_displayed() and page.find("#controls")
        section(page, "setup")
        assert page.find("#setup") and not page.all("#controls")[0].is_displayed()
    finally:
        page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        page.until(lambda: page.script("return innerWidth") > PHONE["width"])


@pytest.fixture
def tanpura(driver, tmp_path):
    """A tanpura in a tab of its own: the bass stays in the other."""
    copy_preset("tanpura-light", tmp_path / "mine.toml")
    first = driver.current_window_handle
    driver.switch_to.new_window("tab")
    with Author(tmp_path, "mine.toml", "--quality", "draft") as author:
        page = Page(driver)
        page.open(author.address)
        yield page
        page.open_nothing()
    driver.close()
    driver.switch_to.window(first)


def test_open_strings_over_a_bridge_lie_side_by_side(tanpura):
    section(tanpura, "setup")
    assert tanpura.find("#wish").get_property("value") == "longest buzz at medium"
    compute(tanpura)
    tanpura.until(lambda: len(tanpura.all(".neck-map-cell")) == 4)
    tops = "return [...document.querySelectorAll('.neck-map-cell rect')].map((each) => each.getBoundingClientRect().top)"
    assert len(set(tanpura.script(tops))) == 1
    names = tanpura.script("return [...document.querySelectorAll('.neck-map .tick')].map((each) => each.textContent)")
    assert names == ["Pa", "Sa 1", "Sa 2", "kharaj"]
    assert tanpura.errors() == []


def test_strings_that_rest_and_chaotic_notes_are_told_apart_without_colour(page, bass):
    """As no preset that can be loaded has them all."""
    notes = [dict(note) for note in bass.values() if note["string"] == "E"]
    notes[1] |= {"rests": True, "touches": "fret 2", "buzz_mm": 0.0, "touch_mm": 0.0}
    notes[2] |= {"chaotic_up_to_mm": 3.25, "buzzes": True, "uncertain": False}
    notes[3] |= {"buzz_velocity": 140.2, "buzz_high_mm": None}
    notes[4] |= {"buzz_mm": None, "buzzes_on": None, "touch_mm": None, "touches": None, "buzz_velocity": None}
    notes[4] |= {"buzzes": False, "uncertain": False}
    found = page.result(
        """const { inWords, makeNeckMap, thresholdVelocity } = await import("/page/neck-map.js");
        const map = makeNeckMap({ told() {}, hear() {} });
        const place = document.getElementById("map-result");
        place.append(map.element);
        map.element.id = "another-map";
        while (map.element.clientWidth === 0) await new Promise(requestAnimationFrame);
        map.show(given[0], false);
        await new Promise((done) => setTimeout(done, 200));
        const cells = [...map.element.querySelectorAll(".neck-map-cell")];
        const shown = cells.map((cell) => [...cell.querySelectorAll("text")].map((text) => text.textContent).join(" "));
        return [shown, given[0].map(inWords), given[0].map(thresholdVelocity)];""",
        notes,
    )
    page.script("document.getElementById('another-map').remove()")
    shown, words, velocities = found
    assert shown[1] == "2 ×" and shown[2].endswith(" *~") and shown[4] == "–"
    assert words[1] == "rests on fret 2 before it is plucked: lower that or raise the string"
    assert "chaotic: up to 3.25 mm the buzz comes and goes" in words[2]
    assert "to more), harder than any key" in words[3] and velocities[3] == 127
    assert words[4] == f"no buzz up to {notes[4]['limit_mm']:.2f} mm" and velocities[4] is None
