"""A detector of clicks: what stands out of the sound before and after it, where its curve bends most sharply.

A click is a step, a kink or a lost sample: in the second difference of the signal it is a peak of some samples' width. A
string has sharp bends, too, whenever a wave comes round, but of these there are as many before or behind. So a click is a
peak of the second difference that is `FACTOR` times as large as the largest one from `GAP_S` to `AROUND_S` away, on both
sides. So much finds a step of a tenth of the level around it in the loudest, brightest sounds of a bass, and one of a
hundredth in its dull ones.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d

#: how far a click stands out
FACTOR = 3.0
#: its neighbourhood: from so far to so far [s]
GAP_S, AROUND_S = 0.0015, 0.03
#: what is bent less than this share of full scale is not heard as a click
LEAST = 1e-6


def prominence(x: np.ndarray, rate_hz: float) -> np.ndarray:
    """(n,) how many times larger the second difference of x (n,) is than around it, before and after."""
    bent = np.zeros(len(x))
    bent[1:-1] = np.abs(np.diff(x, 2))
    gap, around = round(GAP_S * rate_hz), round(AROUND_S * rate_hz)
    width = around - gap
    largest = maximum_filter1d(bent, width, mode="constant")  # centred
    shift = gap + width // 2
    before, after = np.zeros(len(x)), np.zeros(len(x))
    before[shift:] = largest[: len(x) - shift]
    after[: len(x) - shift] = largest[shift:]
    return bent / np.maximum(np.maximum(before, after), LEAST)


def clicks(x: np.ndarray, rate_hz: float, factor: float = FACTOR) -> list[tuple[int, float]]:
    """(frame, prominence) of every click of a signal (n,) or (n, channels), the sharpest of each neighbourhood."""
    many = x if x.ndim == 2 else x[:, np.newaxis]
    found = np.max([prominence(many[:, c], rate_hz) for c in range(many.shape[1])], axis=0)
    out: list[tuple[int, float]] = []
    gap = round(GAP_S * rate_hz)
    for frame in np.flatnonzero(found > factor):
        if out and frame - out[-1][0] <= gap:
            if found[frame] > out[-1][1]:
                out[-1] = (int(frame), float(found[frame]))
            continue
        out.append((int(frame), float(found[frame])))
    return out
