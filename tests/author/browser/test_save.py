"""What is saved is the file, with its comments; nothing is written over unasked; a reload of the tab loses nothing."""

from synth.instrument.preset import load_preset
from tests.author.browser.running import PRESETS, copy_preset, set_value

REMARK = "# 0 rests on the bridge and buzzes most"


def dirty(page):
    return "edited" in page.script("return document.getElementById('doc-status').className")


def edit(page, path, value):
    set_value(page, path, value)
    page.until(lambda: dirty(page))


def test_saved_file_has_the_value_and_keeps_comments(page, folder):
    assert page.find("#save").get_property("disabled")
    edit(page, "pluck.position", 0.31)
    assert load_preset(str(folder / "mine.toml")).pluck.position == 0.42
    page.find("#save").click()
    page.until(lambda: not dirty(page))
    text = (folder / "mine.toml").read_text(encoding="utf-8")
    assert REMARK in text
    assert load_preset(str(folder / "mine.toml")).pluck.position == 0.31
    assert [path.name for path in folder.iterdir()] == ["mine.toml"]
    assert page.errors() == []


def test_reload_of_the_tab_keeps_value_and_undo(page):
    edit(page, "pluck.position", 0.37)
    page.reload()
    assert page.field("pluck.position").get_property("value") == "0.37"
    assert dirty(page)
    page.find("#undo").click()
    page.until(lambda: not dirty(page))
    assert page.field("pluck.position").get_property("value") == "0.42"


def test_leaving_with_unsaved_changes_asks(page):
    asks = """const event = new Event("beforeunload", {cancelable: true});
    window.dispatchEvent(event);
    return event.defaultPrevented;"""
    assert not page.script(asks)
    edit(page, "pluck.position", 0.31)
    assert page.script(asks)


def menu(page, entry):
    page.find("#more").click()
    page.button(entry, ".menu").click()


def test_save_as_writes_over_another_file_only_when_told_twice(page, folder):
    copy_preset("fretted-bass", folder / "other.toml")
    before = (folder / "other.toml").read_bytes()
    edit(page, "pluck.position", 0.31)
    menu(page, "Save as")
    name = page.find("#file-name")
    name.clear()
    name.send_keys("other\n")
    button = page.button("Overwrite it", "dialog")
    assert "other" in page.text("dialog .field-error")
    assert (folder / "other.toml").read_bytes() == before
    button.click()
    page.until(lambda: page.all("dialog[open]") == [])
    assert load_preset(str(folder / "other.toml")).pluck.position == 0.31
    assert load_preset(str(folder / "mine.toml")).pluck.position == 0.42
    assert page.text("#doc-status") == "other.toml"


def test_built_in_preset_is_saved_under_a_name_of_its_own(page, folder):
    page.find("#open").click()
    page.find('dialog [data-preset="jawari-harp"]').click()
    page.until(lambda: page.text("#title") == "Jawari harp")
    page.ready()
    edit(page, "pluck.position", 0.25)
    page.find("#save").click()
    name = page.find("#file-name")
    name.clear()
    name.send_keys("my-harp\n")
    page.until(lambda: (folder / "my-harp.toml").exists())
    assert load_preset(str(folder / "my-harp.toml")).pluck.position == 0.25


def test_change_on_disk_is_noticed_and_not_written_over(page, folder):
    edit(page, "pluck.position", 0.31)
    file = folder / "mine.toml"
    file.write_text(file.read_text(encoding="utf-8").replace("jiva_um = 3.0", "jiva_um = 7.0"), encoding="utf-8")
    page.until(lambda: "changed by another program" in page.text("#file-banners"))
    theirs = file.read_bytes()
    page.find("#save").click()
    page.button("Load the file", "dialog")
    assert file.read_bytes() == theirs
    page.button("Load the file", "dialog").click()
    page.until(lambda: page.field("obstacle.jiva_um").get_property("value") == "7")
    page.until(lambda: not dirty(page))
    assert page.field("pluck.position").get_property("value") == "0.42"
    page.find("#undo").click()
    page.until(lambda: page.field("pluck.position").get_property("value") == "0.31")


DROP = """
const [name, text] = arguments;
const files = new DataTransfer();
files.items.add(new File([text], name));
for (const type of ["dragover", "drop"])
  document.body.dispatchEvent(new DragEvent(type, {dataTransfer: files, bubbles: true, cancelable: true}));
"""


