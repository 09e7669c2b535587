"""A field of modes: what stands for a structure above the frequencies at which its modes are known one by one.

Of a plate or a neck only the density of its modes and their mean mobility are known there. The spacings s between
neighbouring modes of an irregular structure, in units of their mean, follow Wigner's law p(s) = (π/2) s exp(−πs²/4)
(Weaver, JASA 85(3), 1989, 1005), and what a mode does at a point is normally distributed over points, so that the mobility
scatters there as measured ones do; its mean is that of the infinite structure (Skudrzyk, JASA 67(4), 1980, 1105). Q scatters
by `Q_SPREAD`, an estimate.
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from functools import lru_cache
from statistics import NormalDist

#: standard deviation of ln Q from mode to mode
Q_SPREAD = 0.25
#: least |ψ| of a mode: a point close to a nodal line is not on it
LEAST_SHAPE = 0.1
#: fewest modes of one field in the mean, and most of them
LEAST_MODES, MOST_MODES = 2.0, 400
#: a mode of less would not oscillate
LEAST_Q = 0.51

_NORMAL = NormalDist()


@dataclass(frozen=True)
class FieldMode:
    """One mode of a field.

    frequency_hz, q; shape: ψ at a point in three directions, each of mean square 1 and independent of the others; radiation:
    the same of what is heard of it; pan: −1 left … 1 right, even
    """

    frequency_hz: float
    q: float
    shape: tuple[float, float, float]
    radiation: float
    pan: float


@lru_cache(maxsize=256)
def field_modes(low_hz: float, high_hz: float, spacing_hz: float, q: float, seed: int) -> tuple[FieldMode, ...]:
    """Modes up to high_hz, the first of them at low_hz, spacing_hz apart in the mean, about this Q.

    The same for the same seed; fields of one seed share shapes and losses. Raises ValueError for fewer than two modes in the
    mean, or more than 0.8 `MOST_MODES`.
    """
    expected = (high_hz - low_hz) / spacing_hz
    if not LEAST_MODES <= expected <= 0.8 * MOST_MODES:
        raise ValueError(
            f"a field of modes must have {LEAST_MODES:g} to {0.8 * MOST_MODES:.0f} modes from frequency_hz to to_hz in the "
            f"mean, got {expected:.4g} ({low_hz:g} to {high_hz:g} Hz every {spacing_hz:g} Hz); change spacing_hz or to_hz"
        )
    chance = random.Random(seed)
    found: list[FieldMode] = []
    frequency = low_hz
    while frequency <= high_hz and len(found) < MOST_MODES:
        loss = math.exp(Q_SPREAD * normal(chance))
        upright, lateral, rocking, radiation = (_not_nodal(normal(chance)) for _ in range(4))
        pan = 2.0 * chance.random() - 1.0
        found.append(FieldMode(frequency, max(LEAST_Q, q * loss), (upright, lateral, rocking), radiation, pan))
        frequency += spacing_hz * math.sqrt(-4.0 / math.pi * math.log(1.0 - chance.random()))
    return tuple(found)


def normal(chance: random.Random) -> float:
    """Normally distributed; by `random()` alone, which Python keeps the same from version to version."""
    return _NORMAL.inv_cdf(min(max(chance.random(), 1e-9), 1.0 - 1e-9))


def _not_nodal(value: float) -> float:
    return math.copysign(max(abs(value), LEAST_SHAPE), value)
