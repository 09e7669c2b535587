"""Linear complementarity problems z ≥ 0, w = A z + b ≥ 0, zᵀw = 0 with a symmetric positive semidefinite A.

`solve` is block principal pivoting (Kostreva 1978; Júdice and Pires, Computers & OR 21(5), 1994): every infeasible
index changes sides at once while that helps. It starts from the active set it is given, so that a contact that lasts
costs one factorisation a step, and none where `pivot` is handed the factor of the step before. Where block steps stop
helping, or meet contacts that depend on each other (coincident, or more than modes), the principal pivoting method of
Dantzig and Cottle (1968) goes on one at a time: slower, and sure for every semidefinite A. `natural_residual` judges any
solver's answer.
"""

from __future__ import annotations

import numpy as np
from numba import float64, int64, njit, uint8

from synth.jit.entries import kernel
from synth.solver.vectors import INNER, add, dot

#: w may fall this much below zero, relative to the largest |b|: rounding of one Cholesky solve.
FEASIBILITY = 1e-13
#: and this much, relative to the terms of its own sum: forces on nearly dependent contacts are large.
_ROUNDING = 4e-15
#: a pivot below this times its diagonal means contacts that depend on each other.
DEPENDENT = 1e-13
#: stricter where one contact joins a set, and laxer for sets so made: pivots of another order are up to n times smaller
_JOINS_ABOVE = 1e-12
_SINGULAR = 1e-16

#: block steps that may fail to lower the number of infeasible contacts before they are taken one by one
_PATIENCE = 3
#: bit of `active` while infeasible contacts are collected
_MARK = 2

SOLVED = 0
NOT_SOLVED = 1


@njit(cache=True, nogil=True)
def single(a: float, b: float) -> float:
    """One contact in closed form: z = max(0, −b/a), a > 0."""
    return max(0.0, -b / a)


@njit(cache=True, nogil=True)
def natural(a: float, z: float, w: float) -> float:
    """|min(z a, w)|, one entry of the natural map, in the units of w; a is the matrix's diagonal entry."""
    return abs(min(z * a, w))


@njit(cache=True, nogil=True)
def natural_residual(a, b, z) -> float:
    """max |min(A_ii z_i, w_i)| with w = A z + b: the natural-map residual in the units of w. It judges every solver."""
    worst = 0.0
    for i in range(b.size):
        w = b[i]
        for k in range(b.size):
            w += a[i, k] * z[k]
        r = natural(a[i, i], z[i], w)
        if r > worst or r != r:  # NaN stays
            worst = r
    return worst


@kernel(
    float64[:, ::1],
    float64[::1],
    *[uint8[::1]] * 2,
    float64[::1],
    float64[:, ::1],
    int64[::1],
    answer=int64,
)
def solve(a, b, enabled, active, z, factor, index) -> int:
    """Solve the LCP on the enabled indices; z of the others is 0.

    a (n, n) symmetric positive semidefinite, b (n,), enabled (n,) uint8, active (n,) uint8 in: first guess, out: the
    set with z > 0, z (n,) out, factor (n, n) and index (n,) int64 work space. n is b's; the other arrays may be longer.
    Returns SOLVED or NOT_SOLVED.
    """
    return pivot(a, b, enabled, active, z, factor, index, 0)[0]


@njit(cache=True, nogil=True)
def pivot(a, b, enabled, active, z, factor, index, held: int) -> tuple[int, int, int]:
    """`solve` for a sequence of problems with the same A: (status, sets tried, held).

    held rows of `factor`, those of the contacts index[:held] in rising order, are valid for this A from the call before
    (0: none), and are kept as far as the active set agrees with them. The answer is bitwise that of held = 0.
    """
    n = b.size
    active, z = active[:n], z[:n]
    scale = 0.0
    for i in range(n):
        if enabled[i]:
            scale = max(scale, abs(b[i]))
        else:
            active[i] = 0
    tolerance = FEASIBILITY * scale
    best = n + 1
    patience = _PATIENCE
    tried = 0
    while patience >= 0:
        tried += 1
        m, held = factorise(a, active, DEPENDENT, factor, index, held)
        if m < 0:
            break
        substitute(b, m, factor, index, z)
        wrong = _mark_infeasible(a, b, enabled, tolerance, m, index, active, z, factor)
        if wrong == 0:
            return SOLVED, tried, held
        if wrong < best:
            best = wrong
            patience = _PATIENCE
        else:
            patience -= 1
        for i in range(n):
            if active[i] & _MARK:
                active[i] ^= _MARK | 1
    status, loads = _solve_one_by_one(a, b, enabled, tolerance, active, z, factor, index)
    return status, tried + loads, 0


@njit(**INNER)
def _mark_infeasible(a, b, enabled, tolerance: float, m: int, index, active, z, factor) -> int:
    """Mark in `active` the enabled contacts that pull or that lie in the obstacle; how many."""
    n = b.size
    wrong = 0
    if m < n:
        w = factor[n - 1]  # no row of the factor when m < n
        gaps(a, b, z, w)
        for i in range(n):
            if enabled[i] and not active[i] and w[i] < -tolerance and _shortfall(a, b, z, i, tolerance) < 0.0:
                active[i] |= _MARK
                wrong += 1
    for r in range(m):
        i = index[r]
        if z[i] < 0.0:
            active[i] |= _MARK
            wrong += 1
    return wrong


@njit(cache=True, nogil=True)
def gaps(a, b, z, w) -> None:
    """w = A z + b for a z that is mostly zero."""
    n = b.size
    for i in range(n):
        w[i] = b[i]
    for k in range(n):
        if z[k] != 0.0:
            add(z[k], a[k, :n], w)


