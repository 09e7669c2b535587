"""The body of an instrument as a bank of measured resonances: frequency, Q and gain of each.

A resonance is a damped oscillation A·e^(−at)·cos(bt + φ) with a = ω₀/(2Q), sampled exactly (impulse
invariance):

    H(z) = K (1 − z⁻¹) / (1 − 2 r cosθ z⁻¹ + r² z⁻²),   r = e^(−aT)

The zero at z = 1 keeps a static force out of the sound, as in a mobility, ω₀s/Q / (s² + ω₀s/Q + ω₀²). |H| of
this form has its maximum where cos ωT = cosθ − (cosh aT − 1). Choosing θ by that equation and K by |H| there
puts the peak exactly on the measured frequency with exactly the measured gain, at any rate and Q.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray


def body_coefficients(frequencies_hz, q, gains_db, rate_hz: float) -> NDArray[np.float64]:
    """Coefficients of a bank of resonances.

    Parameters
    ----------
    frequencies_hz : (m,) frequencies of the peaks [Hz], between 0 and rate_hz/2.
    q : (m,) quality factors, at least 1; the ring decays by 60 dB in 2.2·Q/f seconds.
    gains_db : (m,) gains at the peaks [dB].
    rate_hz : sample rate [Hz].

    Returns
    -------
    (3, m) rows K, 2 r cosθ, −r².

    Raises
    ------
    ValueError : lists of different lengths, or a value out of range.
    """
    f, quality, gain = (np.atleast_1d(np.asarray(a, dtype=np.float64)) for a in (frequencies_hz, q, gains_db))
    if not (f.ndim == 1 and f.shape == quality.shape == gain.shape):
        raise ValueError(
            "frequencies_hz, q and gains_db must have the same length, got "
            f"{f.size}, {quality.size} and {gain.size}; give one of each per resonance"
        )
    if not rate_hz > 0:
        raise ValueError(f"rate_hz must be positive, got {rate_hz:g} Hz; give the output rate")
    for i in range(f.size):
        if not 0 < f[i] < rate_hz / 2:
            raise ValueError(
                f"frequencies_hz[{i}] must lie between 0 and half the sample rate, {rate_hz / 2:g} Hz, "
                f"got {f[i]:g} Hz; remove that resonance or use a higher rate"
            )
        if not (quality[i] >= 1 and np.isfinite(quality[i])):
            raise ValueError(f"q[{i}] must be at least 1, got {quality[i]:g}; a broader hump is no resonance")
        if not np.isfinite(gain[i]):
            raise ValueError(f"gains_db[{i}] must be finite, got {gain[i]:g} dB; remove a resonance to silence it")
    peak = 2 * np.pi * f / rate_hz
    decay = peak / (2 * quality)
    r = np.exp(-decay)
    cos_theta = np.cos(peak) + np.cosh(decay) - 1
    z = np.exp(-1j * peak)
    unscaled = np.abs((1 - z) / (1 - 2 * r * cos_theta * z + (r * z) ** 2))
    return np.array([10 ** (gain / 20) / unscaled, 2 * r * cos_theta, -(r**2)])


def body_state(coefficients) -> NDArray[np.float64]:
    """State of a bank at rest: (3, m) last two outputs of every resonance, and in [2, 0] the last input."""
    m = coefficients.shape[1]
    return np.zeros((3, max(1, m)))


# Reassociation lets the sum over the resonances use vector registers: 2 times faster for 16 of them.
@njit(cache=True, nogil=True, fastmath={"reassoc", "nsz", "contract"})
def body_filter(coefficients, state, x, out):
    """Add the response of the bank to ``out``.

    Allocates nothing; bitwise the same for any split of the stream.

    Parameters
    ----------
    coefficients : (3, m) from :func:`body_coefficients`.
    state : from :func:`body_state`, updated.
    x : (n,) input.
    out : (n,) the response is added here; may not be ``x``.
    """
    scale, first, second = coefficients[0], coefficients[1], coefficients[2]
    y1, y2 = state[0], state[1]
    previous = state[2, 0]
    for n in range(x.size):
        difference = x[n] - previous
        previous = x[n]
        total = 0.0
        for j in range(scale.size):
            y = scale[j] * difference + first[j] * y1[j] + second[j] * y2[j]
            y2[j] = y1[j]
            y1[j] = y
            total += y
        out[n] += total
    state[2, 0] = previous
