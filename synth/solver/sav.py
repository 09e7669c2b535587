"""Compliant contact, explicit: one scalar auxiliary variable for the potential of all contacts, V = ψ²/2.

Bilbao, Ducceschi, Zama, J. Comput. Phys. 472 (2023), on the exact modal oscillator:

    f = ½(ψ⁺ + ψ⁻) G,   ψ⁺ = ψ⁻ + ½ Gᵀr,   G = ∇V(gⁿ)/√(2V(gⁿ)),   r + A f = b,

a rank-one update, so that a step takes A G and no solution of equations. The energy with ½ψ² in it is kept, but ψ drifts
from √(2V), and what is left of it when the string has gone waits for the next contact. The sign of ψ holds no energy;
ψ⁻ enters as |ψ⁻|, because below zero it would pull the string in and hold it there. `correction` κ in 0 … 1 takes that
part of the drift back over the step, G ← G − κ (ψ⁻ − √(2V)) d/(d·d) with d = b/2 at the contacts in reach: less drift,
the energy still kept, but not less error on stiff contacts.
"""

from __future__ import annotations

import math

from numba import njit

from synth.solver.penalty import force, potential


@njit(cache=True, nogil=True)
def forces(stiffness, exponent, compliance, correction, before, now, b, psi, f, r, gradient) -> float:
    """f, r (C,) of a step and ψ (1,) moved on; returns |ψ̄ − √(2V(gⁿ))| [√J]. gradient (C,) work space."""
    n = b.size
    here = 0.0
    for c in range(n):
        here += potential(stiffness, exponent, now[c])
    root = math.sqrt(2.0 * here)
    psi[0] = abs(psi[0])
    for c in range(n):
        gradient[c] = force(stiffness, exponent, now[c]) / root if root > 0.0 else 0.0
    if correction > 0.0:
        length, earlier = 0.0, 0.0
        for c in range(n):
            earlier += potential(stiffness, exponent, before[c])
            if now[c] > 0.0 or before[c] > 0.0:
                length += 0.25 * b[c] * b[c]
        if length > 0.0:
            back = correction * (psi[0] - math.sqrt(here + earlier)) / length
            for c in range(n):
                if now[c] > 0.0 or before[c] > 0.0:
                    gradient[c] -= 0.5 * back * b[c]
    along, own = 0.0, 0.0
    for c in range(n):
        f[c] = 0.0
        along += gradient[c] * b[c]
        for d in range(n):
            f[c] += compliance[c, d] * gradient[d]
        own += gradient[c] * f[c]
    mean = (psi[0] + 0.25 * along) / (1.0 + 0.25 * own)
    for c in range(n):
        r[c] = b[c] - f[c] * mean
    for c in range(n):
        f[c] = mean * gradient[c]
    psi[0] = 2.0 * mean - psi[0]
    return abs(mean - root)
