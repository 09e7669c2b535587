"""Scala tunings against values worked out by hand."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from synth.host.scala import ScalaError, note_frequencies, playable_frequencies
from synth.units import midi_to_hz
from tests.patience import patience_s

MIDDLE_C_HZ = 261.6255653005986  # 440 · 2^(−9/12)

JUST = """! just.scl
!
Just major
 7
!
 9/8
 5/4 third
 4/3
 3/2
 5/3
 15/8
 2
"""


@pytest.fixture
def write(tmp_path):
    def make(name: str, text: str):
        path = tmp_path / name
        path.write_text(text, encoding="latin-1")
        return path

    return make


def test_a_scale_key_after_key_from_middle_c(write) -> None:
    note_hz = note_frequencies(write("just.scl", JUST))
    ratios = note_hz[60:68] / MIDDLE_C_HZ
    np.testing.assert_allclose(ratios, [1, 9 / 8, 5 / 4, 4 / 3, 3 / 2, 5 / 3, 15 / 8, 2], rtol=1e-13)
    np.testing.assert_allclose(note_hz[53:60] * 2, note_hz[60:67], rtol=1e-13)
    assert not np.isnan(note_hz).any()


def test_cents_and_a_scale_that_does_not_repeat_at_the_octave(write) -> None:
    note_hz = note_frequencies(write("bp.scl", "Tritave\n2\n701.955\n3/1\n"))
    np.testing.assert_allclose(note_hz[61] / note_hz[60], 1.5, rtol=1e-6)
    np.testing.assert_allclose(note_hz[62] / note_hz[60], 3.0, rtol=1e-13)
    np.testing.assert_allclose(note_hz[58] / note_hz[60], 1 / 3, rtol=1e-13)


def test_a_keyboard_mapping_with_silent_keys(write) -> None:
    # White keys play the seven degrees, black keys are silent; A4 = 442 Hz is degree 5.
    kbm = "! white.kbm\n12\n21\n108\n60\n69\n442.0\n7\n0\nx\n1\nx\n2\n3\nx\n4\nx\n5\nx\n6\n"
    note_hz = note_frequencies(write("just.scl", JUST), write("white.kbm", kbm))
    np.testing.assert_allclose(note_hz[69], 442.0, rtol=1e-13)
    np.testing.assert_allclose(note_hz[60], 442.0 * 3 / 5, rtol=1e-13)
    np.testing.assert_allclose(note_hz[72], 442.0 * 6 / 5, rtol=1e-13)
    assert np.isnan(note_hz[[61, 63, 66, 68, 70, 20, 109]]).all()


def test_a_mapping_alone_retunes_twelve_equal_steps(write) -> None:
    note_hz = note_frequencies(None, write("a432.kbm", "0\n0\n127\n60\n69\n432\n12\n"))
    np.testing.assert_allclose(note_hz, 432.0 * 2.0 ** ((np.arange(128) - 69) / 12), rtol=1e-12)


def test_trailing_keys_of_a_mapping_may_be_left_out(write) -> None:
    note_hz = note_frequencies(write("just.scl", JUST), write("short.kbm", "3\n0\n127\n60\n60\n261.6\n7\n0\n1\n"))
    assert np.isnan(note_hz[62])
    np.testing.assert_allclose(note_hz[63] / note_hz[60], 2.0, rtol=1e-13)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "description line"),
        ("x\nmany\n", "line 2: the number of notes must be a whole number, got 'many'"),
        ("x\n3\n3/2\n2\n", "3 notes are declared, 2 found"),
        ("x\n2\nfifth\n2/1\n", "line 3: 'fifth' is not a pitch"),
        ("x\n2\n3/0\n2/1\n", "line 3: '3/0' is not a pitch"),
        ("x\n2\n-3/2\n2/1\n", "is not a pitch"),
        ("x\n1\n1/1\n", "must be above 1/1"),
        ("x\n1\nnan.\n", "is not a pitch"),
        ("x\n1\ninf\n", "is not a pitch"),
        ("x\n1\n ! a comment\n", "is not a pitch"),
    ],
)
def test_scales_that_cannot_be_used(write, text: str, problem: str) -> None:
    with pytest.raises(ScalaError, match=problem):
        note_frequencies(write("bad.scl", text))


@pytest.mark.parametrize("pitch", ["1000000000000.0", "-1000000000000.0", "76801.0", "1e300", "100000000000000000000000/3"])
def test_pitches_beyond_all_hearing(write, pitch: str) -> None:
    with pytest.raises(ScalaError, match=r"line 3: a pitch must lie within 64 octaves of 1/1|is not a pitch"):
        note_frequencies(write("far.scl", f"far\n2\n{pitch}\n1200.0\n"))


def test_many_octaves_a_key_stay_numbers(write) -> None:
    note_hz = note_frequencies(write("wide.scl", "wide\n1\n76800.0\n"))
    assert np.isfinite(note_hz).all() and (np.diff(note_hz) >= 0).all()
    assert note_hz[60] == pytest.approx(261.63, abs=0.01) and note_hz[61] == 1e6 and note_hz[59] == 1e-3


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("12\n0\n127\n", "begins with seven numbers, got 3"),
        ("12\n0\n200\n60\n69\n440\n12\n", "the last key must be 0 to 127, got 200"),
        ("12\n0\n127\n60\n69\nloud\n12\n", "the reference frequency must be 1 to 20000 Hz, got 'loud'"),
        ("2\n0\n127\n60\n61\n440\n7\n0\nx\n", "the reference key 61 is not mapped"),
        ("12\n90\n20\n60\n69\n440\n12\n", r"the last key \(20\) is below the first"),
    ],
)
def test_mappings_that_cannot_be_used(write, text: str, problem: str) -> None:
    with pytest.raises(ScalaError, match=problem):
        note_frequencies(write("just.scl", JUST), write("bad.kbm", text))


def test_a_pitch_takes_no_longer_than_its_text(write) -> None:
    # In another process: what computes such a number can be ended by nothing else.
    program = "import sys; from synth.host.scala import note_frequencies; note_frequencies(sys.argv[1])"
    words = [sys.executable, "-c", program, str(write("bad.scl", "x\n1\n1e999999999\n"))]
    done = subprocess.run(words, cwd=Path(__file__).parents[2], capture_output=True, text=True, timeout=patience_s())
    assert done.returncode == 1 and "line 3: '1e999999999' is not a pitch" in done.stderr


def test_silent_keys_have_a_frequency_and_are_said_to_be_silent(write) -> None:
    note_hz, silent = playable_frequencies(
        write("just.scl", JUST), write("white.kbm", "2\n50\n70\n60\n60\n261.6\n1\n0\nx\n")
    )
    assert list(np.flatnonzero(~silent)) == list(range(50, 71, 2))
    assert note_hz[60] == 261.6 and note_hz[61] == midi_to_hz(61) and np.isfinite(note_hz).all()


def test_the_ends_of_what_a_mapping_may_say(write) -> None:
    scale = write("just.scl", JUST)
    whole = note_frequencies(scale, write("whole.kbm", "0\n0\n127\n0\n127\n20000\n0\n"))
    assert np.isfinite(whole).all() and whole[127] == pytest.approx(20000.0)
    one = note_frequencies(scale, write("one.kbm", "1\n60\n60\n60\n60\n1.0\n1\n0\n"))
    assert np.flatnonzero(np.isfinite(one)).tolist() == [60] and one[60] == 1.0
    for text, problem in (
        ("129\n0\n127\n60\n69\n440\n12\n", "line 1: the map's size must be 0 to 128, got 129"),
        ("-1\n0\n127\n60\n69\n440\n12\n", "line 1: the map's size must be 0 to 128, got -1"),
        ("0\n128\n127\n60\n69\n440\n12\n", "line 2: the first key must be 0 to 127, got 128"),
        ("0\n0\n127\n128\n69\n440\n12\n", "line 4: the middle key must be 0 to 127, got 128"),
        ("0\n0\n127\n60\n-1\n440\n12\n", "line 5: the reference key must be 0 to 127, got -1"),
        ("0\n0\n127\n60\n69\n0.99\n12\n", "line 6: the reference frequency must be 1 to 20000 Hz, got '0.99'"),
        ("0\n0\n127\n60\n69\n20001\n12\n", "line 6: the reference frequency must be"),
        ("0\n0\n127\n60\n69\n440\n4097\n", "line 7: the octave's degree must be 0 to 4096, got 4097"),
        ("2\n0\n127\n60\n60\n440\n1\n0\n4097\n", "line 9: a degree must be 0 to 4096, got 4097"),
        ("0\n0\n127\n60\n69\n440\n", "begins with seven numbers, got 6"),
    ):
        with pytest.raises(ScalaError, match=problem):
            note_frequencies(scale, write("bad.kbm", text))


def test_a_mapping_repeats_at_its_own_degree(write) -> None:
    """Two keys a turn; a turn is degree 4, 3/2; 0 stands for the scale's length."""
    scale = write("just.scl", JUST)
    note_hz = note_frequencies(scale, write("fifths.kbm", "2\n0\n127\n60\n60\n100\n4\n0\n2\n"))
    np.testing.assert_allclose(note_hz[58:65] / 100.0, [2 / 3, 5 / 6, 1, 5 / 4, 3 / 2, 15 / 8, 9 / 4], rtol=1e-13)
    note_hz = note_frequencies(scale, write("octaves.kbm", "2\n0\n127\n60\n60\n100\n0\n0\n2\n"))
    np.testing.assert_allclose(note_hz[58:64] / 100.0, [1 / 2, 5 / 8, 1, 5 / 4, 2, 5 / 2], rtol=1e-13)


