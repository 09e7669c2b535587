"""Contact laws by name, and the exact step coefficients of one damped mode under each of them.

A mode obeys μ(q̈ + 2σq̇ + ω²q) = f. Every law here steps a pair (q, v) per mode by

    q_free = p11 q + p12 v        q ← q_free + kq f
    v_free = p21 q + p22 v        v ← v_free + kv f

and differs only in what v means, in the six numbers and in what the contact unknown f is:

exact-hold
    v = q̇, f a force [N] held over the step; (p) is the exact propagator Φ(Δt), kq and kv its step responses.
moreau-jean
    v = (qⁿ − qⁿ⁻¹)/Δt, f an impulse [N s] acting unfiltered on v (Issanchou et al., JASA 143(5), 2018, eqs 24–33).
moreau-jean-filtered
    the same with each mode's impulse multiplied by F = (1 − a + e)/(ωΔt)².

ω = 0 is a rigid motion and has its limits in every row (F → (1 − e^{−2σΔt})/(2σΔt), 1 without loss).
"""

from __future__ import annotations

import math

import numpy as np
from numba import float64, int64, njit

from synth.jit.entries import kernel
from synth.solver.contact_laws import check_scheme
from synth.solver.schemes import LAWS
from synth.solver.vectors import FAST, INNER

EXACT_HOLD = 0
MOREAU_JEAN = 1
MOREAU_JEAN_FILTERED = 2

#: numbers of the laws that the kernels know
NUMBERS: dict[str, int] = {
    "exact-hold": EXACT_HOLD,
    "moreau-jean": MOREAU_JEAN,
    "moreau-jean-filtered": MOREAU_JEAN_FILTERED,
}

#: Below this (ω + 2σ)Δt the power series in Δt replaces the closed forms, which cancel there.
_SERIES_BELOW = 0.25
_SERIES_TERMS = 16
#: ωΔt whose square is no number worth dividing by: a rigid motion
_RIGID_BELOW = 1e-150


def law_of(scheme: str) -> int:
    """The law's number for a scheme name, exact-hold's for a registered law (`contact_laws`). Raises ValueError, which names
    the known ones, for another."""
    return NUMBERS.get(check_scheme(scheme, LAWS), EXACT_HOLD)


@njit(**INNER)
def hold_responses(omega: float, sigma: float, dt: float):
    """(1 − p11)/ω², p12 and p11, p22 of q̈ + 2σq̇ + ω²q = 1 over one step, free of cancellation."""
    if (omega + 2.0 * sigma) * dt < _SERIES_BELOW:
        # y = Σ c_k Δt^k with y(0) = y'(0) = 0 and y'' = 1 − 2σy' − ω²y: y is the displacement response.
        c0, c1 = 0.0, 0.5
        y, yp = 0.5 * dt * dt, dt
        # coefficients are carried already multiplied by their power of Δt
        t0, t1 = c0 * dt, c1 * dt * dt
        for k in range(1, _SERIES_TERMS):
            t2 = -(2.0 * sigma * dt * (k + 1) * t1 + omega * omega * dt * dt * t0) / ((k + 1) * (k + 2))
            y += t2
            yp += (k + 2) * t2 / dt
            t0, t1 = t1, t2
        return y, yp, 1.0 - omega * omega * y, 1.0 - omega * omega * y - 2.0 * sigma * yp
    d2 = (omega - sigma) * (omega + sigma)
    decay = math.exp(-sigma * dt)
    if abs(d2) * dt * dt < 1e-4:  # critically damped or near it
        x = d2 * dt * dt
        cosine = decay * (1.0 - x / 2.0 + x * x / 24.0)
        sine = decay * dt * (1.0 - x / 6.0 + x * x / 120.0)
        p11 = cosine + sigma * sine
        y = (1.0 - p11) / (omega * omega)
    elif d2 > 0.0:
        wd = math.sqrt(d2)
        sine = decay * math.sin(wd * dt) / wd
        cosine = decay * math.cos(wd * dt)
        half = math.sin(0.5 * wd * dt)
        p11 = cosine + sigma * sine
        y = (-math.expm1(-sigma * dt) + 2.0 * decay * half * half - sigma * sine) / (omega * omega)
    else:
        s = math.sqrt(-d2)
        slow = omega * omega / (sigma + s)  # σ − s without cancellation
        e_slow, e_fast = math.exp(-slow * dt), math.exp(-(sigma + s) * dt)
        sine = (e_slow - e_fast) / (2.0 * s)
        cosine = 0.5 * (e_slow + e_fast)
        p11 = ((s + sigma) * e_slow - slow * e_fast) / (2.0 * s)
        # (1 − e^{−slow Δt})/ω² = Δt/(σ + s) · (1 − e^{−z})/z, which holds for ω = 0 too
        z = slow * dt
        y = (dt * (-math.expm1(-z) / z if z > 1e-300 else 1.0) + math.expm1(-(sigma + s) * dt) / (sigma + s)) / (2.0 * s)
    return y, sine, p11, cosine - sigma * sine


