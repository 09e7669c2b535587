"""How fast a mode decays under a hand, and where a bend takes it too high."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.layout import CORE
from synth.units import LN_1000

#: T60 of a stolen or silenced string, and of what a bend carries beyond half the internal rate [s]
CUT_S = 0.03


@njit(**CORE)
def damping(sigma: float, hand: float, turn: float) -> float:
    """σ of a mode under a hand; `turn` = ω dt. Bent above half the internal rate, it would be heard mirrored: it is cut."""
    return sigma + hand + (LN_1000 / CUT_S if turn > math.pi else 0.0)
