"""How partials decay that are several vibrations: strings that share a bridge beat, and die away fast, then slowly.

Within the band of a partial the note's complex envelope is a sum of a few exponentials, Σ a e^((−σ + 2πi f) t), which a
matrix pencil finds (Hua & Sarkar, IEEE Trans. ASSP 38 (1990) 814). Of these

    early  the rate at which the energy falls at first, beats left out: Σ|a|²σ/Σ|a|²
    late   the rate of the one that is the strongest at the end of what is heard
    beat   the distance of the two strongest, where both last for a beat at least

(Weinreich, Coupled piano strings, JASA 62 (1977) 1474, has both rates and the beats of two strings.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from synth.fit.exponential import Bands
from synth.units import LN_1000

#: of the partial's band [of the fundamental], levels that are looked at [dB re its loudest], most exponentials and samples
BAND, WITHIN_DB, MOST, SAMPLES = 0.35, 50.0, 4, 300
#: singular values below that part of the largest are noise; of two that beat the weaker is at least so strong
NOISE, BEATING = 3e-3, 0.08
#: points of the envelope that are given
POINTS = 160


@dataclass(frozen=True)
class Stages:
    """Of one partial. t_s, level_db: its envelope, re full scale. early_t60_s, late_t60_s [s]; beat_hz and how deep the
    beats are at first, from crest to trough [dB], None where it does not beat; fitted_db: level of the exponentials at
    t_s."""

    t_s: np.ndarray
    level_db: np.ndarray
    fitted_db: np.ndarray
    early_t60_s: float
    late_t60_s: float
    beat_hz: float | None
    beat_db: float | None


def stages(bands: Bands, hz: float) -> Stages | None:
    """The stages of the partial at `hz`; None where it is not there, or not for long enough to tell."""
    t, y = bands.envelope(hz)
    if t.size < 16 or not np.abs(y).max() > 0.0:
        return None
    size = np.abs(y)
    loud = np.flatnonzero(size > size.max() * 10.0 ** (-WITHIN_DB / 20.0))
    begin = int(np.argmax(size[: max(1, t.size // 4)]))
    end = int(loud[-1]) + 1
    every = max(1, min((end - begin) // SAMPLES, int(1.0 / (2.5 * BAND * bands.spacing_hz * (t[1] - t[0])))))
    t, y = t[begin:end:every], y[begin:end:every]
    if t.size < 12:
        return None
    step = float(t[1] - t[0])
    poles = _poles(y, step, BAND * bands.spacing_hz)
    if poles.size == 0:
        return None
    amplitudes = np.linalg.lstsq(np.exp(np.outer(t - t[0], poles)), y, rcond=None)[0]
    power = np.abs(amplitudes) ** 2
    sigma = -poles.real
    early = float(power @ sigma / power.sum())
    late = float(sigma[np.argmax(np.log(power) - 2.0 * sigma * (t[-1] - t[0]))])
    if early <= 0.0 or late <= 0.0:
        return None
    beat_hz, beat_db = _beat(poles, np.sqrt(power), float(t[-1] - t[0]))
    shown = np.unique(np.linspace(0, t.size - 1, min(POINTS, t.size)).astype(int))
    fitted = np.abs(np.exp(np.outer(t[shown] - t[0], poles)) @ amplitudes)

    def decibels(x: np.ndarray) -> np.ndarray:
        return np.asarray(20.0 * np.log10(np.maximum(x, 1e-15)))

    return Stages(t[shown], decibels(np.abs(y[shown])), decibels(fitted), LN_1000 / early, LN_1000 / late, beat_hz, beat_db)


def _poles(y: np.ndarray, step_s: float, band_hz: float) -> np.ndarray:
    """s = −σ + 2πi f (K,) [1/s] of the exponentials in samples, those that decay within the band; maybe none."""
    rows = y.size // 2
    hankel = np.lib.stride_tricks.sliding_window_view(y, y.size - rows)
    left, values, _ = np.linalg.svd(hankel, full_matrices=False)
    for count in range(min(MOST, int(np.sum(values > NOISE * values[0]))), 0, -1):
        basis = left[:, :count]
        z = np.linalg.eigvals(np.linalg.lstsq(basis[:-1], basis[1:], rcond=None)[0])
        s = np.log(np.where(z == 0.0, 1e-30, z)) / step_s
        if np.all((s.real < 0.0) & (np.abs(s.imag) < 2.0 * math.pi * band_hz)):
            return np.asarray(s)
    return np.zeros(0, np.complex128)


def _beat(poles: np.ndarray, size: np.ndarray, length_s: float) -> tuple[float | None, float | None]:
    if poles.size < 2:
        return None, None
    first, second = np.argsort(size)[::-1][:2]
    hz = abs(float(poles[first].imag - poles[second].imag)) / (2.0 * math.pi)
    lasting_s = min(length_s, math.log(10.0) / float(max(-poles[first].real, -poles[second].real)))
    share = float(size[second] / size[first])
    if share < BEATING or hz * lasting_s < 1.0:
        return None, None
    return hz, 20.0 * math.log10((1.0 + share) / max(1.0 - share, 1e-3))
