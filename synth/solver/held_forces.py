"""A frame of coupled strings whose contacts hold one force each: one problem of all contacts and fingers, which has a root.

Asked for where the iteration of `frames` finds none. String and obstacle are kept apart at the end of the frame only. With z
the held forces the bridge goes at V = V₀ + W Gᵀz/H, W = (I + ΓA/H)⁻¹Γ, row i of G being (ξ − pull/H)_i B, and

    0 ≤ b + (Θ + G W Gᵀ) z  ⊥  z ≥ 0,

b the gaps at V₀, Θ what the forces do to the gaps of their own lines: symmetric and positive semidefinite. A finger is a
row of either sign, eliminated before; a soft contact is two rows (`layers`), the frame its step. Nothing rubs in such a
frame.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK
from synth.solver.coupled_body import COMPONENTS
from synth.solver.coupling import KIND, NEAR, SINGLE, coupling_at, end_at, steps_of
from synth.solver.laws import EXACT_HOLD
from synth.solver.layers import middle
from synth.solver.lcp import pivot
from synth.solver.stepwise import finger_blend, finger_target
from synth.solver.stringmodel import DEPTH, RESISTANCE, STIFFNESS, string_model, string_state


@njit(inline="always")
def _sum_of(response, steps: int) -> float:
    """What a force held over the steps has done at their end."""
    total = 0.0
    for t in range(steps):
        total += response[BLOCK + t]
    return total


@njit(inline="always")
def _lay_out(c, v0, number: int, begin: int, fingers: int, count: int) -> int:
    """Rows of all contacts (fingers = 0) or fingers (1) behind `count`: line and row, G and b; how many there are then."""
    frame = c.frame
    d = COMPONENTS
    for line in range(c.lines.end.size):
        e, s, m = end_at(c.lines.end[line]), string_state(c.lines.state[line]), string_model(c.lines.model[line])
        if e.counts[KIND] < SINGLE:
            continue
        steps, of_path = steps_of(c, e, line), c.lines.steps[line]
        first, at = number % (BLOCK // steps) * steps, (begin + number) * of_path
        if fingers and s.finger[0].on == 0:
            continue
        turn = 0.0
        for i in range(d):
            turn += c.lines.direction[line, i] * (v0[i] - c.bridge.speed[i])
        contacts, layers = m.contacts.size, m.contacts.layers
        if c.lines.friction[line] > 0.0 and not fingers:  # none in such a frame
            for i in range(e.counts[NEAR]):
                for t in range(steps):
                    e.block.forces[i, first + t] = 0.0
            continue
        for i in range(1 if fingers else e.counts[NEAR]):
            row = e.block.u[contacts] if fingers else e.block.u[i]
            moved = e.responses.finger_moved[0] if fingers else e.responses.moved[e.block.near[i]]
            reach = e.responses.finger_reach[0] if fingers else e.responses.reach[e.block.near[i]]
            gap = row[first + steps - 1] + moved[BLOCK + steps - 1] * turn
            if fingers:
                finger = s.finger[0]
                blend, _ = finger_blend(EXACT_HOLD, frame, finger.stiffness, finger.resistance)
                before, after = e.path[at], e.path[at + of_path]
                target = finger_target(EXACT_HOLD, frame, finger.stiffness, finger.resistance, before, after, finger.here)
                gap -= target / blend
            drawn = 0.0
            for t in range(steps):
                drawn += reach[t]
            if not fingers and layers.shape[1] > 0:  # two rows: the layer, numbered backwards, and the stop behind it
                depth = layers[DEPTH, e.block.near[i]]
                if depth > 0.0:
                    a, kept = _middle(m, e.block.near[i], frame)
                    sunk = min(depth, max(0.0, -s.u[e.block.near[i]]))
                    count = _add_row(c, count, line, -1 - i, drawn, gap - kept / a * sunk)
                gap += depth
            count = _add_row(c, count, line, i, drawn, gap)
    return count


@njit(inline="always")
def _add_row(c, count: int, line: int, number: int, drawn: float, gap: float) -> int:
    c.problem.places[0, count] = line
    c.problem.places[1, count] = number
    c.problem.rows[0, count] = drawn
    c.problem.rows[1, count] = gap
    return count + 1


@njit(inline="always")
def _middle(m, contact: int, frame: float):
    """`layers.middle` of a contact's layer over a frame."""
    return middle(m.contacts.layers[STIFFNESS, contact], m.contacts.layers[RESISTANCE, contact], frame)


