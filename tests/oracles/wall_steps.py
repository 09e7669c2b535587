"""Readable twin of `wall`: the same instants with plain matrices and whole rows at once. For tests and for reading."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tests.oracles.steps import held_force_propagator

Array = NDArray[np.float64]


def wall_steps(
    omega: Array, sigma: Array, mu: float, dt: float, length: float, numbers: Array, eta: Array, stiffness: float,
    e: float, q: Array, v: Array, steps: int,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """q, v (N,) after so many steps and the accounts (C,) of the nodes [J]; `numbers` (C,) of the nodes count from 1."""
    n = omega.size
    modes = np.arange(1, n + 1)
    spacing = length / (n + 1)
    shapes = math.sqrt(2.0 / length) * np.sin(np.pi * np.outer(numbers, modes) / (n + 1))
    fly = np.array([held_force_propagator(w, s, mu, dt)[:2, :2] for w, s in zip(omega, sigma, strict=True)], dtype=float)
    rigid = math.isinf(stiffness)
    kappa = 0.0 if rigid else (2.0 / dt * math.sin(0.5 * min(2.0, math.sqrt(stiffness / mu) * dt))) ** 2
    touching = np.zeros(eta.size, bool)
    account = np.zeros(eta.size)
    q, v = q.copy(), v.copy()
    for _ in range(steps):
        q, v = np.einsum("jab,bj->aj", fly, np.array([q, v]))
        gap, w = shapes @ q - eta, shapes @ v
        if rigid:
            after = np.where((w < 0.0) & (gap + 0.5 * dt * w <= 0.0), -e * w, w)
        else:
            inside = gap < 0.0
            touching |= inside & (w < 0.0)
            raw = w - kappa * np.where(w < 0.0, 1.0, e * e) * gap * dt
            # what a node pays in until it stops, and what it would like back after it has turned
            paid = np.where(w < 0.0, 0.5 * (w**2 - np.minimum(raw, 0.0) ** 2), 0.0)
            rebound = 0.5 * (raw**2 - np.maximum(w, 0.0) ** 2)
            wish = np.where(
                raw <= 0.0, 0.0, rebound if e == 1.0 else np.where(w < 0.0, rebound, rebound / max(e * e, 1e-300))
            )
            wish = np.where(inside, wish, np.inf)
            account = account + np.where(inside & touching, paid, 0.0)
            given = np.where(touching & ((w > 0.0) | inside), np.minimum(wish, account), 0.0)
            account = account - given
            turned = np.sqrt(np.maximum(w, 0.0) ** 2 + 2.0 * e * e * given)
            after = np.where(touching & (given > 0.0), turned, np.where(touching & inside & (w < 0.0), raw, w))
            touching &= inside & (account > 0.0)
            account = np.where(touching, account, 0.0)
        v = v + spacing * (after - w) @ shapes
    return q, v, mu * spacing * account
