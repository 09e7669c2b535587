"""Friction at the contacts of a string that moves in two directions: Coulomb's, along the obstacle.

Where the first direction of a string presses a contact with λ_n over a step, its second one, the line behind it, gets the
force λ_t there, held over the same step, with Δu_t how far it slides:

    |λ_t| ≤ μ λ_n,    λ_t = −μ λ_n sign Δu_t unless Δu_t = 0,

u_t = S w + R λ_t + ξ b as at every contact. Each λ_t Δu_t ≤ 0, so that it takes energy, whatever V the frame ends with; both
forces act on the bridge. Of several contacts it is the least of ½ λᵀGλ + dᵀλ within the bounds, d the way without forces,
found by block principal pivoting with bounds (Júdice & Pires, Computers & OR 21(5), 1994). λ_t depends on the speed of its
own line and, where it slides, on that of the first: the slopes of both are Newton's.

There is none while a finger is on the string, nor in a frame whose normal forces are held (`held_forces`).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK
from synth.solver.coupling import NEAR, coupling_at, end_at
from synth.solver.due_responses import fill_those
from synth.solver.lanes import add_late
from synth.solver.lcp import DEPENDENT, NOT_SOLVED, SOLVED, factorise, substitute
from synth.solver.line_rows import MIX
from synth.solver.stringmodel import scratch_of, string_model, string_state
from synth.solver.vectors import INNER

#: what a contact does: it sticks, slides with the force up or down, or is not pressed
_STICKS, _UP, _DOWN, _FREE = range(4)
#: rounding of a way, of the terms of its sum, and of a force, of its bound
_ROUNDING = 1e-14
#: times that block steps may fail to help before they are taken one by one
_PATIENCE = 3


@njit(cache=True, nogil=True)
def rubs(coupling: int, line: int) -> bool:
    """Whether contacts of a line are those of the line before, where that presses them."""
    c = coupling_at(coupling)
    return c.lines.friction[line] > 0.0 and string_state(c.lines.state[line]).finger[0].on == 0


@njit(cache=True, nogil=True)
def rub_where_pressed(coupling: int, line: int, pressed: bool) -> None:
    """Before `line_forces.look_at_line`: of the contacts of a line with friction those are looked at that are in the line
    before, where that looks at any (`pressed`) and no finger is on."""
    c = coupling_at(coupling)
    s, e, first = string_state(c.lines.state[line]), end_at(c.lines.end[line]), end_at(c.lines.end[line - 1])
    pressed = pressed and s.finger[0].on == 0
    for k in range(e.certificate.clearance.size):
        e.certificate.clearance[k] = first.certificate.clearance[k] if pressed else 1.0


@njit(**INNER)
def answer_of_rubbed(
    model: int, state: int, end: int, first_end: int, friction: float, scratch: int, first: int, steps: int, turn: float
) -> tuple[float, float, float, int, int]:
    """`line_forces.answer_of_line` of a second direction, once the first has its forces (End.block.forces and slopes): (mean
    force on the bridge, its slope by the speed of its own end, by that of the first one's, what contacts do, status)."""
    m, s, e, one, w = string_model(model), string_state(state), end_at(end), end_at(first_end), scratch_of(scratch)
    several, near, lags = e.counts[NEAR], e.block.near, m.contacts.lags
    ways, moves = w.rows.u, w.rows.forces  # of the contacts over these steps, and by the speed of the own end
    others = w.record[: several * BLOCK].reshape(several, BLOCK)  # by that of the first direction's
    a = e.block.matrix[: several * several].reshape(several, several)
    for i in range(several):
        for t in range(BLOCK):
            ways[i, t] = e.block.u[i, first + t] + e.responses.moved[near[i], BLOCK + t] * turn if t < steps else 0.0
            moves[i, t] = e.responses.moved[near[i], BLOCK + t] if t < steps else 0.0
            others[i, t] = 0.0
        for d in range(several):
            a[i, d] = lags[near[i], near[d], BLOCK]
    force, slope, cross, pattern, status = 0.0, 0.0, 0.0, 0, SOLVED
    side, active, way = w.pivot.enabled[:several], w.pivot.active[:several], w.pivot.b[:several]
    bound, z, right, change = w.y[:several], w.z[:several], w.modes.after[:several], w.pivot.matrix[:several]
    for t in range(steps):
        pressed = False
        for i in range(several):
            bound[i] = friction * one.block.forces[i, first + t]
            pressed = pressed or bound[i] > 0.0
            way[i] = ways[i, t] - (ways[i, t - 1] if t > 0 else s.u[near[i]])
            e.block.forces[i, first + t] = 0.0
        if not pressed:
            continue
        fill_those(model, state, scratch, near, several)
        bad, held = hold_back(a, way, bound, side, active, right, w.pivot.factor, w.pivot.order, z)
        status = max(status, bad)
        for i in range(several):
            e.block.forces[i, first + t] = z[i]
            pattern = pattern * MIX + (4 * t + 1 + side[i])
            right[i] = moves[i, t] - (moves[i, t - 1] if t > 0 else 0.0)
        substitute(right, held, w.pivot.factor, w.pivot.order, change)
        for i in range(several):
            e.block.slopes[i, first + t] = change[i]
        for i in range(several):
            right[i] = others[i, t] - (others[i, t - 1] if t > 0 else 0.0)
            for d in range(several):
                right[i] += a[i, d] * _sliding(side[d]) * friction * one.block.slopes[d, first + t]
        substitute(right, held, w.pivot.factor, w.pivot.order, change)
        for i in range(several):
            change[i] += _sliding(side[i]) * friction * one.block.slopes[i, first + t]
            reach = e.responses.reach[near[i], t]
            force += reach * z[i]
            slope += reach * e.block.slopes[i, first + t]
            cross += reach * change[i]
            for d in range(several):
                add_late(ways[d], lags[near[d], near[i]], t, z[i])
                add_late(moves[d], lags[near[d], near[i]], t, e.block.slopes[i, first + t])
                add_late(others[d], lags[near[d], near[i]], t, change[i])
    return force, slope, cross, pattern, status


@njit(inline="always")
def _sliding(side: int) -> float:
    """The sign of the force of what slides; 0 of what does not."""
    if side == _UP:
        return 1.0
    return -1.0 if side == _DOWN else 0.0


@njit(cache=True, nogil=True)
def hold_back(a, way, bound, side, active, right, factor, order, z) -> tuple[int, int]:
    """z (n,), |z| ≤ bound, so that w = A z + way is 0 where |z| < bound and against z elsewhere: (status of `lcp`, rows).

    a (n, n) symmetric and positive. side (n,) uint8: what each does; active (n,) uint8 marks those that stick, and the first
    `rows` rows of factor (n, n) are their Cholesky factor, of order (n,). right (n,) is work space. Where it is not solved
    nothing is held back.
    """
    n = way.size
    for i in range(n):
        side[i] = _STICKS if bound[i] > 0.0 else _FREE
    best, patience, zero = n + 1, _PATIENCE, int(np.int64(0))
    for _ in range(100 + 20 * n):
        for i in range(n):
            active[i] = 1 if side[i] == _STICKS else 0
        rows, _ = factorise(a, active, DEPENDENT, factor, order, zero)
        if rows < 0:
            break
        for i in range(n):
            right[i] = way[i]
            for k in range(n):
                right[i] += a[i, k] * _sliding(side[k]) * bound[k]
        substitute(right, rows, factor, order, z)
        for i in range(n):
            z[i] += _sliding(side[i]) * bound[i]
        wrong = 0
        alone = patience < 0
        for i in range(n):
            wanted = _wanted(a, way, bound, side, z, i)
            if wanted != side[i]:
                wrong += 1
                if alone:
                    side[i] = wanted
                    break
                right[i] = wanted
            else:
                right[i] = side[i]
        if wrong == 0:
            return SOLVED, rows
        if not alone:
            for i in range(n):
                side[i] = int(right[i])
            if wrong < best:
                best, patience = wrong, _PATIENCE
            else:
                patience -= 1
    for i in range(n):
        z[i] = 0.0
        side[i] = _FREE
        active[i] = 0
    return NOT_SOLVED, zero


@njit(inline="always")
def _wanted(a, way, bound, side, z, i: int) -> int:
    """What contact i ought to do next."""
    if side[i] == _STICKS:
        if abs(z[i]) <= bound[i] * (1.0 + _ROUNDING):
            return _STICKS
        return _UP if z[i] > 0.0 else _DOWN
    if side[i] == _FREE:
        return _FREE
    total, terms = way[i], abs(way[i])
    for k in range(z.size):
        total += a[i, k] * z[k]
        terms += abs(a[i, k] * z[k])
    goes_with = total if side[i] == _UP else -total
    return _STICKS if goes_with > _ROUNDING * terms else side[i]
