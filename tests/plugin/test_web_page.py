"""Instruments for web pages in a real Chromium: played by mouse, touch, keys and MIDI, and what they say when they fail."""

from __future__ import annotations

import gzip
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from selenium.webdriver.common.keys import Keys

from synth.cli import main
from synth.plugin import shelf
from tests.author.browser.running import chromium, why_not
from tests.plugin.webserved import AS_COMES, INSTRUMENT, InstrumentPage, served

if why_not():
    pytest.skip(why_not(), allow_module_level=True)

NOTE_ON, NOTE_OFF, CONTROL, BEND, PROGRAM, PARAMETER = range(1, 7)
PA, SA = 43, 48
#: quieter than any note of an instrument
HEARD = 1e-3
PLAYING = "return [...instrument.root.querySelectorAll('.key:not(:disabled)')].map((key) => Number(key.dataset.note))"
REFUSED = "navigator.requestMIDIAccess = async () => { throw new DOMException('', 'NotAllowedError') }"
MIDI = """
const input = { id: "one", name: "A keyboard", state: "connected", onmidimessage: null };
const other = { id: "two", name: "Another", state: "connected", onmidimessage: null };
const inputs = new Map([[input.id, input], [other.id, other]]);
navigator.requestMIDIAccess = async () => ({ inputs, onstatechange: null });
window.midi = (...bytes) => input.onmidimessage?.({ data: new Uint8Array(bytes) });
window.otherMidi = (...bytes) => other.onmidimessage?.({ data: new Uint8Array(bytes) });
"""


@pytest.fixture(scope="module")
def driver() -> Iterator[Any]:
    with chromium(flags=AS_COMES) as driver:
        yield driver


@pytest.fixture(scope="module")
def address(web_folders: dict[str, Path]) -> Iterator[str]:
    with served(web_folders["tanpura-light"].parent) as address:
        yield address


@pytest.fixture
def page(driver) -> Iterator[InstrumentPage]:
    page = InstrumentPage(driver)
    yield page
    driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
    page.open_nothing()


@pytest.fixture
def tanpura(page: InstrumentPage, address: str) -> InstrumentPage:
    page.play_on(f"{address}tanpura-light/")
    return page


def sounds(page: InstrumentPage) -> None:
    page.until(lambda: page.figures()["peak"] > HEARD)


def test_a_key_sounds_under_the_mouse(tanpura: InstrumentPage, address: str) -> None:
    assert not tanpura.script("return instrument.engine.sounding")  # before a person has done something
    assert tanpura.figures()["blocks"] == 0
    key = tanpura.key(SA)
    tanpura.hand().move_to_element(key).click_and_hold().perform()
    assert tanpura.down() == [SA]
    sounds(tanpura)
    assert tanpura.figures()["notes"] == 1
    tanpura.hand().release().perform()
    assert tanpura.down() == []
    tanpura.until(lambda: tanpura.sent(NOTE_OFF))
    assert [each["a"] for each in tanpura.sent(NOTE_ON)] == [SA]
    assert not tanpura.script("return crossOriginIsolated")
    asked = tanpura.script("return performance.getEntriesByType('resource').map((each) => each.name)")
    assert asked and all(each.startswith((address, "data:")) for each in asked)
    assert tanpura.errors() == []


def test_the_page_that_the_command_writes_opens_its_bank(
    page: InstrumentPage, web_library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shelf, "web_library", lambda *_: web_library)
    command = [
        "export",
        "tanpura-light",
        "--drone",
        "--quality",
        "draft",
        "-f",
        "web",
        "-o",
        str(tmp_path / "it"),
        "--quiet",
    ]
    assert main(command) == 0
    with served(tmp_path) as address:
        page.play_on(f"{address}it/")
        assert page.script("return instrument.bank.presets.length") == 1
        page.inside(".drone-play").click()
        sounds(page)
        page.open_nothing()


