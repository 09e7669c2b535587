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
#: modes are computed in blocks of the square of this
_BLOCK = 32


def scatter_of(cents: float, length_m: float) -> float:
    """Standard deviation of ε by which the partials of a string of this length are so many cents (rms) off."""
    return cents * _CENT * 4.0 * math.sqrt(0.5 * length_m / PIECE_M)


def frequency_factors(length_m: float, scatter: float, seed: int, n: int) -> np.ndarray:
    """(n,) by what the modes are higher than those of an even string; scatter: standard deviation of ε.

    That of the first is 1, as a string is tuned by it: what its mass does to the first mode alone, the tuning undoes.
    """
    return _of_blocks(length_m, scatter, seed, 1 + n // _BLOCK**2)[:n]


@lru_cache(maxsize=64)
def _of_blocks(length_m: float, scatter: float, seed: int, blocks: int) -> np.ndarray:
    """`frequency_factors` of the first modes, so many blocks of them; whatever their number, those of a block are the same.

    πn a_2n/2 is a sum of sines of 2πnx at the ends of pieces, by the steps of ε there. With n − 1 = `_BLOCK` i + j,
    e^(2πinx) is a product of what belongs to i and to j.
    """
    pieces = math.ceil(length_m / PIECE_M)
    uneven = scatter * _deviations(seed, 1 << pieces.bit_length())[:pieces]
    turn = np.exp(2j * math.pi * PIECE_M / length_m * np.arange(1, pieces))  # the sines vanish at the ends of the string
    small = turn * _powers(turn, _BLOCK)
    large = _powers(small[-1], blocks * _BLOCK).reshape(blocks, _BLOCK, -1)
    small = small * (uneven[:-1] - uneven[1:])
    sines = large.real @ small.imag.T + large.imag @ small.real.T
    factors = 1.0 + 0.25 / math.pi * sines.reshape(-1) / np.arange(1, sines.size + 1)
    factors[0] = 1.0
    factors.flags.writeable = False
    return factors


def _powers(base: np.ndarray, count: int) -> np.ndarray:
    """(count, size) powers 0 … count − 1 of each."""
    powers, known = np.ones((count, base.size), complex), 1
    while known < count:
        powers[known : 2 * known] = powers[: min(known, count - known)] * base
        known, base = 2 * known, base * base
    return powers


@lru_cache(maxsize=64)
def _deviations(seed: int, pieces: int) -> np.ndarray:
    """(pieces,) ε of the first pieces of a string, in standard deviations."""
    chance = random.Random(seed)
    return np.array([normal(chance) for _ in range(pieces)])
