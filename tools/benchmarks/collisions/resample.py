"""A signal at other instants: picked where it has them, else by band-limited interpolation."""

from __future__ import annotations

import numpy as np

#: samples on either side that an interpolated value is made of, and the Kaiser window's β: −90 dB beside the passband
_REACH, _BETA = 48, 9.0
#: decimals of a sample to which an instant is taken: products of times and rates keep no more
_DIGITS = 10


def interpolated(u: np.ndarray, rate_hz: float, t: np.ndarray) -> np.ndarray:
    """u (n,) at rate_hz from t = 0, at the times t (m,) [s] within it: Kaiser-windowed sinc.

    Before its first sample the signal is mirrored, as a string that starts at rest goes both ways alike, behind its last one
    turned about that. What lies above half of rate_hz cannot be had back.
    """
    reach = min(_REACH, u.size - 1)
    padded = np.concatenate([u[reach:0:-1], u, 2.0 * u[-1] - u[-2 : -reach - 2 : -1]])
    place = t * rate_hz
    nearest = np.rint(place).astype(np.int64)
    offsets = np.arange(-reach, reach + 1)
    out = np.empty(t.size)
    for some in np.array_split(np.arange(t.size), max(1, t.size // 20_000)):
        if not some.size:
            continue
        # between rates of a simple ratio few fractions of a sample come again and again
        fractions, which = np.unique(np.round(place[some] - nearest[some], _DIGITS), return_inverse=True)
        distance = fractions[:, None] - offsets
        inside = np.sqrt(np.maximum(0.0, 1.0 - (distance / (reach + 1)) ** 2))
        taps = np.sinc(distance) * np.i0(_BETA * inside)
        taps /= np.sum(taps, axis=1, keepdims=True)
        index = np.clip(nearest[some, None] + offsets + reach, 0, padded.size - 1)
        out[some] = np.sum(taps[which] * padded[index], axis=1)
    return out