def test_ways_to_write_a_pitch(write) -> None:
    text = "! c\n\n 6\n!\n 100.0 cents\n 200.\n 5/4! third\n 3 / 2\n-50.0\n 2\n 9/1\n"
    note_hz = note_frequencies(write("ways.scl", text))
    expected = [2 ** (1 / 12), 2 ** (2 / 12), 1.25, 1.5, 2 ** (-50 / 1200), 2.0]
    np.testing.assert_allclose(note_hz[61:67] / note_hz[60], expected, rtol=1e-12)
    far = note_frequencies(write("far.scl", "far\n2\n-76800.0\n1200.0\n"))
    assert far[61] == 1e-3
    with pytest.raises(ScalaError, match=r"64 octaves of 1/1 \(±76800 cents\), got '-76801\.0'"):
        note_frequencies(write("far.scl", "far\n2\n-76801.0\n1200.0\n"))


def test_scales_of_many_notes_and_of_none(write) -> None:
    most = "x\n4096\n" + "".join(f"{k}.0\n" for k in range(1, 4097))
    assert note_frequencies(write("most.scl", most))[127] == pytest.approx(MIDDLE_C_HZ * 2 ** (67 / 1200), rel=1e-12)
    for count in (0, 4097):
        with pytest.raises(ScalaError, match=f"line 2: the number of notes must be 1 to 4096, got {count}"):
            note_frequencies(write("bad.scl", f"x\n{count}\n2/1\n"))
    with pytest.raises(ScalaError, match="a scale has a description line and a line with the number of notes"):
        note_frequencies(write("bad.scl", "x\n"))
    with pytest.raises(ScalaError, match="must be above 1/1, got -1200 cents"):
        note_frequencies(write("down.scl", "x\n1\n-1200.0\n"))
    narrow = note_frequencies(write("narrow.scl", "x\n1\n0.5\n"))
    assert narrow[72] / narrow[60] == pytest.approx(2 ** (6 / 1200), rel=1e-12)


def test_a_missing_file() -> None:
    with pytest.raises(ScalaError, match=r"\.scl: cannot be read \(File name too long\)"):
        note_frequencies("x" * 300 + ".scl")
    with pytest.raises(ScalaError, match=r"nowhere\.scl: no such file"):
        note_frequencies("nowhere.scl")