def test_nearer_is_louder_and_a_pulled_finger_goes_on_to_other_keys(tanpura: InstrumentPage) -> None:
    key = tanpura.key(SA)
    half = key.size["height"] // 2
    for place in (-half + 4, half - 4):
        tanpura.hand().move_to_element_with_offset(key, 0, place).click().perform()
    soft, loud = (each["b"] for each in tanpura.sent(NOTE_ON))
    assert 1 <= soft < 40 < 100 < loud <= 127
    tanpura.hand().move_to_element(key).click_and_hold().move_to_element(tanpura.key(PA)).perform()
    assert tanpura.down() == [PA]
    tanpura.hand().release().perform()
    assert tanpura.down() == []


def test_keys_without_a_string_are_shown_so(tanpura: InstrumentPage) -> None:
    assert tanpura.script(PLAYING) == [36, PA, SA]
    tanpura.hand().move_to_element(tanpura.key(40)).click().perform()
    assert tanpura.sent(NOTE_ON) == []


def test_computer_keys_play_and_are_let_go_with_the_window(tanpura: InstrumentPage) -> None:
    tanpura.hand().key_down("a").perform()
    assert tanpura.down() == [36]
    sounds(tanpura)
    tanpura.script("window.dispatchEvent(new Event('blur'))")
    assert tanpura.down() == []
    tanpura.until(lambda: [each["a"] for each in tanpura.sent(NOTE_OFF)] == [36])
    tanpura.hand().key_up("a").key_down("g").key_up("g").perform()
    tanpura.until(lambda: len(tanpura.sent(NOTE_OFF)) == 2)
    assert [each["a"] for each in tanpura.sent(NOTE_ON)] == [36, PA]


def test_the_tab_key_and_the_space_bar_play(tanpura: InstrumentPage) -> None:
    tanpura.script("instrument.root.querySelector('.key[tabindex=\"0\"]').focus()")
    tanpura.hand().send_keys(Keys.ARROW_RIGHT).key_down(Keys.SPACE).perform()
    assert tanpura.down() == [PA]
    tanpura.hand().key_up(Keys.SPACE).perform()
    assert tanpura.down() == []
    sounds(tanpura)


def test_two_fingers_play_two_notes_and_a_touch_that_is_taken_away_ends(tanpura: InstrumentPage) -> None:
    command = tanpura.driver.execute_cdp_cmd
    command("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 5})
    boxes = [tanpura.key(note).rect for note in (PA, SA)]
    middles = [(box["x"] + box["width"] / 2, box["y"] + 0.9 * box["height"]) for box in boxes]
    points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(middles)]
    command("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": points[:1]})
    tanpura.until(lambda: tanpura.down() == [PA])
    command("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    tanpura.until(lambda: tanpura.down() == [])
    command("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": points})
    tanpura.until(lambda: tanpura.down() == [PA, SA])
    sounds(tanpura)
    command("Input.dispatchTouchEvent", {"type": "touchCancel", "touchPoints": []})
    tanpura.until(lambda: tanpura.down() == [])


def test_a_midi_keyboard_plays_as_it_sends(page: InstrumentPage, address: str) -> None:
    page.play_on(f"{address}two/")
    page.script(MIDI)
    page.inside(".midi").click()
    choice = page.inside(".midi-inputs select")
    page.until(choice.is_displayed)
    assert [each.text for each in choice.find_elements("tag name", "option")] == ["All MIDI inputs", "A keyboard", "Another"]
    page.script("midi(0x90, 48, 100); midi(0xB0, 64, 127); midi(0xE0, 0, 80); midi(0xD0, 40)")
    assert page.down() == [SA]
    sounds(page)
    page.script("midi(0x90, 48, 0)")
    assert page.down() == []
    sent = [each["midi"] for each in page.sent() if "midi" in each]
    assert sent == [[0x90, 48, 100], [0xB0, 64, 127], [0xE0, 0, 80], [0xD0, 40], [0x90, 48, 0]]
    page.script("midi(0xC0, 1)")
    assert page.inside(".program").get_attribute("value") == "1"
    page.script("arguments[0].value = 'two'; arguments[0].dispatchEvent(new Event('change'))", choice)
    page.script("midi(0x90, 40, 100); otherMidi(0x90, 41, 100)")
    assert page.down() == [41]


