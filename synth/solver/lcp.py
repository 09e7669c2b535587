"""Linear complementarity problems z ≥ 0, w = A z + b ≥ 0, zᵀw = 0 with a symmetric positive semidefinite A.

`solve` is block principal pivoting (Kostreva 1978; Júdice and Pires, Computers & OR 21(5), 1994): every infeasible
index changes sides at once while that helps, and one at a time (Murty's rule, finite for P-matrices) when it does
not. It starts from the active set it is given, so that a contact that lasts costs one factorisation a step. Where it
meets contacts that depend on each other (coincident, or more than modes), the principal pivoting method of Dantzig and
Cottle (1968) takes over: slower, and sure for every semidefinite A. `natural_residual` judges any solver's answer.
"""

from __future__ import annotations

import numpy as np
from numba import njit

#: w may fall this much below zero, relative to the largest |b|: rounding of one Cholesky solve of ≤ 40 unknowns.
FEASIBILITY = 1e-13
#: and this much, relative to the terms of its own sum: forces on nearly dependent contacts are large.
_ROUNDING = 4e-15
#: a pivot below this times its diagonal means contacts that depend on each other.
_DEPENDENT = 1e-13
#: stricter where one contact joins a set, and laxer for sets so made: pivots of another order are up to n times smaller
_JOINS_ABOVE = 1e-12
_SINGULAR = 1e-16

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
    best = n + 1
    patience = 3
    for _ in range(50 + 20 * n):
        if not _solve_on_active(a, b, active, z, factor, index):
            break
        wrong = 0
        for i in range(n):
            if not enabled[i]:
                continue
            if active[i]:
                infeasible = z[i] < 0.0
            else:
                infeasible = _shortfall(a, b, z, i, tolerance) < 0.0
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
    return _solve_one_by_one(a, b, enabled, tolerance, active, z, factor, index)


@njit(cache=True, nogil=True)
def _shortfall(a, b, z, i: int, tolerance: float) -> float:
    """w_i where it is below zero by more than rounding explains, else 0."""
    w, terms = b[i], 0.0
    for k in range(b.size):
        term = a[i, k] * z[k]
        w += term
        terms += abs(term)
    return w if w < -(tolerance + _ROUNDING * terms) else 0.0


@njit(cache=True, nogil=True)
def _solve_one_by_one(a, b, enabled, tolerance: float, active, z, factor, index) -> int:
    """Principal pivoting from z = 0: the most violated contact is loaded until it holds, or until another one lets go.

    While contact i is loaded along d = e_i − A_PP⁻¹A_Pi the active ones P stay closed. If i depends on P the load
    changes no motion and only shifts forces, until one of P has none left: P never holds dependent contacts.
    """
    n = b.size
    for i in range(n):
        z[i] = 0.0
        active[i] = 0
    loads = 0
    while loads < 50 + 20 * n:
        entering, worst = -1, 0.0
        for i in range(n):
            if enabled[i] and not active[i]:
                w = _shortfall(a, b, z, i, tolerance)
                if w < 0.0 and a[i, i] <= 0.0:
                    return NOT_SOLVED  # nothing moves this contact
                if w < 0.0 and w / np.sqrt(a[i, i]) < worst:
                    entering, worst = i, w / np.sqrt(a[i, i])
        if entering < 0:
            return SOLVED
        while True:
            loads += 1
            m = 0
            for i in range(n):
                if active[i]:
                    index[m] = i
                    m += 1
            if not _factorise(a, active, _SINGULAR, factor, index):
                return NOT_SOLVED
            # the row of `factor` that the entering contact would get, and what is left of its diagonal
            row = factor[m]
            pivot = a[entering, entering]
            for c in range(m):
                total = a[entering, index[c]]
                for k in range(c):
                    total -= row[k] * factor[c, k]
                row[c] = total * factor[c, c]
                pivot -= row[c] * row[c]
            # A_PP⁻¹A_Pi in place
            for r in range(m - 1, -1, -1):
                total = row[r]
                for k in range(r + 1, m):
                    total -= factor[k, r] * row[k]
                row[r] = total * factor[r, r]
            w = b[entering]
            for k in range(n):
                w += a[entering, k] * z[k]
            holds = pivot > _JOINS_ABOVE * a[entering, entering]
            step = max(0.0, -w) / pivot if holds else np.inf
            leaving = -1
            for r in range(m):
                if row[r] > 0.0 and z[index[r]] < step * row[r]:
                    step = z[index[r]] / row[r]
                    leaving = r
            if step == np.inf:
                return NOT_SOLVED  # no force can close it: the problem has no solution
            for r in range(m):
                z[index[r]] = max(0.0, z[index[r]] - step * row[r])
            z[entering] += step
            if leaving < 0:
                active[entering] = 1
                break
            z[index[leaving]] = 0.0
            active[index[leaving]] = 0
            if loads >= 50 + 20 * n:
                return NOT_SOLVED
    return NOT_SOLVED


@njit(cache=True, nogil=True)
def _factorise(a, active, least: float, factor, index) -> bool:
    """Cholesky factor of A on the active set, the diagonal as reciprocals; False at a pivot below least·A_ii."""
    m = 0
    for i in range(active.size):
        if active[i]:
            index[m] = i
            m += 1
    for r in range(m):
        i = index[r]
        for c in range(r):
            total = a[i, index[c]]
            for k in range(c):
                total -= factor[r, k] * factor[c, k]
            factor[r, c] = total * factor[c, c]
        pivot = a[i, i]
        for k in range(r):
            pivot -= factor[r, k] * factor[r, k]
        if pivot <= least * a[i, i]:
            return False
        factor[r, r] = 1.0 / np.sqrt(pivot)
    return True


@njit(cache=True, nogil=True)
def _solve_on_active(a, b, active, z, factor, index) -> bool:
    """z on the active set from A z = −b by Cholesky, zero elsewhere; False where A is singular there."""
    m = 0
    for i in range(b.size):
        z[i] = 0.0
        m += active[i]
    if not _factorise(a, active, _DEPENDENT, factor, index):
        return False
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
