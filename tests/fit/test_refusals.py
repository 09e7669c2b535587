"""What is not one plucked string gets an honest answer; what only looks unusual is fitted."""

from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from synth.fit import FitRefused, fit_recording
from synth.units import cents
from tests.fit.strings import render, steel

RATE = 44100.0
T = np.arange(round(3 * RATE)) / RATE


@cache
def note(f0_hz: float, seconds: float = 3.0) -> np.ndarray:
    samples = render(steel(f0_hz), np.random.default_rng(0), seconds=seconds, snr_db=60.0)
    samples.flags.writeable = False
    return samples


def voice() -> np.ndarray:
    """Glottal pulses that glide, through three formants, in syllables."""
    phase = np.cumsum(120.0 + 30.0 * np.sin(2 * np.pi * 0.7 * T) + 10.0 * np.sin(2 * np.pi * 3.0 * T)) / RATE
    x = (phase % 1.0 < 0.1) - 0.1
    for hz, width in ((600.0, 80.0), (1100.0, 90.0), (2500.0, 120.0)):
        r = np.exp(-np.pi * width / RATE)
        x = lfilter([1.0 - r], [1.0, -2.0 * r * np.cos(2 * np.pi * hz / RATE), r * r], x)
    return 0.5 * x / np.abs(x).max() * (np.sin(2 * np.pi * 1.5 * T) > -0.5)


def vibrato() -> np.ndarray:
    turn = 2 * np.pi * 110.0 * T + 110.0 * 0.02 / 5.0 * np.sin(2 * np.pi * 5.0 * T)
    return sum(0.3 / k * np.sin(k * turn) for k in range(1, 20)) * np.exp(-T)


def ringing(ratios: list[float], f0_hz: float) -> np.ndarray:
    return sum(0.1 * np.sin(2 * np.pi * f0_hz * r * T) for r in ratios) * np.exp(-2.0 * T)


