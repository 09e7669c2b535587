"""The controls as a hand uses them: setup first, what is not given folded away, sliders, wheel, units, stops of Tab."""

import pytest
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
from selenium.webdriver.common.keys import Keys

from tests.author.browser.running import Page, copy_preset, set_value, state


@pytest.fixture(scope="module")
def shared(driver, author):
    """One page with a tanpura for all tests that leave nothing behind."""
    driver.set_window_size(1280, 900)
    copy_preset("tanpura-light", author.folder / "shared.toml")
    page = Page(driver)
    page.open(author.address)
    page.choose("shared")
    yield page
    page.open_nothing()


@pytest.fixture
def page(shared):
    """That page, as it was saved, at the beginning of its controls."""
    shared.errors()
    shared.result(
        "await fetch('/api/docs/' + location.hash.slice(1) + '/revert', {method: 'POST', body: '{}'});"
        "document.activeElement.blur();"
    )
    shared.until(lambda: not state(shared)["dirty"])
    shared.until(lambda: not shared.all(".control.changed"))
    shared.script(
        "for (const each of document.querySelectorAll('.group')) each.open = true;"
        "for (const each of document.querySelectorAll('.unset-values')) each.open = false;"
        "document.querySelector('.controls-body').scrollTop = 0;"
    )
    yield shared
    assert shared.errors() == []


@pytest.fixture
def opened(driver, author):
    """opened("fretted-bass"): a page of its own."""
    page = Page(driver)
    driver.switch_to.new_window("tab")
    driver.set_window_size(1280, 900)

    def open_(preset):
        page.open(author.address)
        page.choose(preset)
        page.errors()
        return page

    yield open_
    page.open_nothing()
    driver.close()
    driver.switch_to.window(driver.window_handles[0])


def slider(page, path):
    found = page.find(f'.control[data-path="{path}"] input[type="range"]')
    page.script("arguments[0].scrollIntoView({block: 'center'})", found)
    return found


def value(page, path):
    table, key = path.rsplit(".", 1)
    found = state(page)["data"]
    for part in table.split("."):
        found = found[int(part)] if part.isdecimal() else found[part]
    return found[key]


def moved(page, path, by):
    """How far it moves a value."""
    before = value(page, path)
    by()
    page.until(lambda: value(page, path) != before)
    rest(page)
    return value(page, path) - before


def rest(page):
    """All edits have been answered."""
    page.result("await new Promise((done) => setTimeout(done)); await (await fetch('/api/session')).json();")
    revision = -1
    while revision != (revision := state(page)["revision"]):
        page.result("await new Promise((done) => setTimeout(done, 100))")


# ---- what a player turns first, then the setup; what is not given folded away


@pytest.mark.parametrize(
    ("preset", "turned", "wanted"),
    [
        ("tanpura-light", ["pluck.position", "obstacle.jiva_um"], ["obstacle.kind", "obstacle.distance_mm", "output.kind"]),
        ("fretted-bass", ["pluck.position", "pluck.displacement_mm"],
         ["obstacle.kind", "obstacle.count", "obstacle.heights_mm", "output.kind"]),
            ],
    ids=["tanpura-light", "bass"],
)  # fmt: skip
def test_what_is_turned_first_and_what_shapes_the_instrument_stand_first(opened, preset, turned, wanted):
    page = opened(preset)
    first, setup = page.all(".control-groups > .group")[:2]
    assert first.get_attribute("data-group") == "first" and first.text.startswith("Main controls")
    assert setup.get_attribute("data-group") == "setup" and setup.text.startswith("Setup")
    page.script("arguments[0].open = true", setup)
    for group, expected in ((first, turned), (setup, wanted)):
        shown = [each for each in group.find_elements("css selector", ".control") if each.is_displayed()]
        paths = [each.get_attribute("data-path") for each in shown]
        assert [path for path in paths if path in expected] == expected
    every = page.script("return [...document.querySelectorAll('.control')].map((each) => each.dataset.path)")
    assert len(set(every)) == len(every), "each control stands once"


