"""Compliant contact without iteration: energy quadratisation, V = ψ²/2 with ψ carried along.

Ducceschi, Bilbao, Willemsen, Serafin, JASA 149(5), 2021. Every contact has a ψ at half steps and

    f = ½(ψ⁺ + ψ⁻) G,   ψ⁺ = ψ⁻ + ½ G r,   r = g⁺ − g⁻,   G = ψ'(gⁿ),   r + A f = b,

which is linear in r. Energy is kept whatever G is, but ψ is not √(2V(g)) any more. Two choices of theirs mend what
comes of that: ψ enters with the sign of G, so that a ψ that fell below zero repels and does not attract, and where the
string is clear of the obstacle (gⁿ ≤ 0) G = −2ψ⁻/b, which gives the string back what ψ still holds.
"""

from __future__ import annotations

from numba import njit

from synth.solver.penalty import root_potential_slope, solve_stiffened


@njit(cache=True, nogil=True)
def forces(stiffness, exponent, compliance, drag, now, b, psi, f, r, work, matrix) -> float:
    """f, r (C,) of a step and ψ (C,) moved on; returns the largest |ψ̄ − ψ(gⁿ)| [√J].

    now (C,) gⁿ, drag (C,) = Q/(2Δt) [N/m] of Hunt and Crossley's loss; work (≥3, C) and matrix (C, C) work space.
    """
    n = b.size
    slope, k, right = work[0], work[1], work[2]
    for c in range(n):
        psi[c] = abs(psi[c])
        slope[c] = root_potential_slope(stiffness, exponent, now[c])
        if now[c] <= 0.0 and b[c] != 0.0:
            slope[c] = -2.0 * psi[c] / b[c]
        f[c] = slope[c] * psi[c]
        k[c] = 0.25 * slope[c] * slope[c] + drag[c]
    for c in range(n):
        right[c] = b[c]
        for d in range(n):
            right[c] -= compliance[c, d] * f[d]
    solve_stiffened(compliance, k, right, r, matrix)
    drift = 0.0
    for c in range(n):
        f[c] += k[c] * r[c]
        change = 0.5 * slope[c] * r[c]
        if now[c] > 0.0:
            drift = max(drift, abs(psi[c] + 0.5 * change - 2.0 * now[c] * slope[c] / (exponent + 1.0)))
        else:
            drift = max(drift, abs(psi[c] + 0.5 * change))
        psi[c] += change
    return drift
