"""Every note of the presets that come with the program sounds at its pitch, with the contact in place."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

from synth.fit.tune import TUNING_RANGE, calibrate, measure, measure_all, retuned, tunings, worst
from synth.instrument.neck import single_strings
from synth.instrument.preset import load_preset
from tests.forkserver import prepared
from tests.patience import compiling_s

ROOT = Path(__file__).resolve().parents[1]
LIMIT_CENTS = 2.0  # what a careful listener may notice in a melody


@pytest.mark.parametrize(("name", "positions"), [("fretted-bass", 84), ("jawari-harp", 69)])
def test_every_position_is_in_tune(name: str, positions: int) -> None:
    pitches = measure(load_preset(name))
    assert len(pitches) == positions
    assert abs(worst(pitches).cents) < LIMIT_CENTS, worst(pitches)


@pytest.mark.parametrize("semitones", range(-TUNING_RANGE, TUNING_RANGE + 1))
def test_tanpura_strings_are_in_tune_over_their_tuning_range(semitones: int) -> None:
    pitches = measure(retuned(load_preset("tanpura-light"), semitones))
    assert [pitch.note - semitones for pitch in pitches] == [43, 48, 48, 36]
    assert abs(worst(pitches).cents) < LIMIT_CENTS, worst(pitches)


def test_strings_tuned_by_setting_are_in_tune() -> None:
    preset = load_preset("tanpura-light").with_setting("string.0.notes", "F2").with_setting("string.3.cents", "-14")
    pitches = measure(preset, {41, 36})
    assert [pitch.note for pitch in pitches] == [41, 36]
    assert abs(worst(pitches).cents) < LIMIT_CENTS, worst(pitches)


@pytest.mark.slow
def test_contact_does_shift_the_pitch_and_calibration_takes_it_back() -> None:
    preset = load_preset("tanpura-light")
    bare = preset.model_copy(update={"tuning": preset.tuning.model_copy(update={"contact_cents": None})})
    raised = measure(bare, {36})
    # a string stopped 6 mm early for the whole period would be 1200 log₂(950/944) = 11 cents sharp
    assert 1.0 < raised[0].cents < 11.0
    calibrated, pitches = calibrate(bare)
    assert abs(worst(pitches).cents) < 1.0
    assert set(calibrated.tuning.contact_cents or {}) == {31, 36, 38, 41, 43, 48, 53}
    again, _ = calibrate(calibrated)
    assert again is calibrated


@pytest.mark.slow
def test_measure_sees_a_string_that_is_out_of_tune() -> None:
    preset = load_preset("fretted-bass").with_setting("string.3.cents", "7")
    # cents of a string are its intended pitch; a preset whose a4 moved after it was measured would be wrong
    assert abs(worst(measure(preset, {43})).cents) < LIMIT_CENTS
    (right,) = [pitch for pitch in measure(preset, {43}) if pitch.string == "G"]
    calibrated = (preset.tuning.contact_cents or {})[43]
    wrong = preset.model_copy(update={"tuning": preset.tuning.model_copy(update={"contact_cents": {43: calibrated + 7.0}})})
    (open_g,) = [pitch for pitch in measure(wrong, {43}) if pitch.string == "G"]
    assert open_g.cents == pytest.approx(right.cents - 7.0, abs=0.1)


def test_retuned_strings_keep_their_make() -> None:
    preset = load_preset("tanpura-light").with_setting("string.3.diameter_mm", "{ C2 = 0.6, C3 = 0.3 }")
    moved = retuned(preset, 5)
    assert moved.string[3].notes == (41, 41)
    assert moved.string[3].diameter_mm == pytest.approx(0.6)
    assert tunings(preset) == (-5, 0, 5)
    assert tunings(load_preset("jawari-harp")) == tunings(load_preset("fretted-bass")) == (0,)
    assert retuned(preset, 0) is preset


def test_single_strings() -> None:
    harp = load_preset("jawari-harp")
    assert [opened for _, opened, _ in single_strings(harp)] == list(range(28, 97))
    bass = load_preset("fretted-bass")
    found = list(single_strings(bass, {50}))
    assert [(index, opened) for index, opened, _ in found] == [(1, 33), (2, 38), (3, 43)]
    assert all(len(alone.string) == 1 for *_, alone in found)


@pytest.mark.slow
def test_tune_presets_writes_the_table_and_nothing_else(tmp_path: Path) -> None:
    text = (ROOT / "presets" / "tanpura-light.toml").read_text(encoding="utf-8")
    lines = text.splitlines()
    (at,) = [i for i, line in enumerate(lines) if line.startswith("contact_cents")]
    path = tmp_path / "mine.toml"
    path.write_text("\n".join([*lines[:at], "contact_cents = { C2 = 30.0 }", *lines[at + 1 :]]) + "\n", encoding="utf-8")

    def tune(*arguments: str) -> subprocess.CompletedProcess[str]:
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        tool = f"import runpy\nrunpy.run_path({str(ROOT / 'tools' / 'tune-presets')!r}, run_name='__main__')"
        return prepared().start(list(arguments), tmp_path, module=None, before=tool, **pipes).done(compiling_s())

    assert tune("--check", str(path)).returncode == 1
    done = tune(str(path))
    assert done.returncode == 0, done.stderr
    after = path.read_text(encoding="utf-8").splitlines()
    assert after[:at] == lines[:at]
    assert after[at + 1 :] == lines[at + 1 :]
    table = load_preset(str(path)).tuning.contact_cents
    shipped = load_preset("tanpura-light").tuning.contact_cents
    assert table is not None and shipped is not None
    assert table.keys() == shipped.keys()
    assert np.allclose(list(table.values()), list(shipped.values()), atol=1.0)
    assert tune("--check", str(path)).returncode == 0


def test_the_tanpura_file_was_calibrated_as_it_is() -> None:
    assert abs(worst(measure_all(load_preset("tanpura-light"))).cents) < 1.0
