"""A crash loses nothing: the server is killed, started again on the same folder, and offers what was never saved."""

import signal

from synth.instrument.preset import load_preset
from tests.author.browser.running import PRESETS, Author, Page, set_value


def crash_after_edit(driver, folder):
    """Edit, wait for the autosave, kill."""
    page = Page(driver)
    with Author(folder, "mine.toml") as author:
        page.open(author.address)
        set_value(page, "pluck.position", 0.31)
        page.until((folder / ".mine.toml.autosave").exists)
        page.until(lambda: "0.31" in (folder / ".mine.toml.autosave").read_text(encoding="utf-8"))
        assert author.end(signal.SIGKILL)[0] == -signal.SIGKILL
    page.until(lambda: "No connection" in page.text("#banner"))
    page.open_nothing()
    return page


def test_what_was_never_saved_is_offered_and_taken(driver, folder):
    original = (folder / "mine.toml").read_bytes()
    page = crash_after_edit(driver, folder)
    with Author(folder, "mine.toml") as author:
        page.open(author.address)
        assert "Unsaved changes" in page.text("#file-banners .offer")
        assert page.field("pluck.position").get_property("value") == "0.42"
        page.button("Compare them", "#file-banners").click()
        removed, added = page.text(".text-difference .removed"), page.text(".text-difference .added")
        assert removed.startswith("- position = 0.42") and added.startswith("+ position = 0.31")
        page.find("dialog .sheet-close").click()
        page.button("Restore them", "#file-banners").click()
        page.until(lambda: page.field("pluck.position").get_property("value") == "0.31")
        assert (folder / "mine.toml").read_bytes() == original
        page.find("#save").click()
        page.until(lambda: load_preset(str(folder / "mine.toml")).pluck.position == 0.31)
        page.until(lambda: not (folder / ".mine.toml.autosave").exists())
        page.open_nothing()


def test_what_was_never_saved_can_be_forgotten(driver, folder):
    original = (folder / "mine.toml").read_bytes()
    page = crash_after_edit(driver, folder)
    with Author(folder, "mine.toml") as author:
        page.open(author.address)
        page.button("Discard them", "#file-banners").click()
        page.until(lambda: page.all("#file-banners .offer") == [])
        page.until(lambda: not (folder / ".mine.toml.autosave").exists())
        assert (folder / "mine.toml").read_bytes() == original
        page.open_nothing()
    with Author(folder, "mine.toml") as author:
        page.open(author.address)
        assert page.all("#file-banners .offer") == []
        page.open_nothing()


def test_preset_that_has_no_file_is_recovered_too(driver, tmp_path):
    page = Page(driver)
    with Author(tmp_path, "jawari-harp") as author:
        page.open(author.address)
        set_value(page, "pluck.position", 0.27)
        page.until(lambda: any(b"0.27" in path.read_bytes() for path in tmp_path.glob(".*.autosave")))
        author.end(signal.SIGKILL)
    page.open_nothing()
    with Author(tmp_path, "jawari-harp") as author:
        page.open(author.address)
        page.button("Restore them", "#file-banners").click()
        page.until(lambda: page.field("pluck.position").get_property("value") == "0.27")
        page.open_nothing()


def test_a_tab_of_an_earlier_run_says_so_and_rests(driver, folder):
    """Started anew at the same address, the program does not know the tab."""
    page = Page(driver)
    with Author(folder, "mine.toml") as author:
        page.open(author.address)
        author.end(signal.SIGKILL)
        port = author.port
    page.until(lambda: "No connection" in page.text("#banner"))
    page.script("const ask = window.fetch; window.asked = 0; window.fetch = (...of) => (window.asked++, ask(...of));")
    with Author(folder, "mine.toml", "--port", str(port)):
        page.until(lambda: "was restarted" in page.text("#banner"))
        asked = page.script("return window.asked")
        assert asked > 0
        page.script("window.dispatchEvent(new Event('focus'))")
        page.result("await new Promise((done) => setTimeout(done, 1000))")
        assert page.script("return window.asked") == asked
        page.open_nothing()


def test_imported_preset_with_the_name_of_a_built_in_one_is_recovered(driver, tmp_path):
    text = (PRESETS / "tanpura-light.toml").read_text(encoding="utf-8").replace("jiva_um = 3.0", "jiva_um = 8.0")
    with Author(tmp_path) as author:
        author.post("/api/import", filename="tanpura-light.toml", text=text)
        left = tmp_path / ".unsaved~tanpura-light.toml.autosave"
        Page(driver).until(left.exists)
        author.end(signal.SIGKILL)
    page = Page(driver)
    (tmp_path / "odd.toml").symlink_to("/dev/null")
    with Author(tmp_path) as author:
        page.open(author.address)
        cards = page.all("#start .cards button")
        assert "tanpura-light: not saved, recovered from" in cards[0].text  # first
        odd = next(card for card in cards if "odd.toml" in card.text)
        assert "leads out" in odd.text and not odd.is_enabled()
        cards[0].click()
        page.until(lambda: page.field("obstacle.jiva_um").get_property("value") == "8")
        page.open_nothing()