@pytest.mark.parametrize(
    ("how", "why"),
    [
        ("delete Navigator.prototype.requestMIDIAccess; delete navigator.requestMIDIAccess", "no Web MIDI"),
        (REFUSED, "does not allow MIDI"),
    ],
)
def test_without_midi_it_says_so(how: str, why: str, tanpura: InstrumentPage) -> None:
    tanpura.script(how)
    tanpura.inside(".midi").click()
    tanpura.until(lambda: why in tanpura.said())


def test_a_program_is_chosen(page: InstrumentPage, address: str) -> None:
    page.play_on(f"{address}two/")
    choice = page.inside(".program")
    names = [each.text for each in choice.find_elements("tag name", "option")]
    assert names[0] == "Tanpura, light" and len(names) == 2
    choice.find_elements("tag name", "option")[1].click()
    page.until(lambda: [each["a"] for each in page.sent(PROGRAM)] == [1])
    page.hand().move_to_element(page.key(41)).click().perform()  # which the tanpura does not have
    sounds(page)
    page.set_slider("pluck.position", 0.5)
    assert page.sent(PARAMETER)[-1]["channel"] == 1


def test_parameters_wheels_and_the_way_back(tanpura: InstrumentPage) -> None:
    tanpura.set_slider("pluck.position", 0)
    tanpura.set_slider("wheel", 1)
    tanpura.set_slider("bend", 1)
    tanpura.inside(".hold").click()
    moved = tanpura.sent(PARAMETER)
    assert [(each["channel"], each["value"]) for each in moved] == [(0, 0.02)]
    assert [(each["a"], each["b"]) for each in tanpura.sent(CONTROL)] == [(1, 127), (64, 127)]
    assert [each["a"] for each in tanpura.sent(BEND)] == [8191]
    tanpura.script("arguments[0].dispatchEvent(new Event('change'))", tanpura.inside('[data-id="bend"]'))
    assert [each["a"] for each in tanpura.sent(BEND)] == [8191, 0]
    tanpura.hand().move_to_element(tanpura.key(SA)).click().perform()
    sounds(tanpura)
    tanpura.inside(".panic").click()
    assert tanpura.inside(".hold").get_attribute("aria-pressed") == "false"
    assert tanpura.inside('[data-id="pluck.position"]').get_attribute("aria-valuetext") == "0.420 of L"
    tanpura.until(lambda: tanpura.figures()["voices"] == 0)


def test_volume_is_how_loud_it_is_heard(tanpura: InstrumentPage) -> None:
    tanpura.set_slider("volume", 0)
    assert tanpura.script("return instrument.engine.level") == 0
    tanpura.set_slider("volume", 1)
    assert tanpura.script("return instrument.engine.level") == pytest.approx(10**0.6)


def test_a_drone_plays_by_itself_until_it_is_stopped(page: InstrumentPage, address: str) -> None:
    page.play_on(f"{address}tanpura-light-drone/")
    page.set_slider("drone/seconds", 0)
    button = page.inside(".drone-play")
    button.click()
    assert button.text == "Stop the drone" and button.get_attribute("aria-pressed") == "true"
    page.until(lambda: page.figures()["notes"] >= 5)
    sounds(page)
    page.set_slider("drone/tonic", 0.6)
    page.set_slider("drone/velocity", 0.9)
    button.click()
    assert button.text == "Play the drone"
    page.figures()  # what was sent before has come
    notes = page.figures()["notes"]
    page.hand().move_to_element(page.key(SA)).click().perform()
    page.until(lambda: page.figures()["notes"] > notes)
    assert page.figures()["notes"] == notes + 1
    assert page.errors() == []


def test_a_tanpura_without_a_drone_has_none(tanpura: InstrumentPage) -> None:
    assert tanpura.script(f"return {INSTRUMENT}.shadowRoot.querySelector('.drone')") is None


def test_blocks_are_measured_where_that_is_asked_for(tanpura: InstrumentPage) -> None:
    tanpura.hand().move_to_element(tanpura.key(SA)).click().perform()
    tanpura.until(lambda: "late" in tanpura.text(".figures") and not tanpura.text(".figures").startswith("0 blocks"))
    figures = tanpura.figures()
    assert figures["blocks"] > 0 and 0 < figures["load"] and figures["dropped"] == 0


