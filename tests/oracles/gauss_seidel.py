"""Projected Gauss–Seidel and projected successive over-relaxation for z ≥ 0, w = A z + b ≥ 0, zᵀw = 0.

Cryer, SIAM J. Control 9(3), 1971: for a symmetric positive definite A it converges for every relaxation in (0, 2), and
at a rate that falls with A's condition. w is kept along, so that a contact without a force costs nothing in a sweep.
"""

from __future__ import annotations

from numba import njit

from synth.solver.lcp import FEASIBILITY, NOT_SOLVED, SOLVED, gaps, natural
from synth.solver.vectors import add

#: sweeps after which `solve` gives up
MOST_SWEEPS = 1000


@njit
def solve(a, b, enabled, active, z, factor, index) -> int:
    """As `lcp.solve`, by projected Gauss–Seidel from z as it stands on the `active` contacts, to the same residual."""
    return relax(a, b, enabled, active, z, factor[0], 1.0, FEASIBILITY, MOST_SWEEPS)[0]


@njit
def relax(a, b, enabled, active, z, w, relaxation: float, tolerance: float, most: int) -> tuple[int, int]:
    """Sweeps until the natural residual on the enabled contacts is at most tolerance·max|b|: (status, sweeps).

    a (n, n) symmetric with a positive diagonal, b (n,), enabled (n,) uint8; active (n,) uint8 in: where z holds a first
    guess (forces of the step before), out: where z > 0; z (n,) in and out; w (n,) out: A z + b; relaxation in (0, 2),
    1 is Gauss–Seidel. NOT_SOLVED after `most` sweeps, z then being the last iterate.
    """
    n = b.size
    z = z[:n]
    scale = 0.0
    for i in range(n):
        if enabled[i]:
            scale = max(scale, abs(b[i]))
        z[i] = max(0.0, z[i]) if active[i] and enabled[i] else 0.0
    enough = tolerance * scale
    status, sweeps = NOT_SOLVED, 0
    gaps(a, b, z, w)
    if _residual(a, enabled, z, w) <= enough:
        status = SOLVED
    while status != SOLVED and sweeps < most:
        sweeps += 1
        for i in range(n):
            if enabled[i] and a[i, i] > 0.0 and (z[i] > 0.0 or w[i] < 0.0):
                force = max(0.0, z[i] - relaxation * w[i] / a[i, i])
                if force != z[i]:
                    add(force - z[i], a[i, :n], w)
                    z[i] = force
        if _residual(a, enabled, z, w) <= enough:
            gaps(a, b, z, w)  # w without the rounding of its many small changes
            if _residual(a, enabled, z, w) <= enough:
                status = SOLVED
    for i in range(n):
        active[i] = 1 if z[i] > 0.0 else 0
    return status, sweeps


@njit
def _residual(a, enabled, z, w) -> float:
    """`lcp.natural_residual` of the enabled contacts, w being known."""
    worst = 0.0
    for i in range(z.size):
        if enabled[i]:
            worst = max(worst, natural(a[i, i], z[i], w[i]))
    return worst
