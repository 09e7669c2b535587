"""One step after the other: one string, its contacts and one finger; `sequence` does several steps at a time.

Every kernel advances modal coordinates (q, v) in place with the first six coefficient rows of a model (`laws`). The
contact unknowns of a step are found from the free prediction: for exact-hold from positions at the end of the step,

    0 ≤ S q_free + G λ − η  ⊥  λ ≥ 0,

for Moreau–Jean (Issanchou et al. 2018, eqs 27–31) from velocities of the contacts that are active,

    0 ≤ S v_free + W p + e vⁿ  ⊥  p ≥ 0.

A finger is one more row of the same problem, of either sign: a spring k and a dashpot r between the string and a given
path, implicit in the step, so that the work done on the string is λ·Δpath less what spring and dashpot keep:

    (k + r/Δt) u⁺ + λ = k path⁺ + (r/Δt)(path⁺ − path + u).

Soft layers (`layers`) and a law of another module (`contact_laws`) take the place of the first problem: they are asked in
every step, with what the contacts would do without a force, the finger's answer to them included.

Kernels allocate nothing and return a status of `lcp`.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.native.views import consult
from synth.solver.laws import EXACT_HOLD, MOREAU_JEAN_FILTERED
from synth.solver.layers import answer_with_layers
from synth.solver.lcp import NOT_SOLVED, SOLVED, pivot, single
from synth.solver.stringmodel import MOVING, place_of, scratch_of, string_model, string_state
from synth.solver.vectors import FAST, INNER, dot

#: of the spring between a string and a finger's path [N/m]: by less a finger holds nothing. On so soft a spring a path that
#: is force/LEAST_STIFFNESS away pulls with that force wherever the string goes
LEAST_STIFFNESS = 1e-3


@njit(inline="always")
def finger_blend(law: int, dt: float, stiffness: float, resistance: float):
    """What spring and dashpot are in one step: (blend, compliance of the finger's row)."""
    if law == EXACT_HOLD:
        blend = stiffness + resistance / dt
        return blend, 1.0 / blend
    blend = stiffness * dt + resistance
    return blend, 1.0 / (dt * blend)


@njit(inline="always")
def finger_target(law: int, dt: float, stiffness: float, resistance: float, before: float, after: float, here: float):
    """What spring and dashpot pull at in a step: path before and after it, and the string under the finger before it [m].

    Divided by the blend it is where, or how fast, the finger's row would go without a force.
    """
    step = after - before
    if law == EXACT_HOLD:
        return stiffness * after + resistance / dt * (step + here)
    return stiffness * (after - here) + resistance * step / dt


@njit(cache=True, nogil=True, fastmath=FAST)
def fly(coef, q, v) -> None:
    """One free step of every mode."""
    n = q.size
    p11, p12, p21, p22 = coef[0, :n], coef[1, :n], coef[2, :n], coef[3, :n]
    for j in range(n):
        a = p11[j] * q[j] + p12[j] * v[j]
        b = p21[j] * q[j] + p22[j] * v[j]
        q[j] = a
        v[j] = b


@njit(fastmath=FAST, **INNER)
def push_modes(q, v, kq, kv, shape, force: float) -> None:
    """A held force, or an impulse, of one row enters the coordinates."""
    for j in range(q.size):
        f = shape[j] * force
        q[j] += kq[j] * f
        v[j] += kv[j] * f


@njit(cache=True, nogil=True, fastmath=FAST)
def advance_free(n_steps: int, coef, q, v, wq, wv, use_q: int, use_v: int, out_q, out_v) -> None:
    """n free steps, no contact in reach: out_q[t] = wq·q and out_v[t] = wv·v after each step where asked for."""
    n = q.size
    p11, p12, p21, p22 = coef[0, :n], coef[1, :n], coef[2, :n], coef[3, :n]
    wq, wv = wq[:n], wv[:n]
    for t in range(n_steps):
        if use_q and not use_v:
            y = 0.0
            for j in range(n):
                a = p11[j] * q[j] + p12[j] * v[j]
                b = p21[j] * q[j] + p22[j] * v[j]
                q[j] = a
                v[j] = b
                y += wq[j] * a
            out_q[t] = y
        else:
            for j in range(n):
                a = p11[j] * q[j] + p12[j] * v[j]
                b = p21[j] * q[j] + p22[j] * v[j]
                q[j] = a
                v[j] = b
            if use_q:
                out_q[t] = dot(wq, q)
            if use_v:
                out_v[t] = dot(wv, v)


@njit(cache=True, nogil=True, fastmath=FAST)
def one_by_one(model: int, state: int, scratch: int, begin: int, at: int, steps: int) -> int:
    """Steps of any law with any number of contacts and at most one finger, over the modes that move. A status of `lcp`.

    The finger is at Scratch.path[begin] before the first; what the steps give goes behind the first `at` steps of rows that
    are at + steps long. Scratch.watch says which contacts may be touched while none has been (the others have a
    certificate; from the first contact on all are looked at, and marked there), Scratch.pivot.active which are thought to be
    pressed. What the laws of velocities need of the contacts is carried in the state (`stringmodel.place_contacts`).
    """
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    law, dt, restitution, contacts, points = m.law, m.dt, m.restitution, m.contacts.size, m.outputs.points
    n = s.counts[MOVING]
    rows, shapes, g, eta, q, v = m.rows, m.contacts.shapes, m.contacts.matrix, s.eta, s.q[:n], s.v[:n]
    p11, p12, p21, p22 = rows[0, :n], rows[1, :n], rows[2, :n], rows[3, :n]
    kq, kv = rows[4, :n], rows[5, :n]
    u_contact, v_contact, force = s.u, s.v_contact, s.force
    finger, coupling, weights = s.finger[0], s.grip.coupling, s.grip.weights[:n]
    fingered = finger.on != 0
    stiffness, resistance = finger.stiffness, finger.resistance
    hold, asked = law == EXACT_HOLD, has_answer(m)
    everything = fingered or not hold or asked
    status = SOLVED
    y, b, z, watch = w.y[:contacts], w.pivot.b[:contacts], w.z[:contacts], w.watch
    enabled, active = w.pivot.enabled[:contacts], w.pivot.active[:contacts]
    wanted = m.outputs.weights[m.outputs.first : m.outputs.first + points]
    out = w.out[: points * (at + steps)].reshape(points, at + steps)
    record, contact_u = w.record, w.contact_u

    # the finger's row, eliminated: λ_f = (target − y_f − couplingᵀλ)/(own + compliance)
    compliance = 0.0
    blend = 0.0
    if fingered:
        blend, compliance = finger_blend(law, dt, stiffness, resistance)
    total_own = finger.own + compliance
    matrix = g
    if fingered or asked:
        matrix = w.a
        for c in range(contacts):
            for d in range(contacts):
                matrix[c, d] = g[c, d]
                if fingered:
                    matrix[c, d] -= coupling[c] * coupling[d] / total_own
    if asked:
        for c in range(contacts):
            u_contact[c] = place_of(m, s, c, q)

    held = int(np.int64(0))  # rows of Scratch.pivot.factor that the steps so far made for `matrix`
    for t in range(steps):
        for j in range(n):  # `fly` in place: the call costs a tenth
            first = p11[j] * q[j] + p12[j] * v[j]
            second = p21[j] * q[j] + p22[j] * v[j]
            q[j] = first
            v[j] = second
        x = q if hold else v
        # finger first: its target at the end of the step
        push = 0.0
        y_finger = 0.0
        if fingered:
            y_finger = dot(weights, x)
            before, after = w.path[begin + t], w.path[begin + t + 1]
            target = finger_target(law, dt, stiffness, resistance, before, after, finger.here)
            push = (target / blend - y_finger) / total_own
        touching = asked and contacts > 0
        for c in range(contacts):
            if everything or watch[c]:
                y[c] = dot(shapes[c], x)
                if asked:
                    if fingered:
                        y[c] += coupling[c] * push
                    z[c] = 0.0
                    continue
                if hold:
                    b[c] = y[c] - eta[c]
                    enabled[c] = 1
                else:
                    b[c] = y[c] + restitution * v_contact[c]
                    gap = u_contact[c] - eta[c]
                    if law == MOREAU_JEAN_FILTERED:
                        gap += 0.5 * dt * v_contact[c]
                    enabled[c] = 1 if gap <= 0.0 else 0
                b[c] += coupling[c] * push if fingered else 0.0
                if enabled[c] and b[c] < 0.0:
                    touching = True
        if touching and not everything:
            for c in range(contacts):
                if not watch[c]:
                    y[c] = dot(shapes[c], q)
                    b[c] = y[c] - eta[c]
                    enabled[c] = 1
                    watch[c] = 1
            everything = True
        if touching:
            if asked:
                if _answer(model, state, scratch) != SOLVED:
                    status = NOT_SOLVED
            elif contacts == 1:
                z[0] = single(matrix[0, 0], b[0])
            else:
                bad, _, held = pivot(matrix, b, enabled, active, z, w.pivot.factor, w.pivot.order, held)
                if bad != SOLVED:
                    status = bad
            for c in range(contacts):
                force[c] = z[c]
        else:
            for c in range(contacts):
                force[c] = 0.0
        if fingered:
            if touching:
                for c in range(contacts):
                    push -= coupling[c] * force[c] / total_own
            push_modes(q, v, kq, kv, weights, push)
            finger.push = push
        if touching:
            for c in range(contacts):
                if force[c] != 0.0:
                    push_modes(q, v, kq, kv, shapes[c], force[c])
        if fingered:
            finger.here = dot(weights, q)
        if asked:
            for c in range(contacts):
                u_contact[c] = place_of(m, s, c, q)
        elif not hold:
            for c in range(contacts):
                v_contact[c] = y[c]
                if fingered:
                    v_contact[c] += coupling[c] * push
                if touching:
                    for d in range(contacts):
                        v_contact[c] += g[c, d] * force[d]
                u_contact[c] += dt * v_contact[c]
        for p in range(points):
            out[p, at + t] = dot(wanted[p], q) if p < m.outputs.on_q else dot(wanted[p], v)
        for c in range(contacts):
            record[(at + t) * contacts + c] = force[c]
        if contact_u.size > 0:
            for c in range(contacts):
                contact_u[(at + t) * contacts + c] = u_contact[c] if asked else dot(shapes[c], q)
    return status


@njit(inline="always")
def has_answer(m) -> bool:
    """Whether layers, or a law of another module, give the forces of a step in the place of the contact problem."""
    return m.step != 0 or m.contacts.layers.shape[1] != 0


@njit(**INNER)
def _answer(model: int, state: int, scratch: int) -> int:
    """Find the forces of a step by layers or a law of another module (`contact_laws.ContactLaw.answer`): a status."""
    m = string_model(model)
    if m.contacts.layers.shape[1] > 0:
        return answer_with_layers(model, state, scratch)
    return consult(m.step, model, state, scratch)


@njit(cache=True, nogil=True, fastmath=FAST)
def finger_row(law: int, coef, shapes, weights, coupling) -> float:
    """Fill coupling (C,) = S diag(k) wᵀ, k the row that `contact_matrix` uses, w the weights; return w diag(k) wᵀ."""
    n = weights.size
    row = coef[4, :n] if law == EXACT_HOLD else coef[5, :n]
    own = 0.0
    for j in range(n):
        own += weights[j] * row[j] * weights[j]
    for c in range(shapes.shape[0]):
        total = 0.0
        for j in range(n):
            total += shapes[c, j] * row[j] * weights[j]
        coupling[c] = total
    return own
