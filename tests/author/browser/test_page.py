"""The page as a person uses it: opening, exact entry, sliders, undo, refusals, ways back, A/B, keyboard, sizes, colours."""

import pytest
from selenium.webdriver.common.keys import Keys

from synth.instrument.preset import load_preset
from tests.author.browser.running import Page, copy_preset, set_value, state


@pytest.fixture
def page(driver, author, mine):
    """A page with a tanpura of the test's own."""
    page = Page(driver)
    driver.set_window_size(1280, 900)
    page.open(author.address)
    page.choose(mine.stem)
    page.errors()
    yield page
    # media features and sizes are those of one test
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    page.open_nothing()


def value_of(page, path):
    return page.field(path).get_property("value")


def control(page, path):
    return page.find(f'.control[data-path="{path}"]')


def focused(page):
    return page.driver.switch_to.active_element


def press(page, *keys):
    chain = page.hand()
    for key in keys:
        chain.send_keys(key)
    chain.perform()


def chord(page, *keys):
    chain = page.hand()
    for key in keys:
        chain.key_down(key)
    for key in reversed(keys):
        chain.key_up(key)
    chain.perform()


def test_start_offers_the_presets_and_opens_one(driver, author):
    page = Page(driver)
    page.open(author.address)
    page.find("[data-preset]")
    assert {"tanpura-light", "fretted-bass", "jawari-harp"} <= {
        each.get_attribute("data-preset") for each in page.all("[data-preset]")
    }
    page.choose("fretted-bass")
    assert page.text("#title") == "Fretted bass"
    assert page.text("#doc-status") == "built in"
    page.until(lambda: len(page.all('[data-handle^="point-"]')) == 20)
    page.until(lambda: page.text(".facts").startswith("Pitch"))
    assert page.errors() == []
    page.open_nothing()


def test_exact_entry_is_what_the_preset_has_then(page):
    set_value(page, "pluck.position", 0.31)
    page.until(lambda: state(page)["data"]["pluck"]["position"] == 0.31)
    assert page.text("#doc-status") == "edited"
    assert "changed" in control(page, "pluck.position").get_attribute("class")
    assert page.errors() == []


def test_comma_and_minus_are_taken(page):
    field = page.field("tuning.offset_cents")
    page.script("arguments[0].select()", field)
    field.send_keys("−12,5", Keys.ENTER)
    page.until(lambda: state(page)["data"]["tuning"]["offset_cents"] == -12.5)


def test_undo_and_redo_by_button_and_keys(page):
    set_value(page, "pluck.position", 0.31)
    set_value(page, "pluck.width_mm", 9)
    page.until(lambda: state(page)["data"]["pluck"]["width_mm"] == 9)
    page.find("#undo").click()
    page.until(lambda: value_of(page, "pluck.width_mm") == "18")
    chord(page, Keys.CONTROL, "z")
    page.until(lambda: value_of(page, "pluck.position") == "0.42")
    assert page.find("#undo").get_property("disabled")
    chord(page, Keys.CONTROL, Keys.SHIFT, "z")
    page.until(lambda: value_of(page, "pluck.position") == "0.31")
    page.find("#redo").click()
    page.until(lambda: value_of(page, "pluck.width_mm") == "9")
    assert page.errors() == []


def test_keys_wait_for_the_edit_before_them(page, mine):
    """Enter, and at once Ctrl-Z or Ctrl-S: the edit is undone, or saved."""
    field = page.field("pluck.width_mm")
    typed = (Keys.CONTROL, "a", Keys.NULL, "9", Keys.ENTER, Keys.CONTROL)
    for _ in range(5):
        before = state(page)["revision"]
        field.send_keys(*typed, "z")
        page.until(lambda before=before: state(page)["revision"] >= before + 2)
        assert state(page)["can_redo"] and not state(page)["dirty"]
        page.until(lambda: value_of(page, "pluck.width_mm") == "18")
    field.send_keys(*typed, "s")
    page.until(lambda: load_preset(str(mine)).pluck.width_mm == 9)
    field.send_keys(Keys.CONTROL, "a", Keys.NULL, "8", Keys.CONTROL, "s")  # without Enter
    page.until(lambda: load_preset(str(mine)).pluck.width_mm == 8)
    page.until(lambda: not state(page)["dirty"])
    assert page.errors() == []


