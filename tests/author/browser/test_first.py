"""What a player meets on the page first: some eight controls, macros, a picture that is the instrument's, a short page."""

import pytest
from selenium.webdriver.common.keys import Keys

from tests.author.browser.running import Page, copy_preset, set_value, state

PHONE = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
#: screens that a phone's page may be long, with a sitar on it
PHONE_SCREENS = 3
OVERPRINTED = """
const boxes = [...document.querySelectorAll(arguments[0])].map((each) => each.getBoundingClientRect());
return boxes.flatMap((a, i) => boxes.slice(0, i).filter((b) =>
  Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 &&
  Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1)).length;
"""


@pytest.fixture(scope="module")
def shared(driver, author):
    driver.set_window_size(1280, 900)
    copy_preset("sitar", author.folder / "my-sitar.toml")
    page = Page(driver)
    page.open(author.address)
    page.choose("my-sitar")
    yield page
    driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    page.open_nothing()


@pytest.fixture
def page(shared):
    """That page, as it was saved."""
    shared.result("await fetch('/api/docs/' + location.hash.slice(1) + '/revert', {method: 'POST', body: '{}'});")
    shared.until(lambda: not state(shared)["dirty"])
    shared.until(lambda: not shared.all(".control.changed"))
    yield shared
    assert shared.errors() == []


def seen(page):
    return page.script(
        "return [...document.querySelectorAll('.control')].filter((each) => each.checkVisibility())"
        ".map((each) => each.dataset.path)"
    )


def losses(page, sympathetic):
    return [one["viscoelastic_loss"] for one in state(page)["data"]["string"] if one["sympathetic"] == sympathetic]


def test_some_eight_controls_are_seen_and_the_search_reaches_the_rest(page):
    paths = seen(page)
    assert 6 <= len(paths) <= 10
    assert {"pluck.position", "obstacle.jiva_um", "pluck.displacement_mm", "tuning.offset_cents"} <= set(paths)
    assert {"macro.sustain", "macro.sympathetic", "macro.body"} <= set(paths)
    page.find("#control-search").send_keys("radius of the bridge")
    page.until(lambda: "obstacle.radius_mm" in seen(page))
    page.find("#control-search").send_keys(Keys.ESCAPE)
    page.until(lambda: seen(page) == paths)


def test_a_macro_moves_its_values_by_its_law_in_one_step_of_undo(page):
    played, others = losses(page, False), losses(page, True)
    set_value(page, "macro.sustain", 2)
    page.until(lambda: losses(page, False) == pytest.approx([0.5 * loss for loss in played], rel=1e-5))
    assert losses(page, True) == others
    page.until(lambda: page.field("macro.sustain").get_property("value") == "2")
    # from the saved values, not from the present ones
    set_value(page, "macro.sustain", 0.5)
    page.until(lambda: losses(page, False) == pytest.approx([2 * loss for loss in played], rel=1e-5))
    page.find("#undo").click()
    page.until(lambda: losses(page, False) == pytest.approx([0.5 * loss for loss in played], rel=1e-5))
    page.find("#undo").click()
    page.until(lambda: losses(page, False) == played)
    page.until(lambda: page.field("macro.sustain").get_property("value") == "1")


def test_a_macro_goes_back_to_exactly_what_was_saved(page):
    modes = [mode["mass_kg"] for mode in state(page)["data"]["body"]["mode"]]
    set_value(page, "macro.body", 1.37)
    page.until(lambda: state(page)["dirty"])
    page.find('.control[data-path="macro.body"] .control-back').click()
    page.until(lambda: [mode["mass_kg"] for mode in state(page)["data"]["body"]["mode"]] == modes)


def test_a_slider_leaves_room_beyond_a_value_at_its_end(page):
    ends = page.result(
        """
        const { makeScale, travelFor, STEPS } = await import('/page/scale.js');
        const place = (parameter, travel, value) =>
          makeScale({...parameter, ...travelFor(parameter, travel, value)}).place(value) / STEPS;
        const linear = {minimum: 0, maximum: 100, scale: 'linear'}, log = {minimum: 0.1, maximum: 1e5, scale: 'log'};
        return [...[50, 70, 10].map((value) => place(linear, [10, 50], value)), place(log, [200, 5000], 8000),
          place(linear, [10, 50], 100)];
        """
    )
    assert ends[4] == 1.0, "what is not allowed is not offered"
    assert all(0.1 < end < 0.95 for end in ends[:4])
    # the radius of the sitar's bridge lies beyond what is usual
    page.unfold("obstacle.radius_mm")
    slider = page.find('.control[data-path="obstacle.radius_mm"] input[type=range]')
    assert float(slider.get_property("value")) < 950
    page.script("for (const each of document.querySelectorAll('.group:not([data-group=first])')) each.open = false")


def test_the_sitar_has_its_frets_and_no_thread(page):
    page.until(lambda: len(page.all(".stage.whole .fret")) == 24)
    page.until(lambda: page.all(".stage.close .wood"))
    assert not page.all(".thread") and not page.all('[data-handle="thread"]')
    names = page.script("return [...document.querySelectorAll('.control-name')].map((each) => each.textContent)")
    assert not [name for name in names if "hread" in name or "jiva" in name]


@pytest.mark.parametrize("width", [390, 820, 1440])
def test_names_do_not_overprint(page, width):
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {**PHONE, "width": width, "mobile": width < 500})
    page.until(lambda: page.script("return innerWidth") == width)
    page.until(lambda: len(page.all(".stage-bridge text")) == 20)
    page.until(lambda: page.script(OVERPRINTED, ".stage-bridge text") == 0)
    page.until(lambda: page.script(OVERPRINTED, ".stage.whole .fret-number") == 0)
    page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_the_page_of_a_phone_is_a_few_screens_long(page):
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", PHONE)
    page.until(lambda: page.script("return innerWidth") == PHONE["width"])
    page.until(lambda: page.script("return document.scrollingElement.scrollHeight") <= PHONE_SCREENS * PHONE["height"])
    page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_the_figure_is_called_what_it_is(page):
    assert page.text("[data-phrase=riff]") == "Alap"
