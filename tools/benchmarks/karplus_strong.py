"""A plucked string as most programs have it: noise round a delay line (Karplus & Strong, Computer Music Journal 7(2), 1983).

The fractional delay is the all-pass filter of Jaffe & Smith (the same issue). No contact, no stiffness, no losses by
frequency but those of the mean of two samples: it is here as what a user might run instead, not as the same sound.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(nogil=True, cache=True)
def _pluck(line, ratio, loss, out):
    at, before, before_in, before_out = 0, 0.0, 0.0, 0.0
    for t in range(out.size):
        now = line[at]
        mean = loss * 0.5 * (now + before)
        before = now
        passed = ratio * (mean - before_out) + before_in
        before_in, before_out = mean, passed
        line[at] = passed
        out[t] += now
        at += 1
        if at == line.size:
            at = 0


def pluck(frequency_hz: float, out: np.ndarray, rate_hz: float, velocity: int = 100, loss: float = 0.996) -> None:
    """Add one note to out (frames,)."""
    period = rate_hz / frequency_hz - 0.5
    whole = int(period - 0.1)
    rest = period - whole
    line = (velocity / 127.0) * np.random.default_rng(1).uniform(-1.0, 1.0, whole)
    _pluck(line, (1.0 - rest) / (1.0 + rest), loss, out)