def test_numbers_that_are_not_given_are_folded_away(page):
    path = "obstacle.distance_ratio"
    shown = "return document.querySelector(`.control[data-path='${arguments[0]}']`).checkVisibility()"
    folds = page.script(
        "return [...document.querySelectorAll('.unset-values:not([hidden])')].map((each) =>"
        " [each.firstChild.textContent, each.querySelectorAll('.control:not([hidden])').length])"
    )
    assert folds and all(text == f"{count} unset value{'s' if count > 1 else ''}" for text, count in folds)
    unset = page.script("return [...document.querySelectorAll('.control.unset')].filter((each) => "
                        "each.querySelector('[data-part=number]')).map((each) => each.checkVisibility())")  # fmt: skip
    assert len(unset) > 5 and not any(unset)
    assert not page.script(shown, path)
    page.find('[data-fold="setup"] > summary').click()
    page.until(lambda: page.script(shown, path))
    # given, it stands with the others as soon as the hand has left it; what it excludes goes
    set_value(page, path, 0.007)
    page.until(lambda: value(page, path) == 0.007)
    assert page.script("return document.activeElement.closest('.control').dataset.path") == path
    page.find("#control-search").click()
    page.until(lambda: page.script("return document.querySelector(`.control[data-path='obstacle.distance_mm']`)"
                                   ".closest('.unset-values') !== null"))  # fmt: skip
    assert page.script(f"return document.querySelector(`.control[data-path='{path}']`).closest('.unset-values') === null")
    page.find("#undo").click()
    page.until(
        lambda: page.script(f"return document.querySelector(`.control[data-path='{path}']`).closest('.unset-values')")
    )


def test_the_search_finds_what_is_folded_away(page):
    page.find("#control-search").send_keys("winding")
    page.until(
        lambda: page.script("return document.querySelector('.control[data-path$=winding_diameter_mm]').checkVisibility()")
    )
    page.find("#control-search").send_keys(Keys.ESCAPE)
    page.until(
        lambda: (
            not page.script("return document.querySelector('.control[data-path$=winding_diameter_mm]').checkVisibility()")
        )
    )


# ---- sliders by hand


def test_a_double_click_goes_back_to_what_was_saved_then_to_the_default(page):
    set_value(page, "obstacle.jiva_um", 12)
    page.until(lambda: value(page, "obstacle.jiva_um") == 12)
    page.hand().double_click(slider(page, "obstacle.jiva_um")).perform()
    page.until(lambda: value(page, "obstacle.jiva_um") == 3)
    rest(page)
    assert not page.all('.control.changed[data-path="obstacle.jiva_um"]')
    page.find("#undo").click()  # of both clicks and the way back
    page.until(lambda: value(page, "obstacle.jiva_um") == 12)


def test_the_slider_of_the_thread_reaches_what_is_allowed(page):
    control = slider(page, "obstacle.jiva_um")
    control.send_keys(Keys.END)
    page.until(lambda: value(page, "obstacle.jiva_um") == 1000)
    control.send_keys(Keys.HOME)
    page.until(lambda: value(page, "obstacle.jiva_um") == -100)
    page.until(lambda: "not" not in page.text(".stage.close figcaption"))
    # the middle is where the buzz is: between rest and 30 µm lie a quarter of the travel and more
    places = page.result(
        "const { makeScale } = await import('/page/scale.js');"
        "const scale = makeScale({minimum: -100, maximum: 1000, scale: 'log', step: 0.5, integer: false});"
        "return [0, 30].map(scale.place)"
    )
    assert places[1] - places[0] > 250


def test_shift_is_finer_by_drag_wheel_and_arrows(page):
    path = "pluck.position"
    control = slider(page, path)

    def drag(chain):
        thumb = page.script(
            "const b = arguments[0].getBoundingClientRect();"
            "return 7 + (b.width - 14) * arguments[0].value / arguments[0].max - b.width / 2", control
        )  # fmt: skip
        chain.move_to_element_with_offset(control, round(thumb), 0).click_and_hold()
        for _ in range(6):
            chain.move_by_offset(-10, 0)
        chain.release()

    def wheel(chain):
        page.script("arguments[0].focus()", control)
        chain.scroll_from_origin(ScrollOrigin.from_element(control), 0, 300)

    def arrows(chain):
        page.script("arguments[0].focus()", control)
        chain.send_keys(Keys.ARROW_LEFT)

    def number(chain):
        page.script("arguments[0].focus()", page.field(path))
        chain.send_keys(Keys.ARROW_DOWN)

    def perform(hand, shift):
        chain = page.hand()
        if shift:
            chain.key_down(Keys.SHIFT)
        hand(chain)
        if shift:
            chain.key_up(Keys.SHIFT)
        chain.perform()

    for hand in (drag, wheel, arrows, number):
        coarse, fine = (moved(page, path, lambda shift=shift, hand=hand: perform(hand, shift)) for shift in (False, True))
        assert coarse < 0 and fine == pytest.approx(0.1 * coarse, rel=0.25), hand.__name__


