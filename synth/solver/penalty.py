"""The power law of a compliant contact, f = K [g]₊^α, its potential and their discrete forms.

g = η − u is how deep the string lies in the obstacle [m]; K [N/m^α] is the stiffness of a *point* contact. A law that
is written as a force per length, K_l [N/m^(α+1)] at the nodes of a grid of spacing Δx, as in Issanchou, Bilbao, Le
Carrou, Touzé, Doaré, J. Sound Vib. 393 (2017), has K = K_l Δx: 10¹³ on their grid of 1 mm is 10¹⁰ N/m^1.5 here.
"""

from __future__ import annotations

import math

from numba import njit

#: |Δg| below this part of g: the quotient's derivative ∫ t V''(g + tΔg) dt is taken at t = 2/3, O(ratio²) away.
_CLOSE = 1e-5


@njit(cache=True, nogil=True)
def _power(g: float, exponent: float) -> float:
    """g^α, g > 0; without `pow` for Hertz's 3/2."""
    return g * math.sqrt(g) if exponent == 1.5 else g**exponent


@njit(cache=True, nogil=True)
def potential(stiffness: float, exponent: float, g: float) -> float:
    """V(g) = K/(α + 1) [g]₊^(α+1) [J]."""
    return stiffness / (exponent + 1.0) * g * _power(g, exponent) if g > 0.0 else 0.0


@njit(cache=True, nogil=True)
def force(stiffness: float, exponent: float, g: float) -> float:
    """V'(g) = K [g]₊^α [N]."""
    return stiffness * _power(g, exponent) if g > 0.0 else 0.0


@njit(cache=True, nogil=True)
def discrete_gradient(stiffness: float, exponent: float, before: float, after: float) -> float:
    """(V(after) − V(before))/(after − before) [N] to rounding for any two depths, V'(g) where they are equal."""
    high, low = max(before, after), min(before, after)
    if high <= 0.0:
        return 0.0
    if low <= 0.0:
        return potential(stiffness, exponent, high) / (high - low)
    if exponent == 1.5:  # (a⁵ − b⁵)/(a² − b²) with the common factor taken out
        a, b = math.sqrt(high), math.sqrt(low)
        return 0.4 * stiffness * (high * high + low * low + a * b * (high + low + a * b)) / (a + b)
    ratio = (low - high) / high
    if ratio == 0.0:
        return force(stiffness, exponent, high)
    mean = math.expm1((exponent + 1.0) * math.log1p(ratio)) / ratio
    return stiffness / (exponent + 1.0) * high**exponent * mean


@njit(cache=True, nogil=True)
def discrete_gradient_slope(stiffness: float, exponent: float, before: float, after: float, quotient: float) -> float:
    """∂/∂after of `discrete_gradient` [N/m], given its value; never negative (V is convex)."""
    high = max(before, after)
    if high <= 0.0:
        return 0.0
    step = after - before
    if abs(step) < _CLOSE * high:
        return 0.5 * stiffness * exponent * max((before + 2.0 * after) / 3.0, 0.0) ** (exponent - 1.0)
    return max(0.0, (force(stiffness, exponent, after) - quotient) / step)


@njit(cache=True, nogil=True)
def root_potential_slope(stiffness: float, exponent: float, g: float) -> float:
    """ψ'(g) of ψ = √(2V) = √(2K/(α+1)) [g]₊^((α+1)/2) [√J/m]; ψ(g) = 2 g ψ'(g)/(α + 1)."""
    if g <= 0.0:
        return 0.0
    return math.sqrt(0.5 * stiffness * (exponent + 1.0)) * g ** (0.5 * (exponent - 1.0))


@njit(cache=True, nogil=True)
def solve_stiffened(compliance, k, right, x, matrix) -> None:
    """x (C,) of (I + A diag(k)) x = right with A (C, C) symmetric positive semidefinite and k ≥ 0.

    By Cholesky of I + √k A √k, which is at least I; rows with k = 0 only follow. matrix (C, C) work space.
    """
    n = right.size
    if n == 1:
        x[0] = right[0] / (1.0 + compliance[0, 0] * k[0])
        return
    # √k x solves (I + √k A √k) z = √k right
    for i in range(n):
        si = math.sqrt(k[i])
        for j in range(i + 1):
            total = si * compliance[i, j] * math.sqrt(k[j])
            if i == j:
                total += 1.0
            for m in range(j):
                total -= matrix[i, m] * matrix[j, m]
            if i == j:
                matrix[i, i] = math.sqrt(total)
            else:
                matrix[i, j] = total / matrix[j, j]
    for i in range(n):
        total = math.sqrt(k[i]) * right[i]
        for m in range(i):
            total -= matrix[i, m] * x[m]
        x[i] = total / matrix[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for m in range(i + 1, n):
            total -= matrix[m, i] * x[m]
        x[i] = total / matrix[i, i]
    # where k is stiff the difference right − A √k z cancels; z is still needed, so x goes to the diagonal first
    for i in range(n):
        if k[i] * compliance[i, i] > 1.0:
            matrix[i, i] = x[i] / math.sqrt(k[i])
            continue
        total = right[i]
        for j in range(n):
            if k[j] > 0.0:
                total -= compliance[i, j] * math.sqrt(k[j]) * x[j]
        matrix[i, i] = total
    for i in range(n):
        x[i] = matrix[i, i]
