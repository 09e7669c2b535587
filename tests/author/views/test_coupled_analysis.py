"""How partials of strings that share a bridge decay and beat, and which strings ring along."""

import json

import numpy as np
import pytest

from synth.author.views.analysis import analyse
from synth.author.views.decays import stages
from synth.author.views.motion import film
from synth.fit.exponential import Bands
from synth.units import LN_1000

from .kit import ROLLED_ON, preset, together


def exponentials(rows: list[tuple[float, float, float]], seconds: float, rate_hz: float) -> np.ndarray:
    """Σ a e^(−σt) cos(2πft) of rows (a, σ, f)."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    return np.asarray(sum(a * np.exp(-sigma * t) * np.cos(2.0 * np.pi * f * t) for a, sigma, f in rows))


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_two_vibrations_in_a_partial_are_told_apart(noise: float) -> None:
    """Amplitudes 1 and 0.5 that decay at 6 and 1 per second, 3 Hz apart, beside two other partials: the energy falls at
    (6 + 0.25 · 1)/1.25 at first and at 1 in the end; crest to trough 20 log₁₀ 3 dB."""
    rate_hz = 8000.0
    x = exponentials([(1.0, 6.0, 330.0), (0.5, 1.0, 333.0), (0.7, 2.0, 660.0), (0.7, 1.0, 990.0)], 3.0, rate_hz)
    x += noise * np.random.default_rng(1).normal(size=x.size)
    found = stages(Bands(x, rate_hz, 330.0), 330.0)
    assert found is not None
    # of what is left where the window lies behind the onset
    begin = found.t_s[0]
    power = np.array([np.exp(-12.0 * begin), 0.25 * np.exp(-2.0 * begin)])
    early = float(power @ [6.0, 1.0] / power.sum())
    share = float(np.sqrt(power.min() / power.max()))
    assert found.early_t60_s == pytest.approx(LN_1000 / early, rel=0.03)
    assert found.late_t60_s == pytest.approx(LN_1000, rel=0.03)
    assert found.beat_hz == pytest.approx(3.0, rel=0.01)
    assert found.beat_db == pytest.approx(20.0 * np.log10((1.0 + share) / (1.0 - share)), rel=0.03)
    assert np.abs(found.level_db - found.fitted_db).max() < (0.2 if noise == 0.0 else 3.0)


def test_one_vibration_has_one_rate_and_does_not_beat() -> None:
    x = exponentials([(1.0, 2.5, 220.0), (0.5, 4.0, 440.0)], 2.0, 8000.0)
    found = stages(Bands(x, 8000.0, 220.0), 220.0)
    assert found is not None and found.beat_hz is None is found.beat_db
    assert found.early_t60_s == pytest.approx(LN_1000 / 2.5, rel=1e-3) == found.late_t60_s


def test_what_does_not_sound_has_no_stages() -> None:
    assert stages(Bands(np.zeros(8000), 8000.0, 220.0), 220.0) is None


def test_two_strings_in_unison_decay_in_two_stages_and_wake_each_other() -> None:
    """One of two is plucked: as fast at first as both against the bridge, at last as what is left between them
    (Weinreich)."""
    shown = analyse(together(), 48, 100, 3.0)
    json.dumps(shown, allow_nan=False)
    staged = {each["number"]: each for each in shown["decays"]}
    assert len(staged) >= 6 and any(each["late_t60_s"] > 1.5 * each["early_t60_s"] for each in staged.values())
    for each in staged.values():
        assert len(each["t_s"]) == len(each["level_db"]) == len(each["fitted_db"])
    a, b, c = shown["waking"]["strings"]
    assert a["played"] and not b["played"] and (a["opened"], b["opened"], c["opened"]) == (48, 48, 43)
    assert b["level_db"][0] < max(b["level_db"]) - 20.0 and max(b["level_db"]) > max(c["level_db"])
    assert len(a["level_db"]) * shown["waking"]["bin_s"] == pytest.approx(3.0, rel=0.01)


def test_a_string_by_itself_has_neither() -> None:
    shown = analyse(preset("free"), 48, 100, 0.5)
    assert shown["decays"] == [] and shown["waking"] is None


def test_the_contacts_of_coupled_strings_are_those_of_its_film() -> None:
    made = together(obstacle=ROLLED_ON)
    shown = analyse(made, 43, 100, 0.5)
    assert shown["contacts"] and {each["label"] for each in shown["contacts"]} == {"bridge"}
    seen = film(made, 43, 100, 0.02, 150, start_s=0.1)
    peak = max(row[0] for row in seen["force"])
    touched = [each for each in shown["contacts"] if each["end_s"] > 0.1 and each["start_s"] < 0.12]
    assert peak == pytest.approx(max(each["peak_n"] for each in touched), rel=0.05)
