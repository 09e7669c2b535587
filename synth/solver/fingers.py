"""Strings under a finger, K = `block_rows.BLOCK` steps at a time: the fast twin of `stepwise` with a finger on.

Exact-hold solves the finger by itself first, and again with the contacts where it brings one of them down. Contacts that
free flight cannot reach stay certified: the pushes p_k of a finger move contact c, at any later time, by no more than

    h_c Σ |p_k|,    h_c = Σ_j |φ_j w_j| √(κ_q² + (κ_v/ω)²),

a mode's energy not growing, and this is taken off the margin; where that is used up, the K steps themselves are looked at.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK, KQ, KV
from synth.solver.blocks import look, observe
from synth.solver.certificates import MARGIN, certify, extents
from synth.solver.due_responses import fill_due
from synth.solver.lanes import (
    add_forced,
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
from synth.solver.laws import EXACT_HOLD
from synth.solver.lcp import SOLVED
from synth.solver.responses import fill_response
from synth.solver.sequence import end_certificates, gather, note_forces, others_stay_clear, solve_sequence
from synth.solver.stepwise import finger_blend, finger_row, finger_target
from synth.solver.stringmodel import CLOCK, MOVING, scratch_of, string_model, string_state
from synth.solver.vectors import FAST, INNER


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_grip(model: int, state: int, scratch: int, on_q: int) -> None:
    """The responses to the finger whose weights the state has, of all outputs: the first `on_q` are displacements."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    rows, n, contacts = m.rows, m.rows.shape[1], m.contacts.size
    q, v, spare = w.modes.q[:n], w.modes.v[:n], w.rows.spare
    finger, weights = s.grip.weights[:n], s.grip.weights[:n].reshape(1, n)
    velocity = 0 if m.law == EXACT_HOLD else 1
    own = finger_row(m.law, rows, m.contacts.shapes, finger, s.grip.coupling)
    for j in range(n):
        q[j] = rows[KQ, j] * finger[j]
        v[j] = rows[KV, j] * finger[j]
    zero, one = int(np.int64(0)), int(np.int64(1))  # literals would have it compiled once more for each
    fill_response(velocity, rows, q, v, weights, zero, spare, s.grip.own)
    fill_response(velocity, rows, q, v, m.contacts.shapes, zero, spare, s.grip.contacts)
    fill_response(zero, rows, q, v, m.outputs.weights[:on_q], zero, spare, s.grip.outputs[:on_q])
    fill_response(one, rows, q, v, m.outputs.weights[on_q:], zero, spare, s.grip.outputs[on_q:])
    s.grip.own[0, BLOCK] = own
    s.finger[0].own = own
    extents(m.omega, q, v, q)
    for c in range(contacts):
        s.grip.contacts[c, BLOCK] = s.grip.coupling[c]
        total = 0.0
        for j in range(n):
            total += abs(m.contacts.shapes[c, j]) * q[j]
        s.grip.far[c] = MARGIN * total


@njit(inline="always")
def _look_under(m, s, w, velocity: int, several: int, joined: int, at: int) -> None:
    """`blocks.look`, and the same of the finger's row, after the contacts', and of the first output where `joined`."""
    n, rows, shapes, q, v, near, u = m.rows.shape[1], m.rows, m.contacts.shapes, s.q, s.v, w.rows.near, w.rows.u
    touch, u_finger = s.grip.weights[:n], u[shapes.shape[0]]
    look(n, rows, shapes, q, v, velocity, near, several // 2 * 2, u)
    if joined and several % 2 == 1:
        last = shapes[near[several - 1]]
        project_qqq(n, rows, q, v, last, touch, m.outputs.weights[m.outputs.first], u[several - 1], u_finger, w.out[at:])
    elif joined:
        project_qq(n, rows, q, v, touch, m.outputs.weights[m.outputs.first], u_finger, w.out[at:])
    elif several % 2 == 1 and velocity:
        project_vv(n, rows, q, v, shapes[near[several - 1]], touch, u[several - 1], u_finger)
    elif several % 2 == 1:
        project_qq(n, rows, q, v, shapes[near[several - 1]], touch, u[several - 1], u_finger)
    elif velocity:
        project_v(n, rows, q, v, touch, u_finger)
    else:
        project_q(n, rows, q, v, touch, u_finger)


@njit(inline="always")
def _brings_down(several: int, pushes, s, w) -> bool:
    """Whether the pushes bring the string to one of the contacts near[:several], whose rows u are free."""
    for i in range(several):
        c = w.rows.near[i]
        if any_forced_below(w.rows.u[i], s.grip.contacts[c], pushes, s.eta[c]):
            return True
    return False


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
    law, dt, n, first, points, on_q = m.law, m.dt, m.rows.shape[1], m.outputs.first, m.outputs.points, m.outputs.on_q
    contacts, rows, shapes, lags, q, v, eta = m.contacts.size, m.rows, m.contacts.shapes, m.contacts.lags, s.q, s.v, s.eta
    weights = m.outputs.weights[first : first + points]
    grip_own, grip, grip_outputs = s.grip.own[0], s.grip.contacts, s.grip.outputs[first : first + points]
    out, record = w.out[: points * stride].reshape(points, stride), w.record
    hold = law == EXACT_HOLD
    near, u, forces, looked = w.rows.near, w.rows.u, w.rows.forces, s.certificates.looked
    u_finger, pushes, pull = u[contacts], forces[contacts], w.rows.spare[2]
    finger = s.finger[0]
    stiffness, resistance = finger.stiffness, finger.resistance
    blend, compliance = finger_blend(law, dt, stiffness, resistance)
    per_blend, stiff = 1.0 / blend, 1.0 / (grip_own[BLOCK] + compliance)
    follow = finger_target(law, dt, stiffness, resistance, 0.0, 0.0, 1.0) * per_blend * stiff
    touch = s.grip.weights[:n]
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
            touched, true, status = not hold, w.rows.spare[1], SOLVED
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
                    status = solve_sequence(model, state, scratch, several, at)
            strength = 0.0
            for k in range(BLOCK):
                strength += abs(pushes[k])
            until = s.counts[CLOCK]
            if several == contacts or others_stay_clear(model, state, scratch, several, touched, strength, until):
                break
        if status != SOLVED:
            result = status
        finger.here = true[BLOCK - 1]
        finger.push = pushes[BLOCK - 1]
        s.counts[CLOCK] += BLOCK
        end_certificates(model, state, touched, strength)
        pressed = _only_pressed(several, near, forces) if touched else 0
        note_forces(model, scratch, pressed, at, stride)
        for p in range(points):
            add_forced(out[p, at:], grip_outputs[p], pushes)
        if pressed == 0:
            drive(n, rows, q, v, touch, pushes)
        else:
            drive_listed_and_one(n, rows, q, v, pressed, near, shapes, forces, touch, pushes)
    for c in range(contacts):
        s.force[c] = record[(blocks * BLOCK - 1) * contacts + c]
    return result
