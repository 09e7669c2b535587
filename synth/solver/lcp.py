"""Linear complementarity problems z ≥ 0, w = A z + b ≥ 0, zᵀw = 0 with a symmetric positive semidefinite A.

`solve` is block principal pivoting (Kostreva 1978; Júdice and Pires, Computers & OR 21(5), 1994): every infeasible
index changes sides at once while that helps, and one at a time (Murty's rule, finite for P-matrices) when it does
not. It starts from the active set it is given, so that a contact that lasts costs one factorisation a step.
`natural_residual` judges any solver's answer.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: w may fall this much below zero, relative to the largest |b|: rounding of one Cholesky solve of ≤ 40 unknowns.
FEASIBILITY = 1e-13
#: a pivot below this times its diagonal means contacts that depend on each other (coincident, or more than modes).
_DEPENDENT = 1e-13
#: then each contact is given this fraction of its own compliance, which makes the matrix definite: at a millimetre of
#: prevented penetration it lets 1e-14 m through.
_SOFTENING = 1e-11

SOLVED = 0
NOT_SOLVED = 1


@njit(cache=True, nogil=True)
def solve(a, b, enabled, active, z, factor, index) -> int:
    """Solve the LCP on the enabled indices; z of the others is 0.

    a (n, n) symmetric positive semidefinite, b (n,), enabled (n,) uint8, active (n,) uint8 in: first guess, out: the
    set with z > 0, z (n,) out, factor (n, n) and index (n,) int64 work space. Returns SOLVED or NOT_SOLVED.
    """
    n = b.size
    scale = 0.0
    for i in range(n):
        if enabled[i]:
            scale = max(scale, abs(b[i]))
        else:
            active[i] = 0
    tolerance = FEASIBILITY * scale
    softening = 0.0
    best = n + 1
    patience = 3
    for _ in range(50 + 20 * n):
        if not _solve_on_active(a, b, softening, active, z, factor, index):
            softening = _SOFTENING
            best = n + 1
            _solve_on_active(a, b, softening, active, z, factor, index)
        wrong = 0
        for i in range(n):
            if not enabled[i]:
                continue
            if active[i]:
                infeasible = z[i] < 0.0
            else:
                w = b[i]
                for k in range(n):
                    w += a[i, k] * z[k]
                infeasible = w < -tolerance
            if infeasible:
                index[wrong] = i
                wrong += 1
        if wrong == 0:
            return SOLVED
        if wrong < best:
            best = wrong
            patience = 3
        else:
            patience -= 1
        first = 0 if patience >= 0 else wrong - 1
        for k in range(first, wrong):
            active[index[k]] = 1 - active[index[k]]
    for i in range(n):
        z[i] = max(z[i], 0.0)
    return NOT_SOLVED


@njit(cache=True, nogil=True)
def _solve_on_active(a, b, softening: float, active, z, factor, index) -> bool:
    """z on the active set from A z = −b by Cholesky, zero elsewhere; False where A is singular there."""
    n = b.size
    m = 0
    for i in range(n):
        z[i] = 0.0
        if active[i]:
            index[m] = i
            m += 1
    for r in range(m):
        i = index[r]
        for c in range(r):
            total = a[i, index[c]]
            for k in range(c):
                total -= factor[r, k] * factor[c, k]
            factor[r, c] = total * factor[c, c]  # the diagonal holds reciprocals
        pivot = a[i, i] * (1.0 + softening)
        for k in range(r):
            pivot -= factor[r, k] * factor[r, k]
        if pivot <= _DEPENDENT * a[i, i]:
            return False
        factor[r, r] = 1.0 / np.sqrt(pivot)
    for r in range(m):
        total = -b[index[r]]
        for k in range(r):
            total -= factor[r, k] * z[index[k]]
        z[index[r]] = total * factor[r, r]
    for r in range(m - 1, -1, -1):
        total = z[index[r]]
        for k in range(r + 1, m):
            total -= factor[k, r] * z[index[k]]
        z[index[r]] = total * factor[r, r]
    return True


@njit(cache=True, nogil=True)
def natural_residual(a, b, z) -> float:
    """max |min(z_i/s, w_i)| with w = A z + b and s = 1/A_ii: the natural-map residual in the units of w."""
    worst = 0.0
    for i in range(b.size):
        w = b[i]
        for k in range(b.size):
            w += a[i, k] * z[k]
        r = abs(min(z[i] * a[i, i], w))
        if r > worst:
            worst = r
    return worst
