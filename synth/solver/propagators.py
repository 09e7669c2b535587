"""Exact free flight over many steps at once: propagators for some numbers of steps, any other in parts."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from synth.solver.laws import EXACT_HOLD, coefficients
from synth.solver.stepwise import fly
from synth.solver.vectors import FAST

#: numbers of steps, each at most half as many again as the one before
STRIDES = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024)


class Flights(NamedTuple):
    """Propagators of N modes over K strides."""

    strides: np.ndarray  # (K,) int64 numbers of steps, rising from 1
    coef: np.ndarray  # (K, 6, N) as `laws.coefficients` gives them


def make_flights(omega: np.ndarray, sigma: np.ndarray, mu: float, dt: float) -> Flights:
    """For modes ω, σ (N,) [1/s], μ [kg/m] and steps of Δt [s]."""
    return Flights(np.array(STRIDES), np.array([coefficients(EXACT_HOLD, omega, sigma, mu, k * dt) for k in STRIDES]))


@njit(cache=True, nogil=True)
def largest(flights: Flights, steps: int) -> int:
    """Number of the largest stride of no more than so many steps, at least 1."""
    k = flights.strides.size - 1
    while flights.strides[k] > steps:
        k -= 1
    return k


@njit(cache=True, nogil=True)
def hop(flights: Flights, steps: int, q, v) -> None:
    """So many free steps of every mode, as few strides as it takes."""
    while steps > 0:
        k = largest(flights, steps)
        fly(flights.coef[k], q, v)
        steps -= flights.strides[k]


@njit(cache=True, nogil=True, fastmath=FAST)
def flown(coef, q, v, out_q, out_v) -> None:
    """`stepwise.fly` into other arrays."""
    n = q.size
    p11, p12, p21, p22 = coef[0, :n], coef[1, :n], coef[2, :n], coef[3, :n]
    out_q, out_v = out_q[:n], out_v[:n]
    for j in range(n):
        out_q[j] = p11[j] * q[j] + p12[j] * v[j]
        out_v[j] = p21[j] * q[j] + p22[j] * v[j]
