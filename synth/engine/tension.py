"""Tension that rises with a string's own motion: a hard pluck begins sharp and glides down to its pitch.

A string that moves is longer than one at rest, by Kirchhoff and Carrier

    T = T₀ + EA/(2L) ∫ u′² dx = T₀ + EA/(2L) Σ k_j² q_j²,    k_j = jπ/L, φ_j = √(2/L) sin(k_j x),

EA its axial stiffness; u = Σ a_j sin(k_j x) has EA/4 Σ k_j² a_j². Quasi-static is the mean of that over each mode's own
period, ½(q² + v²/ω²) in the place of q² (Legge & Fletcher, JASA 76 (1984) 5; Tolonen, Välimäki & Karjalainen, IEEE Trans.
Speech Audio Process. 8 (2000) 300): what is left changes as slowly as the string decays, and can follow in steps. Left out
is the swing at twice a mode's frequency, which raises it by half its own part once more and couples it to others.

With E the energy of a string under T, that of one that is stretched is H = E − (T − T₀)² L/(2EA). A step from T to T′ adds
(T′ − T)(S − (S̄ + S̄′)/2) to it, S = ½ Σ k² q² now, S̄ and S̄′ its means at the step before and now. As T − T₀ goes with E,
that is at most about ½(T − T₀)/T times what E has changed by in between: a string that loses E loses H.
"""

from __future__ import annotations

import math

from numba import njit

from synth.engine.core import bank_of, expression_of, hand_of, model_of, shared_of, string_of
from synth.engine.expression import MOST_BEND
from synth.engine.layout import CHECK_EVERY, CORE, FIRST_QUANTUM
from synth.solver.vectors import FAST

#: the tension follows every CHECK_EVERY quanta, between two checks, which pass over strings whose coefficients are stale
_FOLLOW_AT = CHECK_EVERY // 2
#: …as soon as it is off by so much of itself (0.05 cents); a string that is stretched by less flies like any other
LEAST_RISE = 2.0 * math.log(2.0) * 0.05 / 1200.0
#: share of its tension by which a string's motion raises it, at most
MOST_RISE = 2.0 ** (MOST_BEND / 6.0)


@njit(**CORE)
def bend_with_motion(core: int, s: int, k: int, bend: float) -> float:
    """Semitones of a string that is bent by `bend` and stretched by its motion, in quantum k of the span."""
    second = bank_of(core).strings[s].second
    expression = expression_of(core, s)
    if (shared_of(core).task[FIRST_QUANTUM] + k) % CHECK_EVERY == _FOLLOW_AT:
        rise = _rise(core, s)
        if second >= 0:
            rise += _rise(core, second)
        if abs(rise - expression.rise) > LEAST_RISE:
            expression.rise = min(MOST_RISE, rise) if rise > LEAST_RISE else 0.0
    if expression.rise == 0.0:
        return bend
    return min(MOST_BEND, 6.0 * math.log2(2.0 ** (bend / 6.0) + expression.rise))


@njit(fastmath=FAST, **CORE)
def _stretch(omega, q, v) -> float:
    """Σ j²(q² + v²/ω²)"""
    total = 0.0
    for j in range(q.size):
        speed = v[j] / omega[j]
        total += (j + 1.0) * (j + 1.0) * (q[j] * q[j] + speed * speed)
    return total


@njit(**CORE)
def _rise(core: int, s: int) -> float:
    """Share of its tension by which what a string does in one direction raises it, over its modes' periods."""
    string, model = string_of(core, s), bank_of(core).models[hand_of(core, s).model]
    n, k = model.own, math.pi / model.length
    stretch = k * k * _stretch(model_of(core, s).omega[:n], string.q[:n], string.v[:n])
    return 0.25 * bank_of(core).strings[s].axial_stiffness / model.length * stretch / model.tension
