"""Strings under a finger, K = `lanes.BLOCK` steps at a time: the fast twin of `kernels.advance` with a finger on.

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

from typing import NamedTuple

import numpy as np
from numba import njit

from synth.solver.blocks import BlockWork, certify, fill_matrix, fill_response, gather, look, observe
from synth.solver.kernels import MARGIN, Finger, extents, finger_blend, finger_row, finger_target
from synth.solver.lanes import (
    BLOCK,
    KQ,
    KV,
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
from synth.solver.vectors import FAST, INNER


class Grip(NamedTuple):
    """Responses to a unit unknown of the finger over a block, as `blocks.fill_lags` has them: `fill_grip`."""

    own: np.ndarray  # (1, 2K) of the finger's row
    contacts: np.ndarray  # (C, 2K)
    outputs: np.ndarray  # (P, 2K)
    far: np.ndarray  # (C,) h_c, a bound on the displacement of a contact at any later time


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_grip(law: int, rows, omega, shapes, weights, out_weights, on_q: int, at_once, q, v, spare, grip: Grip) -> float:
    """Fill a Grip, and at_once (C,) with the contacts' responses of the same step; returns the finger's own.

    rows (ROWS, n); omega (N,); shapes (C, n); weights (1, n) of the finger, zero beyond N; out_weights (P, n), the first
    on_q on displacements. q, v (n,) and spare (2, K) are work space.
    """
    velocity = 0 if law == EXACT_HOLD else 1
    finger = weights[0]
    own = finger_row(law, rows, shapes, finger, at_once)
    for j in range(rows.shape[1]):
        q[j] = rows[KQ, j] * finger[j]
        v[j] = rows[KV, j] * finger[j]
    zero, one = int(np.int64(0)), int(np.int64(1))  # literals would have it compiled once more for each
    fill_response(velocity, rows, q, v, weights, zero, spare, grip.own)
    fill_response(velocity, rows, q, v, shapes, zero, spare, grip.contacts)
    fill_response(zero, rows, q, v, out_weights[:on_q], zero, spare, grip.outputs[:on_q])
    fill_response(one, rows, q, v, out_weights[on_q:], zero, spare, grip.outputs[on_q:])
    grip.own[0, BLOCK] = own
    extents(omega, q, v, q)
    for c in range(shapes.shape[0]):
        grip.contacts[c, BLOCK] = at_once[c]
        total = 0.0
        for j in range(omega.size):
            total += abs(shapes[c, j]) * q[j]
        grip.far[c] = MARGIN * total
    return own


@njit(inline="always")
def _look_under(
    n: int, rows, shapes, touch, q, v, velocity: int, near, m: int, u, u_finger, joined: int, weights, out, at: int
) -> None:
    """`blocks.look`, and the same of the finger's row: u_finger (K,), and of the first output where it has `joined`."""
    look(n, rows, shapes, q, v, velocity, near, m // 2 * 2, u)
    if joined and m % 2 == 1:
        last = shapes[near[m - 1]]
        project_qqq(n, rows, q, v, last, touch, weights[0], u[m - 1], u_finger, out[0, at:])
    elif joined:
        project_qq(n, rows, q, v, touch, weights[0], u_finger, out[0, at:])
    elif m % 2 == 1 and velocity:
        project_vv(n, rows, q, v, shapes[near[m - 1]], touch, u[m - 1], u_finger)
    elif m % 2 == 1:
        project_qq(n, rows, q, v, shapes[near[m - 1]], touch, u[m - 1], u_finger)
    elif velocity:
        project_v(n, rows, q, v, touch, u_finger)
    else:
        project_q(n, rows, q, v, touch, u_finger)


@njit(**INNER)
def _sequence(
    law: int, m: int, at: int, dt: float, restitution: float, eta, lags, finger: Finger, grip: Grip, u_finger, pushes,
    u_contact, v_contact, work: BlockWork,
) -> int:  # fmt: skip
    """K steps of any law at contacts near[:m] and the finger: forces and pushes (K,) from the free rows u and u_finger.

    The rows become the true ones, of displacements: for Moreau–Jean u_finger only.
    """
    hold = law == EXACT_HOLD
    near, u, forces, b, z = work.near, work.u, work.forces, work.b, work.z
    blend, compliance = finger_blend(law, dt, finger.stiffness, finger.resistance)
    total = grip.own[0, BLOCK] + compliance
    per_blend, per_total = 1.0 / blend, 1.0 / total
    ahead = 0.5 * dt if law == MOREAU_JEAN_FILTERED else 0.0
    fill_matrix(lags, near, m, work.matrix)
    matrix = work.matrix[: m * m].reshape(m, m)
    enabled, active = work.enabled[:m], work.active[:m]
    for i in range(m):
        enabled[i] = 1
        active[i] = 0
        for d in range(m):
            matrix[i, d] -= grip.contacts[near[i], BLOCK] * grip.contacts[near[d], BLOCK] * per_total
    status, held = SOLVED, int(np.int64(0))
    here = finger.state[0]
    for k in range(BLOCK):
        before, after = finger.path[at + k], finger.path[at + k + 1]
        target = finger_target(law, dt, finger.stiffness, finger.resistance, before, after, here)
        push = (target * per_blend - u_finger[k]) * per_total
        touching = False
        for i in range(m):
            c = near[i]
            if hold:
                b[i] = u[i, k] - eta[c]
            else:
                b[i] = u[i, k] + restitution * v_contact[c]
                enabled[i] = 1 if u_contact[c] - eta[c] + ahead * v_contact[c] <= 0.0 else 0
            b[i] += grip.contacts[c, BLOCK] * push
            forces[i, k] = 0.0
            touching = touching or (enabled[i] != 0 and b[i] < 0.0)
        if touching:
            if m == 1:
                z[0] = single(matrix[0, 0], b[0])
            else:
                bad, _, held = pivot(matrix, b[:m], enabled, active, z[:m], work.factor, work.order, held)
                if bad != SOLVED:
                    status = bad
            for i in range(m):
                if z[i] > 0.0:
                    forces[i, k] = z[i]
                    response = grip.contacts[near[i]]
                    push -= response[BLOCK] * z[i] * per_total
                    add_late(u_finger, response, k, z[i])
                    for d in range(m):
                        add_late(u[d], lags[near[d], near[i]], k, z[i])
        pushes[k] = push
        add_late(u_finger, grip.own[0], k, push)
        for i in range(m):
            add_late(u[i], grip.contacts[near[i]], k, push)
        if hold:
            here = u_finger[k]
        else:
            here += dt * u_finger[k]
            u_finger[k] = here
            for i in range(m):
                v_contact[near[i]] = u[i, k]
                u_contact[near[i]] += dt * u[i, k]
    return status


@njit(inline="always")
def _brings_down(m: int, eta, grip: Grip, pushes, work: BlockWork) -> bool:
    """Whether the pushes bring the string to one of the contacts near[:m], whose rows u are free."""
    for i in range(m):
        c = work.near[i]
        if any_forced_below(work.u[i], grip.contacts[c], pushes, eta[c]):
            return True
    return False


@njit(inline="always")
def _others_stay_clear(m: int, touched: bool, strength: float, lags, grip: Grip, pushes, work: BlockWork) -> bool:
    """Whether pushes, Σ|p| = strength, and where touched the forces at near[:m], leave every contact that was not looked
    at out of reach; those that they do not are looked at from now on."""
    clear = True
    y = work.spare[0]
    for c in range(work.looked.size):
        if work.looked[c] == 0 and (touched or work.margin[c] <= grip.far[c] * strength):
            for k in range(BLOCK):
                y[k] = 0.0
            if touched:
                for i in range(m):
                    add_forced(y, lags[c, work.near[i]], work.forces[i])
            if any_forced_below(y, grip.contacts[c], pushes, -work.margin[c]):
                work.looked[c] = 1
                work.until[c] = work.clock[0]
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
def advance_under_finger(
    blocks: int, law: int, n: int, dt: float, restitution: float, rows, omega, shapes, eta, lags, certified: int, q, v,
    u_contact, v_contact, finger: Finger, grip: Grip, weights, on_q: int, out_lags, out, rec_force, work: BlockWork,
) -> int:  # fmt: skip
    """`blocks.advance_blocks` with a finger on: arguments as there. Returns a status of `lcp`.

    finger.weights (n,), path (≥ blocks·K + 1,), state in and out; its `own` and `coupling` are not read, those of `grip`
    are. A finger that takes hold changes the state from outside: `blocks.forget`.
    """
    contacts = eta.size
    hold = law == EXACT_HOLD
    points = weights.shape[0]
    near, u, forces, looked = work.near, work.u, work.forces, work.looked[:contacts]
    u_finger, pushes, pull = u[contacts], forces[contacts], work.spare[2]
    blend, compliance = finger_blend(law, dt, finger.stiffness, finger.resistance)
    per_blend, stiff = 1.0 / blend, 1.0 / (grip.own[0, BLOCK] + compliance)
    follow = finger_target(law, dt, finger.stiffness, finger.resistance, 0.0, 0.0, 1.0) * per_blend * stiff
    touch = finger.weights
    joined = 1 if hold and on_q > 0 else 0  # of displacements too: the finger's pass has room for it
    result = SOLVED
    work.moving[0] = n
    for t in range(blocks):
        at = t * BLOCK
        if certified and hold:
            certify(
                dt, omega[:n], shapes, eta, q, v, work.clock[0], looked, work.until, work.margin, work.bounds, work.renewed,
                work.moved,
            )  # fmt: skip
        else:
            for c in range(contacts):
                looked[c] = 1
        if points > joined:
            observe(n, rows, q, v, weights[joined:], on_q - joined, out[joined:, at:])
        for k in range(BLOCK):
            for c in range(contacts):
                rec_force[at + k, c] = 0.0
            before, after = finger.path[at + k], finger.path[at + k + 1]
            target = finger_target(law, dt, finger.stiffness, finger.resistance, before, after, 0.0)
            pull[k] = target * per_blend * stiff
        while True:
            m = gather(looked, near)
            _look_under(n, rows, shapes, touch, q, v, 0 if hold else 1, near, m, u, u_finger, joined, weights, out, at)
            touched, true, status = not hold, work.spare[1], SOLVED
            here = finger.state[0]
            if hold and m == 1:
                c = near[0]
                grip_and_press_sequence(
                    pull, stiff, follow, here, u_finger, grip.own[0], eta[c], u[0], grip.contacts[c], lags[c, c], pushes,
                    true, forces[0],
                )  # fmt: skip
                for k in range(BLOCK):
                    touched = touched or forces[0, k] > 0.0
            else:
                if hold:
                    grip_sequence(pull, stiff, follow, here, u_finger, grip.own[0], pushes, true)
                    touched = _brings_down(m, eta, grip, pushes, work)
                if touched:
                    true = u_finger
                    status = _sequence(
                        law, m, at, dt, restitution, eta, lags, finger, grip, u_finger, pushes, u_contact, v_contact, work
                    )
            strength = 0.0
            for k in range(BLOCK):
                strength += abs(pushes[k])
            if m == contacts or _others_stay_clear(m, touched, strength, lags, grip, pushes, work):
                break
        if status != SOLVED:
            result = status
        finger.state[0] = true[BLOCK - 1]
        finger.state[1] = pushes[BLOCK - 1]
        work.clock[0] += BLOCK
        for c in range(contacts):
            work.renewed[c] = -1
            if looked[c] == 0:
                work.margin[c] -= grip.far[c] * strength
                if touched or work.margin[c] <= 0.0:  # the forces have ended the certificate
                    work.until[c] = work.clock[0]
        pressed = _only_pressed(m, near, forces) if touched else 0
        for i in range(pressed):
            c = near[i]
            for k in range(BLOCK):
                rec_force[at + k, c] = forces[i, k]
            for p in range(points):
                add_forced(out[p, at:], out_lags[p, c], forces[i])
        for p in range(points):
            add_forced(out[p, at:], grip.outputs[p], pushes)
        if pressed == 0:
            drive(n, rows, q, v, touch, pushes)
        else:
            drive_listed_and_one(n, rows, q, v, pressed, near, shapes, forces, touch, pushes)
    return result
