"""Step coefficients of exact-hold for all modes of a string at once, in vectors: for strings that are bent while they sound.

The closed forms are those of `laws.step_coefficients`; what they need of exponentials and sines is made by power series, in
loops without a branch, to a few units in the last place:

    exp(−z) − 1 = t(t + 2), t = exp(−z/2) − 1        sin 2x = 2 sin x cos x, cos 2x = 1 − 2 sin² x, twice

with x a quarter of the angle that a mode turns by in a step, whole turns left out. Modes for which these are not as good
(angles beyond `_MOST`, losses beyond `_MOST_LOSS` or so large beside the angle that the terms cancel, near critical damping
or beyond) are left to `laws.hold_responses`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.laws import EXACT_HOLD, hold_responses, put_hold, step_coefficients
from synth.solver.vectors import FAST, INNER

#: largest angle ωΔt and loss σΔt of a mode that the series are for
_MOST, _MOST_LOSS = 1000.0, 0.5
#: 2π in two parts: of so many turns the first is exact
_TURN, _TURN_REST = 6.283185307176609, 2.9774189921946493e-12
#: …and largest loss in units of the angle's square: what is lost to cancellation are twice as many units in the last place
_LOSS_OF_SQUARE = 4.0


@njit(**INNER)
def quick_coefficients(law: int, omega, sigma, mu: float, dt: float, coef) -> None:
    """`laws.step_coefficients`: rows of `coef` (6, ≥N) for modes ω, σ (N,) [1/s], μ [kg/m], Δt [s]."""
    if law != EXACT_HOLD:
        step_coefficients(law, omega, sigma, mu, dt, coef)
        return
    n = omega.size
    _turn(omega, sigma, dt, coef[0, :n], coef[1, :n])
    _in_vectors(omega, sigma, 1.0 / mu, dt, coef[0, :n], coef[1, :n], coef[2, :n], coef[3, :n], coef[4, :n], coef[5, :n])
    left = int(np.int64(0))
    for j in range(n):
        left += _is_left(omega[j], sigma[j], dt)
    for j in range(n if left else 0):
        w, s = omega[j], sigma[j]
        if _is_left(w, s, dt):
            put_hold(w, mu, hold_responses(w, s, dt), coef, j)


@njit(inline="always")
def _is_left(w: float, s: float, dt: float) -> int:
    """1 where the series are not as good as the closed forms, else 0."""
    turn, loss = w * dt, s * dt
    far = (turn > _MOST) | (loss > _MOST_LOSS)
    return int(far | (loss > _LOSS_OF_SQUARE * turn * turn) | ((w - s) * (w + s) < 0.5 * w * w))


@njit(error_model="numpy", **INNER)
def _turn(omega, sigma, dt: float, angle, speed) -> None:
    """speed (N,) = √|ω² − σ²|, angle (N,) = speed Δt between −π and π. Not to be reordered."""
    for j in range(omega.size):
        w, s = omega[j], sigma[j]
        speed[j] = np.sqrt(abs((w - s) * (w + s)))
        whole = speed[j] * dt
        turns = np.floor(whole * (0.5 / np.pi) + 0.5)
        angle[j] = (whole - turns * _TURN) - turns * _TURN_REST


@njit(fastmath=FAST, error_model="numpy", **INNER)
def _in_vectors(omega, sigma, per_mu: float, dt: float, p11, p12, p21, p22, kq, kv) -> None:
    """All modes, those for which it is not meant too; p11 and p12 come with their angles and speeds (`_turn`)."""
    for j in range(omega.size):
        w, s = omega[j], sigma[j]
        turn, x = p12[j], 0.25 * p11[j]
        xx = x * x
        sine = 1.0 / 355687428096000.0 - xx / 121645100408832000.0
        sine = -1.0 / 1307674368000.0 + xx * sine
        sine = 1.0 / 6227020800.0 + xx * sine
        sine = -1.0 / 39916800.0 + xx * sine
        sine = 1.0 / 362880.0 + xx * sine
        sine = -1.0 / 5040.0 + xx * sine
        sine = 1.0 / 120.0 + xx * sine
        sine = -1.0 / 6.0 + xx * sine
        sine = x + x * (xx * sine)
        cosine = 1.0 / 20922789888000.0 - xx / 6402373705728000.0
        cosine = -1.0 / 87178291200.0 + xx * cosine
        cosine = 1.0 / 479001600.0 + xx * cosine
        cosine = -1.0 / 3628800.0 + xx * cosine
        cosine = 1.0 / 40320.0 + xx * cosine
        cosine = -1.0 / 720.0 + xx * cosine
        cosine = 1.0 / 24.0 + xx * cosine
        cosine = -0.5 + xx * cosine
        cosine = 1.0 + xx * cosine
        z = -0.5 * s * dt
        lost = 1.0 / 479001600.0 + z / 6227020800.0
        lost = 1.0 / 39916800.0 + z * lost
        lost = 1.0 / 3628800.0 + z * lost
        lost = 1.0 / 362880.0 + z * lost
        lost = 1.0 / 40320.0 + z * lost
        lost = 1.0 / 5040.0 + z * lost
        lost = 1.0 / 720.0 + z * lost
        lost = 1.0 / 120.0 + z * lost
        lost = 1.0 / 24.0 + z * lost
        lost = 1.0 / 6.0 + z * lost
        lost = 0.5 + z * lost
        lost = z + z * (z * lost)
        lost = lost * (lost + 2.0)  # exp(−σΔt) − 1
        decay = 1.0 + lost
        half = 2.0 * sine * cosine
        half_cosine = 1.0 - 2.0 * sine * sine
        whole = decay * (2.0 * half * half_cosine) / turn
        side = decay * (1.0 - 2.0 * half * half)
        own = (2.0 * decay * half * half - lost - s * whole) / (w * w)
        p11[j] = side + s * whole
        p12[j] = whole
        p21[j] = -w * w * whole
        p22[j] = side - s * whole
        kq[j] = own * per_mu
        kv[j] = whole * per_mu
