"""Global search of the contact fit: a dictionary of notes, evolution from its best, and the shape of the minimum.

The unknowns of a note are numbers in a unit cube (`Space`). A scrambled Sobol sequence (SciPy) covers it; the best of what
it finds, far enough from each other, are where the covariance matrix adaptation (CMA-ES, Hansen & Ostermeier 2001; package
`cma`) starts. Around the minimum the loss is a quadratic form of the unknowns, fitted to all that was computed near it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]
#: notes of a dictionary, starts of the evolution, its population, first step and most evaluations of one start
NOTES, STARTS, POPULATION, STEP, MOST = 1024, 3, 8, 0.06, 400
#: starts lie that far from each other in the cube
APART = 0.12
SEED = 1


def sobol(dimensions: int, notes: int = NOTES) -> Real:
    """(notes, dimensions) in the unit cube."""
    from scipy.stats import qmc

    return np.asarray(qmc.Sobol(dimensions, seed=SEED).random(notes))


def starts_of(points: Real, losses: Real, count: int = STARTS, apart: float = APART) -> Real:
    """The best of (n, d) that are apart from each other."""
    chosen: list[Real] = []
    for i in np.argsort(losses):
        if all(float(np.abs(points[i] - other).max()) > apart for other in chosen):
            chosen.append(points[i])
        if len(chosen) == count:
            break
    return np.array(chosen)


@dataclass
class Trail:
    """Every point that was looked at and its loss."""

    function: Callable[[Real], float]
    points: list[Real] = field(default_factory=list)
    losses: list[float] = field(default_factory=list)

    def __call__(self, point: Real) -> float:
        loss = self.function(point)
        self.points.append(np.array(point))
        self.losses.append(loss)
        return loss

    @property
    def best(self) -> tuple[Real, float]:
        """Point and loss of the best."""
        i = int(np.argmin(self.losses))
        return self.points[i], self.losses[i]


def evolve(
    function: Callable[[Real], float], start: Sequence[float] | Real, *, step: float = STEP, most: int = MOST,
    tolerance: float = 2e-5, size: float = 2e-4, seed: int = SEED, population: int = POPULATION,
) -> Trail:  # fmt: skip
    """Evolution within the unit cube from a start, until neither loss (tolerance) nor place (size) change."""
    import cma

    trail = Trail(function)
    options = {
        "bounds": [0.0, 1.0],
        "popsize": population,
        "maxfevals": most,
        "tolfun": tolerance,
        "tolx": size,
        "verbose": -9,
        "verb_log": 0,
        "seed": seed,
    }
    evolution = cma.CMAEvolutionStrategy(np.clip(start, 0.01, 0.99), step, options)
    while not evolution.stop():
        points = evolution.ask()
        evolution.tell(points, [trail(np.asarray(point)) for point in points])
    return trail
