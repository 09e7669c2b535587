"""Controls of the impostor test: sines that must be told from recordings, and an equaliser that must not move them."""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np
from scipy.signal import butter, lfilter, sosfilt

from truth_of_sound.families import Notes
from truth_of_sound.note_features import RATE_HZ, Samples, features

#: bells of the equaliser: Hz, dB
BELLS = ((70, 6), (200, -8), (500, 9), (900, -9), (1600, 10), (3000, 10))


def sines(note: float, loud: float, seconds: float = 5.0) -> Samples:
    """Forty sines as a control: twenty pairs 0.8 Hz apart, T60 from 14 down to 2 s, no string and no pluck; loud 0 … 1."""
    tilt = (-15.0, -9.0, -6.0)[min(2, int(3.0 * loud))]
    pairs = _pairs(note, seconds)
    x = np.zeros_like(pairs[0])
    for number, pair in enumerate(pairs, 1):
        x += 10.0 ** (tilt * np.log2(number) / 20.0) * pair
    return np.concatenate([np.zeros(RATE_HZ // 20), 0.1 * x])


@lru_cache(maxsize=1)
def _pairs(note: float, seconds: float) -> list[Samples]:
    """The twenty pairs, each as loud as the first: they are the same however loud a note is."""
    f0, t = 440.0 * 2.0 ** ((note - 69.0) / 12.0), np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    decays = {t60: np.exp(-np.log(1000.0) * t / t60) for t60 in (14.0, 8.0, 4.0, 2.0)}
    out = []
    for number in range(1, 21):
        f = number * f0 * np.sqrt(1.0 + 1e-4 * number**2)
        t60 = 14.0 if number == 1 else 8.0 if number < 6 else 4.0 if number < 13 else 2.0
        pair = np.sin(2.0 * np.pi * f * t) + 0.15 * np.sin(2.0 * np.pi * (f + 0.8) * t)
        out.append(decays[t60] * pair)
    return out


def sine_notes(notes: tuple[int, ...]) -> Notes:
    """Features of the forty sines, soft, medium and loud."""
    return [found for note in notes for found in _sine_note(note)]


@cache
def _sine_note(note: int) -> Notes:
    """Of one note: families share some."""
    return [features(sines(note, loud), RATE_HZ, note) for loud in (0.1, 0.5, 0.9)]


def equalised(x: Samples, rate_hz: float) -> Samples:
    """Behind six bells of 6 to 10 dB: a recording must be told as before."""
    for hz, gain_db in BELLS:
        a, w = 10.0 ** (gain_db / 40.0), 2.0 * np.pi * hz / rate_hz
        slope = np.sin(w) / 2.0
        x = lfilter(
            [1.0 + slope * a, -2.0 * np.cos(w), 1.0 - slope * a], [1.0 + slope / a, -2.0 * np.cos(w), 1.0 - slope / a], x
        )
    return sosfilt(butter(1, 20.0, "high", fs=rate_hz, output="sos"), x)