def test_ctrl_z_in_a_field_undoes_its_typing_then_its_edit(page):
    field = page.field("pluck.position")
    set_value(page, "pluck.position", 0.31)
    page.until(lambda: state(page)["dirty"])
    field.send_keys("77")
    chord(page, Keys.CONTROL, "z")
    assert state(page)["dirty"]
    press(page, Keys.ESCAPE)
    assert value_of(page, "pluck.position") == "0.31"
    chord(page, Keys.CONTROL, "z")
    page.until(lambda: value_of(page, "pluck.position") == "0.42")
    assert page.errors() == []


def test_a_drag_of_a_slider_is_one_step_of_undo(page):
    slider = page.find('[data-path="damping.release_s"] input[type="range"]')
    page.script("arguments[0].scrollIntoView({block: 'center'})", slider)
    before = value_of(page, "damping.release_s")
    chain = page.hand().move_to_element(slider).click_and_hold()
    for _ in range(8):
        chain.move_by_offset(6, 0)
    chain.release().perform()
    page.until(
        lambda: (
            state(page)["dirty"] and str(state(page)["data"]["damping"]["release_s"]) == value_of(page, "damping.release_s")
        )
    )
    assert value_of(page, "damping.release_s") != before
    page.find("#undo").click()
    page.until(lambda: value_of(page, "damping.release_s") == before)
    assert not state(page)["can_undo"]


@pytest.mark.parametrize(
    ("typed", "reason"),
    [("1.5", "less than 1"), ("abc", "must be a number"), ("0", "greater than 0")],
    ids=["high", "text", "zero"],
)
def test_a_wrong_value_is_refused_at_the_field(page, typed, reason):
    field = page.field("pluck.position")
    page.script("arguments[0].select()", field)
    field.send_keys(typed, Keys.ENTER)
    error = page.until(lambda: page.text('.control[data-path="pluck.position"] .control-error'))
    assert reason in error
    assert field.get_attribute("aria-invalid") == "true"
    assert value_of(page, "pluck.position") == typed, "what was typed stays, to be put right"
    assert state(page)["data"]["pluck"]["position"] == 0.42
    assert not state(page)["dirty"]
    set_value(page, "pluck.position", 0.3)
    page.until(lambda: state(page)["data"]["pluck"]["position"] == 0.3)
    page.until(lambda: field.get_attribute("aria-invalid") is None)
    page.until(lambda: not page.all('.control[data-path="pluck.position"] .control-error:not([hidden])'))


def test_ways_back_to_saved_and_to_default(page):
    set_value(page, "obstacle.jiva_um", 12)
    page.until(lambda: state(page)["data"]["obstacle"]["jiva_um"] == 12)
    back = page.find('.control[data-path="obstacle.jiva_um"] .control-back')
    assert back.get_attribute("title") == "Back to saved: 3"
    back.click()
    page.until(lambda: state(page)["data"]["obstacle"]["jiva_um"] == 3)
    page.until(lambda: back.get_attribute("title") == "Back to default: 0")
    back.click()
    page.until(lambda: state(page)["data"]["obstacle"]["jiva_um"] == 0)
    assert "obstacle.jiva_um" not in state(page)["set"]


def test_values_by_note(page):
    path = "pluck.displacement_mm"
    page.field(path).click()
    page.find(f'.control[data-path="{path}"] [data-part="split"]').click()
    page.until(lambda: state(page)["data"]["pluck"]["displacement_mm"] == {"36": 3.0, "48": 3.0})
    cell = page.find(f'.control[data-path="{path}"] [data-part="value 1"]')
    page.script("arguments[0].select()", cell)
    cell.send_keys("2.5", Keys.ENTER)
    page.until(lambda: state(page)["data"]["pluck"]["displacement_mm"] == {"36": 3.0, "48": 2.5})
    assert "C3 = 2.5" in state(page)["text"]
    page.find(f'.control[data-path="{path}"] [data-part="join"]').click()
    page.until(lambda: state(page)["data"]["pluck"]["displacement_mm"] in (2.5, 3.0))
    assert page.errors() == []


def test_what_excludes_each_other_changes_together(page):
    assert state(page)["data"]["string"][0]["density_kg_m3"] == 7850
    page.unfold_all()
    page.tab(0)
    set_value(page, "string.0.linear_density_g_m", 0.9)
    page.until(lambda: state(page)["data"]["string"][0]["linear_density_g_m"] == 0.9)
    assert state(page)["data"]["string"][0]["density_kg_m3"] is None
    assert page.errors() == []


