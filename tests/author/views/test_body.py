"""The body as peaks of its mobility: what is drawn is the body that sounds, and what a drag sends moves the peak there."""

import json
import math
from itertools import pairwise

import numpy as np
import pytest

from synth.author.changes import apply, checked
from synth.author.views.begin_body import ESTIMATES, MOST_STRINGS, PEAK_DBFS, REMARK, begin
from synth.author.views.body_peaks import describe_body
from synth.engine.engine import Engine
from synth.instrument.preset import load_preset
from synth.instrument.soundboard import body_of
from synth.midi.events import NOTE_ON, make_events

from .kit import TEXTS, preset

GUITAR = TEXTS["steel-guitar"]


def level_db(shown: dict, axis: int, hz: float) -> float:
    """Of the curve at one of its frequencies."""
    return shown["mobility_db"][axis][int(np.argmin(np.abs(np.array(shown["hz"]) - hz)))]


def test_strings_with_ends_at_rest_have_no_body() -> None:
    assert describe_body(load_preset("tanpura-light")) == {"coupled": False}


def test_a_mode_alone_peaks_where_it_is_said_to() -> None:
    """|Y| = ψ²Q/(mΩ), 20 log₁₀ of it: of ψ 0.5, Q 40, 0.2 kg, 300 Hz."""
    text = (
        GUITAR[: GUITAR.index("[[body.mode]]")] + "[[body.mode]]\nfrequency_hz = 300\nq = 40\nmass_kg = 0.2\nshape = [0.5]\n"
    )
    shown = describe_body(checked(text, "one"))
    json.dumps(shown, allow_nan=False)
    expected = 20.0 * math.log10(0.25 * 40.0 / (0.2 * 2.0 * math.pi * 300.0))
    assert shown["axes"] == ["normal"]
    assert shown["modes"][0]["peak_db"] == [pytest.approx(expected, abs=1e-3)]
    assert max(shown["mobility_db"][0]) == pytest.approx(expected, abs=2e-3) == level_db(shown, 0, 300.0)
    assert shown["modes"][0]["rings_s"] == pytest.approx(2.2 * 40.0 / 300.0, rel=1e-2)


def test_a_mode_that_does_not_move_that_way_has_no_height_there() -> None:
    shown = describe_body(preset("steel-guitar"))
    assert shown["axes"] == ["normal", "lateral", "rocking"]
    air = shown["modes"][0]
    assert air["shape"] == [1.0, -0.03, 0.0] and air["peak_db"][2] is None
    assert air["drag"]["q"][2] is None is air["drag"]["mass"][2] and air["drag"]["q"][1] is not None


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("which", ["q", "mass"])
def test_a_drag_puts_the_peak_under_the_hand(which: str, axis: int) -> None:
    shown = describe_body(preset("steel-guitar"))
    for mode in shown["modes"][::4]:
        along, up = mode["drag"]["frequency"], mode["drag"][which][axis]
        assert math.exp(along["offset"] + along["factor"] * math.log(mode["frequency_hz"])) == pytest.approx(
            mode["frequency_hz"]
        )
        wanted_hz, wanted_db = 1.1 * mode["frequency_hz"], mode["peak_db"][axis] + 4.5
        value = math.exp(up["offset"] + up["factor"] * wanted_db)
        assert up["minimum"] <= value <= up["maximum"]
        raised = describe_body(apply(GUITAR, [(up["path"], value)], "g")[1])["modes"][mode["index"]]
        assert raised["peak_db"][axis] == pytest.approx(wanted_db, abs=2e-3)
        moved = describe_body(apply(GUITAR, [(along["path"], wanted_hz)], "g")[1])["modes"][mode["index"]]
        assert moved["frequency_hz"] == pytest.approx(wanted_hz) and moved["q"] == mode["q"]
        # of one mass and Q a higher mode is as much lower
        assert moved["peak_db"][axis] == pytest.approx(mode["peak_db"][axis] - 20.0 * math.log10(1.1), abs=2e-3)


def test_the_mode_to_begin_with_lies_where_there_is_room_and_is_taken() -> None:
    shown = describe_body(preset("steel-guitar"))
    places = sorted(mode.frequency_hz for mode in body_of(preset("steel-guitar").body.mode).modes)
    widest = max(b / a for a, b in pairwise(places))
    new = shown["new"]["frequency_hz"]
    nearest = min(max(new / hz, hz / new) for hz in places)
    assert nearest > math.sqrt(widest) * 0.99
    count = len(shown["modes"])
    text, grown = apply(GUITAR, [(f"body.mode.{count}", shown["new"])], "g")
    assert len(grown.body.mode) == count + 1 == text.count("[[body.mode]]")


def test_strings_are_listed_along_the_bridge() -> None:
    strings = describe_body(preset("steel-guitar"))["strings"]
    assert [string["string"] for string in strings] == ["E2", "A2", "D3", "G3", "B3", "E4"]
    assert [string["place_mm"] for string in strings] == [-27.0, -16.0, -5.0, 5.0, 16.0, 27.0]


@pytest.mark.parametrize("name", ["tanpura-light", "fretted-bass", "points", "free"])
def test_a_body_can_be_begun(name: str) -> None:
    """All in one edit; called an estimate in the file; heard at the level that presets have."""
    found = begin(preset(name))
    json.dumps(found, allow_nan=False)
    text, begun = apply(TEXTS[name], [(edit["path"], edit["value"]) for edit in found["edits"]], name)
    assert begun.coupled and len(begun.body.mode) == len(ESTIMATES) and not begun.body.resonance
    assert REMARK in begun.remarks and "estimates" in found["said"]
    assert text.count("[[body.mode]]") == len(ESTIMATES)
    for line in TEXTS[name].splitlines():
        if line.startswith("#"):
            assert line in text
    engine = Engine(
        [begun], limiter=False, every_fret=False, only_notes=[{begun.string[0].notes[0], begun.string[-1].notes[1]}]
    )
    engine.prepare(44100.0)
    loudest = 0.0
    for note in (begun.string[0].notes[0], begun.string[-1].notes[1]):
        engine.reset()
        out = np.zeros((22050, 2))
        engine.process(make_events([(0, NOTE_ON, 0, note, 127)]), out)
        loudest = max(loudest, float(np.abs(out).max()))
    assert 20.0 * math.log10(loudest) < PEAK_DBFS + 6.0
    assert 20.0 * math.log10(loudest) > PEAK_DBFS - 12.0
    again = begin(begun)
    assert again["edits"] is None and "already" in again["said"]


def test_a_body_in_one_place_of_the_remarks_only() -> None:
    noted = preset("tanpura-light").with_setting("remarks", f'"{REMARK}"')
    edits = {edit["path"]: edit["value"] for edit in begin(noted)["edits"]}
    assert edits["remarks"].count(REMARK) == 1


def test_too_many_strings_are_refused_with_the_number() -> None:
    found = begin(load_preset("jawari-harp"))
    assert found["edits"] is None and "69 strings" in found["said"] and str(MOST_STRINGS) in found["said"]