def test_the_wheel_scrolls_the_page_unless_the_slider_has_the_focus(page):
    control = slider(page, "pluck.width_mm")
    body = "return document.querySelector('.controls-body').scrollTop"
    before = page.script(body)
    page.hand().scroll_from_origin(ScrollOrigin.from_element(control), 0, 120).perform()
    page.until(lambda: page.script(body) != before)
    assert not state(page)["dirty"]
    control = slider(page, "pluck.width_mm")
    page.script("arguments[0].focus()", control)
    before = page.script(body)
    page.hand().scroll_from_origin(ScrollOrigin.from_element(control), 0, -100).perform()
    page.until(lambda: value(page, "pluck.width_mm") > 18)
    assert page.script(body) == before
    page.find("#undo").click()
    page.until(lambda: value(page, "pluck.width_mm") == 18)
    field = page.field("pluck.width_mm")
    page.script("arguments[0].focus()", field)
    page.hand().scroll_from_origin(ScrollOrigin.from_element(field), 0, -100).perform()
    page.until(lambda: value(page, "pluck.width_mm") > 18)


def test_sliders_of_the_dock_and_the_film_take_double_clicks(page):
    for place, usual in ((".key-velocity", "90"), (".player-volume", "0 dB")):
        control, text = page.find(f"{place} input"), f"{place} output"
        page.script("arguments[0].focus()", control)
        page.hand().send_keys(Keys.ARROW_LEFT).perform()
        page.until(lambda text=text, usual=usual: page.text(text) != usual)
        page.hand().double_click(control).perform()
        page.until(lambda text=text, usual=usual: page.text(text) == usual)
    film = page.find("#film-time")
    page.until(lambda: page.all(".strip polygon"))
    page.script("arguments[0].focus()", film)
    page.hand().send_keys(Keys.PAGE_UP).perform()
    page.until(lambda: float(film.get_property("value")) == 30)
    page.hand().key_down(Keys.SHIFT).send_keys(Keys.ARROW_RIGHT).key_up(Keys.SHIFT).perform()
    page.until(lambda: float(film.get_property("value")) == pytest.approx(30.3))
    page.hand().double_click(film).perform()
    page.until(lambda: float(film.get_property("value")) == 0)


# ---- units


@pytest.mark.parametrize(
    ("path", "typed", "found"),
    [
        ("obstacle.jiva_um", "0.02 mm", 20),
        ("obstacle.jiva_um", "20um", 20),
        ("obstacle.jiva_um", "12,5 μm", 12.5),
        ("obstacle.jiva_um", "−5e-6 m", -5),
        ("obstacle.distance_mm", "7000 µm", 7),
        ("pluck.position", "30 %", 0.3),
        ("tuning.a4_hz", "0.442kHz", 442),
        ("pluck.draw_ms", "0.01 s", 10),
        ("tuning.offset_cents", "0.5 semitones", 50),
        ("string.3.density_kg_m3", "8.5 g/cm3", 8500),
        ("string.3.youngs_modulus_gpa", "2e5 MPa", 200),
        ("pluck.finger_stiffness_n_mm", "6000 N/m", 6),
    ],
)
def test_a_field_takes_its_unit(page, path, typed, found):
    field = page.field(path)
    page.script("arguments[0].select()", field)
    field.send_keys(typed, Keys.ENTER)
    page.until(lambda: value(page, path) == found)
    page.until(lambda: field.get_property("value") != typed)  # until the page has heard of it
    assert float(field.get_property("value")) == found
    assert field.get_attribute("aria-invalid") is None


@pytest.mark.parametrize(
    ("path", "typed", "said"),
    [
        ("obstacle.jiva_um", "3 s", "must be a length in µm (or m, cm, mm, nm), got “3 s”"),
        ("tuning.a4_hz", "440 mm", "must be a frequency in Hz (or kHz), got “440 mm”"),
        ("pluck.velocity_exponent", "2 dB", "must be a number without a unit, got “2 dB”"),
        ("pluck.width_mm", "mm", "must be a number, got “mm”"),
        ("pluck.width_mm", "1.2.3 mm", "must be a number, got “1.2.3 mm”"),
        ("output.gain_db", "3 Hz", "must be a level in dB, got “3 Hz”"),
    ],
)
def test_a_wrong_unit_is_refused_at_the_field(page, path, typed, said):
    before = value(page, path)
    field = page.field(path)
    page.script("arguments[0].select()", field)
    field.send_keys(typed, Keys.ENTER)
    page.until(lambda: page.text(f'.control[data-path="{path}"] .control-error') == said)
    assert value(page, path) == before and field.get_property("value") == typed
    field.send_keys(Keys.ESCAPE)
    page.until(lambda: not page.all(f'.control[data-path="{path}"] .control-error:not([hidden])'))