@njit(**INNER)
def _shortfall(a, b, z, i: int, tolerance: float) -> float:
    """w_i where it is below zero by more than rounding explains, else 0."""
    w, terms = b[i], 0.0
    for k in range(b.size):
        term = a[i, k] * z[k]
        w += term
        terms += abs(term)
    return w if w < -(tolerance + _ROUNDING * terms) else 0.0


@njit(**INNER)
def _solve_one_by_one(a, b, enabled, tolerance: float, active, z, factor, index) -> tuple[int, int]:
    """Principal pivoting: the most violated contact is loaded until it holds, or until another one lets go.

    It starts from the part of the active set that holds without pulling. While contact i is loaded along
    d = e_i − A_PP⁻¹A_Pi the active ones P stay closed. If i depends on P the load changes no motion and only shifts
    forces, until one of P has none left: P never holds dependent contacts.
    """
    n = b.size
    loads, held = 0, _hold_without_pull(a, b, active, z, factor, index)
    most = 50 + 20 * n
    w_all = factor[n - 1]  # free while contacts are outside the set, and then only while one is chosen
    while loads < most:
        entering, worst = -1, 0.0
        if held < n:
            gaps(a, b, z, w_all)
            for i in range(n):
                if enabled[i] and not active[i] and w_all[i] < -tolerance:
                    w = _shortfall(a, b, z, i, tolerance)
                    if w < 0.0 and a[i, i] <= 0.0:
                        return NOT_SOLVED, loads  # nothing moves this contact
                    if w < 0.0 and w / np.sqrt(a[i, i]) < worst:
                        entering, worst = i, w / np.sqrt(a[i, i])
        if entering < 0:
            return SOLVED, loads
        while True:
            loads += 1
            m, held = factorise(a, active, _SINGULAR, factor, index, held)
            if m < 0:
                return NOT_SOLVED, loads
            # the row of `factor` that the entering contact would get, and what is left of its diagonal
            row = factor[m]
            pivot = a[entering, entering]
            for c in range(m):
                row[c] = (a[entering, index[c]] - dot(row, factor[c, :c])) * factor[c, c]
                pivot -= row[c] * row[c]
            # A_PP⁻¹A_Pi in place
            for r in range(m - 1, -1, -1):
                row[r] *= factor[r, r]
                add(-row[r], factor[r, :r], row)
            w = b[entering] + dot(a[entering], z)
            holds = pivot > _JOINS_ABOVE * a[entering, entering]
            step = max(0.0, -w) / pivot if holds else np.inf
            leaving = -1
            for r in range(m):
                if row[r] > 0.0 and z[index[r]] < step * row[r]:
                    step = z[index[r]] / row[r]
                    leaving = r
            if step == np.inf:
                return NOT_SOLVED, loads  # no force can close it: the problem has no solution
            for r in range(m):
                z[index[r]] = max(0.0, z[index[r]] - step * row[r])
            z[entering] += step
            if leaving < 0:
                active[entering] = 1
                break
            z[index[leaving]] = 0.0
            active[index[leaving]] = 0
            if loads >= most:
                return NOT_SOLVED, loads
    return NOT_SOLVED, loads


@njit(**INNER)
def _hold_without_pull(a, b, active, z, factor, index) -> int:
    """Drop contacts from the active set until the rest are independent and push, z with w = 0 on them; rows of factor."""
    held = int(np.int64(0))
    while True:
        m, held = factorise(a, active, _JOINS_ABOVE, factor, index, held)
        if m < 0:
            active[index[held]] = 0  # it depends on those before it
            continue
        substitute(b, m, factor, index, z)
        pulls = False
        for r in range(m):
            i = index[r]
            if z[i] <= 0.0:
                z[i] = 0.0
                active[i] = 0
                pulls = True
        if not pulls:
            return held


@njit(cache=True, nogil=True)
def factorise(a, active, least: float, factor, index, held: int) -> tuple[int, int]:
    """Cholesky factor of A on the active set, the diagonal as reciprocals: (size of the set, rows now valid).

    The size is −1 at a pivot below least·A_ii. `held` rows for index[:held] are there already.
    """
    m = 0
    keep = True
    for i in range(active.size):
        if active[i]:
            if keep and (m >= held or index[m] != i):
                keep = False
                held = m
            index[m] = i
            m += 1
    if keep:
        held = m
    for r in range(held, m):
        i = index[r]
        row = factor[r]
        pivot = a[i, i]
        for c in range(r):
            entry = (a[i, index[c]] - dot(row, factor[c, :c])) * factor[c, c]
            row[c] = entry
            pivot -= entry * entry
        if pivot <= least * a[i, i]:
            return -1, r
        row[r] = 1.0 / np.sqrt(pivot)
    return m, m


@njit(cache=True, nogil=True)
def substitute(b, m: int, factor, index, z) -> None:
    """z on the active set index[:m] from A z = −b by its Cholesky factor, zero elsewhere."""
    for r in range(m):
        z[r] = (-b[index[r]] - dot(z, factor[r, :r])) * factor[r, r]
    for r in range(m - 1, -1, -1):
        z[r] *= factor[r, r]
        add(-z[r], factor[r, :r], z)
    # from the first m places to their own: the order is rising, so that nothing is overwritten
    z[m:] = 0.0
    for r in range(m - 1, -1, -1):
        i = index[r]
        if i != r:
            z[i] = z[r]
            z[r] = 0.0
