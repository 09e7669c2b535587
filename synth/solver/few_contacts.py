"""Up to four contacts of a line without a finger, by tables of what each set of pressed ones does.

With P the contacts of a set, the others N, and b the gaps without forces of this step, the set answers by

    z_P = −A_PP⁻¹ b_P,    w_N = b_N − A_NP A_PP⁻¹ b_P,

one product with a table T that depends on the set and the contacts' matrix A alone. It is the right set where nothing of
T b is negative; else what is changes sides. A table is made when a set is asked for and is there until the contacts looked
at, or the coefficients of their line, become others.
"""

from __future__ import annotations

from numba import njit

from synth.solver.block_rows import BLOCK
from synth.solver.coupling import FEW, NEAR, OF_SETS, SETS, end_at
from synth.solver.due_responses import fill_due
from synth.solver.lcp import FEASIBILITY, NOT_SOLVED, SOLVED
from synth.solver.stringmodel import string_model, string_state
from synth.solver.vectors import INNER

#: sets that are tried with all that is wrong changing sides at once, and then with the first of it alone, which always ends
_AT_ONCE = 4
_MOST_TRIED = 40
#: of a contact's diagonal entry, what is left of it beside the others of its set: of sets with less, whose inverse loses too
#: many digits where a factor would not, no table is made
_LEAST_LEFT = 1e-4
#: rows of End.few.sides: gaps without forces, their slopes, what the set makes of both
_GAPS, _MOVES, _ANSWERS, _CHANGES = range(4)


@njit(**INNER)
def note_matrix(model: int, end: int) -> None:
    """The matrix of the contacts that are looked at; tables of another one are forgotten."""
    m, e = string_model(model), end_at(end)
    several = e.counts[NEAR]
    same = e.block.known[OF_SETS] == several
    for i in range(several):
        for d in range(several):
            entry = m.contacts.lags[e.block.near[i], e.block.near[d], BLOCK]
            same = same and e.block.matrix[i * several + d] == entry
            e.block.matrix[i * several + d] = entry
    if not same:
        e.block.known[SETS] = 0
        e.block.known[OF_SETS] = several


@njit(**INNER)
def _fill_table(end: int, held: int) -> bool:
    """The table of a set, bit i of `held` for contact i; whether its contacts are independent enough.

    Each contact of it is swept (Beaton 1964): the matrix, P swept, is −A_PP⁻¹, A_NP A_PP⁻¹ and what is left of A_NN.
    """
    e = end_at(end)
    several, table = e.counts[NEAR], e.few.tables[held].reshape(FEW, FEW)
    for i in range(FEW):
        for k in range(FEW):
            table[k, i] = e.block.matrix[i * several + k] if i < several and k < several else 0.0
    for p in range(several):
        if held >> p & 1:
            left = table[p, p]
            if left <= _LEAST_LEFT * e.block.matrix[p * several + p]:
                return False
            for i in range(several):
                for k in range(several):
                    if i != p and k != p:
                        table[k, i] -= table[p, i] * table[k, p] / left
            for i in range(several):
                if i != p:
                    table[p, i] /= left
                    table[i, p] /= left
            table[p, p] = -1.0 / left
    for i in range(several):
        if held >> i & 1 == 0:
            for k in range(several):
                table[k, i] = -table[k, i] if held >> k & 1 else (1.0 if i == k else 0.0)
        else:
            for k in range(several):
                table[k, i] = table[k, i] if held >> k & 1 else 0.0
    e.block.known[SETS] |= 1 << held
    return True


@njit(inline="always")
def _row(table, i: int, x0: float, x1: float, x2: float, x3: float) -> float:
    return table[i] * x0 + table[FEW + i] * x1 + table[2 * FEW + i] * x2 + table[3 * FEW + i] * x3


@njit(inline="always")
def _apply(table, x, out) -> None:
    """out (FEW,) = T x, all read before any is written."""
    x0, x1, x2, x3 = x[0], x[1], x[2], x[3]
    y0, y1 = _row(table, 0, x0, x1, x2, x3), _row(table, 1, x0, x1, x2, x3)
    y2, y3 = _row(table, 2, x0, x1, x2, x3), _row(table, 3, x0, x1, x2, x3)
    out[0], out[1], out[2], out[3] = y0, y1, y2, y3


@njit(inline="always")
def _find_set(e, end: int, held: int, tolerance: float) -> int:
    """The set that presses over the gaps of End.few.sides, whose answers are there then; −1 where none is to be found."""
    gaps, answers = e.few.sides[_GAPS], e.few.sides[_ANSWERS]
    for tried in range(_MOST_TRIED):
        if e.block.known[SETS] >> held & 1 == 0 and not _fill_table(end, held):
            return -1
        _apply(e.few.tables[held], gaps, answers)
        wrong = 0
        for i in range(FEW):
            if answers[i] < (0.0 if held >> i & 1 else -tolerance):
                wrong |= 1 << i
        if wrong == 0:
            return held
        held ^= wrong if tried < _AT_ONCE else wrong & -wrong
    return -1


@njit(**INNER)
def answer_of_few(
    model: int, state: int, end: int, scratch: int, first: int, steps: int, turn: float
) -> tuple[float, float, int, int]:
    """`line_forces.answer_of_line` of two to four contacts whose matrix is noted; NOT_SOLVED where no set of independent
    ones is found."""
    m, s, e = string_model(model), string_state(state), end_at(end)
    several, near, lags = e.counts[NEAR], e.block.near, m.contacts.lags
    forces, slopes, apart, opening = e.block.forces, e.block.slopes, e.block.apart, e.block.opening
    gaps, moves, answers, changes = e.few.sides[_GAPS], e.few.sides[_MOVES], e.few.sides[_ANSWERS], e.few.sides[_CHANGES]
    held = 0
    for i in range(several):
        if s.force[near[i]] > 0.0:
            held |= 1 << i
    for i in range(several, FEW):
        gaps[i] = moves[i] = 0.0
    force, slope, pattern, ever = 0.0, 0.0, 0, 0
    for t in range(steps):
        largest = 0.0
        for i in range(several):
            move = e.responses.moved[near[i], BLOCK + t]
            gap = e.block.u[i, first + t] + move * turn
            if ever:
                for d in range(several):
                    if ever >> d & 1:
                        for k in range(t):
                            lag = lags[near[i], near[d], BLOCK + t - k]
                            gap += lag * forces[d, first + k]
                            move += lag * slopes[d, first + k]
            gaps[i], moves[i] = gap, move
            largest = max(largest, abs(gap))
        held = _find_set(e, end, held, FEASIBILITY * largest)
        if held < 0:
            return 0.0, 0.0, 0, NOT_SOLVED
        ever |= held
        pattern = pattern << FEW | held
        _apply(e.few.tables[held], moves, changes)
        for i in range(several):
            if held >> i & 1:
                if s.due[near[i]]:
                    fill_due(model, state, scratch, near[i])
                forces[i, first + t], slopes[i, first + t] = answers[i], changes[i]
                apart[i, first + t] = opening[i, first + t] = 0.0
                force += e.responses.reach[near[i], t] * answers[i]
                slope += e.responses.reach[near[i], t] * changes[i]
            else:
                apart[i, first + t], opening[i, first + t] = answers[i], changes[i]
                forces[i, first + t] = slopes[i, first + t] = 0.0
    return force, slope, pattern, SOLVED
