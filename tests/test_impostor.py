"""The impostor test: its features on notes of known make, its classifier on notes that are and are not alike, its controls
on the recordings whose features are kept (tests/truth/features.csv), and our presets."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import soundfile

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from truth_of_sound import controls, families, impostor, verdict
from truth_of_sound.note_features import FEATURES, RATE_HZ, features
from truth_of_sound.ours import Player, judged

from synth.instrument.preset import load_preset
from synth.units import LN_1000


def plucked(
    hz=110.0, *, stiffness=1e-4, t60_s=lambda n: 6.0 / n**0.3, off_cents=lambda n: 0.0, beat=0.0, burst_db=None, attack_s=0.0
):
    """(frames,) thirty partials; pairs 1.3 Hz apart, the second with `beat` of the first; noise of 8 ms at the onset."""
    t = np.arange(4 * RATE_HZ) / RATE_HZ
    x = np.zeros(t.size)
    for n in range(1, 31):
        f = n * hz * np.sqrt(1.0 + stiffness * n * n) * 2.0 ** (off_cents(n) / 1200.0)
        if f < 8000.0:
            pair = np.sin(2 * np.pi * f * t + n) + beat * np.sin(2 * np.pi * (f + 1.3) * t + 2 * n)
            x += pair * np.exp(-LN_1000 / t60_s(n) * t) / n
    if attack_s:
        x *= np.minimum(1.0, t / attack_s)
    if burst_db is not None:
        noise = np.random.default_rng(2).standard_normal(t.size) * np.exp(-t / 0.008)
        x += 10.0 ** (burst_db / 20.0) * np.abs(x).max() * noise
    return np.concatenate([np.zeros(4410), 0.2 * x])


@cache
def of(**make) -> dict[str, float]:
    return features(plucked(**make), RATE_HZ, 45)


def test_decays_and_stiffness_of_known_partials() -> None:
    found = of(t60_s=lambda n: 8.0 if n < 5 else 4.0 if n < 14 else 2.0, stiffness=2e-4)
    assert found["t60_1"] == pytest.approx(8.0, rel=0.03)
    assert found["t60_low"] == pytest.approx(8.0, rel=0.03)
    assert found["t60_middle"] == pytest.approx(4.0, rel=0.05)
    assert found["t60_high"] == pytest.approx(2.0, rel=0.1)
    assert found["inharmonicity"] == pytest.approx(2e-4, rel=0.02)


def test_scatter_tells_uneven_decays_from_smooth_ones() -> None:
    spread = dict(enumerate(np.random.default_rng(3).standard_normal(31)))
    smooth, uneven = of(), of(t60_s=lambda n: 6.0 / n**0.3 * np.exp(0.5 * spread[n]))
    assert smooth["scatter"] < 0.12
    # differences of independent numbers of deviation 0.5
    assert uneven["scatter"] == pytest.approx(0.5 * np.sqrt(2.0), abs=0.25)


def test_beating_and_partials_off_the_law() -> None:
    assert of()["beating_db"] < 0.6 < 3.0 < of(beat=0.3)["beating_db"]
    assert of()["off_law_cents"] < 0.2
    assert of(off_cents=lambda n: 3.0 * (-1) ** n)["off_law_cents"] == pytest.approx(3.0, abs=0.8)


def test_a_burst_is_heard_between_partials_and_at_the_onset() -> None:
    quiet, loud = of(), of(burst_db=3.0)
    for name in ("between_middle_db", "between_high_db", "burst_2k_db"):
        assert loud[name] > quiet[name] + 6.0, name


def test_attack() -> None:
    assert of(attack_s=0.05)["attack_ms"] == pytest.approx(40.0, abs=9.0)
    assert of()["attack_ms"] < 12.0


def test_an_equaliser_hardly_moves_the_features() -> None:
    x = plucked(beat=0.2, burst_db=-15.0)
    before, after = features(x, RATE_HZ, 45), features(controls.equalised(x, RATE_HZ), RATE_HZ, 45)
    for name in ("t60_1", "t60_low", "scatter", "off_law_cents", "inharmonicity"):
        assert after[name] == pytest.approx(before[name], rel=0.1, abs=0.05), name
    for name in ("burst_1k_db", "burst_2k_db", "beating_db"):
        assert after[name] == pytest.approx(before[name], abs=2.0), name


def test_rates_and_levels_do_not_matter() -> None:
    from scipy.signal import resample_poly

    x = plucked()
    before, after = features(x, RATE_HZ, 45), features(0.01 * resample_poly(x, 160, 147), 48000, 45)
    for name in ("t60_1", "scatter", "off_law_cents", "attack_ms"):
        assert after[name] == pytest.approx(before[name], rel=0.05, abs=0.05), name


def test_silence_is_refused() -> None:
    with pytest.raises(ValueError, match="silent"):
        features(np.zeros(RATE_HZ), RATE_HZ, 45)


def test_a_short_note_is_refused() -> None:
    with pytest.raises(ValueError, match=r"must last 0.5 s to be judged, got 0.3"):
        features(plucked()[: 4410 + 13230], RATE_HZ, 45)


def random_notes(count: int, seed: int, shift: float = 0.0) -> list[dict[str, float]]:
    chance = np.random.default_rng(seed)
    return [{key: float(np.exp(chance.standard_normal() * 0.3 + shift)) for key in FEATURES} for _ in range(count)]


def test_what_is_alike_is_not_told_and_what_is_not_is() -> None:
    real = {f"set {k}": random_notes(30, k) for k in range(5)}
    assert impostor.mean(impostor.told(random_notes(30, 9), real)) == pytest.approx(0.5, abs=0.12)
    assert impostor.mean(impostor.told(random_notes(30, 9, 0.6), real)) > 0.95
    assert len(impostor.real_ones(real)) == 5
    assert impostor.real_ones({name: real[name] for name in ("set 0", "set 1")}) == {}


def test_gaps_do_not_tell_by_themselves() -> None:
    real, ours = {f"set {k}": random_notes(30, k) for k in range(4)}, random_notes(30, 9)
    for note in ours[:15]:
        note["t60_high"] = float("nan")
    assert impostor.mean(impostor.told(ours, real)) == pytest.approx(0.5, abs=0.15)


def test_distance_is_in_standard_deviations_of_the_recordings() -> None:
    real = {"a": random_notes(400, 1), "b": random_notes(40, 2)}
    near, far = impostor.distances(random_notes(400, 3), real), impostor.distances(random_notes(400, 3, 0.6), real)
    assert list(near) == impostor.DISTANT
    assert len(near) == 13
    assert np.mean(list(near.values())) < 0.25
    # ln of these notes has a standard deviation of 0.3, and 0.6 is two of them
    assert np.mean([far[key] for key in far if FEATURES[key][1]]) == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize("family", families.families().values(), ids=lambda family: family.name)
def test_recordings_are_kept_and_controls_are_told(family) -> None:
    """Forty sines are told from recordings with near certainty; a real set is told as before behind an equaliser."""
    recordings, turned = families.kept(family)
    assert tuple(recordings) == family.sets
    assert set(family.tuning).isdisjoint(family.judging)
    found = verdict.verdict(family, {}, recordings, turned)
    if family.weak:
        return
    assert found.sines >= verdict.LEAST_OF_SINES
    assert found.moved
    for name, (before, after) in found.moved.items():
        assert abs(after - before) < verdict.MOST_MOVED, name


def test_every_set_has_a_source_and_a_licence() -> None:
    said = families.sources()
    for family in families.families().values():
        for name in family.sets:
            text = said[name.removesuffix(families.TUNING).removesuffix(families.JUDGING)]
            assert any(licence in text for licence in ("CC0", "CC-BY", "MIT")), name


def test_notes_of_file_names() -> None:
    assert [families.note_of(name) for name in ("E1_f_1.flac", "g#2_rr1.wav", "Eb3.flac", "noise_1.flac", "E.flac")] == [
        28, 44, 51, None, None,
    ]  # fmt: skip


def test_features_are_measured_into_the_file(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(families, "KEPT", tmp_path / "features.csv")
    table = 'title = "T"\nlow = 30\nhigh = 60\nnotes = [45]\npresets = []\n'
    (tmp_path / "families.toml").write_text(
        f'[one]\n{table}tuning = ["a"]\njudging = ["b"]\n[two]\n{table}tuning = ["b (tuning)"]\njudging = ["b (judging)"]\n'
    )
    every = families.families(tmp_path / "families.toml")
    monkeypatch.setattr(families, "families", lambda: every)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        for number, hz in enumerate((110.0, 110.3, 109.8, 110.1)):
            soundfile.write(tmp_path / name / f"A2_f_{number}.wav", plucked(hz), RATE_HZ)
        soundfile.write(tmp_path / name / "A2_release.wav", plucked(), RATE_HZ)
        soundfile.write(tmp_path / name / "A2_short.wav", plucked()[:8000], RATE_HZ)
    families.measure([tmp_path], controls.equalised)
    assert "left out: a/A2_short.wav: a note must last" in capsys.readouterr().err
    recordings, turned = families.kept(every["one"], tmp_path / "features.csv")
    assert {name: len(notes) for name, notes in recordings.items()} == {"a": 4, "b": 4}
    assert list(turned) == ["a", "b"]
    found, straight = recordings["a"][0], features(plucked(110.0), RATE_HZ, 45)
    assert found == pytest.approx(straight, rel=1e-3, abs=1e-2, nan_ok=True)
    with pytest.raises(ValueError, match="no folder a in"):
        families.measure([tmp_path / "b"], controls.equalised)


#: presets that meet the aim of docs/sound.md, by a margin; the page names those that miss it
MEET = {
    "bass": ("fretted-bass", "picked-bass", "roundwound-bass", "flatwound-bass"),
    "electric-guitar": ("electric-guitar", "jazz-guitar"),
    "acoustic-guitar": ("steel-guitar", "steel-guitar-picked", "nylon-guitar"),
    "pizzicato": ("pizzicato-strings",),
    "harp": ("harp",),
}


@pytest.mark.parametrize("family", MEET)
@pytest.mark.slow
def test_presets_that_meet_the_aim_are_not_told_easily(family: str) -> None:
    home = families.families()[family]
    recordings, _ = families.kept(home)
    ours = {name: judged(Player(load_preset(name)), home.notes) for name in MEET[family]}
    auc = {name: impostor.mean(impostor.told(notes, recordings)) for name, notes in ours.items()}  # as `verdict` has it
    assert {name: found for name, found in auc.items() if found > verdict.MOST} == {}
