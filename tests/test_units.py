import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from synth import units


@pytest.mark.parametrize(
    ("name", "number"),
    [("C4", 60), ("A4", 69), ("C-1", 0), ("G9", 127), ("C#3", 49), ("Db3", 49), ("cb4", 59), ("B#3", 60),
     ("e♭2", 39), ("F♯2", 42), ("Fx2", 43), ("A##1", 35), ("Bbb1", 33), (" E1 ", 28)],
)  # fmt: skip
def test_note_names(name, number):
    assert units.note_to_midi(name) == number


@pytest.mark.parametrize("name", ["", "H4", "C", "4", "C#", "C###4", "C4.5", "Cb-1", "G#9", "C10", None, 60])
def test_bad_note_names(name):
    with pytest.raises(ValueError, match=r"note must"):
        units.note_to_midi(name)


@given(st.integers(0, 127))
def test_names_round_trip(number):
    assert units.note_to_midi(units.midi_to_note(number)) == number


@pytest.mark.parametrize("number", [-1, 128, 60.5])
def test_bad_numbers(number):
    with pytest.raises(ValueError, match="0 to 127"):
        units.midi_to_note(number)


def test_frequencies():
    assert units.midi_to_hz(69) == 440.0
    assert units.midi_to_hz(57, a4_hz=442.0) == 221.0
    assert units.midi_to_hz(60) == pytest.approx(261.6255653005986, rel=1e-15)
    assert units.midi_to_hz(60.5) == pytest.approx(440 * 2 ** (-8.5 / 12), rel=1e-15)


@given(st.floats(-20, 150), st.floats(400, 480))
def test_frequencies_round_trip(note, a4):
    assert units.hz_to_midi(units.midi_to_hz(note, a4), a4) == pytest.approx(note, abs=1e-12)


def test_cents_and_decibels():
    assert units.cents(880.0, 440.0) == 1200.0
    assert units.cents(440.0, units.midi_to_hz(70)) == pytest.approx(-100.0, abs=1e-10)
    assert units.db_to_gain(-20.0) == pytest.approx(0.1, rel=1e-15)
    assert units.gain_to_db(2.0) == pytest.approx(6.020599913279624, rel=1e-15)
    assert units.gain_to_db(0.0) == -math.inf
    assert units.db_to_gain(-math.inf) == 0.0


@pytest.mark.parametrize("bad", [0.0, -1.0, math.inf, math.nan])
def test_frequencies_must_be_positive(bad):
    with pytest.raises(ValueError, match="frequency_hz must be > 0 Hz"):
        units.hz_to_midi(bad)
    with pytest.raises(ValueError, match="reference_hz must be > 0 Hz"):
        units.cents(440.0, bad)
    with pytest.raises(ValueError, match="a4_hz must be > 0 Hz"):
        units.midi_to_hz(60, a4_hz=bad)


@pytest.mark.parametrize("bad", [-0.5, math.nan])
def test_gain_must_not_be_negative(bad):
    with pytest.raises(ValueError, match="gain must be >= 0"):
        units.gain_to_db(bad)


@pytest.mark.parametrize(
    ("text", "ratio"), [("3/2", 1.5), (" 9 / 8 ", 1.125), ("1.25", 1.25), ("2", 2.0), ("1e999", math.inf)]
)
def test_ratios(text, ratio):
    assert units.read_ratio(text) == ratio


@pytest.mark.parametrize("text", ["", "/", "1/0", "1.5/2", "x", "1/2/3", "9" * 400 + "/1", "1/" + "9" * 9999])
def test_what_is_no_ratio(text):
    with pytest.raises(ValueError, match="ratio such as 3/2"):
        units.read_ratio(text)