def test_engine_and_bank_may_be_compressed(page: InstrumentPage, web_folders: dict[str, Path], tmp_path: Path) -> None:
    shutil.copytree(web_folders["tanpura-light"], tmp_path / "it")
    for name in ("jawari.wasm", "tanpura-light.jawari"):
        path = tmp_path / "it" / name
        path.write_bytes(gzip.compress(path.read_bytes()))
    with served(tmp_path) as address:
        page.play_on(f"{address}it/")
        page.hand().move_to_element(page.key(SA)).click().perform()
        sounds(page)
        assert page.errors() == []
        page.open_nothing()


def heavy_above(folder: Path, load: float) -> None:
    """From which share of a block's time on an instrument in a folder is a heavy one."""
    program = folder / "jawari.js"
    text, count = re.subn(r"^const HEAVY = [\d.]+;$", f"const HEAVY = {load};", program.read_text(), flags=re.MULTILINE)
    assert count == 1
    program.write_text(text)


def test_what_needs_much_of_the_processor_is_computed_farther_ahead_and_says_so(
    page: InstrumentPage, web_folders: dict[str, Path], tmp_path: Path
) -> None:
    shutil.copytree(web_folders["tanpura-light-drone"], tmp_path / "it")
    heavy_above(tmp_path / "it", -1)
    with served(tmp_path) as address:
        page.play_on(f"{address}it/")
        assert "needs much of the processor" in page.inside(".late").text
        assert page.script("return instrument.engine.context.baseLatency") >= 0.02
        page.inside(".drone-play").click()
        sounds(page)
        assert page.errors() == []
        page.open_nothing()


def test_others_have_the_browser_s_least_latency(page: InstrumentPage, web_folders: dict[str, Path], tmp_path: Path) -> None:
    shutil.copytree(web_folders["tanpura-light"], tmp_path / "it")
    heavy_above(tmp_path / "it", 1e9)
    with served(tmp_path) as address:
        page.play_on(f"{address}it/")
        assert page.script("return instrument.engine.load") > 0
        assert page.script(f"return {INSTRUMENT}.shadowRoot.querySelector('.late')") is None
        assert page.script("return instrument.engine.context.baseLatency") < 0.02
        page.open_nothing()


def engines(page: InstrumentPage) -> list[str]:
    """The engines that a page has asked for."""
    asked = page.script("return performance.getEntriesByType('resource').map((each) => new URL(each.name).pathname)")
    return [each.rsplit("/", 1)[1] for each in asked if each.endswith(".wasm")]


def test_a_browser_with_relaxed_simd_takes_that_engine_alone(page: InstrumentPage, address: str) -> None:
    page.play_on(f"{address}relaxed/")
    assert engines(page) == ["jawari-relaxed.wasm"]
    page.hand().move_to_element(page.key(SA)).click().perform()
    sounds(page)
    assert page.errors() == []


@pytest.mark.parametrize("at", [None, 0.0], ids=["missing", "refused"])
def test_without_the_relaxed_engine_the_other_plays(
    at: float | None, page: InstrumentPage, web_folders: dict[str, Path], tmp_path: Path
) -> None:
    damaged(web_folders["relaxed"], tmp_path / "it", "jawari-relaxed.wasm", at)
    with served(tmp_path) as address:
        page.play_on(f"{address}it/")
        assert engines(page) == ["jawari-relaxed.wasm", "jawari.wasm"]
        page.hand().move_to_element(page.key(SA)).click().perform()
        sounds(page)
        page.driver.get_log("browser")
        page.open_nothing()


MOUNT = """
const { mountInstrument } = await import("./jawari.js");
const place = document.createElement("div");
document.body.append(place);
const here = (name) => new URL(name, document.baseURI).href;
const [wasm, worklet, style] = ["jawari.wasm", "jawari-worklet.js", "jawari.css"].map(here);
const other = mountInstrument(place, { wasm, worklet, style, bank: here("tanpura-light.jawari") });
const told = other.ready.then(() => "ready", (error) => error.message);
"""


