"""Where a string was plucked, from the levels of its partials at the onset.

Partial n is excited by |sin(nπp)|; what else there is (width of the finger, place of the pickup at the saddle, radiation,
tone controls) is taken for smooth in n: level = a + b ln n + c n + d n² [dB]. For every p the smooth part is fitted
robustly; the p that leaves least is the estimate, how sharply the rest is worse its uncertainty.

Levels alone do not tell p from 1 − p: the answer is the distance from the nearer end. Nor do they tell the place of
plucking from that of a pickup, which makes the same comb: on electric instruments it may be either.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: levels further (rms) beside the model may be another comb's, such as a pickup's [dB]
CLEAR_DB = 3.0
#: least partials for a place
LEAST_PARTIALS = 10
_GRID = np.arange(0.01, 0.50001, 0.0005)
# A node is never perfect; no level is known better than that.
_NODE, _FLOOR_DB = 0.01, 0.15
# A place less certain than that, or levels that lie further beside the model, do not tell it.
_MOST_ERROR, _MOST_SPREAD_DB = 0.03, 8.0
# Nearer to the end than that a comb is hardly told from the trend.
_NEAREST = 0.02


@dataclass(frozen=True)
class FittedPluck:
    """position: distance from the nearer end as a share of L.  error: half the width of what fits nearly as well (3σ).

    determined: whether the levels tell the place.  spread_db: rms beside the model.
    trend: (4,) coefficients of 1, ln n, n, n² in dB.
    """

    position: float
    error: float
    determined: bool
    spread_db: float
    trend: tuple[float, float, float, float]

    def levels_db(self, numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        """Levels of partials by the model [dB]."""
        return _trend_terms(numbers) @ np.array(self.trend) + _comb_db(numbers, np.array([self.position]))[0]


def _trend_terms(numbers: NDArray[np.int64]) -> NDArray[np.float64]:
    n = np.asarray(numbers, dtype=np.float64)
    return np.stack([np.ones_like(n), np.log(n), n / 10.0, (n / 10.0) ** 2], axis=1)


def _comb_db(numbers: NDArray[np.int64], positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """(positions, numbers)"""
    sine = np.sin(np.pi * np.outer(positions, numbers))
    return 10.0 * np.log10(sine**2 + _NODE**2)


def fit_pluck(
    numbers: NDArray[np.int64], levels_db: NDArray[np.float64], errors_db: NDArray[np.float64]
) -> FittedPluck | None:
    """The place of plucking from levels (n,) with their errors (n,) [dB]; None with too few partials."""
    if numbers.size < LEAST_PARTIALS:
        return None
    # Fewer partials carry less of a trend.
    terms = _trend_terms(numbers)[:, : 4 if numbers.size >= 16 else 3]
    combs = _comb_db(numbers, _GRID)
    scale = 2.0
    cost = np.zeros(_GRID.size)
    trends = np.zeros((_GRID.size, terms.shape[1]))
    best = 0
    for _ in range(4):
        sigma = np.sqrt(errors_db**2 + scale**2)
        cost, trends, left = _profile(terms, levels_db[None, :] - combs, sigma)
        best = int(np.argmin(cost))
        size = 1.4826 * float(np.median(np.abs(left[best])))
        size *= np.sqrt(numbers.size / max(1.0, numbers.size - terms.shape[1] - 1.0))
        scale = max(_FLOOR_DB, np.sqrt(max(0.0, size**2 - float(np.median(errors_db)) ** 2)))
    as_good = _GRID[cost < cost[best] + 9.0]
    position = _refined(cost, best)
    error = max(float(np.abs(as_good - position).max()), 0.5 * float(_GRID[1] - _GRID[0]))
    trend = np.zeros(4)
    trend[: terms.shape[1]] = trends[best]
    determined = error < _MOST_ERROR and scale < _MOST_SPREAD_DB and position > _NEAREST
    return FittedPluck(position, error, determined, float(scale), (trend[0], trend[1], trend[2], trend[3]))


def _profile(
    terms: NDArray[np.float64], wanted: NDArray[np.float64], sigma: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Robust trends for every row of wanted (P, n): costs (P,), coefficients (P, k), what is left (P, n)."""
    robust = np.ones_like(wanted)
    ridge = 1e-9 * np.eye(terms.shape[1])
    coefficients = np.zeros((wanted.shape[0], terms.shape[1]))
    left = wanted
    for _ in range(8):
        weight = robust / sigma**2
        normal = np.einsum("pn,ni,nj->pij", weight, terms, terms) + ridge
        right = np.einsum("pn,ni->pi", weight * wanted, terms)
        coefficients = np.linalg.solve(normal, right[..., None])[..., 0]
        left = wanted - coefficients @ terms.T
        robust = np.minimum(1.0, 2.0 * sigma / np.maximum(np.abs(left), 1e-12))
    z = np.abs(left) / sigma
    cost = np.where(z < 2.0, z**2, 4.0 * z - 4.0).sum(axis=1)  # Huber
    return cost, coefficients, left


def _refined(cost: NDArray[np.float64], best: int) -> float:
    """The minimum by a parabola through three neighbours."""
    if not 0 < best < cost.size - 1:
        return float(_GRID[best])
    a, b, c = cost[best - 1 : best + 2]
    curvature = a - 2.0 * b + c
    shift = 0.5 * (a - c) / curvature if curvature > 0.0 else 0.0
    return float(min(0.5, _GRID[best] + shift * (_GRID[1] - _GRID[0])))
