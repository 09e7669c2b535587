"""The drawing: drags by mouse and arrow keys, the scale, notes, the film of the string."""

from contextlib import suppress

import pytest
from selenium.webdriver.common.keys import Keys

from tests.author.browser.running import PRESETS, Author, Page, state
from tests.patience import until


@pytest.fixture(scope="module")
def author(tmp_path_factory):
    folder = tmp_path_factory.mktemp("presets")
    for name in ("tanpura-light", "fretted-bass", "jawari-harp"):
        text = (PRESETS / f"{name}.toml").read_text(encoding="utf-8")
        (folder / f"my-{name}.toml").write_text(text.replace(f'name = "{name}"', f'name = "my-{name}"'), encoding="utf-8")
    with Author(folder) as author:
        yield author


@pytest.fixture
def opened(driver, author):
    """Opens a preset of the folder, as it was saved."""
    page = Page(driver)

    def open_(name):
        page.open(author.address)
        page.script("sessionStorage.clear()")
        page.find(f'[data-preset="my-{name}"]').click()
        page.until(lambda: page.all("[data-handle]"))
        page.result("await fetch('/api/docs/' + location.hash.slice(1) + '/revert', {method: 'POST', body: '{}'});")
        page.until(lambda: not state(page)["dirty"])
        page.errors()
        return page

    yield open_
    page.open_nothing()


def handle(page, name):
    return page.find(f'[data-handle="{name}"]')


def drag(page, name, dx, dy, steps=6):
    chain = page.hand().move_to_element(handle(page, name).find_element("css selector", ".reach")).click_and_hold()
    for _ in range(steps):
        chain.move_by_offset(dx / steps, dy / steps)
    chain.release().perform()


def place(page, name):
    """Where a handle is on the screen: (x, y)."""
    box = page.script(
        "const b = document.querySelector(arguments[0]).getBoundingClientRect();"
        "return [b.x + b.width / 2, b.y + b.height / 2]",
        f'[data-handle="{name}"] .reach',
    )
    return tuple(box)


def test_drag_of_the_pluck_moves_its_place_only_and_is_one_step(opened):
    page = opened("tanpura-light")
    before = state(page)["data"]["pluck"]
    x0, _ = place(page, "pluck")
    drag(page, "pluck", 120, 6, steps=12)
    page.until(lambda: state(page)["dirty"])
    page.until(lambda: page.script("return document.querySelector('.handle.held')") is None)
    page.until(lambda: place(page, "pluck")[0] - x0 == pytest.approx(120, abs=2))  # once the last move is drawn
    page.until(lambda: float(page.field("pluck.position").get_property("value")) < before["position"])
    now = state(page)["data"]["pluck"]
    assert now["displacement_mm"] == before["displacement_mm"]
    page.find("#undo").click()
    page.until(lambda: not state(page)["dirty"])
    page.until(lambda: abs(place(page, "pluck")[0] - x0) < 1)
    assert not state(page)["can_undo"]
    assert page.errors() == []


def test_the_value_is_said_while_it_is_dragged(opened):
    page = opened("tanpura-light")
    grip = handle(page, "pluck").find_element("css selector", ".reach")
    page.hand().move_to_element(grip).click_and_hold().move_by_offset(-15, 0).move_by_offset(-10, 0).perform()
    text = page.script("return document.querySelector('.stage-whole .readout text').textContent")
    assert text.startswith("Pluck: 0.")
    assert "of L" in text
    page.hand().release().perform()
    page.until(lambda: state(page)["dirty"])
    # a later edit of the same drag may still be on its way
    page.until(
        lambda: handle(page, "pluck").get_attribute("aria-valuenow") == f"{state(page)['data']['pluck']['position']:g}"
    )
    assert state(page)["data"]["pluck"]["position"] > 0.42


