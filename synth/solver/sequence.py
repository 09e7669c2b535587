"""K steps of contacts and a finger, one after the other, on their rows' K numbers alone; K = `block_rows.BLOCK`.

Over a block of K steps a string flies free but for the forces on it, so that the motion of every row is its free projection
(`blocks.look`) plus a lower triangular Toeplitz sum over the forces:

    u_k = S q_free,k + Σ_{i ≤ k} h_{k−i} λ_i,    h_0 = G,  h_l = S (Φ^l κ) Sᵀ,

u displacements for exact-hold, velocities for Moreau–Jean. The problem of each step is that of `stepwise`. A finger is one
more row; as a string answers mutually, what a contact does to the finger is what the finger does to that contact. What its
spring and dashpot pull at depends on the displacement under it at the start of the step, u after the step before.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK
from synth.solver.due_responses import ROW_DUE, fill_due, fill_row
from synth.solver.lanes import add_forced, add_late, any_below, any_forced_below
from synth.solver.laws import EXACT_HOLD, MOREAU_JEAN_FILTERED
from synth.solver.lcp import SOLVED, pivot, single
from synth.solver.stepwise import finger_blend, finger_target
from synth.solver.stringmodel import CLOCK, scratch_of, string_model, string_state
from synth.solver.vectors import INNER


@njit(inline="always")
def gather(looked, near) -> int:
    """Numbers of the contacts that are looked at; returns how many."""
    m = int(np.int64(0))  # a literal would have kernels that are called with m compiled once more
    for c in range(looked.size):
        if looked[c]:
            near[m] = c
            m += 1
    return m


@njit(inline="always")
def _fill_matrix(model: int, state: int, near, m: int, matrix) -> None:
    """matrix (m·m,) of contacts near[:m] from their lag responses, of which what still waits is filled."""
    lags, due = string_model(model).contacts.lags, string_state(state).due
    for i in range(m if m > 1 else 0):
        if due[near[i]] == ROW_DUE:
            fill_row(model, state, near[i])
    for i in range(m):
        for d in range(m):
            matrix[i * m + d] = lags[near[i], near[d], BLOCK]


@njit(**INNER)
def solve_sequence(model: int, state: int, scratch: int, several: int, at: int) -> int:
    """K steps of any law at contacts near[:several] and at the finger that is on, along Scratch.path[at:]: a status of
    `lcp`.

    Scratch.rows.forces, with a finger's pushes in the row behind the contacts', from the free rows Scratch.rows.u, which
    become the true ones, of displacements.
    """
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    law, dt, restitution, lags, contacts = m.law, m.dt, m.restitution, m.contacts.lags, m.contacts.size
    near, u, forces, b, z = w.rows.near, w.rows.u, w.rows.forces, w.pivot.b, w.z
    eta, u_contact, v_contact, grip_own, grip = s.eta, s.u, s.v_contact, s.grip.own[0], s.grip.contacts
    finger, u_finger, pushes = s.finger[0], u[contacts], forces[contacts]
    hold, fingered = law == EXACT_HOLD, finger.on != 0
    stiffness, resistance, here = finger.stiffness, finger.resistance, finger.here
    push, per_blend, per_total = 0.0, 0.0, 0.0
    if fingered:
        blend, compliance = finger_blend(law, dt, stiffness, resistance)
        per_blend, per_total = 1.0 / blend, 1.0 / (grip_own[BLOCK] + compliance)
    ahead = 0.5 * dt if law == MOREAU_JEAN_FILTERED else 0.0
    _fill_matrix(model, state, near, several, w.pivot.matrix)
    matrix = w.pivot.matrix[: several * several].reshape(several, several)
    enabled, active = w.pivot.enabled[:several], w.pivot.active[:several]
    for i in range(several):
        enabled[i] = 1
        active[i] = 0
        for d in range(several if fingered else 0):
            matrix[i, d] -= grip[near[i], BLOCK] * grip[near[d], BLOCK] * per_total
    status, held = SOLVED, int(np.int64(0))
    for k in range(BLOCK):
        if fingered:
            target = finger_target(law, dt, stiffness, resistance, w.path[at + k], w.path[at + k + 1], here)
            push = (target * per_blend - u_finger[k]) * per_total
        if hold:
            for i in range(several):
                b[i] = u[i, k] - eta[near[i]]
        else:
            for i in range(several):
                c = near[i]
                b[i] = u[i, k] + restitution * v_contact[c]
                enabled[i] = 1 if u_contact[c] - eta[c] + ahead * v_contact[c] <= 0.0 else 0
        if fingered:
            for i in range(several):
                b[i] += grip[near[i], BLOCK] * push
        touching = False
        for i in range(several):
            forces[i, k] = 0.0
            touching = touching or (enabled[i] != 0 and b[i] < 0.0)
        if touching:
            if several == 1:
                z[0] = single(matrix[0, 0], b[0])
            else:
                bad, _, held = pivot(matrix, b[:several], enabled, active, z[:several], w.pivot.factor, w.pivot.order, held)
                if bad != SOLVED:
                    status = bad
            for i in range(several):
                if z[i] > 0.0:
                    if s.due[near[i]]:
                        fill_due(model, state, scratch, near[i])
                    forces[i, k] = z[i]
                    if fingered:
                        push -= grip[near[i], BLOCK] * z[i] * per_total
                        add_late(u_finger, grip[near[i]], k, z[i])
                    for d in range(several):
                        add_late(u[d], lags[near[d], near[i]], k, z[i])
        if fingered:
            pushes[k] = push
            add_late(u_finger, grip_own, k, push)
            for i in range(several):
                add_late(u[i], grip[near[i]], k, push)
            if not hold:
                u_finger[k] = here + dt * u_finger[k]
            here = u_finger[k]
        if not hold:
            for i in range(several):
                c = near[i]
                v_contact[c] = u[i, k]
                u_contact[c] += dt * v_contact[c]
                u[i, k] = u_contact[c]
    return status


@njit(**INNER)
def strike_sequence(model: int, state: int, scratch: int) -> None:
    """`solve_sequence` of Moreau–Jean over one contact without a finger, what goes from step to step in registers."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    u, forces, response, eta = w.rows.u[0], w.rows.forces[0], m.contacts.lags[0, 0], s.eta[0]
    dt, restitution = m.dt, m.restitution
    ahead = 0.5 * dt if m.law == MOREAU_JEAN_FILTERED else 0.0
    here, speed, stiffness = s.u[0], s.v_contact[0], 1.0 / response[BLOCK]
    for k in range(BLOCK):
        forces[k] = 0.0
        wanted = -(u[k] + restitution * speed) * stiffness
        if wanted > 0.0 and here - eta + ahead * speed <= 0.0:
            forces[k] = wanted
            add_late(u, response, k, wanted)
        speed = u[k]
        here += dt * speed
        u[k] = here
    s.u[0], s.v_contact[0] = here, speed


