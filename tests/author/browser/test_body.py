"""Bridge and body on the page: modes dragged, added, taken away, what was measured over them; the film moves them."""

import math
from contextlib import suppress

import pytest
from selenium.webdriver.common.keys import Keys

from tests.author.browser.running import PRESETS, Author, Page, state
from tests.patience import until


@pytest.fixture(scope="module")
def author(tmp_path_factory):
    folder = tmp_path_factory.mktemp("presets")
    for name in ("steel-guitar", "tanpura-light"):
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
        page.until(
            lambda: page.all("#body-begin") and page.script("return document.querySelector('.body-view').hidden") is False
        )
        page.result("await fetch('/api/docs/' + location.hash.slice(1) + '/revert', {method: 'POST', body: '{}'});")
        page.until(lambda: not state(page)["dirty"])
        page.settle()
        page.errors()
        return page

    yield open_
    page.open_nothing()


def modes(page):
    return state(page)["data"]["body"]["mode"]


def peak(page, index):
    return page.until(lambda: page.all(f'[data-handle="mode-{index}"]'))[0]


def drag(page, index, dx, dy):
    grip = peak(page, index).find_element("css selector", ".reach")
    page.script("arguments[0].scrollIntoView({block: 'center'})", grip)
    chain = page.hand().move_to_element(grip).click_and_hold()
    for _ in range(5):
        chain.move_by_offset(dx / 5, dy / 5)
    chain.release().perform()
    page.until(lambda: page.script("return document.querySelector('.handle.held')") is None)


def place(page, index):
    return page.script(
        "const b = document.querySelector(arguments[0]).getBoundingClientRect();"
        "return [b.x + b.width / 2, b.y + b.height / 2]",
        f'[data-handle="mode-{index}"] .reach',
    )


def test_a_peak_dragged_along_changes_its_frequency_alone_in_one_step(opened):
    page = opened("steel-guitar")
    before = modes(page)
    x0, _ = place(page, 1)
    drag(page, 1, 30, 0)
    page.until(lambda: modes(page)[1]["frequency_hz"] > before[1]["frequency_hz"])
    page.until(lambda: place(page, 1)[0] - x0 == pytest.approx(30, abs=2))  # once the last move is drawn
    page.until(
        lambda: f"{modes(page)[1]['frequency_hz']:g}".replace(".", "")[:3] in page.text("#body-facts").replace(".", "")
    )
    after = modes(page)
    assert {**after[1], "frequency_hz": 0} == {**before[1], "frequency_hz": 0} and after[2:] == before[2:]
    page.find("#undo").click()
    page.until(lambda: modes(page) == before and not state(page)["can_undo"])
    page.until(lambda: abs(place(page, 1)[0] - x0) < 1)
    assert page.errors() == []


@pytest.mark.parametrize(("upward", "key", "sign"), [("q", "q", 1), ("mass", "mass_kg", -1)])
def test_a_peak_dragged_up_gets_a_higher_q_or_less_mass(opened, upward, key, sign):
    page = opened("steel-guitar")
    page.script(
        "const s = document.querySelector('#body-upward'); s.value = arguments[0]; s.dispatchEvent(new Event('change'))",
        upward,
    )
    before = modes(page)
    drag(page, 4, 0, -20)
    page.until(lambda: sign * (modes(page)[4][key] - before[4][key]) > 0)
    assert {**modes(page)[4], key: 0} == {**before[4], key: 0}
    handle = peak(page, 4)
    page.until(lambda: key == "q" or "kg" in handle.get_attribute("aria-valuetext"))
    assert handle.get_attribute("role") == "slider" and handle.get_attribute("aria-label") == "Mode 5"


def test_a_mode_is_added_moved_by_keys_and_taken_away(opened):
    page = opened("steel-guitar")
    before = modes(page)
    page.click("#body-add")
    page.until(lambda: len(modes(page)) == len(before) + 1)
    index = len(before)
    page.until(lambda: page.script("return document.activeElement.dataset.handle") == f"mode-{index}")
    page.until(lambda: page.find("#body-mode").get_property("value") == str(index))
    hz = modes(page)[index]["frequency_hz"]
    page.driver.switch_to.active_element.send_keys(Keys.ARROW_RIGHT)
    page.until(lambda: modes(page)[index]["frequency_hz"] > hz)
    q = modes(page)[index]["q"]
    page.driver.switch_to.active_element.send_keys(Keys.ARROW_UP)
    page.until(lambda: modes(page)[index]["q"] > q)
    page.driver.switch_to.active_element.send_keys(Keys.DELETE)
    page.until(lambda: modes(page) == before)
    page.until(lambda: page.script("return document.activeElement.dataset.handle") == f"mode-{index - 1}")
    assert page.errors() == []


