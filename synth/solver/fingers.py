"""Strings under a finger, K = `block_rows.BLOCK` steps at a time: the fast twin of `stepwise` with a finger on.

The finger is one more row u_f of the block's problem (`blocks`), of either sign. Its responses are those of any row; as a
string answers mutually, what a contact does to the finger is what the finger does to that contact. What spring and dashpot
pull at depends on the displacement under the finger at the start of the step, which is u_f after the step before it: all
K steps are solved on the rows' K numbers alone.

Exact-hold solves the finger by itself first, and again with the contacts where it brings one of them down. Contacts that
free flight cannot reach stay certified: the pushes p_k of a finger move contact c, at any later time, by no more than

    h_c Σ |p_k|,    h_c = Σ_j |φ_j w_j| √(κ_q² + (κ_v/ω)²),

a mode's energy not growing, and this is taken off the margin; where that is used up, the K steps themselves are looked at.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK, KQ, KV
from synth.solver.blocks import fill_matrix, gather, look, observe
from synth.solver.certificates import MARGIN, certify, extents
from synth.solver.due_responses import fill_due
from synth.solver.lanes import (
    add_forced,
    add_late,
    any_forced_below,
    drive,
    drive_listed_and_one,
    grip_and_press_sequence,
    grip_sequence,
    project_q,
    project_qq,
    project_qqq,
    project_v,
    project_vv,
)
from synth.solver.laws import EXACT_HOLD, MOREAU_JEAN_FILTERED
from synth.solver.lcp import SOLVED, pivot, single
from synth.solver.responses import fill_response
from synth.solver.stepwise import finger_blend, finger_row, finger_target
from synth.solver.stringmodel import CLOCK, MOVING, scratch_of, string_model, string_state
from synth.solver.vectors import FAST, INNER


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_grip(model: int, state: int, scratch: int, on_q: int) -> None:
    """The responses to the finger whose weights the state has, of all outputs: the first `on_q` are displacements."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    rows, n, contacts = m.rows, m.rows.shape[1], m.shapes.shape[0]
    q, v, spare = w.q[:n], w.v[:n], w.spare
    finger, weights = s.finger_weights[:n], s.finger_weights[:n].reshape(1, n)
    velocity = 0 if m.law == EXACT_HOLD else 1
    own = finger_row(m.law, rows, m.shapes, finger, s.finger_coupling)
    for j in range(n):
        q[j] = rows[KQ, j] * finger[j]
        v[j] = rows[KV, j] * finger[j]
    zero, one = int(np.int64(0)), int(np.int64(1))  # literals would have it compiled once more for each
    fill_response(velocity, rows, q, v, weights, zero, spare, s.grip_own)
    fill_response(velocity, rows, q, v, m.shapes, zero, spare, s.grip_contacts)
    fill_response(zero, rows, q, v, m.weights[:on_q], zero, spare, s.grip_outputs[:on_q])
    fill_response(one, rows, q, v, m.weights[on_q:], zero, spare, s.grip_outputs[on_q:])
    s.grip_own[0, BLOCK] = own
    s.finger[0].own = own
    extents(m.omega, q, v, q)
    for c in range(contacts):
        s.grip_contacts[c, BLOCK] = s.finger_coupling[c]
        total = 0.0
        for j in range(n):
            total += abs(m.shapes[c, j]) * q[j]
        s.grip_far[c] = MARGIN * total


