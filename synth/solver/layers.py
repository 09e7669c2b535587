"""Contacts with a soft, lossy layer (thread, felt, a finger's tip) in front of what is rigid.

A layer is as deep as h, a spring k and a dashpot r in parallel; it comes back at once when it is let go, and does not pull.
With p the depth to which the string has come below its surface, p ≤ h, the force on the string in a step is

    λ = max(0, a p⁺ + c),    a = k/2 + r/Δt,    c = (k/2 − r/Δt) δ,    δ = max(0, p) at the start of the step,

the spring in the middle of the step, and whatever more it takes at p⁺ = h. A layer holds ½ k δ². It gains no energy:

    a p⁺ + c > 0, p⁺ > 0   λ (p⁺ − p) ≥ (k/2)(p⁺ + δ)(p⁺ − δ) + r (p⁺ − δ)²/Δt: what it holds more, and losses
    p⁺ ≤ 0                 −λ (p⁺ − p) ≤ (k/2)(δ² − p⁺²): at most what it held is given back (λ = 0 if δ = 0)
    λ = 0                  p⁺ < δ, as a p⁺ + c < 0: it comes back without pushing
    p⁺ = h                 the rigid stop's part works −(h − p) ≤ 0 on the string

It is a contact with the compliance 1/a whose surface is (c/a) higher, and a rigid one h below: with λ = λ_s + λ_r

    0 ≤ λ_s ⊥ u⁺ − η − c/a + λ_s/a ≥ 0,    0 ≤ λ_r ⊥ u⁺ − η + h ≥ 0,    u⁺ = y + A (λ_s + λ_r),

a linear complementarity problem with a positive semidefinite matrix. u is S q + R λ as at any contact of exact-hold.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.lcp import SOLVED, pivot, solve
from synth.solver.stringmodel import DEPTH, RESISTANCE, STIFFNESS, scratch_of, string_model, string_state
from synth.solver.vectors import dot


@njit(inline="always")
def middle(stiffness: float, resistance: float, dt: float):
    """(a, what c is for each metre of δ) of a layer over a step."""
    per_step = resistance / dt
    return 0.5 * stiffness + per_step, 0.5 * stiffness - per_step


@njit(cache=True, nogil=True)
def answer_with_layers(model: int, state: int, scratch: int) -> int:
    """`contact_laws.ContactLaw.answer` of contacts that have a layer, or a depth of 0: forces into Scratch.z. A status of
    `lcp`. The scratch is one for twice as many contacts."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    contacts, layers, y, z = m.contacts.size, m.contacts.layers, w.y, w.z
    if contacts == 1:
        z[0] = _one(w.a[0, 0], s.eta[0] - y[0], s.eta[0] - s.u[0], layers[:, 0], m.dt)
        return SOLVED
    b, enabled, active = w.pivot.b[: 2 * contacts], w.pivot.enabled[: 2 * contacts], w.pivot.active[: 2 * contacts]
    touching = False
    for c in range(contacts):
        depth = layers[DEPTH, c]
        gap = y[c] - s.eta[c]
        a, keep = middle(layers[STIFFNESS, c], layers[RESISTANCE, c], m.dt)
        b[c] = gap
        if depth > 0.0:
            b[c] -= keep / a * min(depth, max(0.0, s.eta[c] - s.u[c]))
        b[contacts + c] = gap + depth
        enabled[c] = 1 if depth > 0.0 else 0
        enabled[contacts + c] = 1
        active[c] = active[contacts + c] = 0
        touching = touching or (depth > 0.0 and b[c] < 0.0) or b[contacts + c] < 0.0
        z[c] = 0.0
    if not touching:
        return SOLVED
    twice = w.pivot.matrix[: 4 * contacts * contacts].reshape(2 * contacts, 2 * contacts)
    for c in range(contacts):
        for d in range(contacts):
            mutual = w.a[c, d]
            twice[c, d] = twice[c, contacts + d] = twice[contacts + c, d] = twice[contacts + c, contacts + d] = mutual
        if layers[DEPTH, c] > 0.0:
            twice[c, c] += 1.0 / middle(layers[STIFFNESS, c], layers[RESISTANCE, c], m.dt)[0]
    status, _, _ = pivot(twice, b, enabled, active, z, w.pivot.factor, w.pivot.order, int(np.int64(0)))
    for c in range(contacts):
        z[c] += z[contacts + c]
    return status