def test_one_peak_is_a_stop_of_tab_and_the_list_chooses_which(opened):
    page = opened("steel-guitar")
    handles = "[...document.querySelectorAll('.stage-mobility [data-handle]')]"
    stops = f"return {handles}.filter((e) => e.tabIndex === 0).map((e) => e.dataset.handle)"
    page.until(lambda: page.script(stops) == ["mode-0"])
    page.script("const s = document.querySelector('#body-mode'); s.value = 6; s.dispatchEvent(new Event('change'))")
    assert page.script(stops) == ["mode-6"]
    assert "538" in page.text("#body-facts")


def test_a_double_click_puts_a_peak_back(opened):
    page = opened("steel-guitar")
    before = modes(page)
    drag(page, 4, -15, 0)
    page.until(lambda: modes(page) != before)

    def put_back():
        """On a busy machine two clicks may lie too far apart to be a double one."""
        page.hand().double_click(peak(page, 4).find_element("css selector", ".reach")).perform()
        with suppress(AssertionError):
            return until(lambda: modes(page) == before, quiet_s=5.0)
        return False

    page.until(put_back)


def test_what_was_measured_lies_over_the_curve_until_it_is_taken_away(opened, tmp_path):
    page = opened("steel-guitar")
    file = tmp_path / "bridge.csv"
    rows = [f"{hz},{1e-3 * math.exp(-((hz - 300) ** 2) / 2e4)},{0}" for hz in range(60, 2000, 5)]
    file.write_text("frequency_hz,y11_re,y11_im\n" + "\n".join(rows) + "\n", encoding="utf-8")
    page.all("#body-file")[0].send_keys(str(file))
    page.until(lambda: page.all(".stage-mobility .measured"))
    assert len(page.all(".stage-mobility .measured")[0].get_attribute("points").split()) == len(rows)
    assert "bridge.csv" in page.text(".stage.mobility figcaption")
    page.find("#body-measured").click()
    page.until(lambda: not page.all(".stage-mobility .measured"))
    file.write_text("frequency_hz,y11_re,y11_im\n1,2\n", encoding="utf-8")
    page.all("#body-file")[0].send_keys(str(file))
    page.until(lambda: "row 2" in page.text("#notices"))
    assert not page.all(".stage-mobility .measured")


def test_the_film_moves_the_bridge_and_strings_are_seen_to_wake(opened):
    page = opened("steel-guitar")
    wood = "return document.querySelector('.stage-bridge .wood').getAttribute('points')"
    meters = "[...document.querySelectorAll('.stage-bridge .string-meter')]"
    levels = f"return {meters}.map((e) => Number(e.getAttribute('aria-valuenow')))"
    at_rest = page.script(wood)
    assert page.script(levels) == [-90] * 6
    page.script("const s = document.querySelector('#film-moment'); s.value = 1; s.dispatchEvent(new Event('change'))")
    page.until(lambda: page.script(levels) != [-90] * 6)
    page.script("const s = document.querySelector('#film-time'); s.value = 100; s.dispatchEvent(new Event('input'))")
    page.until(lambda: page.script(wood) != at_rest)
    found = page.script(levels)
    played = page.script("return document.querySelector('.stage-bridge .tick.played').textContent")
    assert played == "D3" and max(found) == found[2] >= -3 and -90 < min(found)
    assert page.script("return document.querySelectorAll('.stage-mobility .reed').length") == len(modes(page))
    assert page.script(
        "return [...document.querySelectorAll('.orbit')].every((e) => e.getAttribute('points').split(' ').length === 300)"
    )
    assert page.errors() == []


def test_a_body_is_begun_and_undone_as_one_step(opened):
    page = opened("tanpura-light")
    before = state(page)["text"]
    assert not page.all(".stage-mobility")[0].is_displayed()
    page.find("#body-begin").click()
    page.until(lambda: len(modes(page)) == 9)
    page.until(lambda: page.all('[data-handle="mode-8"]') and page.all(".stage-mobility")[0].is_displayed())
    page.until(lambda: "estimates" in page.text("#notices"))
    assert state(page)["data"]["output"]["kind"] == "body" and "estimates" in state(page)["data"]["remarks"]
    page.find("#undo").click()
    page.until(lambda: state(page)["text"] == before)
    page.until(lambda: page.find("#body-begin").is_displayed())
    assert page.errors() == []


def test_the_saved_version_is_shown_without_handles(opened, tmp_path):
    page = opened("steel-guitar")
    drag(page, 2, 20, 0)
    page.until(lambda: state(page)["dirty"] and page.all(".stage-mobility .ghost"))
    page.find('[data-which="saved"]').click()
    page.until(lambda: not page.all(".stage-mobility [data-handle]"))
    assert page.find("#body-add").get_property("disabled") and not page.all(".stage-mobility .ghost")