@pytest.mark.parametrize("when", ["at once", "in the audio thread", "ready"])
def test_what_is_closed_before_it_is_ready_never_is(when: str, tanpura: InstrumentPage) -> None:
    tanpura.script(
        "window.nodes = []; window.AudioWorkletNode = class extends AudioWorkletNode { "
        "constructor(...all) { super(...all); nodes.push(this); } }"
    )
    waits = {
        "at once": "",
        "in the audio thread": "while (!other.engine.node) await new Promise((later) => setTimeout(later));",
        "ready": "await other.engine.ready; await other.ready;",
    }[when]
    close = "other.close(); return [await told, place.dataset.state ?? null, other.root.childElementCount, nodes.length];"
    said, state, left, nodes = tanpura.result(f"{MOUNT}{waits}{close}")
    assert said == ("ready" if when == "ready" else "it was closed")
    assert (state, left) == (None, 0)
    assert nodes == (0 if when == "at once" else 1)
    tanpura.script("document.dispatchEvent(new Event('pointerdown')); window.dispatchEvent(new Event('blur'))")
    assert tanpura.errors() == []


def test_what_is_asked_during_the_warm_up_does_not_end_it(tanpura: InstrumentPage) -> None:
    waits = """while (!other.engine.node) await new Promise((later) => setTimeout(later));
    const { engine } = other;
    engine.noteOn(48, 100);
    engine.bend(0);
    engine.reset();
    engine.send({});
    const figures = engine.figures();
    return [await told, (await figures).notes];"""
    assert tanpura.result(f"{MOUNT}{waits}") == ["ready", 0]


def damaged(folder: Path, copy: Path, name: str, at: float | None) -> None:
    """A copy of a folder in which a byte of a file is another, or which lacks that file."""
    shutil.copytree(folder, copy)
    if at is None:
        (copy / name).unlink()
        return
    data = bytearray((copy / name).read_bytes())
    data[int(at * len(data))] ^= 0x55
    (copy / name).write_bytes(data)


@pytest.mark.parametrize(
    ("name", "at", "why"),
    [
        ("tanpura-light.jawari", 0.0, "it does not begin like one"),
        ("tanpura-light.jawari", 0.9, "was changed|damaged|checksum"),
        ("tanpura-light.jawari", None, "the instrument's bank does not come.*404"),
        ("jawari.wasm", 0.0, "the engine \\(WebAssembly\\) cannot be loaded"),
        ("jawari.wasm", None, "the engine does not come.*404"),
        ("jawari-worklet.js", None, "the program of the audio thread does not come"),
    ],
)
def test_what_is_damaged_or_missing_is_named(
    name: str, at: float | None, why: str, page: InstrumentPage, web_folders: dict[str, Path], tmp_path: Path
) -> None:
    damaged(web_folders["tanpura-light"], tmp_path / "it", name, at)
    with served(tmp_path) as address:
        page.open(f"{address}it/")
        assert page.state() == "failed"
        assert re.search(why, page.said()), page.said()
        assert page.script(f"return {INSTRUMENT}.shadowRoot.querySelector('[role=alert]') !== null")
        page.driver.get_log("browser")


def test_the_one_file_plays_from_a_disk(page: InstrumentPage, web_folders: dict[str, Path]) -> None:
    page.play_on((web_folders["tanpura-light"] / "tanpura-light.html").as_uri())
    page.until(lambda: page.script("return instrument.root.adoptedStyleSheets[0].cssRules.length > 10"))
    page.hand().move_to_element(page.key(SA)).click().perform()
    sounds(page)
    assert page.errors() == []


def test_the_page_from_a_disk_says_what_to_do(page: InstrumentPage, web_folders: dict[str, Path]) -> None:
    page.load((web_folders["tanpura-light"] / "index.html").as_uri())
    said = page.text(".first-aid")
    assert "python3 -m http.server" in said and "tanpura-light.html" in said
    page.driver.get_log("browser")