def test_drag_of_the_thread_in_the_close_up_raises_it_and_leaves_the_bridge(opened):
    page = opened("tanpura-light")
    edge, thread = place(page, "point-0"), place(page, "thread")
    drag(page, "thread", 0, -20)
    page.until(lambda: state(page)["data"]["obstacle"]["jiva_um"] > 3.0)
    page.until(lambda: page.script("return document.querySelector('.handle.held')") is None)
    assert state(page)["data"]["obstacle"]["distance_mm"] == 6.0
    assert state(page)["text"].count("# IA2018: the tanpura's two-point bridge") == 1
    heights = page.script(HEIGHTS)
    jiva_um = state(page)["data"]["obstacle"]["jiva_um"]
    page.until(lambda: page.script(HEIGHTS)["edge"] == 0.0)
    assert heights["thread"] > 0.0 and page.script(HEIGHTS)["thread"] == pytest.approx(1e-3 * jiva_um * 950 / 944, rel=2e-3)
    assert place(page, "thread")[1] < place(page, "point-0")[1] and edge[1] > thread[1]
    drag(page, "point-0", -30, 0)
    page.until(lambda: state(page)["data"]["obstacle"]["distance_mm"] > 6.0)
    assert state(page)["data"]["obstacle"]["jiva_um"] == jiva_um
    assert page.errors() == []


HEIGHTS = """
const [close, ticks] = [document.querySelector(".stage-close"), [...document.querySelectorAll(".stage-close .tick")]];
const up = ticks.filter((t) => t.getAttribute("text-anchor") === "end" && !/m$/.test(t.textContent));
const [a, b] = [up[0], up.at(-1)].map((t) => [Number(t.textContent.replace("−", "-")), Number(t.getAttribute("y")) - 3.5]);
const of = (id) => {
  const y = Number(/ ([-\\d.]+)\\)/.exec(close.querySelector(`[data-handle="${id}"]`).getAttribute("transform"))[1]);
  return Math.round(1e4 * 1e-3 * (a[0] + ((b[0] - a[0]) * (y - a[1])) / (b[1] - a[1]))) / 1e4;
};
return {edge: of("point-0"), thread: of("thread")};
"""


def test_a_double_click_puts_a_handle_back(opened):
    page = opened("tanpura-light")
    drag(page, "pluck", 100, 0)
    page.until(lambda: state(page)["data"]["pluck"]["position"] < 0.4)
    page.until(lambda: page.script("return document.querySelector('.handle.held')") is None)
    page.settle()

    def put_back() -> bool:
        """On a busy machine two clicks may lie too far apart to be a double one."""
        page.hand().double_click(handle(page, "pluck").find_element("css selector", ".reach")).perform()
        with suppress(AssertionError):
            return until(lambda: state(page)["data"]["pluck"]["position"] == 0.42, quiet_s=5.0)
        return False

    page.until(put_back)
    assert state(page)["data"]["pluck"]["displacement_mm"] == 3.0
    assert page.errors() == []


def test_shift_is_finer_on_handles(opened):
    page = opened("tanpura-light")
    page.script("arguments[0].focus()", handle(page, "pluck"))
    moved = {}
    for name, keys in (("plain", (Keys.ARROW_LEFT,)), ("fine", (Keys.SHIFT, Keys.ARROW_LEFT))):
        before = state(page)["data"]["pluck"]["position"]
        chain = page.hand()
        for key in keys[:-1]:
            chain.key_down(key)
        chain.send_keys(keys[-1])
        for key in keys[:-1]:
            chain.key_up(key)
        chain.perform()
        page.until(lambda before=before: state(page)["data"]["pluck"]["position"] > before)
        moved[name] = state(page)["data"]["pluck"]["position"] - before
    assert moved["fine"] == pytest.approx(0.1 * moved["plain"], rel=0.15)
    grip = handle(page, "pluck").find_element("css selector", ".reach")
    before = state(page)["data"]["pluck"]["position"]
    chain = page.hand().key_down(Keys.SHIFT).move_to_element(grip).click_and_hold()
    for _ in range(10):
        chain.move_by_offset(10, 0)
    chain.release().key_up(Keys.SHIFT).perform()
    page.until(lambda: state(page)["data"]["pluck"]["position"] != before)
    page.until(lambda: page.script("return document.querySelector('.handle.held')") is None)
    width = page.script("return document.querySelector('.stage-whole').getBoundingClientRect().width")
    assert 0.2 * 100 / width / 10 < before - state(page)["data"]["pluck"]["position"] < 2.0 * 100 / width / 10


def test_drag_of_a_fret_moves_that_fret_alone(opened):
    page = opened("fretted-bass")
    heights = state(page)["data"]["obstacle"]["heights_mm"]
    drag(page, "point-4", 0, -4, steps=4)  # higher, a string at the fret before would lie on it
    page.until(lambda: state(page)["data"]["obstacle"]["heights_mm"] != heights)
    now = state(page)["data"]["obstacle"]["heights_mm"]
    assert now[4] > heights[4]
    assert [h for i, h in enumerate(now) if i != 4] == [h for i, h in enumerate(heights) if i != 4]
    assert page.errors() == []