@njit(inline="always")
def _place(number: int) -> int:
    """The place among those looked at of a row's contact."""
    return number if number >= 0 else -1 - number


@njit(cache=True, nogil=True)
def hold_forces(coupling: int, number: int, begin: int, v0, v, force) -> int:
    """Forces of a frame, the same in each of its steps, into the lines' End.block.forces; a status of `lcp`.

    number, begin: of the frame in its block, of the block's first frame in the call; v0 (D,) speed of the bridge without any
    force here, v (D,) out: with them, force (D,) out: their mean on the bridge.
    """
    c = coupling_at(coupling)
    d = COMPONENTS
    contacts = _lay_out(c, v0, number, begin, int(np.int64(0)), int(np.int64(0)))
    rows = _lay_out(c, v0, number, begin, int(np.int64(1)), contacts)
    problem = c.problem
    lines, numbers, g, b, z = problem.places[0], problem.places[1], problem.rows[0], problem.rows[1], problem.rows[2]
    a = problem.matrix[: rows * rows].reshape(rows, rows)
    for i in range(rows):
        line = lines[i]
        e, s, m = end_at(c.lines.end[line]), string_state(c.lines.state[line]), string_model(c.lines.model[line])
        steps = steps_of(c, e, line)
        for k in range(i + 1):
            total = 0.0
            for p in range(d):
                for q in range(d):
                    total += c.lines.direction[line, p] * c.load.answer[p, q] * c.lines.direction[lines[k], q]
            total *= g[i] * g[k]
            if lines[k] == line:
                if i < contacts:
                    at, by = e.block.near[_place(numbers[i])], e.block.near[_place(numbers[k])]
                    total += _sum_of(m.contacts.lags[at, by], steps)
                    if k == i and numbers[i] < 0:
                        total += 1.0 / _middle(m, at, c.frame)[0]
                elif k < contacts:
                    total += _sum_of(s.grip.contacts[e.block.near[_place(numbers[k])]], steps)
                else:
                    finger = s.finger[0]
                    total += _sum_of(s.grip.own[0], steps)
                    total += finger_blend(EXACT_HOLD, c.frame, finger.stiffness, finger.resistance)[1]
            a[i, k] = a[k, i] = total
    for f in range(contacts, rows):
        for i in range(rows):
            if i < contacts or i > f:
                factor = a[i, f] / a[f, f]
                for k in range(rows):
                    a[i, k] -= factor * a[f, k]
                b[i] -= factor * b[f]
    compact = c.problem.compact[: contacts * contacts].reshape(contacts, contacts)
    factors = c.problem.factor[: contacts * contacts].reshape(contacts, contacts)
    marks = c.problem.marks
    for i in range(contacts):
        marks[0, i] = 1
        marks[1, i] = 0
        for k in range(contacts):
            compact[i, k] = a[i, k]
    zero = int(np.int64(0))
    order = c.problem.places[2]
    status, _, _ = pivot(compact, b[:contacts], marks[0, :contacts], marks[1, :contacts], z, factors, order, zero)
    for f in range(rows - 1, contacts - 1, -1):
        total = b[f]
        for k in range(rows):
            if k < contacts or k > f:
                total += a[f, k] * z[k]
        z[f] = -total / a[f, f]
    for i in range(d):
        force[i] = 0.0
    for i in range(rows):
        e, m = end_at(c.lines.end[lines[i]]), string_model(c.lines.model[lines[i]])
        row = _place(numbers[i]) if i < contacts else m.contacts.size
        steps = steps_of(c, e, lines[i])
        first = number % (BLOCK // steps) * steps
        behind_layer = i < contacts and i > 0 and lines[i - 1] == lines[i] and numbers[i - 1] == -1 - row
        for t in range(steps):
            e.block.forces[row, first + t] = z[i] + (z[i - 1] if behind_layer else 0.0)
        for k in range(d):
            force[k] += c.lines.direction[lines[i], k] * g[i] * z[i]
    for i in range(d):
        v[i] = v0[i]
        for k in range(d):
            v[i] += c.load.answer[i, k] * force[k] / c.frame
    return status