# ---- the keyboard


STOPS = """
const seen = (each) => each.checkVisibility({visibilityProperty: true}) && !each.matches(":disabled") && each.tabIndex >= 0;
return [...document.querySelectorAll("a[href], button, input, select, textarea, summary, [tabindex]")].filter(seen).length;
"""


@pytest.mark.parametrize("preset", ["fretted-bass", "jawari-harp"])
def test_stops_of_tab_are_a_few_dozen(opened, preset):
    page = opened(preset)
    for group in page.all(".group:not([open])"):
        page.script("arguments[0].open = true", group)
    assert page.script(STOPS) < 45
    # counted by going through them
    page.find("#title").click()
    count, seen = 0, set()
    while count < 100:
        page.hand().send_keys(Keys.TAB).perform()
        mark = page.script("const a = document.activeElement; if (a === document.body) return null;"
                           "return (a.dataset.tabbed ??= String(Math.random()))")  # fmt: skip
        if mark is None or mark in seen:
            break
        seen.add(mark)
        count += 1
    assert 20 < count < 45
    groups = page.script("return [...document.querySelectorAll('.group')].map((group) => "
                         "group.querySelectorAll('[data-tabbed]').length)")  # fmt: skip
    assert groups == [1] * len(groups), "one stop a group"


def test_arrows_go_through_a_group_and_tab_into_a_control(page):
    page.script("document.querySelector('[data-group=pluck] > summary').focus()")
    path = "return document.activeElement.closest('[data-path]')?.dataset.path ?? document.activeElement.localName"

    def go(*keys):
        page.hand().send_keys(*keys).perform()
        return page.script(path)

    assert go(Keys.ARROW_DOWN) == "button"  # a step at random
    assert go(Keys.ARROW_DOWN) == "pluck.velocity_exponent"
    assert go(Keys.ARROW_DOWN) == "pluck.draw_ms"
    assert go(Keys.TAB) == "pluck.draw_ms"
    assert page.script("return document.activeElement.dataset.part") == "number"
    # from field to field
    assert go(Keys.PAGE_DOWN) == "pluck.finger_stiffness_n_mm"
    assert page.script("return document.activeElement.dataset.part") == "number"
    assert go(Keys.PAGE_UP) == "pluck.draw_ms"
    page.hand().key_down(Keys.SHIFT).send_keys(Keys.TAB).key_up(Keys.SHIFT).perform()
    assert page.script("return document.activeElement.classList.contains('control-name')")
    assert go(Keys.END) == "summary"  # of what is not given
    assert go(Keys.HOME) == "summary"
    assert page.script("return document.activeElement.closest('.group').dataset.group") == "pluck"
    # who leaves the group comes back to where they were
    go(Keys.ARROW_DOWN, Keys.ARROW_DOWN, Keys.ARROW_DOWN)
    page.find("#control-search").click()
    stops = page.all('[data-group=pluck] .control-name[tabindex="0"]')
    assert [page.script("return arguments[0].closest('.control').dataset.path", each) for each in stops] == ["pluck.draw_ms"]


def test_toolbars_are_one_stop_and_go_by_arrows(page):
    bars = page.script(
        "const own = (each) => !each.closest('[role=radiogroup], [role=menu]') && each.tabIndex >= 0;"
        "const bars = [...document.querySelectorAll('[role=toolbar]')];"
        "return bars.map((bar) => [...bar.querySelectorAll('button')].filter(own).length)"
    )
    assert bars == [1] * 6
    page.script("document.querySelector('[data-phrase=note]').focus()")
    page.hand().send_keys(Keys.ARROW_RIGHT, Keys.ARROW_RIGHT).perform()
    assert page.script("return document.activeElement.dataset.phrase") == "scale"  # a tanpura has no figure but its drone
    page.hand().send_keys(Keys.END).perform()
    assert page.script("return document.activeElement.textContent") == "Stop"
    outline = page.script("return getComputedStyle(document.activeElement).outlineStyle")
    assert outline == "solid"