@njit(inline="always")
def _look_under(m, s, w, velocity: int, several: int, joined: int, at: int) -> None:
    """`blocks.look`, and the same of the finger's row, after the contacts', and of the first output where `joined`."""
    n, rows, shapes, q, v, near, u = m.rows.shape[1], m.rows, m.shapes, s.q, s.v, w.near, w.u
    touch, u_finger = s.finger_weights[:n], u[shapes.shape[0]]
    look(n, rows, shapes, q, v, velocity, near, several // 2 * 2, u)
    if joined and several % 2 == 1:
        last = shapes[near[several - 1]]
        project_qqq(n, rows, q, v, last, touch, m.weights[m.first], u[several - 1], u_finger, w.out[at:])
    elif joined:
        project_qq(n, rows, q, v, touch, m.weights[m.first], u_finger, w.out[at:])
    elif several % 2 == 1 and velocity:
        project_vv(n, rows, q, v, shapes[near[several - 1]], touch, u[several - 1], u_finger)
    elif several % 2 == 1:
        project_qq(n, rows, q, v, shapes[near[several - 1]], touch, u[several - 1], u_finger)
    elif velocity:
        project_v(n, rows, q, v, touch, u_finger)
    else:
        project_q(n, rows, q, v, touch, u_finger)


@njit(**INNER)
def _sequence(model: int, state: int, scratch: int, several: int, at: int) -> int:
    """K steps of any law at contacts near[:several] and the finger: forces and pushes from the free rows u.

    The rows become the true ones, of displacements: for Moreau–Jean the finger's only.
    """
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    law, dt, restitution, lags, contacts = m.law, m.dt, m.restitution, m.lags, m.shapes.shape[0]
    hold = law == EXACT_HOLD
    near, u, forces, b, z = w.near, w.u, w.forces, w.b, w.z
    u_finger, pushes = u[contacts], forces[contacts]
    eta, u_contact, v_contact, grip_own, grip = s.eta, s.u, s.v_contact, s.grip_own[0], s.grip_contacts
    finger = s.finger[0]
    stiffness, resistance = finger.stiffness, finger.resistance
    blend, compliance = finger_blend(law, dt, stiffness, resistance)
    total = grip_own[BLOCK] + compliance
    per_blend, per_total = 1.0 / blend, 1.0 / total
    ahead = 0.5 * dt if law == MOREAU_JEAN_FILTERED else 0.0
    fill_matrix(model, state, near, several, w.matrix)
    matrix = w.matrix[: several * several].reshape(several, several)
    enabled, active = w.enabled[:several], w.active[:several]
    for i in range(several):
        enabled[i] = 1
        active[i] = 0
        for d in range(several):
            matrix[i, d] -= grip[near[i], BLOCK] * grip[near[d], BLOCK] * per_total
    status, held = SOLVED, int(np.int64(0))
    here = finger.here
    for k in range(BLOCK):
        before, after = w.path[at + k], w.path[at + k + 1]
        target = finger_target(law, dt, stiffness, resistance, before, after, here)
        push = (target * per_blend - u_finger[k]) * per_total
        touching = False
        for i in range(several):
            c = near[i]
            if hold:
                b[i] = u[i, k] - eta[c]
            else:
                b[i] = u[i, k] + restitution * v_contact[c]
                enabled[i] = 1 if u_contact[c] - eta[c] + ahead * v_contact[c] <= 0.0 else 0
            b[i] += grip[c, BLOCK] * push
            forces[i, k] = 0.0
            touching = touching or (enabled[i] != 0 and b[i] < 0.0)
        if touching:
            if several == 1:
                z[0] = single(matrix[0, 0], b[0])
            else:
                bad, _, held = pivot(matrix, b[:several], enabled, active, z[:several], w.factor, w.order, held)
                if bad != SOLVED:
                    status = bad
            for i in range(several):
                if z[i] > 0.0:
                    if s.due[near[i]]:
                        fill_due(model, state, scratch, near[i])
                    forces[i, k] = z[i]
                    response = grip[near[i]]
                    push -= response[BLOCK] * z[i] * per_total
                    add_late(u_finger, response, k, z[i])
                    for d in range(several):
                        add_late(u[d], lags[near[d], near[i]], k, z[i])
        pushes[k] = push
        add_late(u_finger, grip_own, k, push)
        for i in range(several):
            add_late(u[i], grip[near[i]], k, push)
        if hold:
            here = u_finger[k]
        else:
            here += dt * u_finger[k]
            u_finger[k] = here
            for i in range(several):
                v_contact[near[i]] = u[i, k]
                u_contact[near[i]] += dt * u[i, k]
    return status


@njit(inline="always")
def _brings_down(several: int, pushes, s, w) -> bool:
    """Whether the pushes bring the string to one of the contacts near[:several], whose rows u are free."""
    for i in range(several):
        c = w.near[i]
        if any_forced_below(w.u[i], s.grip_contacts[c], pushes, s.eta[c]):
            return True
    return False


@njit(inline="always")
def _others_stay_clear(several: int, contacts: int, touched: bool, strength: float, lags, pushes, s, w) -> bool:
    """Whether pushes, Σ|p| = strength, and where touched the forces at near[:several], leave every contact that was not
    looked at out of reach; those that they do not are looked at from now on."""
    clear = True
    y = w.spare[0]
    for c in range(contacts):
        if s.looked[c] == 0 and (touched or s.margin[c] <= s.grip_far[c] * strength):
            for k in range(BLOCK):
                y[k] = 0.0
            if touched:
                for i in range(several):
                    add_forced(y, lags[c, w.near[i]], w.forces[i])
            if any_forced_below(y, s.grip_contacts[c], pushes, -s.margin[c]):
                s.looked[c] = 1
                s.until[c] = s.counts[CLOCK]
                clear = False
    return clear


@njit(inline="always")
def _only_pressed(m: int, near, forces) -> int:
    """Move those of near[:m] that have a force, and their forces (m, K), to the front; returns how many."""
    h = 0
    for i in range(m):
        pressed = False
        for k in range(BLOCK):
            pressed = pressed or forces[i, k] > 0.0
        if pressed:
            if h < i:
                near[h] = near[i]
                for k in range(BLOCK):
                    forces[h, k] = forces[i, k]
            h += 1
    return h


@njit(**INNER)
def advance_under_finger(model: int, state: int, scratch: int, blocks: int, stride: int) -> int:
    """`blocks.advance_blocks` with the state's finger on, along Scratch.path. Returns a status of `lcp`.

    A finger that takes hold changes the state from outside: `certificates.forget`.
    """
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    law, dt, n, points, on_q, contacts = m.law, m.dt, m.rows.shape[1], m.points, m.on_q, m.shapes.shape[0]
    rows, shapes, lags, q, v, eta = m.rows, m.shapes, m.lags, s.q, s.v, s.eta
    weights, out_lags = m.weights[m.first : m.first + points], m.out_lags[m.first : m.first + points]
    grip_own, grip, grip_outputs = s.grip_own[0], s.grip_contacts, s.grip_outputs[m.first : m.first + points]
    out, record = w.out[: points * stride].reshape(points, stride), w.record
    hold = law == EXACT_HOLD
    near, u, forces, looked = w.near, w.u, w.forces, s.looked
    u_finger, pushes, pull = u[contacts], forces[contacts], w.spare[2]
    finger = s.finger[0]
    stiffness, resistance = finger.stiffness, finger.resistance
    blend, compliance = finger_blend(law, dt, stiffness, resistance)
    per_blend, stiff = 1.0 / blend, 1.0 / (grip_own[BLOCK] + compliance)
    follow = finger_target(law, dt, stiffness, resistance, 0.0, 0.0, 1.0) * per_blend * stiff
    touch = s.finger_weights[:n]
    joined = 1 if hold and on_q > 0 else 0  # of displacements too: the finger's pass has room for it
    result = SOLVED
    s.counts[MOVING] = m.modes
    for t in range(blocks):
        at = t * BLOCK
        if m.certified and hold:
            certify(model, state, scratch, s.q[:n], s.v[:n])
        else:
            for c in range(contacts):
                looked[c] = 1
        if points > joined:
            observe(n, rows, q, v, weights[joined:], on_q - joined, out[joined:, at:])
        for i in range(at * contacts, (at + BLOCK) * contacts):
            record[i] = 0.0
        for k in range(BLOCK):
            before, after = w.path[at + k], w.path[at + k + 1]
            target = finger_target(law, dt, stiffness, resistance, before, after, 0.0)
            pull[k] = target * per_blend * stiff
        while True:
            several = gather(looked[:contacts], near)
            _look_under(m, s, w, 0 if hold else 1, several, joined, at)
            touched, true, status = not hold, w.spare[1], SOLVED
            here = finger.here
            if hold and several == 1:
                c = near[0]
                if s.due[c]:
                    fill_due(model, state, scratch, c)
                held = (stiff, follow, here)
                grip_and_press_sequence(
                    pull, held, u_finger, grip_own, eta[c], u[0], grip[c], lags[c, c], pushes, true, forces[0]
                )
                for k in range(BLOCK):
                    touched = touched or forces[0, k] > 0.0
            else:
                if hold:
                    grip_sequence(pull, (stiff, follow, here), u_finger, grip_own, pushes, true)
                    touched = _brings_down(several, pushes, s, w)
                if touched:
                    true = u_finger
                    status = _sequence(model, state, scratch, several, at)
            strength = 0.0
            for k in range(BLOCK):
                strength += abs(pushes[k])
            if several == contacts or _others_stay_clear(several, contacts, touched, strength, lags, pushes, s, w):
                break
        if status != SOLVED:
            result = status
        finger.here = true[BLOCK - 1]
        finger.push = pushes[BLOCK - 1]
        s.counts[CLOCK] += BLOCK
        for c in range(contacts):
            s.renewed[c] = -1
            if looked[c] == 0:
                s.margin[c] -= s.grip_far[c] * strength
                if touched or s.margin[c] <= 0.0:  # the forces have ended the certificate
                    s.until[c] = s.counts[CLOCK]
        pressed = _only_pressed(several, near, forces) if touched else 0
        for i in range(pressed):
            c = near[i]
            for k in range(BLOCK):
                record[(at + k) * contacts + c] = forces[i, k]
            for p in range(points):
                add_forced(out[p, at:], out_lags[p, c], forces[i])
        for p in range(points):
            add_forced(out[p, at:], grip_outputs[p], pushes)
        if pressed == 0:
            drive(n, rows, q, v, touch, pushes)
        else:
            drive_listed_and_one(n, rows, q, v, pressed, near, shapes, forces, touch, pushes)
    for c in range(contacts):
        s.force[c] = record[(blocks * BLOCK - 1) * contacts + c]
    return result
