"""One step after the other: one string, its contacts and one finger; `blocks` does several steps at a time.

Every kernel advances modal coordinates (q, v) in place with the six coefficient rows of `laws`. The contact unknowns of
a step are found from the free prediction: for exact-hold from positions at the end of the step,

    0 ≤ S q_free + G λ − η  ⊥  λ ≥ 0,

for Moreau–Jean (Issanchou et al. 2018, eqs 27–31) from velocities of the contacts that are active,

    0 ≤ S v_free + W p + e vⁿ  ⊥  p ≥ 0.

A finger is one more row of the same problem, of either sign: a spring k and a dashpot r between the string and a given
path, implicit in the step, so that the work done on the string is λ·Δpath less what spring and dashpot keep:

    (k + r/Δt) u⁺ + λ = k path⁺ + (r/Δt)(path⁺ − path + u).

Kernels allocate nothing and return a status of `lcp`. Shapes: N modes, C contacts, n steps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from synth.solver.laws import EXACT_HOLD, MOREAU_JEAN_FILTERED
from synth.solver.lcp import SOLVED, pivot, single
from synth.solver.vectors import FAST, INNER, dot

#: what bounds on a string's reach are multiplied by, against rounding
MARGIN = 1.001
#: more steps than any run has
FOR_EVER = 2**62


class Work(NamedTuple):
    """Scratch arrays of one kernel call for up to C contacts; contents carry nothing but the last active set."""

    y: np.ndarray  # (C,) free prediction of the contact rows
    b: np.ndarray  # (C,)
    z: np.ndarray  # (C,)
    a: np.ndarray  # (C, C) contact matrix with the finger eliminated
    factor: np.ndarray  # (C, C)
    order: np.ndarray  # (C,) int64
    enabled: np.ndarray  # (C,) uint8
    active: np.ndarray  # (C,) uint8


class Finger(NamedTuple):
    """A finger's row of the contact problem; `on` is 0 where no finger is near."""

    on: int
    weights: np.ndarray  # (N,) mode shapes averaged over the finger's width
    coupling: np.ndarray  # (C,) S diag(k) weightsᵀ, contact responses to a unit finger unknown
    own: float  # weights diag(k) weightsᵀ
    stiffness: float  # [N/m]
    resistance: float  # [N s/m]
    path: np.ndarray  # (n + 1,) prescribed position [m] at the start and after each step
    state: np.ndarray  # (2,) string displacement under the finger [m], finger unknown of the last step


def make_work(contacts: int) -> Work:
    """Work arrays for `contacts` contacts."""
    c = max(contacts, 1)
    return Work(
        np.zeros(c),
        np.zeros(c),
        np.zeros(c),
        np.zeros((c, c)),
        np.zeros((c, c)),
        np.zeros(c, np.int64),
        np.zeros(c, np.uint8),
        np.zeros(c, np.uint8),
    )


def no_finger(n_modes: int, contacts: int) -> Finger:
    """A finger that is not there."""
    return Finger(0, np.zeros(n_modes), np.zeros(contacts), 0.0, 0.0, 0.0, np.zeros(1), np.zeros(2))


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
def advance_one(n_steps: int, coef, shape, eta: float, g: float, q, v, wq, wv, use_q: int, use_v: int, out_q, out_v):
    """Exact-hold with one contact and no finger: λ = max(0, (η − u_free)/G). Returns the number of steps in contact.

    `blocks.press_blocks` does the same faster; this is what it is measured against.

    The force of a step enters the coordinates in the pass of the next one (after the last step in a pass of its
    own); its share in the output is λ Σ wq kq φ.
    """
    n = q.size
    p11, p12, p21, p22 = coef[0, :n], coef[1, :n], coef[2, :n], coef[3, :n]
    kq, kv = coef[4, :n], coef[5, :n]
    shape = shape[:n]
    wq, wv = wq[:n], wv[:n]
    response = 0.0
    for j in range(n):
        response += wq[j] * kq[j] * shape[j]
    touched = 0
    force = 0.0
    for t in range(n_steps):
        u = 0.0
        y = 0.0
        if force > 0.0:
            for j in range(n):
                f = shape[j] * force
                qj = q[j] + kq[j] * f
                vj = v[j] + kv[j] * f
                a = p11[j] * qj + p12[j] * vj
                b = p21[j] * qj + p22[j] * vj
                q[j] = a
                v[j] = b
                u += shape[j] * a
                y += wq[j] * a
        else:
            for j in range(n):
                a = p11[j] * q[j] + p12[j] * v[j]
                b = p21[j] * q[j] + p22[j] * v[j]
                q[j] = a
                v[j] = b
                u += shape[j] * a
                y += wq[j] * a
        force = 0.0
        if u < eta:
            force = (eta - u) / g
            touched += 1
            y += response * force
            if use_v:
                push_modes(q, v, kq, kv, shape, force)
                force = 0.0
        if use_q:
            out_q[t] = y
        if use_v:
            out_v[t] = dot(wv, v)
    if force > 0.0:
        push_modes(q, v, kq, kv, shape, force)
    return touched


