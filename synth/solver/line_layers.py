"""Soft contacts (`layers`) of a line whose end moves, and where the contacts of a line are as a block or a frame begins.

As in `line_forces` every row is what free flight and the kicks make of it plus sums over the forces; what is its own here is
the law of a step, twice as many rows as contacts, and that it looks back: StringState.u has the gaps S w + R λ + ξ b − η of
the contacts that are looked at, at the end of the step before.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK
from synth.solver.coupling import NEAR, along, coupling_at, end_at
from synth.solver.due_responses import fill_due
from synth.solver.layers import middle
from synth.solver.lcp import SOLVED, factorise, pivot, substitute
from synth.solver.line_rows import LEAST_PIVOT, MIX, act_on_rows, begin_rows, push_of_finger
from synth.solver.stringmodel import DEPTH, RESISTANCE, STIFFNESS, scratch_of, string_model, string_state
from synth.solver.vectors import INNER, dot

#: of a layer's depth: from here on it is on the stop, and how deep it was no longer changes with the end's speed
_NEARLY = 1.0 - 1e-9


@njit(cache=True, nogil=True)
def note_gaps(coupling: int, line: int) -> None:
    """StringState.u of the contacts of a line that are not certified, from its modes."""
    c = coupling_at(coupling)
    m, s, e = string_model(c.lines.model[line]), string_state(c.lines.state[line]), end_at(c.lines.end[line])
    height, contacts, n = along(c, line, c.bridge.beta), m.contacts.size, m.modes
    for k in range(contacts):
        if e.certificate.clearance[k] <= 0.0:
            here = dot(m.contacts.shapes[k, :n], s.q[:n]) + e.leverage[k] * height - s.eta[k]
            for d in range(contacts):
                here += m.contacts.residual[k, d] * s.force[d]
            s.u[k] = here


@njit(cache=True, nogil=True)
def keep_gaps(state: int, end: int, last: int) -> None:
    """Gaps of soft contacts and of those that rub once a frame is decided whose last step is number `last` of the block."""
    s, e = string_state(state), end_at(end)
    for i in range(e.counts[NEAR]):
        s.u[e.block.near[i]] = e.block.u[i, last]


@njit(**INNER)
def answer_of_soft_line(
    model: int, state: int, end: int, scratch: int, first: int, at: int, steps: int, turn: float
) -> tuple[float, float, int, int]:
    """`line_forces.answer_of_line` of a line whose contacts have layers."""
    m, s, e, w = string_model(model), string_state(state), end_at(end), scratch_of(scratch)
    several, near, dt, layers = e.counts[NEAR], e.block.near, m.dt, m.contacts.layers
    gaps, moves, forces, slopes = w.rows.u, w.rows.forces, e.block.forces, e.block.slopes
    grip, fingered = s.grip.contacts, s.finger[0].on != 0
    begin_rows(m, s, e, w, first, steps, turn)
    rows = 2 * several
    twice = w.pivot.matrix[: rows * rows].reshape(rows, rows)
    one = e.block.matrix[: several * several].reshape(several, several)
    enabled, active, z, b, change = w.pivot.enabled[:rows], w.pivot.active[:rows], w.z[:rows], w.pivot.b[:rows], w.y[:rows]
    for i in range(several):
        depth = layers[DEPTH, near[i]]
        for d in range(several):
            mutual = one[i, d]
            twice[i, d] = twice[i, several + d] = twice[several + i, d] = twice[several + i, several + d] = mutual
        if depth > 0.0:
            twice[i, i] += 1.0 / middle(layers[STIFFNESS, near[i]], layers[RESISTANCE, near[i]], dt)[0]
        enabled[i] = 1 if depth > 0.0 else 0
        enabled[several + i] = 1
        active[i] = active[several + i] = 0
    push, push_slope, total = 0.0, 0.0, 1.0
    here, here_slope = s.finger[0].here, 0.0
    force, slope, pattern, status, held = 0.0, 0.0, 0, SOLVED, int(np.int64(0))
    for t in range(steps):
        if fingered:
            push, push_slope, total = push_of_finger(s, e, w, dt, at + t, t, here, here_slope)
        touching = False
        for i in range(several):
            c, depth = near[i], layers[DEPTH, near[i]]
            b[i] = gaps[i, t] + (grip[c, BLOCK] * push if fingered else 0.0)
            change[i] = moves[i, t] + (grip[c, BLOCK] * push_slope if fingered else 0.0)
            b[several + i], change[several + i] = b[i] + depth, change[i]
            sunk = -(gaps[i, t - 1] if t > 0 else s.u[c])
            if depth > 0.0 and sunk > 0.0:
                a, kept = middle(layers[STIFFNESS, c], layers[RESISTANCE, c], dt)
                b[i] -= kept / a * min(depth, sunk)
                inside = t > 0 and sunk < _NEARLY * depth
                if inside:
                    change[i] += kept / a * moves[i, t - 1]
                pattern = pattern * MIX + 4 * (i * BLOCK + t) + (1 if inside else 2)
            touching = touching or (depth > 0.0 and b[i] < 0.0) or b[several + i] < 0.0
            forces[i, first + t] = slopes[i, first + t] = 0.0
        if touching:
            bad, _, held = pivot(twice, b, enabled, active, z, w.pivot.factor, w.pivot.order, held)
            status = max(status, bad)
            for i in range(several):
                forces[i, first + t] = z[i] + z[several + i]
                if s.due[near[i]] and forces[i, first + t] > 0.0:
                    fill_due(model, state, scratch, near[i])
            for i in range(rows):
                if z[i] > 0.0:
                    pattern = pattern * MIX + 4 * (i * BLOCK + t) + 3
            # contacts solved one by one leave no factor
            count = held if held > 0 else factorise(twice, active, LEAST_PIVOT, w.pivot.factor, w.pivot.order, held)[0]
            if count > 0:
                substitute(change, count, w.pivot.factor, w.pivot.order, z)
                for i in range(several):
                    slopes[i, first + t] = z[i] + z[several + i]
        more, steeper = act_on_rows(m, s, e, w, first, t, push, push_slope, total, True)
        force += more
        slope += steeper
        if fingered:
            here, here_slope = gaps[several, t], moves[several, t]
    return force, slope, pattern, status
