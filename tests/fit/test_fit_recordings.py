"""Prediction of dynamics that were not fitted: recordings that a known preset made, and folders that hold none."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import soundfile

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from fit_recordings.between import learn, off
from fit_recordings.prediction import SPLITS, Effort, predict
from fit_recordings.runs import retuned, splits
from fit_recordings.strokes import Player, Sounded, sounded
from fit_recordings.takes import named, read

from synth.fit.contact_features import bands_of
from synth.fit.fret_features import SECONDS, db
from synth.fit.fret_model import RATE_HZ
from synth.fit.recording import FitRefused
from synth.instrument.preset import load_preset
from synth.units import midi_to_hz

TOOLS = Path(__file__).parents[2] / "tools"
NOTE = 43  # G2, the highest open string
#: of the hardest stroke that is played [dB]
LEVELS_DB = {"pp": -24.0, "p": -18.0, "mf": -12.0, "f": -6.0, "ff": 0.0}
#: a hand that is duller and a neck that is lower than the preset's
OTHER = {"slip_ms": 7.0, "slip_hard_ratio": 0.5, "width_mm": 30.0, "action_mm": 0.9, "position": 0.12}


@cache
def bass() -> Sounded:
    return sounded(load_preset("fretted-bass"), NOTE, float(midi_to_hz(NOTE)))


def recordings(folder: Path, dynamics: dict[str, float] = LEVELS_DB) -> Path:
    """Another player's strokes on another neck, through a dull microphone, in a little noise."""
    rng = np.random.default_rng(5)
    player = Player(bass(), bass().values() | OTHER)
    scale = 0.5 / float(np.abs(player.stroke(0.0)).max())
    for dynamic, level in dynamics.items():
        sound = scale * player.stroke(level, 2.0)
        sound = np.concatenate([np.zeros(RATE_HZ // 2), sound])
        sound[1:] += 0.7 * sound[:-1]
        sound += 1e-5 * rng.standard_normal(sound.size)
        soundfile.write(folder / f"g2_{dynamic}_rr1.flac", 0.5 * sound, RATE_HZ, subtype="PCM_24")
    return folder


def test_strokes_that_are_known_are_predicted(tmp_path: Path) -> None:
    """The truth is next to nothing off, at dynamics that nothing was learned from; the preset is, by far."""
    takes = {take.dynamic: take for take in read(NOTE, named(recordings(tmp_path))[NOTE])}
    bands = bands_of(bass().model.string, RATE_HZ)
    heard = {dynamic: take.heard(bands) for dynamic, take in takes.items()}
    found = {}
    for name, values in (("truth", bass().values() | OTHER), ("preset", None)):
        player = Player(bass(), values)
        power = {dynamic: bands.powers(player.stroke(level), RATE_HZ, SECONDS) for dynamic, level in LEVELS_DB.items()}
        fitted = SPLITS["beyond"][0]
        learned = learn([heard[d] for d in fitted], [power[d] for d in fitted])
        found[name] = off(heard["ff"], learned.applied(power["ff"], bands.hop_s))
        assert learned.gains_db.shape == (3,) and abs(learned.gains_db.sum()) < 1e-9
    assert found["truth"].spectrum_db < 0.5
    assert found["truth"].windows_db < 1.0
    assert found["preset"].windows_db > 3.0 * found["truth"].windows_db


def test_a_gain_and_an_onset_are_nobodys_merit(tmp_path: Path) -> None:
    take = read(NOTE, named(recordings(tmp_path, {"mf": -12.0}))[NOTE])[0]
    bands = bands_of(bass().model.string, RATE_HZ)
    heard = take.heard(bands)
    power = bands.powers(Player(bass(), bass().values() | OTHER).stroke(-12.0), RATE_HZ, SECONDS)
    own = learn([heard], [power]).applied(power, bands.hop_s)
    assert off(heard, own).windows_db == pytest.approx(off(heard, own + 17.0).windows_db, abs=1e-3)
    # half of all windows 6 dB off are what that is of them
    wrong = own + 6.0 * (np.arange(own.shape[0]) % 2)[:, None]
    assert off(heard, wrong).windows_db > off(heard, own).windows_db + 2.0
    assert np.isfinite(db(power)).all()


def test_a_fit_predicts_better_than_the_preset(tmp_path: Path) -> None:
    """Of strokes that hardly reach the frets: harder ones are chaotic, and a short search does not explain them."""
    softer = {dynamic: level - 20.0 for dynamic, level in LEVELS_DB.items()}
    takes = read(NOTE, named(recordings(tmp_path, softer))[NOTE])
    row = predict(takes, bass(), SPLITS["beyond"][0], Effort(notes=16, starts=1, most=80))
    assert row["loss"]["fit"] < row["loss"]["preset"]
    assert {one["dynamic"] for one in row["predicted"]} == {"f", "ff"}
    for one in row["predicted"]:
        assert one["fit"]["windows_db"] < one["preset"]["windows_db"]
        assert "nearest recording" in one and "another take" not in one
    assert set(row["values"]) == {"top_db", *bass().values()}


def test_what_a_folder_has_to_hold(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="must be a folder"):
        named(tmp_path / "none")
    with pytest.raises(ValueError, match="holds no recording named"):
        named(tmp_path)
    recordings(tmp_path, {"mf": -12.0, "ff": 0.0})
    with pytest.raises(ValueError, match="no note has the dynamics"):
        splits(tmp_path, None)
    with pytest.raises(ValueError, match="has no note C2; it has G2"):
        splits(tmp_path, ["C2"])
    (tmp_path / "g2_p_rr1.wav").write_bytes(b"no sound")
    with pytest.raises(ValueError, match=r"g2_p_rr1\.wav"):
        read(NOTE, named(tmp_path)[NOTE])
    soundfile.write(tmp_path / "g2_p_rr1.wav", np.zeros(RATE_HZ), RATE_HZ)
    with pytest.raises(FitRefused, match=r"g2_p_rr1\.wav"):
        read(NOTE, named(tmp_path)[NOTE])


def test_strings_that_are_tuned_otherwise() -> None:
    preset = load_preset("fretted-bass")
    assert sorted(t.notes[0] for t in retuned(preset, "C1,G1,D2,A2").string) == [24, 31, 38, 45]
    with pytest.raises(ValueError, match="--open must name 4 notes"):
        retuned(preset, "C1")
    with pytest.raises(ValueError, match="as low as note 20"):
        sounded(preset, 20, float(midi_to_hz(20)))


def test_the_command_says_what_is_wrong(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(TOOLS / "fit-recordings"), str(tmp_path)], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 2
    assert done.stderr.startswith(f"fit-recordings: {tmp_path}: holds no recording") and "Traceback" not in done.stderr
