"""The measure of a buzz, written from its definition (`synth.setup.audible`) and from IEC 61260-1 and IEC 61672-1.

    B = max_b 10 log₁₀ (E_b + m) / (E⁰_b + m)

over the third octaves of base ten whose middle lies between the fifth partial and 10 kHz; E_b and E⁰_b are A-weighted
energies with and without contact, from the touch of the finger until 0.25 s after the string is free, the last half of which
fades out as half a cosine; m lies 40 dB below the whole note without contact.
"""

from __future__ import annotations

import numpy as np

from setup_truth.scene import SECONDS, Scene

#: frequencies of the A weighting's poles [Hz]
_POLES = (20.598997, 107.65265, 737.86223, 12194.217)


def heard(scene: Scene, t: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, float]:
    """A-weighted energies of the bands, and of the whole signal, of displacements u (n, P) [m] at times t (n,) [s]."""
    signal = u @ scene.weights
    fading = np.clip((t - scene.free_s - 0.5 * SECONDS) / (0.5 * SECONDS), 0.0, 1.0)
    signal = signal * np.cos(0.5 * np.pi * fading) ** 2
    step = float(t[1] - t[0])
    if scene.speed:
        signal = np.diff(signal) / step
    spectrum = np.fft.rfft(signal)
    f = np.arange(spectrum.size) / (signal.size * step)
    weighted = np.abs(spectrum * _a_weighting(f)) ** 2
    bands = [
        float(weighted[(f >= middle * 10.0**-0.05) & (f < middle * 10.0**0.05)].sum()) for middle in _middles(scene.pitch_hz)
    ]
    return np.array(bands), float(weighted.sum())


def buzz_db(bands: np.ndarray, free: np.ndarray, whole: float) -> float:
    """B of energies with contact and without, `whole` the whole energy without."""
    floor = 1e-4 * whole
    return float(max((10.0 * np.log10((e + floor) / (e0 + floor)) for e, e0 in zip(bands, free, strict=True)), default=0.0))


def _middles(pitch_hz: float) -> list[float]:
    """Exact middle frequencies of the bands [Hz]."""
    every = [1000.0 * 10.0 ** (number / 10.0) for number in range(-20, 11)]
    return [each for each in every if each >= 5.0 * pitch_hz]


def _a_weighting(f: np.ndarray) -> np.ndarray:
    """Amplitude, but for a factor."""
    s = 2j * np.pi * f
    p1, p2, p3, p4 = (2.0 * np.pi * each for each in _POLES)
    return np.asarray(np.abs(s**4 / ((s + p1) ** 2 * (s + p2) * (s + p3) * (s + p4) ** 2)))