@njit(**INNER)
def _characteristic_at_one(omega: float, sigma: float, dt: float) -> float:
    """1 − a + e of the two-step form q⁺ = a q − e q⁻, as a sum or product of terms that do not cancel."""
    d2 = (omega - sigma) * (omega + sigma)
    if d2 >= 0.0:
        lost = math.expm1(-sigma * dt)
        half = math.sin(0.5 * math.sqrt(d2) * dt)
        return lost * lost + 4.0 * math.exp(-sigma * dt) * half * half
    s = math.sqrt(-d2)
    return math.expm1(-omega * omega / (sigma + s) * dt) * math.expm1(-(sigma + s) * dt)


@njit(inline="always")
def put_hold(omega: float, mu: float, responses, coef, j: int) -> None:
    """Column j of the step coefficients of exact-hold from `hold_responses`."""
    y, impulse, p11, p22 = responses
    coef[0, j] = p11
    coef[1, j] = impulse
    coef[2, j] = -omega * omega * impulse
    coef[3, j] = p22
    coef[4, j] = y / mu
    coef[5, j] = impulse / mu


@kernel(int64, float64[::1], float64[::1], float64, float64, float64[:, ::1])
def step_coefficients(law: int, omega, sigma, mu: float, dt: float, coef) -> None:
    """Fill `coef` (6, ≥N) with rows p11, p12, p21, p22, kq, kv for modes ω, σ (N,) [1/s], μ [kg/m], Δt [s]."""
    for j in range(omega.size):
        w, s = omega[j], sigma[j]
        if law == EXACT_HOLD:
            put_hold(w, mu, hold_responses(w, s, dt), coef, j)
        else:
            e = math.exp(-2.0 * s * dt)
            missing = _characteristic_at_one(w, s, dt)
            coef[0, j] = 1.0 - missing
            coef[1, j] = dt * e
            coef[2, j] = -missing / dt
            coef[3, j] = e
            gain = 1.0 / mu
            if law == MOREAU_JEAN_FILTERED:
                if w * dt > _RIGID_BELOW:
                    gain *= missing / (w * w * dt * dt)
                elif s > 0.0:
                    gain *= -math.expm1(-2.0 * s * dt) / (2.0 * s * dt)
            coef[4, j] = dt * gain
            coef[5, j] = gain


@kernel(int64, *[float64[:, ::1]] * 4, fastmath=FAST)
def contact_matrix(law: int, coef, shapes, residual, out) -> None:
    """Fill `out` (C, C): G = S diag(kq) Sᵀ + R (exact-hold) or the Delassus matrix S diag(kv) Sᵀ (Moreau–Jean)."""
    contacts, modes = shapes.shape
    row = 4 if law == EXACT_HOLD else 5
    for a in range(contacts):
        for b in range(a + 1):
            total = 0.0
            for j in range(modes):
                total += shapes[a, j] * coef[row, j] * shapes[b, j]
            if law == EXACT_HOLD:
                total += residual[a, b]
            out[a, b] = total
            out[b, a] = total


def coefficients(law: int, omega: np.ndarray, sigma: np.ndarray, mu: float, dt: float) -> np.ndarray:
    """A fresh (6, N) coefficient array; see `step_coefficients`."""
    coef = np.empty((6, omega.size))
    step_coefficients(law, np.ascontiguousarray(omega), np.ascontiguousarray(sigma), mu, dt, coef)
    return coef
