"""An elastic bar thrown against a rigid wall.

D. Doyen, A. Ern and S. Piperno, "Time-integration schemes for the finite element dynamic Signorini problem", SIAM J. Sci.
Comput. 33(1), 2011, section 5 (E = 900, ρ = 1, L = 10, h₀ = 5, v₀ = 10, unit section). The bar comes with v₀; a wave of
compression runs from the wall to its free end and back as relief, at c = √(E/ρ), while the wall pushes with E v₀/c; after
2L/c every part moves away with v₀, undeformed. In modes it is free at both ends, and the first of them is rigid (ω = 0).
"""

from __future__ import annotations

import math

import numpy as np


def displacement(x: np.ndarray, t: np.ndarray, length: float, speed: float, gap: float, throw: float) -> np.ndarray:
    """Height over the wall, less x, of the part x ∈ [0, L] above the bar's lower end, at times t; gap h₀, throw v₀ > 0."""
    landing = gap / throw
    t, x = np.asarray(t, dtype=np.float64), np.asarray(x, dtype=np.float64)
    stopped = landing + x / speed
    away = landing + (2.0 * length - x) / speed
    return gap - throw * np.minimum(t, stopped) + throw * np.maximum(0.0, t - away)


def contact_force(t: np.ndarray, length: float, modulus: float, speed: float, gap: float, throw: float) -> np.ndarray:
    """E v₀/c during the contact, h₀/v₀ < t < h₀/v₀ + 2L/c, else 0 (unit section)."""
    since = np.asarray(t, dtype=np.float64) - gap / throw
    return np.where((since > 0.0) & (since < 2.0 * length / speed), modulus * throw / speed, 0.0)


def modes(length: float, speed: float, n: int) -> np.ndarray:
    """ω_j (n,) of a bar free at both ends: 0, πc/L, 2πc/L, …"""
    return np.arange(n) * (math.pi * speed / length)


def shapes(length: float, x: np.ndarray, n: int) -> np.ndarray:
    """(P, n) mode shapes of unit norm at x (P,): 1/√L, √(2/L) cos(jπx/L)."""
    values = math.sqrt(2.0 / length) * np.cos(np.outer(np.atleast_1d(x), np.arange(n)) * (math.pi / length))
    values[:, 0] = 1.0 / math.sqrt(length)
    return values


def end_compliance(length: float, modulus: float, n: int) -> float:
    """Static compliance of the modes left out above the first n, at the bar's end: Σ_{j≥n} 2L/(E π² j²) (unit section)."""
    j = np.arange(1, n)
    return 2.0 * length / (modulus * math.pi**2) * float(math.pi**2 / 6.0 - np.sum(1.0 / j[::-1] ** 2))
