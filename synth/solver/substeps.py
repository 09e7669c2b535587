"""Exact-hold with a contact force that changes K times in a step of the modes.

The force is held over each K-th part of the step and the Signorini condition imposed at the end of each part: the
exact-hold scheme with steps of varying length, whose proof of passivity asks nothing of their lengths.

One contact: always K parts, so that the motion is exact-hold's at K times the rate, with the modes of the lower one and no
output in between; `blocks` does that as it is, with steps Δt/K.

Several (`advance_substepped`): whole steps as long as nothing is touched, K steps of Δt/K where the end of a whole one
would lie inside the obstacle, and after one at whose end a contact was pressed or was coming down fast enough to
arrive by the next. A touch between two clear ends of whole steps is not seen.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.lcp import SOLVED
from synth.solver.stepwise import one_by_one
from synth.solver.stringmodel import scratch_of, string_model, string_state
from synth.solver.vectors import FAST, INNER, dot, put


@njit(fastmath=FAST, **INNER)
def clear_step(model: int, state: int, scratch: int) -> bool:
    """Whether a whole free step ends clear of every contact of Scratch.watch; leaves the state alone.

    StringState.u is S q now; q, v and after of Scratch.modes get q, v and S q at the end, the latter what it was where a
    contact is not watched.
    """
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    n = m.modes
    q, v, free_q, free_v = s.q[:n], s.v[:n], w.modes.q[:n], w.modes.v[:n]
    p11, p12, p21, p22 = m.rows[0, :n], m.rows[1, :n], m.rows[2, :n], m.rows[3, :n]
    for j in range(n):
        free_q[j] = p11[j] * q[j] + p12[j] * v[j]
        free_v[j] = p21[j] * q[j] + p22[j] * v[j]
    for c in range(m.contacts.size):
        w.modes.after[c] = s.u[c]
        if w.watch[c]:
            w.modes.after[c] = dot(m.contacts.shapes[c], free_q)
            if w.modes.after[c] < s.eta[c]:
                return False
    return True


@njit(**INNER)
def arriving(contacts: int, eta, before, after) -> bool:
    """Whether a contact that moves on as it did from `before` to `after` (C,) would be inside by the next step."""
    for c in range(contacts):
        if after[c] - eta[c] < before[c] - after[c]:
            return True
    return False


@njit(cache=True, nogil=True, fastmath=FAST)
def advance_substepped(model: int, part: int, state: int, scratch: int, count: int, divide, record) -> int:
    """Steps over any number of contacts, divided in `count` parts where needed, without a finger. A status of `lcp`.

    model: of whole steps; part: of a part of a step; divide (1,) whether the next step must be divided, in and out; record
    (steps, C) gets the mean force over each step, Scratch.out the outputs after it. StringState.u is S q, in and out;
    Scratch.record has room for the parts.
    """
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    contacts, n = m.contacts.size, m.modes
    q, v, after = s.q[:n], s.v[:n], w.modes.after[:contacts]
    steps, wanted = record.shape[0], m.outputs.weights[m.outputs.first : m.outputs.first + m.outputs.points]
    status = SOLVED
    for t in range(steps):
        for c in range(contacts):
            record[t, c] = 0.0
        touched = False
        if divide[0] == 0 and clear_step(model, state, scratch):
            for j in range(n):
                q[j] = w.modes.q[j]
                v[j] = w.modes.v[j]
            for c in range(contacts):
                s.force[c] = 0.0
        else:
            zero = int(np.int64(0))  # a literal would have it compiled once more
            bad = one_by_one(part, state, scratch, zero, zero, count)
            if bad != SOLVED:
                status = bad
            for c in range(contacts):
                after[c] = dot(m.contacts.shapes[c], q)
                for k in range(count):
                    force = w.record[k * contacts + c]
                    record[t, c] += force / count
                    touched = touched or force > 0.0
        divide[0] = 1 if touched or arriving(contacts, s.eta, s.u, after) else 0
        put(s.u, after)
        for p in range(m.outputs.points):
            w.out[p * steps + t] = dot(wanted[p], q)
    return status
