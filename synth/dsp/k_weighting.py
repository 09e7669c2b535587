"""Loudness of a sound: ITU-R BS.1770-4, integrated, gated; K-weighting for any rate."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

#: length of a block and from block to block [s]
BLOCK_S, STEP_S = 0.4, 0.1
#: blocks below this are not counted [LUFS], nor those so far below what is left [LU]
ABSOLUTE_LUFS, RELATIVE_LU = -70.0, -10.0
_OFFSET = -0.691
#: the shelf's and the high-pass's frequency [Hz], gain [dB] and Q: with them the standard's coefficients at 48 kHz come out
_SHELF_HZ, _SHELF_DB, _SHELF_Q = 1681.974450955533, 3.999843853973347, 0.7071752369554196
_HIGH_PASS_HZ, _HIGH_PASS_Q = 38.13547087602444, 0.5003270373238773


def k_weighting(rate_hz: float) -> NDArray[np.float64]:
    """(2, 6) second-order sections of K-weighting, as SciPy has them (bilinear transform, frequencies warped)."""
    k = math.tan(math.pi * _SHELF_HZ / rate_hz)
    high, middle = 10.0 ** (_SHELF_DB / 20.0), 10.0 ** (_SHELF_DB / 20.0 * 0.4996667741545416)
    a0 = 1.0 + k / _SHELF_Q + k * k
    shelf = [
        (high + middle * k / _SHELF_Q + k * k) / a0,
        2.0 * (k * k - high) / a0,
        (high - middle * k / _SHELF_Q + k * k) / a0,
        1.0,
        2.0 * (k * k - 1.0) / a0,
        (1.0 - k / _SHELF_Q + k * k) / a0,
    ]
    k = math.tan(math.pi * _HIGH_PASS_HZ / rate_hz)
    a0 = 1.0 + k / _HIGH_PASS_Q + k * k
    return np.array([shelf, [1.0, -2.0, 1.0, 1.0, 2.0 * (k * k - 1.0) / a0, (1.0 - k / _HIGH_PASS_Q + k * k) / a0]])


def loudness_lufs(samples: NDArray[np.float64], rate_hz: float, gain: float = 1.0) -> float | None:
    """Integrated loudness of gain × (frames, channels), left and right alike, one channel counted once [LUFS]; None where
    nothing is louder than ABSOLUTE_LUFS. What is shorter than a block is one block."""
    if not len(samples):
        return None
    step = round(STEP_S * rate_hz)
    power = gain * gain * _powers(np.ascontiguousarray(samples, np.float64), k_weighting(rate_hz), step)
    steps = round(BLOCK_S / STEP_S)
    if len(samples) < steps * step:
        blocks = np.array([power.sum() / len(samples)])
    else:
        whole = np.concatenate(([0.0], np.cumsum(power[: len(samples) // step])))
        blocks = (whole[steps:] - whole[:-steps]) / (steps * step)
    heard = blocks[blocks > _power_of(ABSOLUTE_LUFS)]
    if not heard.size:
        return None
    heard = heard[heard > heard.mean() * 10.0 ** (RELATIVE_LU / 10.0)]
    return _OFFSET + 10.0 * math.log10(heard.mean())


@njit(cache=True, nogil=True)
def _powers(samples, sections, step):
    """Sums of squares of the weighted samples (frames, channels) of all channels, for each `step` frames begun."""
    frames, channels = samples.shape
    out = np.zeros((frames + step - 1) // step)
    b0, b1, b2, a1, a2 = sections[0, 0], sections[0, 1], sections[0, 2], sections[0, 4], sections[0, 5]
    c0, c1, c2, d1, d2 = sections[1, 0], sections[1, 1], sections[1, 2], sections[1, 4], sections[1, 5]
    for channel in range(channels):
        s1 = s2 = t1 = t2 = 0.0
        for number in range(out.size):
            total = 0.0
            for n in range(number * step, min(frames, (number + 1) * step)):
                x = samples[n, channel]
                y = b0 * x + s1
                s1 = b1 * x - a1 * y + s2
                s2 = b2 * x - a2 * y
                z = c0 * y + t1
                t1 = c1 * y - d1 * z + t2
                t2 = c2 * y - d2 * z
                total += z * z
            out[number] += total
    return out


def _power_of(lufs: float) -> float:
    return 10.0 ** ((lufs - _OFFSET) / 10.0)
