"""A string that is stopped elsewhere while it moves: its modes at the other length, and the height of its far end.

The string lies along x from its far end to the bridge, which keeps its place: u = Σ w φ + (x/L) b + (1 − x/L) a. Letters
with a dash are those of the other length; x_n is how far the shorter string's end is from the longer one's.

Shorter (L' = L − x_n). The end begins where the string is there, and the rest is the same shape and motion seen on less:

    a' = w(x_n) + x_n b/L + (1 − x_n/L) a,    w' = P w − d' w(x_n),    ẏ' = P ẏ,    P_ij = ∫ φ'_i(x) φ_j(x + x_n) dx

Longer (L' = L + x_n, the end at a'). Behind the stop the string was straight between both ends:

    ẏ' = Pᵀ ẏ,    w' = Pᵀ w + (a − x_n b/L' − (1 − x_n/L') a') √(2/L') sin(k x_n) L'/(x_n L k²)

By Bessel's inequality neither kinetic nor elastic energy grows where the string gets shorter: what was behind the stop, and
what the modes that are kept do not hold, is lost. A string that is let go gets what was drawn straight behind the stop,
½(T/x_n)(a − a')², which is the work of the hand that held it. Without bending stiffness it has no more than that; a stiff
one does not bend as sharply as the corner at the stop: `eased` rounds it, modes lessened by 1/(1 + τj²), until it has not.
"""

from __future__ import annotations

import math

import numpy as np

from synth.solver.coupled_study import far_moments


def overlap(long_m: float, short_m: float, n_long: int, n_short: int) -> np.ndarray:
    """P (n_short, n_long): ∫ φ'_i(x) φ_j(x + x_n) dx over the shorter string, x_n = long_m − short_m."""
    a = np.arange(1, n_short + 1)[:, None] * (math.pi / short_m)
    b = np.arange(1, n_long + 1)[None, :] * (math.pi / long_m)
    gap = (a - b) * (a + b)
    same = np.abs(gap) <= 1e-9 * a * a
    inner = a * np.sin(b * (long_m - short_m)) / np.where(same, 1.0, gap)
    signs = np.where((np.arange(1, n_short + 1)[:, None] + np.arange(1, n_long + 1)[None, :]) % 2 == 0, 1.0, -1.0)
    return 2.0 / math.sqrt(long_m * short_m) * np.where(same, signs * 0.5 * short_m, inner)


def stop(
    w: np.ndarray, y: np.ndarray, far: float, bridge: float, long_m: float, short_m: float, n: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """w' (n,), ẏ' (n,) and a' of a string of long_m that is stopped at short_m, from w, ẏ (N,), a and b [m]."""
    p = overlap(long_m, short_m, w.size, n)
    x = long_m - short_m
    there = math.sqrt(2.0 / long_m) * float(np.sin(np.arange(1, w.size + 1) * (math.pi * x / long_m)) @ w)
    height = there + x / long_m * bridge + (1.0 - x / long_m) * far
    return p @ w - far_moments(short_m, n) * there, p @ y, height


def release(
    w: np.ndarray, y: np.ndarray, far: float, bridge: float, short_m: float, long_m: float, far_after: float, n: int
) -> tuple[np.ndarray, np.ndarray]:
    """w' (n,), ẏ' (n,) of a string of short_m that is let go to long_m, whose end is at far_after."""
    p = overlap(long_m, short_m, n, w.size)
    x, k = long_m - short_m, np.arange(1, n + 1) * (math.pi / long_m)
    corner = far - x / long_m * bridge - (1.0 - x / long_m) * far_after
    return p.T @ w + corner * math.sqrt(2.0 / long_m) * np.sin(k * x) * long_m / (x * short_m * k**2), p.T @ y


def drawn_behind(far: float, far_after: float, tension_n: float, short_m: float, long_m: float) -> float:
    """Energy [J] of what is drawn straight from the end of the longer string to the stop."""
    return 0.5 * tension_n / (long_m - short_m) * (far - far_after) ** 2


def eased(w: np.ndarray, omega: np.ndarray, mu: float, most: float) -> np.ndarray:
    """w (N,), or the least rounded of w/(1 + τj²) whose energy ½μ Σ ω²w² is at most `most` ≥ 0 [J]."""
    j, energies = np.arange(1, w.size + 1), 0.5 * mu * (omega * w) ** 2

    def rounded(log: float) -> np.ndarray:
        return 1.0 / (1.0 + math.exp(log) * j**2)

    if energies.sum() <= most:
        return w
    low, high = -40.0, 80.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if (energies * rounded(middle) ** 2).sum() <= most else (middle, high)
    return w * rounded(high)