def test_another_obstacle_and_rows_of_lists(page):
    page.unfold_all()
    select = page.find('.control[data-path="obstacle.kind"] select')
    page.script("arguments[0].value = 'points'; arguments[0].dispatchEvent(new Event('change'))", select)
    page.until(lambda: state(page)["data"]["obstacle"]["kind"] == "points")
    add = '.control[data-path="obstacle.positions_mm"] [data-part="add"]'
    page.until(lambda: page.all(add))
    page.script("arguments[0].closest('details').open = true", page.all(add)[0])
    page.find(add).click()
    page.until(lambda: len(state(page)["data"]["obstacle"]["positions_mm"]) == 2)
    assert len(state(page)["data"]["obstacle"]["heights_mm"]) == 2
    page.find('.control[data-path="obstacle.positions_mm"] [data-part="away 0"]').click()
    page.until(lambda: len(state(page)["data"]["obstacle"]["positions_mm"]) == 1)
    page.find('[data-path="nut"] [data-part="add"]').click()
    page.until(lambda: len(state(page)["data"]["nut"]) == 2)
    page.until(lambda: page.all('.control[data-path="nut.1.q"]'))
    page.find('[role="tablist"] [data-part="add"]').click()
    page.until(lambda: len(state(page)["data"]["string"]) == 5)
    assert page.errors() == []


def test_remarks_of_several_lines(page):
    page.script("document.querySelector('[data-group=about]').open = true")
    area = page.find('.control[data-path="remarks"] textarea')
    area.send_keys("first\nsecond", Keys.TAB)
    page.until(lambda: state(page)["data"]["remarks"] == "first\nsecond")
    assert page.errors() == []


def test_search_finds_by_name_and_by_physics(page):
    search = page.find("#control-search")
    search.send_keys("thread jiva")
    page.until(lambda: not page.find('.control[data-path="obstacle.jiva_um"]').get_attribute("class").count("filtered"))
    seen = [each.get_attribute("data-path") for each in page.shown(".control")]
    assert "obstacle.jiva_um" in seen
    assert "pluck.position" not in seen
    search.send_keys("zzz")
    page.until(lambda: page.find(".controls-none").is_displayed())
    search.send_keys(Keys.ESCAPE)
    page.until(lambda: control(page, "pluck.position").is_displayed())


def test_every_parameter_has_a_control_with_a_tip(page):
    wanted = page.result("return (await fetch('/api/docs/' + location.hash.slice(1) + '/parameters')).json();")
    tips = page.script("return Object.fromEntries([...document.querySelectorAll('[data-path] .control-name')].map("
                       "(name) => [name.closest('[data-path]').dataset.path, name.dataset.tip]))")  # fmt: skip
    for index in range(4):  # one string is shown at a time
        page.tab(index)
        page.until(lambda index=index: page.all(f'.control[data-path="string.{index}.length_m"]'))
        tips |= page.script("return Object.fromEntries([...document.querySelectorAll('.control .control-name')].map("
                            "(name) => [name.closest('[data-path]').dataset.path, name.dataset.tip]))")  # fmt: skip
    missing = [each["path"] for each in wanted if each["path"] != "string" and tips.get(each["path"]) != each["tip"]]
    assert missing == []


def test_saved_version_is_shown_and_cannot_be_edited(page):
    set_value(page, "pluck.position", 0.2)
    page.until(lambda: state(page)["dirty"])
    place = page.until(lambda: page.find('[data-handle="pluck"]').get_attribute("aria-valuetext").startswith("0.2 of L"))
    assert place
    page.find('[data-which="saved"]').click()
    page.until(lambda: value_of(page, "pluck.position") == "0.42")
    assert not page.field("pluck.position").is_enabled()
    page.until(lambda: not page.all("[data-handle]"))
    page.find('[data-which="current"]').click()
    page.until(lambda: value_of(page, "pluck.position") == "0.2")
    assert page.field("pluck.position").is_enabled()
    assert page.errors() == []


def test_randomise_is_one_step_and_stays_playable(page):
    page.find("#randomise").click()
    page.until(lambda: state(page)["dirty"])
    random = state(page)["data"]
    assert random["string"][0]["notes"] == [43, 43]
    page.find("#undo").click()
    page.until(lambda: not state(page)["dirty"])
    assert page.errors() == []


