"""A recording is dropped, the fit is shown against its data, the controls are filled; what cannot be fitted is refused."""

import base64

import numpy as np
import pytest
import soundfile

from synth.instrument.preset import load_preset
from tests.author.browser.running import Author, Page, copy_preset
from tests.author.serverkit import ROOT

PRESET = "fretted-bass"
RATE_HZ = 44100
NOTE_HZ, INHARMONICITY, PLUCKED_AT = 110.0, 2e-4, 0.21


@pytest.fixture
def page(page_of_mine):
    return page_of_mine


def plucked(seconds=4.0, note_hz=NOTE_HZ, noise=1e-4):
    """A stiff plucked string, its partials dying the faster the higher they are."""
    rng = np.random.default_rng(3)
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    sound = np.zeros(t.size)
    for n in range(1, 41):
        hz = n * note_hz * np.sqrt(1.0 + INHARMONICITY * n * n)
        if hz > 12000.0:
            break
        t60_s = 6.0 / (1.0 + (hz / 1500.0) ** 1.5)
        sound += abs(np.sin(np.pi * n * PLUCKED_AT)) / n * np.exp(-6.908 * t / t60_s) * np.sin(2 * np.pi * hz * t)
    sound *= 0.4 / np.abs(sound).max()
    return np.concatenate([np.zeros(RATE_HZ // 5), sound]) + noise * rng.standard_normal(t.size + RATE_HZ // 5)


def offer(page, path):
    """Choose a file in the dialog."""
    if not page.script("return document.getElementById('fit-dialog').open"):
        page.find("#open-fit").click()
    page.all("#fit-file")[0].send_keys(str(path))


def ink(page, figure):
    """How many pixels of a figure's canvas are painted."""
    return page.script(
        """const canvas = document.querySelectorAll(".fit-found .plot canvas")[arguments[0]];
        const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        let painted = 0;
        for (let i = 3; i < data.length; i += 4) painted += data[i] > 0;
        return painted;""",
        figure,
    )


def test_fit_is_shown_and_fills_the_controls(page, mine, tmp_path):
    soundfile.write(tmp_path / "note.wav", plucked(), RATE_HZ)
    page.find("#open-fit").click()
    page.find("#fit-string")
    page.find("#fit-string option[value='1']").click()
    offer(page, tmp_path / "note.wav")
    said = page.text(".fit-found .tiles")
    assert "110.0" in said or "109.9" in said
    for figure in range(3):
        page.until(lambda figure=figure: ink(page, figure) > 1000)
    rows = {row.get_attribute("data-path"): row.text for row in page.all(".settings tbody tr")}
    assert any(path.startswith("string.1.") for path in rows)
    assert not any(path.startswith(("string.0.", "string.2.", "string.3.")) for path in rows)
    assert not any("string." in words or "_" in words for words in rows.values())
    assert rows["string.1.notes"].startswith("Notes") and rows["string.1.cents"].startswith("Fine tuning, cents")
    page.find("#apply-fit").click()
    page.until(lambda: "edited" in page.script("return document.getElementById('doc-status').className"))
    page.find("#save").click()
    page.until(lambda: page.text("#doc-status") == mine.name)
    before = load_preset(str(ROOT / "presets" / "fretted-bass.toml"))
    after = load_preset(str(mine))
    assert after.string[1] != before.string[1]
    assert after.string[0] == before.string[0] and after.obstacle == before.obstacle
    page.find("#undo").click()
    page.until(lambda: "edited" in page.script("return document.getElementById('doc-status').className"))
    values = page.result("return (await (await fetch('/api/docs/' + location.hash.slice(1))).json()).data.string")
    assert values == [string.model_dump(mode="json") for string in before.string]


def two_notes():
    sound = plucked(note_hz=110.0) + plucked(note_hz=164.0)
    return 0.5 * sound


def noise():
    return 0.1 * np.random.default_rng(1).standard_normal(3 * RATE_HZ)


@pytest.mark.parametrize(
    "samples", [two_notes, noise, lambda: np.zeros(2 * RATE_HZ), lambda: np.clip(20.0 * plucked(), -1.0, 1.0)]
)
def test_bad_recording_is_refused_with_the_reason(page, tmp_path, samples):
    soundfile.write(tmp_path / "bad.wav", samples(), RATE_HZ, subtype="PCM_16")
    offer(page, tmp_path / "bad.wav")
    words = page.text(".fit-refusal")
    assert words.startswith("bad.wav is not fitted") and len(words.splitlines()[1]) > 15
    assert page.all("#apply-fit") and not page.all("#apply-fit")[0].is_displayed()
    assert "edited" not in page.script("return document.getElementById('doc-status').className")


def test_what_is_no_recording_is_refused(page, tmp_path):
    (tmp_path / "bad.wav").write_bytes(b"RIFF not at all")
    offer(page, tmp_path / "bad.wav")
    assert "cannot be read" in page.text(".fit-refusal")


def test_recording_dropped_on_the_page_is_fitted(page, tmp_path):
    soundfile.write(tmp_path / "note.wav", plucked(2.0), RATE_HZ, subtype="PCM_16")
    drop(page, tmp_path / "note.wav")
    assert "Pitch" in page.text(".fit-found .tiles")


def drop(page, *paths, then=""):
    """Drop files on the page one after the other, and run a script, all at once."""
    return page.script(
        """for (const text of arguments[0]) {
          const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
          const files = new DataTransfer();
          files.items.add(new File([bytes], "dropped.wav", {type: "audio/wav"}));
          for (const type of ["dragover", "drop"])
            document.body.dispatchEvent(new DragEvent(type, {dataTransfer: files, bubbles: true, cancelable: true}));
        }
        """
        + then,
        [base64.b64encode(path.read_bytes()).decode() for path in paths],
    )


def follow_jobs(page):
    """From now on remember the jobs that the server begins."""
    page.script(
        """window.begun = [];
        const plain = window.fetch;
        window.fetch = async (path, options) => {
          const fit = String(path).startsWith("/api/fit");
          if (fit) window.begun.push("?");
          try {
            const answer = await plain(path, options);
            if (fit) window.begun.push((await answer.clone().json()).job);
            return answer;
          } finally {
            if (fit) window.begun.splice(window.begun.indexOf("?"), 1);
          }
        };"""
    )


def jobs_are_over(page):
    return page.result(
        """if (window.begun.includes("?")) return false;
        for (const job of window.begun)
          if ((await (await fetch("/api/jobs/" + job)).json()).state === "running") return false;
        return true;"""
    )


STAGE = """return ["drop", "fit-working", "fit-found"].map((name) => !document.querySelector("#fit ." + name).hidden);"""
WAITING, WORKING, FOUND = [True, False, False], [False, True, False], [False, False, True]


def test_cancel_ends_a_fit_at_once(page, tmp_path):
    """Also while the recording is still on its way."""
    soundfile.write(tmp_path / "note.wav", plucked(12.0), RATE_HZ)
    follow_jobs(page)
    assert drop(page, tmp_path / "note.wav", then=STAGE) == WORKING
    page.find("#cancel-fit")
    assert page.script("document.getElementById('cancel-fit').click();" + STAGE) == WAITING
    page.until(lambda: jobs_are_over(page))
    assert drop(page, tmp_path / "note.wav", then="document.getElementById('cancel-fit').click();" + STAGE) == WAITING
    page.until(lambda: jobs_are_over(page))
    page.result("await new Promise((done) => setTimeout(done, 600));")  # longer than a job is left unasked
    assert page.script(STAGE) == WAITING and not page.find("#fit-dialog").find_element("css selector", ".fit-refusal").text


def test_of_two_recordings_the_second_is_fitted(page, tmp_path):
    """What is said of the first, that it is no recording, is not said any more."""
    (tmp_path / "first.wav").write_bytes(b"RIFF not at all")
    soundfile.write(tmp_path / "second.wav", plucked(4.0, note_hz=164.0), RATE_HZ)
    follow_jobs(page)
    drop(page, tmp_path / "first.wav", tmp_path / "second.wav")
    assert "164.0" in page.text(".fit-found .tiles")
    page.until(lambda: jobs_are_over(page))
    page.result("await new Promise((done) => setTimeout(done, 600));")
    assert page.script(STAGE) == FOUND
    assert page.script("return document.querySelector('#fit .fit-refusal').hidden")


def test_a_fit_proposes_the_nearest_string_and_goes_with_its_document(page, tmp_path):
    """The string that is shown is G; the note that is found lies nearest to A."""
    soundfile.write(tmp_path / "note.wav", plucked(2.0, note_hz=56.0), RATE_HZ)  # A1, 31 cents up
    offer(page, tmp_path / "note.wav")
    assert page.text(".fit-found .fit-proposal") == "Nearest to A1 is string 2: A."
    assert page.script(STAGE) == FOUND
    paths = [row.get_attribute("data-path") for row in page.all(".settings tbody tr")]
    assert "string.1.cents" in paths and not any(path.startswith(("string.0.", "string.2.", "string.3.")) for path in paths)
    # another one by hand: the nearest is told, and can be had
    page.script("const s = document.getElementById('fit-string'); s.value = '3'; s.dispatchEvent(new Event('change'))")
    page.until(lambda: "nearest to A1 is string 2: A" in page.text(".fit-found .fit-proposal"))
    assert page.text(".fit-found .fit-proposal").startswith("Fitted as string 4: G;")
    page.find("#fit-nearest").click()
    page.until(lambda: page.text(".fit-found .fit-proposal").startswith("Nearest to A1 is string 2: A"))
    page.script("document.getElementById('fit-dialog').close()")
    page.find("#open").click()
    page.find('dialog [data-preset="tanpura-light"]').click()
    page.until(lambda: page.text("#title") == "Tanpura, light")
    page.find("#open-fit").click()
    assert page.script(STAGE) == WAITING
    assert page.script("return document.getElementById('fit-string').value") == ""


def test_a_fit_says_which_t60_is_which_and_shows_the_next_step_at_once(page, tmp_path):
    soundfile.write(tmp_path / "note.wav", plucked(2.0), RATE_HZ)
    page.driver.set_window_size(1280, 800)
    offer(page, tmp_path / "note.wav")
    names = [each.text for each in page.find(".fit-found .tiles").find_elements("css selector", "dt")]
    t60 = [name for name in names if name.startswith("T60")]
    assert t60[0] == "T60 of partial 1" and t60[1].startswith("T60 of partial ") and len(set(t60)) == 2 == len(t60)
    seen = """const b = document.getElementById("apply-fit").getBoundingClientRect();
      const at = document.elementFromPoint(b.x + b.width / 2, b.y + b.height / 2);
      return [document.getElementById("fit-dialog").scrollTop, b.bottom <= innerHeight, at?.id];"""
    for figure in range(3):
        page.until(lambda figure=figure: ink(page, figure) > 1000)
    page.until(lambda: page.script(seen) == [0, True, "apply-fit"])
    # a string that is no longer there is refused in the dialog, and the refusal goes with it
    page.result(
        "await fetch('/api/docs/' + location.hash.slice(1) + '/edit', {method: 'POST', body: JSON.stringify({merge: null,"
        " changes: [{path: 'string.3', value: null}, {path: 'string.2', value: null}, {path: 'string.1', value: null},"
        " {path: 'string.0.name', value: 'other'}]})});"
    )
    page.until(lambda: len(page.result("return (await (await fetch('/api/docs/' + location.hash.slice(1))).json())")
                           ["data"]["string"]) == 1)  # fmt: skip
    page.find("#apply-fit").click()
    page.until(lambda: "fit the recording again" in page.text(".fit-refusal"))
    assert not list(page.shown(".notice.error"))
    page.script("document.getElementById('fit-dialog').close()")
    page.find("#open-fit").click()
    assert not page.find("#fit-dialog").find_element("css selector", ".fit-refusal").is_displayed()


def test_bridge_and_hand_are_proposed_cancelled_and_refused(driver, tmp_path):
    copy_preset("tanpura-light", tmp_path / "mine.toml")
    with Author(tmp_path, "mine.toml", program=("-m", "tests.author.quick_contact")) as author:
        page = Page(driver)
        page.open(author.address)
        hz = page.result(
            "return (await (await fetch('/api/docs/' + location.hash.slice(1))).json()).data.string[0].notes[0]"
        )
        soundfile.write(tmp_path / "note.wav", plucked(3.0, note_hz=440.0 * 2.0 ** ((hz - 69) / 12.0)), RATE_HZ)
        choose = (
            "const s = document.getElementById(arguments[0]); s.value = arguments[1]; s.dispatchEvent(new Event('change'))"
        )
        page.find("#open-fit").click()
        assert not page.all("#fit-amplitude")[0].is_displayed()
        page.script(choose, "fit-string", "0")
        page.script(choose, "fit-kind", "contact")
        assert page.all("#fit-amplitude")[0].is_displayed()
        offer(page, tmp_path / "note.wav")
        assert "±" in page.text(".fit-found .tiles") and "the preset's hardest pluck" in page.text(
            ".fit-found .fit-proposal"
        )
        page.until(lambda: ink(page, 3) > 1000)
        assert page.script("return [...document.querySelectorAll('.fit-found .plots > *')].map((each) => each.hidden)") == [
            True, True, True, False,
        ]  # fmt: skip
        page.script(choose, "fit-amplitude", "9")  # which goes on until it is cancelled
        page.until(lambda: page.script(STAGE) == WORKING)
        page.find("#cancel-fit").click()
        assert page.script(STAGE) == WAITING
        page.script(choose, "fit-amplitude", "0.1")  # which touches nothing
        offer(page, tmp_path / "note.wav")
        assert "hardly touches the bridge" in page.text(".fit-refusal")
        page.script(choose, "fit-amplitude", "")
        offer(page, tmp_path / "note.wav")
        page.find("#apply-fit").click()
        page.until(lambda: "edited" in page.script("return document.getElementById('doc-status').className"))
        at = "return (await (await fetch('/api/docs/' + location.hash.slice(1))).json()).data.pluck.position"
        assert page.result(at) == 0.21
        page.open_nothing()
