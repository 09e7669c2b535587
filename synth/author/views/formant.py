"""The descending formant of a buzz: the ridge of the spectrogram along which a touched string's energy comes down.

At every touch of the bridge waves set out of which the high ones, faster on a stiff string, come back first. What the string
hands on at each round is strongest in a band of partials, which sinks from some kHz as the motion dies away: the tanpura's
sound. The ridge is found over all frames at once, as the path of greatest level with a price on leaps.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

#: the ridge is looked for between these partials, at most up to here
LOWEST, HIGHEST, HIGHEST_HZ = 3.0, 64.0, 12000.0
#: places per octave; level is counted as rising by so much per octave; what a leap costs
PER_OCTAVE = 24
TILT_DB, LEAP_DB = 6.0, 60.0
#: a formant sinks by this many octaves in at least this time, without leaps above this many octaves a frame, while touched
SINKS, LASTS_S, LEAP = 0.3, 0.25, 0.35


def descending_formant(
    power: np.ndarray, frequencies_hz: np.ndarray, times_s: np.ndarray, fundamental_hz: float, touched: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """(times_s, hz) of the ridge, both (m,), or None where nothing descends.

    power           (frames, bins) of a spectrogram
    frequencies_hz  (bins,); times_s (frames,) middles of the frames
    touched         (frames,) whether the string touched anything there
    """
    low, high = LOWEST * fundamental_hz, min(HIGHEST * fundamental_hz, HIGHEST_HZ, float(frequencies_hz[-1]))
    if times_s.size < 2 or high < 2.0 * low or not touched.any():
        return None
    grid = np.exp2(np.arange(np.log2(low), np.log2(high), 1.0 / PER_OCTAVE))
    path = _ridge(_levels(power, frequencies_hz, fundamental_hz, grid))
    octaves = np.log2(grid)[path]
    best: tuple[float, slice] | None = None
    for stretch in _stretches(octaves, (path > 0) & touched):
        sunk = float(octaves[stretch][0] - octaves[stretch][-1])
        lasted = float(times_s[stretch][-1] - times_s[stretch][0])
        if sunk >= SINKS and lasted >= LASTS_S and (best is None or lasted > best[0]):
            best = lasted, stretch
    if best is None:
        return None
    return times_s[best[1]], grid[path[best[1]]]


def _levels(power: np.ndarray, frequencies_hz: np.ndarray, fundamental_hz: float, grid: np.ndarray) -> np.ndarray:
    """(frames, grid) level [dB] of the spectrum smoothed over neighbouring partials, tilted."""
    weights = np.exp(-0.5 * ((grid[:, None] - frequencies_hz) / fundamental_hz) ** 2)
    weights /= weights.sum(axis=1, keepdims=True)
    smooth = power @ weights.T
    floor = max(float(smooth.max()) * 1e-15, 1e-300)
    return 10.0 * np.log10(np.maximum(smooth, floor)) + TILT_DB * np.log2(grid / grid[0])


def _ridge(levels: np.ndarray) -> np.ndarray:
    """(frames,) the path through (frames, places) of greatest sum, less the price of its leaps."""
    places = np.arange(levels.shape[1])
    price = LEAP_DB / PER_OCTAVE * np.abs(places[:, None] - places)
    total = levels[0]
    came_from = np.zeros(levels.shape, dtype=np.int64)
    for frame in range(1, len(levels)):
        through = total - price
        came_from[frame] = through.argmax(axis=1)
        total = levels[frame] + through[places, came_from[frame]]
    path = [int(total.argmax())]
    for frame in range(len(levels) - 1, 0, -1):
        path.append(int(came_from[frame, path[-1]]))
    return np.array(path[::-1])


def _stretches(octaves: np.ndarray, there: np.ndarray) -> list[slice]:
    """Frames in a row that are there and without a leap."""
    breaks = np.flatnonzero(~(there[1:] & there[:-1] & (np.abs(np.diff(octaves)) <= LEAP))) + 1
    edges = [0, *breaks.tolist(), octaves.size]
    return [slice(a, b) for a, b in pairwise(edges) if b - a > 1]