def test_dropped_preset_is_imported_unsaved(page, folder):
    text = (PRESETS / "fretted-bass.toml").read_text(encoding="utf-8")
    page.script(DROP, "bass.toml", text)
    page.until(lambda: page.text("#title") == "Fretted bass")
    assert not (folder / "bass.toml").exists()
    assert page.find("#save").is_enabled()


def test_dropped_nonsense_is_refused_and_said(page):
    page.script(DROP, "broken.toml", "format = ")
    page.find(".notice.error")
    assert page.text("#title") == "Tanpura, light"


def test_export_is_the_text(page, folder):
    text = page.result("return (await fetch(`/api/docs/${location.hash.slice(1)}/export`)).text()")
    assert text == (folder / "mine.toml").read_text(encoding="utf-8")


def test_dropped_preset_in_another_encoding_is_refused_and_said(page):
    text = (PRESETS / "fretted-bass.toml").read_text(encoding="utf-8") + "# Bünde\n"
    page.script(DROP.replace("[text]", "[Uint8Array.from(text, (letter) => letter.charCodeAt(0))]"), "bass.toml", text)
    page.until(lambda: "UTF-8" in page.text(".notice.error"))
    assert page.text("#title") == "Tanpura, light"


def test_imported_preset_is_thrown_away(page, folder):
    page.script(DROP, "bass.toml", (PRESETS / "fretted-bass.toml").read_text(encoding="utf-8"))
    page.until(lambda: page.text("#title") == "Fretted bass")
    left = folder / ".unsaved~bass.toml.autosave"
    page.until(left.exists)
    menu(page, "Discard")
    page.button("Discard it", "dialog").click()
    page.until(lambda: not left.exists())
    page.until(lambda: page.text("#title") == "Tanpura, light")  # as the command line named it


def test_tab_of_a_preset_that_is_written_over_shows_what_took_its_place(page, folder):
    """Here the other tab is a script's."""
    key = page.result(
        "const post = async (path, body) => (await fetch(path, {method: 'POST', body: JSON.stringify(body)})).json();"
        "const other = await post('/api/open', {preset: 'jawari-harp'});"
        "await post(`/api/docs/${other.doc}/save-as`, {name: 'mine', overwrite: true});"
        "return other.doc;"
    )
    page.until(lambda: page.text("#title") == "Mine")  # another name gives another title
    assert page.script("return location.hash.slice(1)") == key


def test_difference_of_long_texts(page):
    """Nothing that is equal at either end is compared, nor what is too long to be."""
    rows = page.result(
        "const { difference } = await import('/page/files.js');"
        "const lines = (count, word) => Array.from({length: count}, (_, k) => `${word} ${k}`);"
        "const same = lines(60000, 'same');"
        "const one = difference([...same, 'old', ...same], [...same, 'new', ...same]);"
        "const all = difference(lines(60000, 'a'), lines(60000, 'b'));"
        "return [one, all.length];"
    )
    around = [[" ", f"same {k}"] for k in (59998, 59999)], [[" ", f"same {k}"] for k in (0, 1)]
    assert rows == [[*around[0], ["-", "old"], ["+", "new"], *around[1]], 120_000]


def test_a_refused_name_stands_at_its_field_and_goes_with_the_dialog(page, folder):
    menu(page, "Save as")
    name = page.find("#file-name")
    name.clear()
    name.send_keys("a/b\n")
    page.until(lambda: page.text("dialog .field-error") != "")
    assert name.get_attribute("aria-invalid") == "true"
    assert page.all(".notice.error") == []
    page.find("dialog .sheet-close").click()
    page.until(lambda: page.all("dialog[open]") == [])
    assert page.all(".field-error") == [] and page.all(".notice.error") == []
    assert [path.name for path in folder.iterdir()] == ["mine.toml"]


def test_what_is_said_over_a_dialog_goes_with_it(page):
    page.find("#open").click()
    page.find("dialog .file-list")
    page.script(DROP, "broken.toml", "format = ")
    assert page.text("dialog .notice.error")
    page.find("dialog .sheet-close").click()
    page.until(lambda: page.all(".notice.error") == [])
