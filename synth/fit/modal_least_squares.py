"""Least squares of a body's modes: Ω, Q and a = ψ/√m of all of them together against a measured mobility.

    Y_ij(ω) = Σ_m a_mi a_mj iω/(Ω_m² − ω² + iωΩ_m/Q_m)

The modes that stand for those outside the band keep their Ω and Q. Unknowns are log Ω, log 1/Q and a, the slopes exact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: a resonance may lie so far beyond the band's ends and still be found
REACH = 1.3
LEAST_Q, MOST_Q = 1.0, 1000.0
#: steps at most, and relative gain of a step that is none
MOST_STEPS, SETTLED = 60, 1e-7


@dataclass
class Rows:
    """What is fitted: rows (n,), components (c, n), weights (c, n), pairs of axes as columns of a."""

    omega: NDArray[np.float64]
    y: NDArray[np.complex128]
    weights: NDArray[np.float64]
    pairs: list[tuple[int, int]]
    axes: tuple[int, ...]


@dataclass
class Modes:
    """Ω (M,), 1/Q (M,), a (M, axes), which of a are unknowns, and which modes are outside the band."""

    omega: NDArray[np.float64]
    loss: NDArray[np.float64]
    a: NDArray[np.float64]
    free: NDArray[np.bool_]
    outside: NDArray[np.bool_]

    def chosen(self, keep: NDArray[np.bool_]) -> Modes:
        return Modes(self.omega[keep], self.loss[keep], self.a[keep], self.free[keep], self.outside[keep])


def unit_mobilities(omega: NDArray[np.float64], modes: Modes) -> NDArray[np.complex128]:
    """(M, n): what each mode with a = 1 gives."""
    own = modes.omega[:, None]
    return 1j * omega / (own**2 - omega**2 + 1j * omega * own * modes.loss[:, None])


def stacked(rows: NDArray[np.complex128]) -> NDArray[np.float64]:
    """(2n, M) of (M, n)."""
    return np.concatenate([rows.real, rows.imag], axis=1).T


def residual_of(data: Rows, modes: Modes) -> NDArray[np.float64]:
    """(2cn,): weighted model less measurement."""
    gains = unit_mobilities(data.omega, modes)
    parts = [
        weight * ((modes.a[:, i] * modes.a[:, j]) @ gains - y)
        for (i, j), y, weight in zip(data.pairs, data.y, data.weights, strict=True)
    ]
    return np.concatenate([np.concatenate([part.real, part.imag]) for part in parts])


def explained_by(data: Rows, modes: Modes) -> float:
    """Part of the weighted power that the modes explain, 1 is all."""
    measured = np.sum(np.abs(data.y * data.weights) ** 2)
    return 1.0 - float(np.sum(residual_of(data, modes) ** 2) / measured)


def jacobian_of(data: Rows, modes: Modes) -> NDArray[np.float64]:
    """(2cn, unknowns): by log Ω and log loss of the modes inside, then by the a that are free."""
    gains, own = unit_mobilities(data.omega, modes), modes.omega[:, None]
    squared = gains**2 / (1j * data.omega)
    by_omega = -squared * (2.0 * own**2 + 1j * data.omega * own * modes.loss[:, None])
    by_loss = -squared * (1j * data.omega * own * modes.loss[:, None])
    inside = ~modes.outside
    blocks = []
    for (i, j), weight in zip(data.pairs, data.weights, strict=True):
        product = (modes.a[:, i] * modes.a[:, j])[:, None]
        by_a = np.zeros((*modes.a.shape, data.omega.size), np.complex128)
        by_a[:, i] += modes.a[:, j, None] * gains
        by_a[:, j] += modes.a[:, i, None] * gains
        rows = np.vstack([(product * by_omega)[inside], (product * by_loss)[inside], by_a[modes.free]])
        blocks.append(stacked(rows * weight))
    return np.vstack(blocks)


def packed(modes: Modes) -> NDArray[np.float64]:
    """The unknowns, in the order of `jacobian_of`'s columns."""
    inside = ~modes.outside
    return np.concatenate([np.log(modes.omega[inside]), np.log(modes.loss[inside]), modes.a[modes.free]])


def unpacked(x: NDArray[np.float64], like: Modes) -> Modes:
    """Modes with these unknowns, all else as in `like`."""
    inside = ~like.outside
    k = int(np.count_nonzero(inside))
    omega, loss, a = like.omega.copy(), like.loss.copy(), like.a.copy()
    omega[inside], loss[inside], a[like.free] = np.exp(x[:k]), np.exp(x[k : 2 * k]), x[2 * k :]
    return Modes(omega, loss, a, like.free, like.outside)


def refined(data: Rows, modes: Modes) -> Modes:
    """Levenberg's and Marquardt's steps on the normal equations, with Marquardt's scaling, Ω and Q within their bounds."""
    x = packed(modes)
    k = int(np.count_nonzero(~modes.outside))
    low, high = np.full(x.size, -np.inf), np.full(x.size, np.inf)
    low[:k], high[:k] = math.log(data.omega[0] / REACH), math.log(data.omega[-1] * REACH)
    low[k : 2 * k], high[k : 2 * k] = -math.log(MOST_Q), -math.log(LEAST_Q)
    x = np.clip(x, low, high)
    modes = unpacked(x, modes)
    residual = residual_of(data, modes)
    cost, damping = float(residual @ residual), 1e-3
    for _ in range(MOST_STEPS):
        jacobian = jacobian_of(data, modes)
        slope, square = jacobian.T @ residual, jacobian.T @ jacobian
        scale = np.maximum(np.diag(square), 1e-12 * np.diag(square).max(initial=1e-300))
        better = False
        while not better and damping < 1e8:
            step = np.linalg.lstsq(square + damping * np.diag(scale), -slope, rcond=1e-14)[0]
            tried = unpacked(np.clip(x + step, low, high), modes)
            left = residual_of(data, tried)
            better = float(left @ left) < cost
            damping *= 0.2 if better else 5.0
        if not better:
            break
        before, cost = cost, float(left @ left)
        x, modes, residual = packed(tried), tried, left
        if before - cost < SETTLED * cost:
            break
    return modes