@njit(**INNER)
def others_stay_clear(
    model: int, state: int, scratch: int, several: int, touched: bool, strength: float, until: int
) -> bool:
    """Whether the forces at near[:several], where it is touched, and a finger's pushes, Σ|p| = strength, leave every contact
    that was not looked at out of reach; those that they do not are looked at, up to step number `until`."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    pushes, y, clear = w.rows.forces[m.contacts.size], w.rows.spare[0], True
    for c in range(m.contacts.size):
        if s.certificates.looked[c] == 0 and (touched or s.certificates.margin[c] <= s.grip.far[c] * strength):
            for k in range(BLOCK):
                y[k] = 0.0
            for i in range(several if touched else 0):
                add_forced(y, m.contacts.lags[c, w.rows.near[i]], w.rows.forces[i])
            if s.finger[0].on:
                inside = any_forced_below(y, s.grip.contacts[c], pushes, -s.certificates.margin[c])
            else:
                inside = any_below(y, -s.certificates.margin[c])
            if inside:
                s.certificates.looked[c] = 1
                s.certificates.until[c] = until
                clear = False
    return clear


@njit(**INNER)
def end_certificates(model: int, state: int, touched: bool, strength: float) -> None:
    """Certificates after a block with forces, where it is touched, and pushes Σ|p| = strength: how far contacts may be moved
    is less now, and those that were not looked at are asked for anew where forces or pushes have ended theirs."""
    s = string_state(state)
    for c in range(string_model(model).contacts.size):
        s.certificates.renewed[c] = -1
        if s.certificates.looked[c] == 0:
            s.certificates.margin[c] -= s.grip.far[c] * strength
            if touched or s.certificates.margin[c] <= 0.0:
                s.certificates.until[c] = s.counts[CLOCK]


@njit(**INNER)
def note_forces(model: int, scratch: int, several: int, at: int, stride: int) -> None:
    """Forces at near[:several] from step `at` on into Scratch.record, and what they add to outputs in rows of `stride`."""
    m, w = string_model(model), scratch_of(scratch)
    contacts = m.contacts.size
    for i in range(several):
        c = w.rows.near[i]
        for k in range(BLOCK):
            w.record[(at + k) * contacts + c] = w.rows.forces[i, k]
        for p in range(m.outputs.points):
            add_forced(w.out[p * stride + at :], m.outputs.lags[m.outputs.first + p, c], w.rows.forces[i])