def test_an_engine_that_ends_is_named(tanpura: InstrumentPage) -> None:
    tanpura.script("instrument.engine.node.dispatchEvent(new Event('processorerror'))")
    assert "The engine ended" in tanpura.said()


@pytest.mark.parametrize("width", [390, 820, 1440])
@pytest.mark.parametrize("name", ["tanpura-light-drone", "two"])
def test_it_fits_a_telephone_a_tablet_and_a_screen(name: str, width: int, page: InstrumentPage, address: str) -> None:
    touch = width < 1000
    command = page.driver.execute_cdp_cmd
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": touch}
    command("Emulation.setDeviceMetricsOverride", metrics)
    command("Emulation.setTouchEmulationEnabled", {"enabled": touch, "maxTouchPoints": 5})
    page.play_on(f"{address}{name}/")
    parts = page.script("return instrument.bank.presets.length")
    page.script("instrument.choose(arguments[0])", parts - 1)
    assert page.script("return document.documentElement.scrollWidth <= innerWidth")
    overflowing = "[...instrument.root.querySelectorAll('*')].filter((each) => each.scrollWidth > each.clientWidth + 1)"
    blocks = "each.clientWidth && getComputedStyle(each).display !== 'inline'"
    assert page.script(f"return {overflowing}.filter((each) => {blocks}).map((each) => each.className)") == []
    if touch:
        keys = "[...instrument.root.querySelectorAll('.white')].map((key) => key.getBoundingClientRect().width)"
        assert page.script(f"return Math.min(...{keys})") >= 40
        small = "[...instrument.root.querySelectorAll('button:not(.key), select')].filter((each) => each.checkVisibility())"
        assert page.script(f"return Math.min(...{small}.map((each) => each.getBoundingClientRect().height))") >= 40


def test_every_control_has_a_name(page: InstrumentPage, address: str) -> None:
    page.play_on(f"{address}tanpura-light-drone/")
    for each in page.script("return [...instrument.root.querySelectorAll('button, input, select')]"):
        if each.is_displayed():
            assert each.accessible_name, each.get_attribute("outerHTML")


def test_octaves_lead_to_every_key(page: InstrumentPage, address: str) -> None:
    command = page.driver.execute_cdp_cmd
    command("Emulation.setDeviceMetricsOverride", {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True})
    page.play_on(f"{address}two/")
    page.script("instrument.choose(1)")
    lower, higher = page.inside("[aria-label='An octave lower']"), page.inside("[aria-label='An octave higher']")
    seen: set[int] = set()
    while lower.is_enabled():
        lower.click()
    while True:
        seen |= set(page.script(PLAYING))
        if not higher.is_enabled():
            break
        higher.click()
    preset = page.script("return instrument.bank.presets[1]")
    assert seen == set(range(preset["lowest"], preset["highest"] + 1)) - set(preset["mute"])


def test_of_two_on_a_page_the_one_that_is_played_sounds(page: InstrumentPage, address: str) -> None:
    page.play_on(f"{address}tanpura-light/")
    page.result(
        """const { mountInstrument } = await import("./jawari.js");
        const place = document.createElement("div");
        document.body.append(place);
        const here = (name) => new URL(name, document.baseURI).href;
        const [wasm, worklet, style] = ["jawari.wasm", "jawari-worklet.js", "jawari.css"].map(here);
        window.second = mountInstrument(place, { wasm, worklet, style, bank: here("../two/two.jawari"), measure: true });
        await second.ready;
        return true;"""
    )
    page.hand().move_to_element(page.key(SA)).click_and_hold().perform()
    sounds(page)
    assert page.result("return (await second.engine.figures()).notes") == 0
    page.script("second.engine.noteOn(48, 100)")
    page.until(lambda: page.result("return (await second.engine.figures()).peak") > HEARD)
    page.until(lambda: page.down() == [])
    page.until(lambda: {"rest": True} in page.sent())
    fetched = page.script("return performance.getEntriesByName(new URL('jawari.wasm', document.baseURI).href).length")
    assert fetched == 1
    page.script("second.close()")
    assert page.script("return second.root.childElementCount") == 0
