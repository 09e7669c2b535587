"""What the page says: refusals in words, gone with their cause and in nobody's way; what leads picture and note."""

import os
import re

import pytest
from selenium.webdriver.common.keys import Keys

from tests.author.browser.running import Author, Page, copy_preset, name_of, set_value, state


@pytest.fixture
def opened(driver, author, request):
    """opened("tanpura-light"): a page with a file of the test's own."""
    page = Page(driver)

    def open_(preset):
        name = name_of(request)
        copy_preset(preset, author.folder / f"{name}.toml")
        page.open(author.address)
        page.choose(name)
        page.until(lambda: page.text(".stage.whole figcaption"))
        return page

    yield open_
    page.open_nothing()


def edit(page, *changes):
    """An edit from elsewhere: what the server answers."""
    return page.result(
        "const answer = await fetch('/api/docs/' + location.hash.slice(1) + '/edit', {method: 'POST',"
        " body: JSON.stringify({merge: null, changes: given[0]})}); return answer.json();",
        [{"path": path, "value": value} for path, value in changes],
    )


def refuse(page, path="pluck.position", typed="1.5"):
    field = page.field(path)
    page.script("arguments[0].select()", field)
    field.send_keys(typed, Keys.ENTER)
    return page.until(lambda: page.text(f'.control[data-path="{path}"] .control-error'))


def refusals(page):
    return [each.text for each in page.shown(".control-error")]


@pytest.mark.parametrize("by", ["undo", "randomise", "elsewhere"])
def test_a_refusal_ends_with_its_cause(opened, by):
    page = opened("tanpura-light")
    set_value(page, "pluck.width_mm", 9)
    page.until(lambda: state(page)["dirty"])
    refuse(page)
    if by == "elsewhere":
        edit(page, ("pluck.position", 0.2))
    else:
        page.find(f"#{by}").click()
    page.until(lambda: refusals(page) == [])
    page.until(lambda: page.field("pluck.position").get_attribute("aria-invalid") is None)
    assert page.field("pluck.position").get_property("value") != "1.5"


def test_another_edit_leaves_a_refusal_and_the_saved_version_has_none(opened):
    page = opened("tanpura-light")
    refuse(page)
    set_value(page, "pluck.width_mm", 9)
    page.until(lambda: state(page)["data"]["pluck"]["width_mm"] == 9)
    assert len(refusals(page)) == 1
    page.find('#ab [data-which="saved"]').click()
    page.until(lambda: refusals(page) == [])
    page.find('#ab [data-which="current"]').click()
    page.until(lambda: len(refusals(page)) == 1)


def test_undo_is_seen_from_the_saved_version(opened):
    page = opened("tanpura-light")
    set_value(page, "pluck.width_mm", 9)
    page.until(lambda: state(page)["dirty"])
    page.find('#ab [data-which="saved"]').click()
    page.until(lambda: page.text(".stage.whole figcaption").startswith("as saved"))
    page.find("#undo").click()
    page.until(lambda: page.find('#ab [data-which="current"]').get_attribute("aria-checked") == "true")


def test_reasons_and_steps_are_in_words(opened):
    page = opened("fretted-bass")
    assert refuse(page, "obstacle.count", "19.5") == "must be a whole number, got 19.5"
    set_value(page, "string.3.length_m", 0.87)
    page.until(lambda: page.find("#undo").get_attribute("title") == "Undo: G string, Length")


def test_notices_cover_neither_search_nor_dock(opened):
    page = opened("tanpura-light")
    page.script(
        "const picker = document.querySelector('input[type=file]'); const data = new DataTransfer();"
        "data.items.add(new File(['x = ['], 'bad.toml')); picker.files = data.files;"
        "picker.dispatchEvent(new Event('change', {bubbles: true}));"
    )
    page.find(".notice.error")
    covered = page.script(
        "const box = document.querySelector('.notice.error').getBoundingClientRect();"
        "return ['#control-search', '#randomise', '.bar', '#dock'].filter((selector) => {"
        " const other = document.querySelector(selector).getBoundingClientRect();"
        " return box.left < other.right && other.left < box.right && box.top < other.bottom && other.top < box.bottom; });"
    )
    assert covered == []


def test_the_tab_of_a_string_leads_picture_and_note(opened):
    page = opened("tanpura-light")
    page.tab(0)
    page.until(lambda: page.text(".stage.whole figcaption").startswith("Pa string"))
    assert page.find("#note").get_property("value") == "43"
    # two strings of one note: the one that was chosen stays
    page.tab(2)
    page.until(lambda: page.find("#note").get_property("value") == "48")
    page.until(lambda: page.text(".stage.whole figcaption").startswith("Sa 1 string"))
    assert page.find('[role="tab"][data-tab="2"]').get_attribute("aria-selected") == "true"
    page.find('[aria-label="Lower note"]').click()
    page.until(lambda: page.find('[role="tab"][data-tab="0"]').get_attribute("aria-selected") == "true")


def test_a_note_that_goes_elsewhere_is_announced(opened):
    page = opened("tanpura-light")
    page.tab(0)
    page.until(lambda: page.text(".stage.whole figcaption").startswith("Pa string"))
    edit(page, ("string.0.notes", "F2"))
    said = page.until(lambda: [each.text for each in page.all(".notice") if "G2" in each.text])
    assert said[0].startswith("G2 is no longer playable; now at F2")


def test_what_cannot_be_compared_is_said(opened):
    page = opened("tanpura-light")
    page.tab(0)
    edit(page, ("string.0.notes", "F2"))
    page.until(lambda: page.find("#note").get_property("value") == "41")
    page.find("#analysis .analysis-head input[type=checkbox]").click()
    page.until(lambda: "no comparison with the saved version" in page.text("#analysis .analysis-head [role=status]"))


def test_an_address_that_is_no_name_still_opens_the_page(driver, author):
    page = Page(driver)
    page.open(f"{author.address}#%")
    assert page.find("[data-preset]")


def test_a_first_start_shows_what_it_compiles(driver, tmp_path):
    """…as a bar that moves, at once; the page can be used meanwhile, and its address holds no secret."""
    (tmp_path / "presets").mkdir()
    copy_preset("tanpura-light", tmp_path / "presets" / "mine.toml")
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    environment["XDG_CACHE_HOME"] = str(tmp_path / "cache")
    with Author(tmp_path / "presets", env=environment) as author:
        page = Page(driver)
        page.open(author.address)
        page.until(lambda: page.all("#banner progress"))
        assert "token" not in driver.current_url
        assert "once on this machine" in page.text("#banner") and page.find("#banner").is_displayed()
        before = page.find("#banner progress").get_property("value")
        page.choose("mine")  # its socket tells from now on
        page.until(lambda: page.find("#banner progress").get_property("value") > before)
        assert re.search(r"\d+ of \d+ kernels, \d+ s", page.text("#banner"))
        set_value(page, "pluck.width_mm", 9)
        page.until(lambda: state(page)["dirty"])
        page.open_nothing()
