"""Steps of a string whose contact forces a law of its own decides (`contact_laws`, `layers`), one after the other.

Free motion is exact-hold's: the exact propagator, forces held over the step. The law is asked in every step, with what the
contacts would do without it, and its forces enter the modes and act back on a finger.
"""

from __future__ import annotations

from numba import njit

from synth.native.views import consult
from synth.solver.laws import EXACT_HOLD
from synth.solver.layers import answer_with_layers
from synth.solver.lcp import NOT_SOLVED, SOLVED
from synth.solver.stepwise import finger_blend, finger_target, fly, push_modes
from synth.solver.stringmodel import MOVING, scratch_of, string_model, string_state
from synth.solver.vectors import FAST, dot


@njit(cache=True, nogil=True, fastmath=FAST)
def by_law(model: int, state: int, scratch: int, begin: int, at: int, steps: int) -> int:
    """As `stepwise.one_by_one`, by the law at StringModel.step or that of its layers. A status of `lcp`."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    dt, contacts, points, n = m.dt, m.shapes.shape[0], m.points, s.counts[MOVING]
    rows, shapes, force, z, q, v = m.rows, m.shapes, s.force, w.z, s.q[:n], s.v[:n]
    kq, kv = rows[4, :n], rows[5, :n]
    finger, coupling, weights = s.finger[0], s.finger_coupling, s.finger_weights[:n]
    fingered = finger.on != 0
    stiffness, resistance = finger.stiffness, finger.resistance
    blend, compliance = 1.0, 0.0
    if fingered:
        blend, compliance = finger_blend(EXACT_HOLD, dt, stiffness, resistance)
    total = finger.own + compliance
    wanted = m.weights[m.first : m.first + points]
    out = w.out[: points * (at + steps)].reshape(points, at + steps)
    for c in range(contacts):
        for d in range(contacts):
            w.a[c, d] = m.matrix[c, d]
            if fingered:
                w.a[c, d] -= coupling[c] * coupling[d] / total
    _place(model, state, n)
    status = SOLVED
    for t in range(steps):
        fly(rows, q, v)
        push = 0.0
        if fingered:
            before, after = w.path[begin + t], w.path[begin + t + 1]
            target = finger_target(EXACT_HOLD, dt, stiffness, resistance, before, after, finger.here)
            push = (target / blend - dot(weights, q)) / total
        for c in range(contacts):
            w.y[c] = dot(shapes[c], q)
            if fingered:
                w.y[c] += coupling[c] * push
            z[c] = 0.0
        if contacts > 0:
            if m.layers.shape[1] > 0:
                bad = answer_with_layers(model, state, scratch)
            else:
                bad = consult(m.step, model, state, scratch)
            if bad != SOLVED:
                status = NOT_SOLVED
        for c in range(contacts):
            force[c] = z[c]
            if fingered:
                push -= coupling[c] * force[c] / total
        if fingered:
            push_modes(q, v, kq, kv, weights, push)
            finger.push = push
        for c in range(contacts):
            if force[c] != 0.0:
                push_modes(q, v, kq, kv, shapes[c], force[c])
        if fingered:
            finger.here = dot(weights, q)
        _place(model, state, n)
        for p in range(points):
            out[p, at + t] = dot(wanted[p], q) if p < m.on_q else dot(wanted[p], v)
        for c in range(contacts):
            w.record[(at + t) * contacts + c] = force[c]
        if w.contact_u.size > 0:
            for c in range(contacts):
                w.contact_u[(at + t) * contacts + c] = s.u[c]
    return status


@njit(cache=True, nogil=True, fastmath=FAST)
def _place(model: int, state: int, modes: int) -> None:
    """StringState.u: displacements of the contacts, those of the modes left out with them."""
    m, s = string_model(model), string_state(state)
    contacts, q = m.shapes.shape[0], s.q[:modes]
    for c in range(contacts):
        s.u[c] = dot(m.shapes[c], q)
        for d in range(contacts):
            s.u[c] += m.residual[c, d] * s.force[d]
