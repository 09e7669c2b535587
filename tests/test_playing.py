"""How presets answer the player: the measures on sounds of known make, and on two presets."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from truth_of_sound import playing

from synth.instrument.preset import load_preset
from synth.instrument.shipped import shipped_names

#: presets whose notes are further apart than the aim, and how far they may be [LU]
UNEVEN = {
    "shamisen-clear": 8.5,
    "flatwound-fretless": 7.2,
    "fretless-bass": 6.5,
    "fretless-low": 6.3,
    "nylon-guitar-ponticello": 6.4,
}
RATE = 44100.0
T = np.arange(round(RATE)) / RATE


def sine(hz: float) -> np.ndarray:
    return np.sin(2.0 * np.pi * hz * T)


def test_brightness_is_the_mean_frequency_of_the_power() -> None:
    assert playing.centroid_hz(sine(440.0)) == pytest.approx(440.0, rel=0.01)
    assert playing.centroid_hz(sine(200.0) + sine(600.0)) == pytest.approx(400.0, rel=0.01)
    assert playing.centroid_hz(sine(200.0) + 0.5 * sine(600.0)) == pytest.approx(280.0, rel=0.01)


def test_loudness_is_that_of_the_standard() -> None:
    """A sine of 997 Hz at full scale has −3.01 LUFS (ITU-R BS.1770-4, table 1); a low one is weighted down."""
    assert playing.loudness_lufs(sine(997.0)) == pytest.approx(-3.01, abs=0.1)
    assert playing.loudness_lufs(sine(40.0)) < -5.0


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_names("."))
def test_notes_of_one_velocity_are_as_loud_as_each_other(name: str) -> None:
    apart = playing.notes_apart(load_preset(name))
    # 0.2: what the last digits of another processor's arithmetic make of strings that touch something
    assert apart <= UNEVEN.get(name, playing.MOST_SPREAD + 0.2)
    assert name not in UNEVEN or apart > playing.MOST_SPREAD, "it has become even: take it out of UNEVEN"


def test_takes_are_apart_by_their_thirds_of_octaves() -> None:
    one = sum(sine(hz) for hz in (100.0, 200.0, 400.0))
    assert playing.takes_apart_db(one, one) == 0.0
    assert playing.takes_apart_db(one, 0.5 * one) == pytest.approx(6.0, abs=0.1)


def test_a_hole_in_the_mono_sum_is_found() -> None:
    low, high = sine(100.0), sine(1500.0)
    assert playing.hole_db(low + high, low + high) == pytest.approx(0.0, abs=0.01)
    assert playing.hole_db(low + high, low - 0.5 * high) < -7.0
    # heard on one side alone: half the power of both
    assert playing.hole_db(low, 0.0 * low) == pytest.approx(-3.0, abs=0.05)


def test_steps_and_falls_of_brightness() -> None:
    def of(*centroids: float) -> playing.Answer:
        return playing.Answer(
            load_preset("koto"), {60: np.array(centroids)}, {60: -18.0, 62: -21.0}, 1.0, {60: -20.0}, -10.0, -1.0
        )

    assert of(100.0, 120.0, 180.0).steepest == pytest.approx(1.5)
    assert of(100.0, 200.0, 150.0, 160.0).darkest == pytest.approx(0.25)
    assert of(100.0, 110.0).darkest == 0.0
    assert of(100.0, 110.0).spread == 3.0
    text = playing.table([of(100.0, 120.0, 180.0)])
    assert "**1.50**" in text and "| koto |" in text


def test_a_preset_answers() -> None:
    """A string without contact opens with velocity by its hand alone, evenly."""
    found = playing.answer(load_preset("koto"))
    assert len(found.brightness) == 2
    assert all(centroids.shape == (len(playing.VELOCITIES),) for centroids in found.brightness.values())
    assert found.steepest <= playing.MOST_STEP
    assert found.takes_db > 0.2
    assert set(found.end_db) < set(found.loudness)
