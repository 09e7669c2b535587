"""What varies from stroke to stroke: numbers that follow from a seed, a string and how many strokes it has had.

They are the same in every run, whatever else sounds, and on every machine (integers, splitmix64: Steele, Lea, Flood 2014).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from synth.engine.layout import CORE

#: what brings lines between even chances (`uneven`) to a standard deviation of 1
ROUGH = math.sqrt(4.5)


@njit(**CORE)
def _mixed(value):
    """splitmix64 of an unsigned 64-bit number."""
    z = value + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(**CORE)
def _even(state) -> float:
    """0 … 1 from an unsigned 64-bit number."""
    return float(state >> np.uint64(11)) * 2.0**-53


@njit(**CORE)
def key_of(seed: int, dice: int, strokes: int) -> int:
    """What the chances of one stroke follow from."""
    mixed = _mixed(_mixed(_mixed(np.uint64(seed)) ^ np.uint64(dice)) ^ np.uint64(strokes))
    return int(np.int64(mixed >> np.uint64(1)))


@njit(**CORE)
def even(key: int, number: int) -> float:
    """Evenly between −1 and 1, the number-th of a stroke."""
    return 2.0 * _even(_mixed(np.uint64(key) ^ _mixed(np.uint64(number)))) - 1.0


@njit(**CORE)
def spread(key: int, number: int) -> float:
    """About normally distributed with standard deviation 1 (a sum of four even ones), never beyond 3.5."""
    total = 0.0
    for k in range(4):
        total += even(key, 4 * number + k)
    return math.sqrt(0.75) * total


@njit(**CORE)
def uneven(key: int, first: int, at: float, from_rest: bool = False) -> float:
    """At `at` ≥ 0 of the lines between even chances at whole numbers, the first of them number `first` of a stroke; times
    `ROUGH` it has a standard deviation of 1. from_rest: it begins at 0."""
    knot = int(at)
    before = 0.0 if from_rest and knot == 0 else even(key, first + knot)
    return before + (at - knot) * (even(key, first + knot + 1) - before)
