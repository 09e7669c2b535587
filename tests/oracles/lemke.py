"""Lemke's complementary pivoting for z ≥ 0, w = A z + b ≥ 0, zᵀw = 0 (Lemke, Management Science 11(7), 1965).

The lexicographic ratio test keeps it from cycling (Cottle, Pang and Stone, The Linear Complementarity Problem, 1992,
section 4.9). It starts from z = 0 whatever came before: a method to judge others by, not one for every step.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.lcp import DEPENDENT, FEASIBILITY, NOT_SOLVED, SOLVED, factorise, substitute
from synth.solver.vectors import add, put

#: entries of a column below this times its largest are rounding, and no pivots
_LEAST_PIVOT = 1e-11
#: ratios closer than this are equal: matrix and right side are scaled to 1
_TIE = 1e-13


def make_work(contacts: int) -> tuple[np.ndarray, np.ndarray]:
    """Work space of `solve`: table (n, n + 2) float64 and index (3n + 1,) int64."""
    return np.zeros((contacts, contacts + 2)), np.zeros(3 * contacts + 1, np.int64)


@njit
def solve(a, b, enabled, active, z, table, index) -> int:
    """As `lcp.solve`, but `active` is only written; table and index from `make_work`."""
    return pivot(a, b, enabled, active, z, table, index)[0]


@njit
def pivot(a, b, enabled, active, z, table, index) -> tuple[int, int]:
    """`solve` with the number of pivots: (status, pivots). NOT_SOLVED: it ended on a ray, there is no solution."""
    n = b.size
    active, z = active[:n], z[:n]
    m = 0
    for i in range(n):
        z[i] = 0.0
        active[i] = 0
        if enabled[i]:
            index[m] = i
            m += 1
    # the dictionary basic_r = table[r, m + 1] + Σ_c table[r, c]·nonbasic_c; w_i is variable i, z_i is m + i, z0 is 2m
    contact, basic, nonbasic = index[:m], index[n : n + m], index[2 * n : 2 * n + m + 1]
    row = -1
    for r in range(m):
        i = contact[r]
        unit = _unit(a[i, i])
        for c in range(m):
            table[r, c] = a[i, contact[c]] * unit * _unit(a[contact[c], contact[c]])
        table[r, m] = 1.0
        table[r, m + 1] = b[i] * unit
        basic[r], nonbasic[r] = r, m + r
        if table[r, m + 1] < 0.0 and (row < 0 or table[r, m + 1] < table[row, m + 1]):
            row = r
    if row < 0:
        return SOLVED, 0
    nonbasic[m] = 2 * m
    size = -table[row, m + 1]
    for r in range(m):
        table[r, m + 1] /= size
    column = m
    for pivots in range(1, 100 + 50 * n):
        leaving = basic[row]
        _exchange(table, m, row, column)
        basic[row], nonbasic[column] = nonbasic[column], leaving
        if leaving == 2 * m:
            for r in range(m):
                if basic[r] >= m:
                    i = contact[basic[r] - m]
                    active[i] = 1
                    z[i] = max(0.0, table[r, m + 1]) * size * _unit(a[i, i])
            return _polish(a, b, active, z, table, index), pivots
        complement = leaving + m if leaving < m else leaving - m
        for c in range(m + 1):
            if nonbasic[c] == complement:
                column = c
        row = _leaving_row(table, m, column, basic, nonbasic)
        if row < 0:
            break
    for i in range(n):
        z[i] = 0.0
        active[i] = 0
    return NOT_SOLVED, pivots


@njit
def _unit(diagonal: float) -> float:
    """Scale of a row and column whose diagonal becomes 1."""
    return 1.0 / np.sqrt(diagonal) if diagonal > 0.0 else 1.0


@njit
def _exchange(table, m: int, row: int, column: int) -> None:
    """The basic variable of the row and the nonbasic one of the column change places."""
    inverse = 1.0 / table[row, column]
    pivot_row = table[row, : m + 2]
    for c in range(m + 2):
        pivot_row[c] *= -inverse
    pivot_row[column] = inverse
    for r in range(m):
        if r != row:
            part = table[r, column]
            if part != 0.0:
                table[r, column] = 0.0
                add(part, pivot_row, table[r])


@njit
def _leaving_row(table, m: int, column: int, basic, nonbasic) -> int:
    """The lexicographically least ratio's row, z0's where it is among equals; −1: none bounds the column's variable."""
    largest = 0.0
    for r in range(m):
        largest = max(largest, abs(table[r, column]))
    least = np.inf
    for r in range(m):
        if table[r, column] < -_LEAST_PIVOT * largest:
            least = min(least, -table[r, m + 1] / table[r, column])
    if least == np.inf:
        return -1
    best = -1
    for r in range(m):
        fall = -table[r, column]
        if fall > _LEAST_PIVOT * largest and table[r, m + 1] / fall <= least + _TIE * (1.0 + abs(least)):
            if basic[r] == 2 * m:
                return r
            if best < 0 or _precedes(table, m, column, basic, nonbasic, r, best):
                best = r
    return best


@njit
def _precedes(table, m: int, column: int, basic, nonbasic, r: int, s: int) -> bool:
    """Whether row r of the inverse basis, over its entry in the column, is lexicographically less than row s."""
    for k in range(m):
        # the inverse basis' column k is that of w_k
        mine, other = 0.0, 0.0
        if basic[r] == k:
            mine = 1.0
        elif basic[s] == k:
            other = 1.0
        else:
            for c in range(m + 1):
                if nonbasic[c] == k:
                    mine, other = -table[r, c], -table[s, c]
        mine, other = mine / -table[r, column], other / -table[s, column]
        if abs(mine - other) > _TIE * (1.0 + abs(other)):
            return mine < other
    return False


@njit
def _polish(a, b, active, z, table, index) -> int:
    """z again from the set that was found, by one Cholesky solve, where the set is well enough conditioned for that."""
    n = b.size
    spare = table[:n, n + 1]
    put(spare, z)
    m, _ = factorise(a, active, DEPENDENT, table, index, int(np.int64(0)))
    if m < 0:
        put(z, spare)
        return SOLVED
    substitute(b, m, table, index, z)
    scale = 0.0
    for r in range(m):
        scale = max(scale, abs(b[index[r]]))
    for r in range(m):
        i = index[r]
        if z[i] * a[i, i] < -FEASIBILITY * scale:
            put(z, spare)
            return SOLVED
        z[i] = max(0.0, z[i])
    return SOLVED