def test_drag_of_the_pickup(opened):
    page = opened("fretted-bass")
    before = state(page)["data"]["output"]
    drag(page, "output", 60, 0)
    page.until(lambda: state(page)["data"]["output"]["position"] < before["position"])
    assert state(page)["data"]["output"]["distance_mm"] == before["distance_mm"]


def test_drag_of_a_value_by_note_sets_that_note(opened):
    page = opened("jawari-harp")
    page.find("[data-key='48']").click()
    page.until(lambda: page.find(".keys").get_attribute("aria-valuenow") == "48")
    page.settle()
    before = state(page)["data"]["pluck"]["displacement_mm"]
    drag(page, "pluck", 0, 15)
    page.until(lambda: state(page)["data"]["pluck"]["displacement_mm"] != before)
    now = state(page)["data"]["pluck"]["displacement_mm"]
    assert {note: now[note] for note in before if note != "48"} == {note: before[note] for note in before if note != "48"}
    assert now["48"] < before["48"]


def test_arrow_keys_move_handles(opened):
    page = opened("tanpura-light")
    grip = handle(page, "pluck")
    assert grip.get_attribute("role") == "slider"
    page.script("arguments[0].focus()", grip)
    page.hand().send_keys(Keys.ARROW_LEFT, Keys.ARROW_LEFT, Keys.ARROW_LEFT).perform()
    page.until(lambda: state(page)["data"]["pluck"]["position"] > 0.42)
    page.hand().send_keys(Keys.ARROW_UP).perform()
    page.until(lambda: state(page)["data"]["pluck"]["displacement_mm"] > 3.0)
    page.until(lambda: page.script("return document.activeElement.dataset.handle") == "pluck")
    assert page.errors() == []


def test_frets_are_one_stop_of_tab_and_a_row_for_arrows(opened):
    page = opened("fretted-bass")
    assert len(page.all('[data-handle^="point-"][tabindex="0"]')) == 1
    page.script("document.querySelector('[data-handle=\"point-0\"]').focus()")
    page.hand().send_keys(Keys.ARROW_RIGHT, Keys.ARROW_RIGHT, Keys.ARROW_UP).perform()
    assert page.script("return document.activeElement.dataset.handle") == "point-2"
    page.until(lambda: state(page)["data"]["obstacle"]["heights_mm"][2] > -1.13)
    assert state(page)["data"]["obstacle"]["heights_mm"][:2] == [-0.63, -0.88]
    page.until(
        lambda: [e.get_attribute("data-handle") for e in page.all('[data-handle^="point-"][tabindex="0"]')] == ["point-2"]
    )
    assert page.errors() == []


def test_a_drag_ends_at_the_limit_of_its_value(opened):
    page = opened("tanpura-light")
    drag(page, "pluck", 600, 0, steps=10)
    page.until(lambda: state(page)["data"]["pluck"]["position"] == pytest.approx(0.001))
    assert page.errors() == []


def test_another_note_is_drawn_with_its_finger(opened):
    page = opened("fretted-bass")
    assert not page.all("ellipse.finger")
    page.script("const s = document.getElementById('note'); s.value = '50'; s.dispatchEvent(new Event('change'))")
    page.until(lambda: page.all("ellipse.finger"))
    page.until(lambda: "fret 7" in page.text(".stage.whole figcaption"))
    assert page.text(".facts").startswith("Pitch\n146.83")
    page.find(".note-choice [aria-label='Higher note']").click()
    page.until(lambda: "fret 8" in page.text(".stage.whole figcaption"))
    page.reload()
    page.until(lambda: page.all("[data-handle]"))
    assert page.find("#note").get_property("value") == "51"


