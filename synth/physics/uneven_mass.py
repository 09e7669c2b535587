"""How a string whose mass is uneven along it is out of tune with itself.

Of mass per length μ (1 + ε(x)) the n-th mode, whose motion is sin² (nπx/L), sees the mean and the 2n-th cosine: with
ε = Σ a_k cos(kπx/L) its frequency is that of the even string times 1 + a_2n/4, to first order (Rayleigh, Theory of Sound I,
§ 140). ε here is constant over pieces of `PIECE_M`, from the saddle on, and normally distributed from piece to piece. So
the shifts of partials do not depend on each other, vanish for partials whose half waves are no longer than a piece, and
belong to the string: a stopped string has those of the part that sounds, and the shorter that is, the more a piece counts.
"""

from __future__ import annotations

import math
import random
from functools import lru_cache

import numpy as np

from synth.physics.mode_field import normal

#: over what length of a string its mass is even [m], an estimate
PIECE_M = 0.005
#: frequency ratio of a cent, less 1
_CENT = math.log(2.0) / 1200.0


def scatter_of(cents: float, length_m: float) -> float:
    """Standard deviation of ε by which the partials of a string of this length are so many cents (rms) off."""
    return cents * _CENT * 4.0 * math.sqrt(0.5 * length_m / PIECE_M)


@lru_cache(maxsize=256)
def frequency_factors(length_m: float, scatter: float, seed: int, n: int) -> np.ndarray:
    """(n,) by what the modes are higher than those of an even string; scatter: standard deviation of ε.

    That of the first is 1, as a string is tuned by it: what its mass does to the first mode alone, the tuning undoes.
    """
    pieces = math.ceil(length_m / PIECE_M)
    uneven = scatter * _deviations(seed, 1 << pieces.bit_length())[:pieces]
    ends = np.minimum(PIECE_M * np.arange(pieces + 1), length_m) / length_m
    factors = np.ones(n)
    mode = np.arange(2, n + 1)
    cosines = np.diff(np.sin(2.0 * math.pi * mode[:, None] * ends), axis=1) @ uneven / (math.pi * mode)
    factors[1:] += 0.25 * cosines
    factors.flags.writeable = False
    return factors


@lru_cache(maxsize=64)
def _deviations(seed: int, pieces: int) -> np.ndarray:
    """(pieces,) ε of the first pieces of a string, in standard deviations."""
    chance = random.Random(seed)
    return np.array([normal(chance) for _ in range(pieces)])
