"""Sounds as pictures: the outline of a wave, the rows of a spectrogram."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

#: of the outline of a wave
WAVE_BINS = 800
#: rows of a spectrogram, evenly in octaves between these frequencies
ROWS = 144
LOWEST_HZ, HIGHEST_HZ = 40.0, 18000.0


def waveform(x: np.ndarray, rate_hz: float, bins: int = WAVE_BINS) -> dict[str, Any]:
    """{bin_s, low, high}: smallest and largest sample of each of `bins` stretches of x (n,)."""
    bins = min(bins, x.size)
    starts = np.arange(bins) * x.size // bins
    return {
        "bin_s": x.size / bins / rate_hz,
        "low": np.round(np.minimum.reduceat(x, starts), 5).tolist(),
        "high": np.round(np.maximum.reduceat(x, starts), 5).tolist(),
    }


def rows_of_power(power: np.ndarray, bin_hz: float) -> tuple[list[float], np.ndarray]:
    """(frequencies of the rows [Hz], levels (ROWS, frames) [dB]) of power spectra (frames, bins).

    A row is the strongest bin in it, or lies between two bins where these are sparser than rows.
    """
    level = 10.0 * np.log10(np.maximum(power, 1e-300))
    edges = np.geomspace(LOWEST_HZ, HIGHEST_HZ, ROWS + 1)
    middles = np.sqrt(edges[1:] * edges[:-1])
    rows = np.empty((ROWS, len(level)))
    for row, middle in enumerate(middles):
        first, last = math.ceil(edges[row] / bin_hz), math.ceil(edges[row + 1] / bin_hz)
        if last > first:
            rows[row] = level[:, first:last].max(axis=1)
        else:
            share = middle / bin_hz - (first - 1)
            rows[row] = (1.0 - share) * level[:, first - 1] + share * level[:, first]
    return np.round(middles, 2).tolist(), rows