def test_scale_is_what_it_says(opened):
    """A millimetre up is as many times longer than one along as the caption says."""
    page = opened("fretted-bass")
    caption = page.until(lambda: page.text(".stage.whole figcaption"))
    said = float(caption.rpartition("×")[2])
    ticks = page.script(
        "return [...document.querySelectorAll('.stage-whole .tick')].map((t) => [t.getAttribute('text-anchor'), "
        "t.textContent, +t.getAttribute('x'), +t.getAttribute('y')])"
    )
    along = {float(text): x for anchor, text, x, _ in ticks if anchor == "middle"}
    up = {float(text.replace("−", "-")): y for anchor, text, _, y in ticks if anchor == "end" and text != "mm"}
    per_mm_along = (along[max(along)] - along[min(along)]) / (max(along) - min(along))
    per_mm_up = (up[min(up)] - up[max(up)]) / (max(up) - min(up))
    assert per_mm_up / per_mm_along == pytest.approx(said, rel=0.03)


def test_film_shows_the_contact_with_its_force(opened):
    page = opened("tanpura-light")
    keys = page.find(".keys")
    page.script("arguments[0].focus()", keys)
    keys.send_keys(Keys.HOME)
    page.until(lambda: keys.get_attribute("aria-valuenow") == "36")
    page.settle()
    page.until(lambda: page.all(".strip polygon"))
    assert not page.all(".string-moving")
    page.find("#film-play").click()
    page.until(lambda: page.all(".film-force.lit"))
    page.find("#film-play").click()
    assert page.find("#film-play").get_attribute("aria-label") == "Play in slow motion"
    film = page.result(
        "return (await fetch('/api/docs/' + location.hash.slice(1) + '/motion?note=36&velocity=90&seconds=0.0612&frames=300"
        "&start_s=0.0105')).json();"
    )
    touched = next(i for i, force in enumerate(film["force"]) if force[0] > 0)
    slide = (
        "const s = document.getElementById('film-time'); s.value = arguments[0]; s.dispatchEvent(new Event('input'));"
        "return [document.querySelector('.film-force').textContent, document.querySelectorAll('.stage-close .light').length]"
    )
    assert page.script(slide, 0) == ["free", 0]
    force, lights = page.script(slide, touched)
    assert lights == 1
    assert float(force.removesuffix(" N")) == pytest.approx(film["force"][touched][0], rel=0.06)
    assert page.errors() == []


def test_film_follows_an_edit(opened):
    page = opened("tanpura-light")
    page.find("#film-play").click()
    page.until(lambda: page.all(".film-force.lit"))
    page.find("#film-play").click()
    strip = page.script("return document.querySelector('.strip polygon').getAttribute('points')")
    field = page.field("obstacle.jiva_um")
    page.script("arguments[0].select()", field)
    field.send_keys("200", Keys.ENTER)
    page.until(lambda: page.script("return document.querySelector('.strip polygon').getAttribute('points')") != strip)
    assert page.errors() == []


def test_what_a_drag_cannot_reach_is_told_and_falls_back(opened):
    page = opened("tanpura-light")
    page.result(
        "await fetch('/api/docs/' + location.hash.slice(1) + '/edit', {method: 'POST', body: JSON.stringify({merge: null,"
        " changes: [{path: 'obstacle', value: {kind: 'points', positions_mm: [400, 460], heights_mm: [-1, -1]}},"
        " {path: 'mapping.pressure_um', value: null}]})});"
    )
    page.until(lambda: page.all('[data-handle="point-1"]'))
    page.until(lambda: not page.all(".stage.close:not([hidden])"))
    x1, _ = place(page, "point-1")
    drag(page, "point-0", 150, 0, steps=2)
    reason = page.until(lambda: [each.text for each in page.all(".notice.error") if "Not moved" in each.text])
    assert "sort the points" in reason[0]
    assert state(page)["data"]["obstacle"]["positions_mm"][1] == 460
    page.until(lambda: place(page, "point-0")[0] < x1)


def test_a_fret_that_stops_the_open_string_is_refused(opened):
    page = opened("fretted-bass")
    before = state(page)["data"]["obstacle"]
    drag(page, "point-0", 0, -80, steps=2)
    reason = page.until(lambda: [each.text for each in page.all(".notice.error") if "Not moved" in each.text])
    assert "must lie below the string at rest" in reason[0]
    assert state(page)["data"]["obstacle"] == before


def test_the_saved_version_stays_behind_the_edited_one(opened):
    page = opened("tanpura-light")
    assert not page.all(".ghost")
    drag(page, "pluck", 60, 0)
    page.until(lambda: page.all("polyline.ghost"))
    page.find("#undo").click()
    page.until(lambda: not page.all(".ghost"))
    assert page.errors() == []