@njit(cache=True, nogil=True, fastmath=FAST)
def advance(
    law: int,
    n_steps: int,
    dt: float,
    restitution: float,
    coef,
    shapes,
    eta,
    g,
    q,
    v,
    u_contact,
    v_contact,
    force,
    finger: Finger,
    watch,
    wq,
    wv,
    out_q,
    out_v,
    rec_force,
    rec_u,
    work: Work,
) -> int:
    """n steps of any law with any number of contacts and at most one finger.

    coef (6, ≥N); shapes (C, ≥N); eta (C,); g (C, C) from `laws.contact_matrix`; q, v (N,) in place; u_contact,
    v_contact (C,) position and velocity S q, S v of the contacts, in and out (Moreau–Jean reads them); force (C,) last
    contact unknown; watch (C,) uint8: contacts that may be touched while none has been (the others have a certificate;
    from the first contact on all are looked at, and marked here); wq (P, ≥N), wv (R, ≥N) output weights; out_q (n, P),
    out_v (n, R); rec_force, rec_u (n, C), or empty where not wanted. Returns an `lcp` status.
    """
    n = q.size
    contacts = eta.size
    p11, p12, p21, p22 = coef[0, :n], coef[1, :n], coef[2, :n], coef[3, :n]
    kq, kv = coef[4, :n], coef[5, :n]
    fingered = finger.on != 0
    weights = finger.weights[:n]
    hold = law == EXACT_HOLD
    everything = fingered or not hold
    status = SOLVED
    y, b, z, enabled, active = work.y, work.b, work.z, work.enabled, work.active

    # the finger's row, eliminated: λ_f = (target − y_f − couplingᵀλ)/(own + compliance)
    compliance = 0.0
    blend = 0.0
    if fingered:
        blend, compliance = finger_blend(law, dt, finger.stiffness, finger.resistance)
    total_own = finger.own + compliance
    matrix = g
    if fingered:
        matrix = work.a
        for c in range(contacts):
            for d in range(contacts):
                matrix[c, d] = g[c, d] - finger.coupling[c] * finger.coupling[d] / total_own

    held = int(np.int64(0))  # rows of work.factor that the steps so far made for `matrix`
    for t in range(n_steps):
        for j in range(n):  # `fly` in place: the call costs a tenth
            a = p11[j] * q[j] + p12[j] * v[j]
            w = p21[j] * q[j] + p22[j] * v[j]
            q[j] = a
            v[j] = w
        state = q if hold else v
        # finger first: its target at the end of the step
        push = 0.0
        y_finger = 0.0
        if fingered:
            y_finger = dot(weights, state)
            target = finger_target(
                law, dt, finger.stiffness, finger.resistance, finger.path[t], finger.path[t + 1], finger.state[0]
            )
            push = (target / blend - y_finger) / total_own
        touching = False
        for c in range(contacts):
            if everything or watch[c]:
                y[c] = dot(shapes[c], state)
                if hold:
                    b[c] = y[c] - eta[c]
                    enabled[c] = 1
                else:
                    b[c] = y[c] + restitution * v_contact[c]
                    gap = u_contact[c] - eta[c]
                    if law == MOREAU_JEAN_FILTERED:
                        gap += 0.5 * dt * v_contact[c]
                    enabled[c] = 1 if gap <= 0.0 else 0
                b[c] += finger.coupling[c] * push if fingered else 0.0
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
            if contacts == 1:
                z[0] = single(matrix[0, 0], b[0])
            else:
                bad, _, held = pivot(matrix, b, enabled, active, z, work.factor, work.order, held)
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
                    push -= finger.coupling[c] * force[c] / total_own
            push_modes(q, v, kq, kv, weights, push)
            finger.state[1] = push
        if touching:
            for c in range(contacts):
                if force[c] > 0.0:
                    push_modes(q, v, kq, kv, shapes[c], force[c])
        if fingered:
            finger.state[0] = dot(weights, q)
        if not hold:
            for c in range(contacts):
                v_contact[c] = y[c]
                if fingered:
                    v_contact[c] += finger.coupling[c] * push
                if touching:
                    for d in range(contacts):
                        v_contact[c] += g[c, d] * force[d]
                u_contact[c] += dt * v_contact[c]
        for p in range(wq.shape[0]):
            out_q[t, p] = dot(wq[p], q)
        for p in range(wv.shape[0]):
            out_v[t, p] = dot(wv[p], v)
        if rec_force.size:
            for c in range(contacts):
                rec_force[t, c] = force[c]
        if rec_u.size:
            for c in range(contacts):
                rec_u[t, c] = dot(shapes[c], q)
    return status


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


@njit(fastmath=FAST, **INNER)
def extents(omega, q, v, out) -> None:
    """out (N,) = E_j = √(q_j² + v_j²/ω_j²), which free motion does not enlarge: |q_j| ≤ E_j, |q̇_j| ≤ ω_j E_j. May be q."""
    for j in range(omega.size):
        speed = v[j] / omega[j]
        out[j] = np.sqrt(q[j] * q[j] + speed * speed)


@njit(cache=True, nogil=True, fastmath=FAST)
def amplitudes(omega, sigma, q, v, out) -> None:
    """A_j ≥ |q_j(t)| for all later times of free flight: decaying envelope, or a bound where overdamped."""
    for j in range(q.size):
        d2 = (omega[j] - sigma[j]) * (omega[j] + sigma[j])
        p = v[j] + sigma[j] * q[j]
        if d2 > 1e-6 * omega[j] * omega[j]:
            out[j] = np.sqrt(q[j] * q[j] + p * p / d2)
        else:
            out[j] = abs(q[j]) + abs(v[j]) / (2.0 * sigma[j])


@njit(cache=True, nogil=True, fastmath=FAST)
def reach(shape, amplitude) -> float:
    """Σ |φ_j| A_j: no free motion with these amplitudes displaces the point further than this."""
    total = 0.0
    for j in range(amplitude.size):
        total += abs(shape[j]) * amplitude[j]
    return total
