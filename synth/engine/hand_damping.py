"""What tension and a hand do to modes: their frequencies, how fast they decay, and where a bend takes them too high."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from synth.engine.layout import CORE
from synth.units import LN_1000

#: T60 of a stolen or silenced string, and of what a bend carries beyond half the internal rate [s]
CUT_S = 0.03


@njit(**CORE)
def damping(sigma: float, hand: float, turn: float) -> float:
    """σ of a mode under a hand; `turn` = ω dt. Bent above half the internal rate, it would be heard mirrored: it is cut."""
    return sigma + hand + (LN_1000 / CUT_S if turn > math.pi else 0.0)


@njit(error_model="numpy", **CORE)
def raise_modes(omega, added: float, out) -> None:
    """out (≥N,): √(ω_j² + j² added) of modes ω (N,), in vectors; may be ω."""
    for j in range(omega.size):
        squared = omega[j] * omega[j]
        out[j] = np.sqrt(max(squared + added * (j + 1.0) * (j + 1.0), 1e-6 * squared))
