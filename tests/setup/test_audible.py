"""The measure of a buzz, on signals whose bands are known."""

import numpy as np
import pytest

from synth.setup.audible import AUDIBLE_DB, FRAME_S, band_energies, buzz_db, buzz_seconds, fade

RATE = 44100.0
T = np.arange(round(0.5 * RATE)) / RATE


def tone(hz: float, amplitude: float = 1.0) -> np.ndarray:
    return amplitude * np.sin(2.0 * np.pi * hz * T)


def a_weight(hz: float) -> float:
    """IEC 61672-1, equation of the A weighting, as a factor of power (without its 2 dB at 1 kHz)."""
    pole = [20.598997, 107.65265, 737.86223, 12194.217]
    value = pole[3] ** 2 * hz**4
    value /= (hz**2 + pole[0] ** 2) * (hz**2 + pole[3] ** 2)
    value /= np.sqrt((hz**2 + pole[1] ** 2) * (hz**2 + pole[2] ** 2))
    return value**2


def measured(y: np.ndarray, free: np.ndarray, pitch_hz: float = 100.0, *, speed: bool = False) -> float:
    window = np.hanning(T.size)
    contact, _ = band_energies(y * window, RATE, pitch_hz, speed=speed)
    without, whole = band_energies(free * window, RATE, pitch_hz, speed=speed)
    return buzz_db(contact, without, whole)


def test_a_band_that_is_twice_as_strong_is_three_decibels_louder() -> None:
    free = tone(100.0) + tone(2000.0, 0.1)
    louder = tone(100.0) + tone(2000.0, 0.1 * np.sqrt(2.0))
    assert measured(louder, free) == pytest.approx(3.01, abs=0.02)
    assert measured(free, free) == 0.0


def test_what_lies_forty_decibels_below_the_note_is_lost() -> None:
    free = tone(1000.0)
    added = 10.0 ** (-40.0 / 20.0) * np.sqrt(a_weight(1000.0) / a_weight(4000.0))
    assert measured(free + tone(4000.0, added), free) == pytest.approx(3.01, abs=0.02)
    assert measured(free + tone(4000.0, 0.1 * added), free) == pytest.approx(10.0 * np.log10(1.01), abs=0.01)


def test_what_lies_below_the_fifth_partial_does_not_count() -> None:
    free = tone(100.0)
    assert measured(free + tone(300.0), free) < 1e-6
    assert measured(free + tone(520.0), free) > 20.0


def test_what_lies_above_ten_kilohertz_does_not_count() -> None:
    free = tone(100.0)
    assert measured(free + tone(12500.0), free) < 0.01


def test_a_pickup_hears_the_speed() -> None:
    free = tone(100.0) + tone(2000.0, 1e-4)
    louder = tone(100.0) + tone(2000.0, 2e-4)
    assert measured(louder, free, speed=True) > measured(louder, free) + 1.0


def test_the_window_is_one_and_fades_over_the_second_half() -> None:
    window = fade(1001, 201)
    assert np.all(window[:600] == 1.0)
    assert window[-1] == pytest.approx(0.0, abs=1e-12)
    assert np.all(np.diff(window[600:]) <= 0.0)


def test_a_buzz_lasts_as_long_as_it_is_heard() -> None:
    free = tone(200.0)
    buzz = np.where(T < 0.3, tone(3000.0, 0.2), 0.0)
    seconds = buzz_seconds(free + buzz, free, RATE, 0, 200.0, AUDIBLE_DB, speed=False)
    assert seconds == pytest.approx(0.3, abs=FRAME_S)
    assert buzz_seconds(free, free, RATE, 0, 200.0, AUDIBLE_DB, speed=False) == 0.0