@njit(inline="always")
def _one(compliance: float, free: float, before: float, layer, dt: float) -> float:
    """The force of one contact that would be at the depth `free`, and was at `before` [m]."""
    depth = layer[DEPTH]
    force = max(0.0, (free - depth) / compliance)
    if depth > 0.0:
        a, keep = middle(layer[STIFFNESS], layer[RESISTANCE], dt)
        force = max(force, (a * free + keep * min(depth, max(0.0, before))) / (1.0 + a * compliance))
    return force


@njit(cache=True, nogil=True)
def held_by_layers(model: int, state: int) -> float:
    """½ Σ k δ² [J]: what the layers of a string hold as it stands under its forces."""
    m, s = string_model(model), string_state(state)
    contacts, q, total = m.contacts.size, s.q[: m.modes], 0.0
    for c in range(m.contacts.layers.shape[1]):
        depth = s.eta[c] - dot(m.contacts.shapes[c, : m.modes], q)
        for d in range(contacts):
            depth -= m.contacts.residual[c, d] * s.force[d]
        depth = min(m.contacts.layers[DEPTH, c], max(0.0, depth))
        total += 0.5 * m.contacts.layers[STIFFNESS, c] * depth * depth
    return total


def static_forces(compliance: np.ndarray, gap: np.ndarray, layers: np.ndarray) -> tuple[np.ndarray, int]:
    """λ (C,) [N] of contacts at rest, and a status of `lcp`.

    compliance (C, C) [m/N] of the string under static forces; gap (C,) [m] to the obstacle without them; layers (3, C), or
    (3, 0) without any.
    """
    contacts = gap.size
    matrix, b, enabled = static_matrix(compliance, layers), gap, np.ones(contacts, np.uint8)
    if layers.shape[1]:
        soft = layers[DEPTH] > 0.0
        b, enabled = np.concatenate([gap, gap + layers[DEPTH]]), np.concatenate([soft.astype(np.uint8), enabled])
    force, size = np.zeros(b.size), b.size
    work = (np.zeros(size, np.uint8), force, np.zeros((size, size)), np.zeros(size, np.int64))
    status = solve(matrix, np.ascontiguousarray(b), enabled, *work)
    return force.reshape(-1, contacts).sum(axis=0), status


def static_matrix(compliance: np.ndarray, layers: np.ndarray) -> np.ndarray:
    """Matrix of the contact problem at rest: (C, C), or (2C, 2C) of contacts with layers; arguments: `static_forces`."""
    if not layers.shape[1]:
        return np.ascontiguousarray(compliance)
    contacts, soft = compliance.shape[0], layers[DEPTH] > 0.0
    matrix = np.tile(compliance, (2, 2))
    matrix[:contacts, :contacts] += np.diag(np.divide(1.0, layers[STIFFNESS], out=np.zeros(contacts), where=soft))
    return matrix


@njit(cache=True, nogil=True)
def settle(matrix, under, raised: float, scratch: int) -> int:
    """`static_forces` in Scratch.z of a string that nothing else holds, over contacts (ContactTables) `raised` above their η
    [m]: a status of `lcp`. matrix: `static_matrix`. The scratch is one for as many rows."""
    w, contacts, layers, rows = scratch_of(scratch), under.size, under.layers, matrix.shape[0]
    b, enabled, active, z = w.pivot.b[:rows], w.pivot.enabled[:rows], w.pivot.active[:rows], w.z[:rows]
    touching = False
    for c in range(contacts):
        b[c] = -(under.eta[c] + raised)
        enabled[c] = 1
        if rows > contacts:
            b[contacts + c] = b[c] + layers[DEPTH, c]
            enabled[c] = 1 if layers[DEPTH, c] > 0.0 else 0
            enabled[contacts + c] = 1
        touching = touching or b[c] < 0.0
    for r in range(rows):
        active[r] = 0
        z[r] = 0.0
    if not touching:
        return SOLVED
    status, _, _ = pivot(matrix, b, enabled, active, z, w.pivot.factor, w.pivot.order, int(np.int64(0)))
    for r in range(contacts, rows):
        z[r - contacts] += z[r]
    return status