def test_with_the_keyboard_alone(page):
    """From the top: to a group by Tab, to a control by arrows, its tip, its value by arrows, back by Ctrl-Z."""
    page.find("#title").click()  # from there Tab begins at the top
    chord(page, Keys.SHIFT, Keys.TAB)
    assert focused(page).text == "Skip to the controls"
    press(page, Keys.ENTER, Keys.TAB, Keys.TAB, Keys.TAB)
    assert focused(page).text.startswith("Main controls")
    reached = "return document.activeElement.closest('[data-path]')?.dataset.path"
    for _ in range(20):
        press(page, Keys.ARROW_DOWN)
        if page.script(reached) == "pluck.position":
            break
    else:
        pytest.fail("the arrows never come to the place of the pluck")
    assert "control-name" in focused(page).get_attribute("class")
    page.until(lambda: "share of the open string" in page.text("#tip"))
    press(page, Keys.ESCAPE)
    page.until(lambda: not page.all("#tip:not([hidden])"))
    press(page, Keys.TAB)
    assert focused(page).get_attribute("data-part") == "number"
    press(page, Keys.TAB)
    while focused(page).get_attribute("data-part") != "slider":
        press(page, Keys.TAB)
    for _ in range(3):
        press(page, Keys.ARROW_RIGHT)
    page.until(lambda: state(page)["data"]["pluck"]["position"] > 0.42)
    assert page.script("return document.scrollingElement.scrollTop") == 0, "only the controls scroll"
    outline = page.script("return getComputedStyle(document.activeElement).outlineStyle")
    assert outline == "solid"
    chord(page, Keys.CONTROL, "z")
    page.until(lambda: state(page)["data"]["pluck"]["position"] == 0.42)
    assert page.errors() == []


def test_on_400_pixels_nothing_is_cut_off(page):
    page.driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": True}
    )
    page.until(lambda: page.script("return innerWidth") == 400)
    assert page.script("return document.scrollingElement.scrollWidth") <= 400
    beyond = page.script(
        "return [...document.querySelectorAll('#files button, .bar-tools button, .control input, .control select,"
        " .stage svg, #note')].filter((each) => each.checkVisibility() && each.getBoundingClientRect().right > 401)"
        ".map((each) => each.outerHTML.slice(0, 120))"
    )
    assert beyond == []
    set_value(page, "pluck.position", 0.25)
    page.until(lambda: state(page)["data"]["pluck"]["position"] == 0.25)


def test_fingers_have_targets_of_44_pixels(page):
    page.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 5})
    try:
        page.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride", {"width": 820, "height": 1180, "deviceScaleFactor": 1, "mobile": True}
        )
        page.until(lambda: page.script("return matchMedia('(pointer: coarse)').matches"))
        small = page.script(
            "return [...document.querySelectorAll('.bar button, .note-choice button, .note-choice select, .control-number,"
            " .control-back, .film .play')].filter((each) => each.checkVisibility({visibilityProperty: true}) &&"
            " each.getBoundingClientRect().height < 40).map((each) => each.outerHTML.slice(0, 120))"
        )
        assert small == []
    finally:
        page.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})


def test_reduced_motion_is_respected(page):
    moving = "return getComputedStyle(document.querySelector('.group > summary'), '::before').transitionDuration"
    assert page.script(moving) != "0s"
    page.driver.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-reduced-motion", "value": "reduce"}]}
    )
    assert page.script(moving) == "0s"


LUMINANCE = """
    const of = (name) => getComputedStyle(document.querySelector(name));
    const light = (text) => { const [r, g, b] = text.match(/[\\d.]+/g).map((x) => { x /= 255;
        return x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4; }); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
    const ratio = (a, b) => (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    const paper = light(of('html').backgroundColor);
    return {paper, text: ratio(paper, light(of('html').color)), muted: ratio(paper, light(of('.unit').color))};
"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_colours_follow_the_system_and_the_button(page, scheme):
    page.driver.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    )
    seen = page.script(LUMINANCE)
    assert (seen["paper"] > 0.5) == (scheme == "light")
    assert seen["text"] > 7.0
    assert seen["muted"] > 4.5
    other = "dark" if scheme == "light" else "light"
    while page.script("return document.documentElement.dataset.theme") != other:
        page.find("#theme").click()
    assert (page.script(LUMINANCE)["paper"] > 0.5) == (scheme == "dark")
    page.reload()
    assert page.script("return document.documentElement.dataset.theme") == other
    page.script("localStorage.clear()")


def test_start_with_many_presets_scrolls(driver, author):
    for number in range(40):
        copy_preset("tanpura-light", author.folder / f"zz-{number:02}.toml")
    page = Page(driver)
    page.open(author.address)
    page.choose("zz-39")
    page.open_nothing()


def test_embedded_presets_are_what_they_were(author):
    assert load_preset("tanpura-light").pluck.position == 0.42
    assert sorted(path.name for path in author.folder.glob("tanpura-light.toml")) == []