NOISE = 0.1 * np.random.default_rng(0).standard_normal(T.size)
BAD = {
    "fifth": (lambda: note(110.0) + note(164.8), "two notes sound, near 110 and 164.8 Hz"),
    "third": (lambda: note(110.0) + note(138.6), "two notes sound"),
    "semitone": (lambda: note(110.0) + note(116.5), "two notes sound"),
    "twelfth": (lambda: note(110.0) + note(329.6), "two notes sound"),
    "chord": (lambda: note(110.0) + note(138.6) + note(164.8), "two notes sound"),
    "a second note 10 dB below": (lambda: note(110.0) + 0.3 * note(164.8), "two notes sound"),
    "white noise": (lambda: NOISE, "no partials stand out"),
    "noise that fades": (lambda: NOISE * np.exp(-3.0 * T), "no partials stand out"),
    "brown noise": (lambda: np.cumsum(NOISE) * 0.01, "no partials stand out"),
    "clipped": (lambda: np.clip(4.0 * note(110.0), -0.7, 0.7), "is clipped"),
    "clipped, 16 bits": (lambda: np.round(np.clip(3.0 * note(110.0), -1.0, 1.0) * 32767.0) / 32768.0, "is clipped"),
    "one channel clipped": (lambda: np.stack([note(110.0), np.clip(4.0 * note(110.0), -0.7, 0.7)], 1), "is clipped"),
    "silence": (lambda: np.zeros(T.size), "is silent"),
    "only an offset": (lambda: np.full(T.size, 0.3), r"is constant, at 0\.3 of full scale: an offset without sound"),
    "an offset below": (lambda: np.full(T.size, -0.999), r"is constant, at -0\.999 of full scale"),
    "an offset with noise of -120 dB": (lambda: 0.3 + 1e-5 * NOISE, "is constant, at 0.3"),
    "3 Hz": (lambda: 0.8 * np.sin(2 * np.pi * 3.0 * T), "the sound lies at 3 Hz, below the pitches .* 27 to 1600 Hz"),
    "3 Hz in 16 bits": (lambda: np.round(32700.0 * np.sin(2 * np.pi * 3.0 * T)) / 32768.0, "the sound lies at 3 Hz"),
    "3 Hz that is clipped": (lambda: np.clip(3.0 * np.sin(2 * np.pi * 3.0 * T), -0.7, 0.7), "the sound lies at 3 Hz"),
    "1 Hz": (lambda: 0.8 * np.sin(2 * np.pi * T), "the sound lies at (1|0.8|1.2).* Hz, below the pitches"),
    "15 Hz that fades": (lambda: 0.8 * np.sin(2 * np.pi * 15.0 * T) * np.exp(-T), "the sound lies at 15 Hz"),
    "a square wave": (lambda: 0.5 * np.sign(np.sin(2 * np.pi * 110.0 * T)), "is clipped"),
    "next to silence": (lambda: 1e-5 * NOISE, "is silent"),
    "too short": (lambda: note(110.0, 0.2), "must last at least 0.25 s"),
    "a click": (lambda: np.concatenate([np.zeros(1000), [1.0], np.zeros(44100)]), "no partials stand out"),
    "a sine": (lambda: 0.5 * np.sin(2 * np.pi * 220.0 * T), "no pitch was found"),
    "a sine that fades": (lambda: 0.5 * np.sin(2 * np.pi * 220.0 * T) * np.exp(-2.0 * T), "no pitch was found"),
    "a sawtooth": (lambda: 0.3 * ((110.0 * T) % 1.0 - 0.5), "does not decay"),
    "a sweep": (lambda: 0.5 * np.sin(2 * np.pi * (100.0 * T + 150.0 * T**2)), "no partials stand out"),
    "a sawtooth that glides": (lambda: 0.3 * ((110.0 * T + 5.0 * T**2) % 1.0 - 0.5) * np.exp(-T), "glides cannot be fitted"),
    "vibrato": (lambda: vibrato(), "strong partials, such as 105 and 115 Hz"),
    "a voice": (lambda: voice(), "a voice"),
    "a bell": (lambda: ringing([0.5, 1.0, 1.2, 1.5, 2.0, 2.6, 3.0, 4.2], 300.0), "strong partials, such as 360"),
    "a bar": (lambda: ringing([1.0, 2.756, 5.404, 8.933, 13.34, 18.64], 200.0), "strong partials, such as 200 and 551.2 Hz"),
    "a drum": (
        lambda: ringing([1.0, 1.594, 2.136, 2.296, 2.653, 2.918, 3.156, 3.501], 150.0),
        "strong partials, such as 150 and 344.4 Hz",
    ),
    "nothing": (lambda: np.zeros(0), "must hold samples"),
    "not numbers": (lambda: np.array([0.1, np.nan, 0.2] * 20000), "not finite"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_plucked_string_is_refused_with_the_reason(name: str) -> None:
    samples, reason = BAD[name]
    with pytest.raises(FitRefused, match=reason) as told:
        fit_recording(samples(), RATE)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("rate_hz", [0.0, 4000.0, 1e6])
def test_rates_out_of_range(rate_hz: float) -> None:
    with pytest.raises(FitRefused, match="the sample rate must lie between"):
        fit_recording(note(110.0), rate_hz)


GOOD = {
    "stereo": lambda: np.stack([note(110.0), 0.4 * note(110.0)], 1),
    "channels in opposite phase": lambda: np.stack([note(110.0), -note(110.0)], 1),
    "an offset": lambda: 0.3 * note(110.0) + 0.4,
    "silence first": lambda: np.concatenate([np.zeros(80000), note(110.0)]),
    "digital silence behind": lambda: np.concatenate([note(110.0), np.zeros(40000)]),
    "16 bits": lambda: np.round(note(110.0) * 20000.0) / 32768.0,
    "very soft": lambda: 1e-3 * note(110.0),
}


@pytest.mark.parametrize("name", GOOD)
def test_the_same_string_however_it_was_recorded(name: str) -> None:
    fit = fit_recording(GOOD[name](), RATE)
    assert abs(cents(fit.f0_hz, 110.0)) < 0.1
    assert fit.inharmonicity == pytest.approx(1e-4, rel=0.02)
    assert fit.pluck is not None and abs(fit.pluck.position - 0.21) < 0.005


def test_of_several_notes_the_first_is_measured() -> None:
    fit = fit_recording(np.concatenate([note(110.0, 1.0), note(146.8, 1.0), note(98.0, 1.0)]), RATE)
    assert abs(cents(fit.f0_hz, 110.0)) < 0.5
    assert any("another begins 1.1" in words or "another begins 1.0" in words for words in fit.warnings)


def test_a_note_that_is_damped_is_measured_up_to_there() -> None:
    x = note(110.0)
    fall = np.ones(x.size)
    at = round(1.5 * RATE)
    fall[at:] = np.exp(-60.0 * np.arange(x.size - at) / RATE)
    damped, whole = fit_recording(x * fall, RATE), fit_recording(x, RATE)
    assert any("cut off or damped" in words for words in damped.warnings)
    assert damped.partials[0].t60_s == pytest.approx(whole.partials[0].t60_s, rel=0.05)


def test_a_huge_file_is_looked_at_in_part() -> None:
    fit = fit_recording(np.concatenate([note(110.0), np.zeros(round(200 * RATE))]), RATE)
    assert any("only the first 60 s of 203 s" in words for words in fit.warnings)
    assert abs(cents(fit.f0_hz, 110.0)) < 0.1


def test_what_cannot_be_told_is_said() -> None:
    """A string an octave above whose B is four times as great shares all its partials: the fit says which are odd."""
    octave = render(steel(220.1, 4e-4), np.random.default_rng(0), snr_db=60.0)
    fit = fit_recording(note(110.0) + octave, RATE)
    assert abs(cents(fit.f0_hz, 110.0)) < 0.5
    assert any("without a single decay time" in words or "not a single exponential" in words for words in fit.warnings)
