"""Exact-hold with a contact force that changes K times in a step of the modes.

The force is held over each K-th part of the step and the Signorini condition imposed at the end of each part, while the
modes advance once. Both kernels are the exact-hold scheme with steps of varying length, whose proof of passivity asks
nothing of their lengths.

One contact (`advance_one_substepped`): always K parts, so that the motion is exact-hold's at K times the rate. A part's
end needs one projection u_k = Σ φ_j (p11(kΔt/K) q_j + p12(kΔt/K) v_j), the forces follow from

    λ_k = max(0, (η − u_k − Σ_{i<k} h_{k−i} λ_i)/G),    h_l = Σ φ_j² (K_q((l+1)Δt/K) − K_q(lΔt/K))/μ,

and enter the modes together: 4 + 4K multiplications per mode and step instead of 8K.

Several (`advance_substepped`): whole steps as long as nothing is touched, K steps of Δt/K where the end of a whole one
would lie inside the obstacle, and after one at whose end a contact was pressed or was coming down fast enough to
arrive by the next. A touch between two clear ends of whole steps is not seen.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from synth.solver.kernels import Finger, Work, advance
from synth.solver.laws import EXACT_HOLD, coefficients, contact_matrix
from synth.solver.lcp import SOLVED
from synth.solver.vectors import FAST, dot

#: parts of a step that the kernel for one contact can take
FUSED = (2, 3, 4)


class Substeps(NamedTuple):
    """What the parts of a step need; N modes, C contacts, K parts. The last five are empty unless C = 1 and K in FUSED."""

    parts: int  # K
    coef: np.ndarray  # (6, N) over Δt/K
    g: np.ndarray  # (C, C) S diag(kq) Sᵀ + R of these
    look_q: np.ndarray  # (K − 1, N) φ p11 after each part but the last
    look_v: np.ndarray  # (K − 1, N) φ p12
    push_q: np.ndarray  # (K, N) what a unit force during part k has done to q at the end of the step
    push_v: np.ndarray  # (K, N)
    response: np.ndarray  # (K,) h_l + R δ_l0: contact displacement l parts after a unit force's own


def make_substeps(count: int, omega, sigma, mu: float, dt: float, shapes, residual) -> Substeps:
    """For modes ω, σ (N,), contacts S (C, N), static compliance R (C, C) and a step Δt in `count` ≥ 1 parts."""
    if count != int(count) or count < 1:
        raise ValueError(f"substeps must be a whole number >= 1, got {count}; 1 leaves the step whole")
    contacts, n = shapes.shape
    ends = [coefficients(EXACT_HOLD, omega, sigma, mu, dt * (k + 1) / count) for k in range(count)]
    g = np.empty((contacts, contacts))
    contact_matrix(EXACT_HOLD, ends[0], shapes, residual, g)
    if contacts != 1 or count not in FUSED:
        none = np.zeros((0, n))
        return Substeps(count, ends[0], g, none, none, none, none, np.zeros(0))
    shape = shapes[0]
    kq = np.diff([np.zeros(n)] + [end[4] * shape for end in ends], axis=0)
    kv = np.diff([np.zeros(n)] + [end[5] * shape for end in ends], axis=0)
    response = kq @ shape
    response[0] = g[0, 0]
    return Substeps(
        count,
        ends[0],
        g,
        np.array([shape * end[0] for end in ends[:-1]]),
        np.array([shape * end[1] for end in ends[:-1]]),
        np.ascontiguousarray(kq[::-1]),
        np.ascontiguousarray(kv[::-1]),
        response,
    )


@njit(inline="always")
def _pass2(p11, p12, p21, p22, a1, b1, k1, l1, k2, l2, f1: float, f2: float, shape, wq, q, v):
    """Forces of the step before, looks, free step: (u_1, u_2, wq·q)."""
    u1, u2, y = 0.0, 0.0, 0.0
    for j in range(q.size):
        qj = q[j] + (k1[j] * f1 + k2[j] * f2)
        vj = v[j] + (l1[j] * f1 + l2[j] * f2)
        u1 += a1[j] * qj + b1[j] * vj
        a = p11[j] * qj + p12[j] * vj
        b = p21[j] * qj + p22[j] * vj
        q[j] = a
        v[j] = b
        u2 += shape[j] * a
        y += wq[j] * a
    return u1, u2, y


@njit(inline="always")
def _pass3(
    p11, p12, p21, p22, a1, b1, a2, b2, k1, l1, k2, l2, k3, l3, f1: float, f2: float, f3: float, shape, wq, q, v
):  # fmt: skip
    """`_pass2` for three parts."""
    u1, u2, u3, y = 0.0, 0.0, 0.0, 0.0
    for j in range(q.size):
        qj = q[j] + (k1[j] * f1 + k2[j] * f2 + k3[j] * f3)
        vj = v[j] + (l1[j] * f1 + l2[j] * f2 + l3[j] * f3)
        u1 += a1[j] * qj + b1[j] * vj
        u2 += a2[j] * qj + b2[j] * vj
        a = p11[j] * qj + p12[j] * vj
        b = p21[j] * qj + p22[j] * vj
        q[j] = a
        v[j] = b
        u3 += shape[j] * a
        y += wq[j] * a
    return u1, u2, u3, y


@njit(inline="always")
def _pass4(
    p11, p12, p21, p22, a1, b1, a2, b2, a3, b3, k1, l1, k2, l2, k3, l3, k4, l4,
    f1: float, f2: float, f3: float, f4: float, shape, wq, q, v,
):  # fmt: skip
    """`_pass2` for four parts."""
    u1, u2, u3, u4, y = 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(q.size):
        qj = q[j] + (k1[j] * f1 + k2[j] * f2 + (k3[j] * f3 + k4[j] * f4))
        vj = v[j] + (l1[j] * f1 + l2[j] * f2 + (l3[j] * f3 + l4[j] * f4))
        u1 += a1[j] * qj + b1[j] * vj
        u2 += a2[j] * qj + b2[j] * vj
        u3 += a3[j] * qj + b3[j] * vj
        a = p11[j] * qj + p12[j] * vj
        b = p21[j] * qj + p22[j] * vj
        q[j] = a
        v[j] = b
        u4 += shape[j] * a
        y += wq[j] * a
    return u1, u2, u3, u4, y


@njit(cache=True, nogil=True, fastmath=FAST)
def _enter(push_q, push_v, forces, q, v) -> None:
    """The forces (K,) of a step's parts enter the modes."""
    for k in range(push_q.shape[0]):
        if forces[k] > 0.0:
            for j in range(q.size):
                q[j] += push_q[k, j] * forces[k]
                v[j] += push_v[k, j] * forces[k]


@njit(cache=True, nogil=True, fastmath=FAST)
def advance_one_substepped(
    n_steps: int, sub: Substeps, coef, shape, eta: float, q, v, wq, wv, use_q: int, use_v: int, out_q, out_v,
    rec_u, rec_force, forces,
) -> int:  # fmt: skip
    """n steps over one contact, K in FUSED, no finger. Returns the number of steps in contact.

    coef (6, ≥N) over the whole step; shape, wq, wv (≥N,); out_q, out_v (n,) as in `kernels.advance_one`; rec_u (n,)
    S q + R λ at the end of each step and rec_force (n,) mean force over it, or empty; forces (4,) of the last one's parts.
    """
    n = q.size
    count = sub.parts
    last, third = count - 1, min(2, count - 1)
    p11, p12, p21, p22 = coef[0, :n], coef[1, :n], coef[2, :n], coef[3, :n]
    shape, wq, wv = shape[:n], wq[:n], wv[:n]
    k1, l1, k2, l2 = sub.push_q[0, :n], sub.push_v[0, :n], sub.push_q[1, :n], sub.push_v[1, :n]
    k3, l3, k4, l4 = sub.push_q[third, :n], sub.push_v[third, :n], sub.push_q[last, :n], sub.push_v[last, :n]
    h = sub.response
    a1, b1 = sub.look_q[0, :n], sub.look_v[0, :n]
    a2, b2 = sub.look_q[third - 1, :n], sub.look_v[third - 1, :n]
    a3, b3 = sub.look_q[last - 1, :n], sub.look_v[last - 1, :n]
    g, h1, h2, h3 = h[0], h[1], h[third], h[last]
    stiffness = 1.0 / g
    y1 = y2 = y3 = y4 = 0.0  # displacement at wq per force of each part
    if use_q:
        y1, y2, y3, y4 = dot(k1, wq), dot(k2, wq), dot(k3, wq), dot(k4, wq)
    f1 = f2 = f3 = f4 = 0.0
    touched = 0
    for t in range(n_steps):
        if count == 2:
            u1, u, y = _pass2(p11, p12, p21, p22, a1, b1, k1, l1, k2, l2, f1, f2, shape, wq, q, v)
            f1 = max(0.0, (eta - u1) * stiffness)
            u += h1 * f1
            f2 = max(0.0, (eta - u) * stiffness)
            u += g * f2
            y += y1 * f1 + y2 * f2
        elif count == 3:
            u1, u2, u, y = _pass3(
                p11, p12, p21, p22, a1, b1, a2, b2, k1, l1, k2, l2, k3, l3, f1, f2, f3, shape, wq, q, v
            )  # fmt: skip
            f1 = max(0.0, (eta - u1) * stiffness)
            f2 = max(0.0, (eta - u2 - h1 * f1) * stiffness)
            u += h2 * f1 + h1 * f2
            f3 = max(0.0, (eta - u) * stiffness)
            u += g * f3
            y += y1 * f1 + y2 * f2 + y3 * f3
        else:
            u1, u2, u3, u, y = _pass4(
                p11, p12, p21, p22, a1, b1, a2, b2, a3, b3, k1, l1, k2, l2, k3, l3, k4, l4,
                f1, f2, f3, f4, shape, wq, q, v,
            )  # fmt: skip
            f1 = max(0.0, (eta - u1) * stiffness)
            f2 = max(0.0, (eta - u2 - h1 * f1) * stiffness)
            f3 = max(0.0, (eta - u3 - h2 * f1 - h1 * f2) * stiffness)
            u += h3 * f1 + h2 * f2 + h1 * f3
            f4 = max(0.0, (eta - u) * stiffness)
            u += g * f4
            y += y1 * f1 + y2 * f2 + y3 * f3 + y4 * f4
        total = f1 + f2 + f3 + f4
        touched += total > 0.0
        if use_q:
            out_q[t] = y
        if rec_u.size > 0:
            rec_u[t] = u
            rec_force[t] = total / count
        if use_v or t + 1 == n_steps:
            forces[0], forces[1], forces[2], forces[3] = f1, f2, f3, f4
            _enter(sub.push_q, sub.push_v, forces, q, v)
            f1 = f2 = f3 = f4 = 0.0
            if use_v:
                out_v[t] = dot(wv, v)
    return touched


@njit(cache=True, nogil=True, fastmath=FAST)
def clear_step(coef, shapes, eta, q, v, watch, before, free, after) -> bool:
    """Whether a whole free step ends clear of every watched contact; leaves q, v alone.

    coef (6, ≥N); before (C,) S q now; free (≥2, N) and after (C,) get q, v and S q at the end, the latter what it was
    where watch (C,) is 0.
    """
    n = q.size
    p11, p12, p21, p22 = coef[0, :n], coef[1, :n], coef[2, :n], coef[3, :n]
    free_q, free_v = free[0, :n], free[1, :n]
    for j in range(n):
        free_q[j] = p11[j] * q[j] + p12[j] * v[j]
        free_v[j] = p21[j] * q[j] + p22[j] * v[j]
    for c in range(eta.size):
        after[c] = before[c]
        if watch[c]:
            after[c] = dot(shapes[c], free_q)
            if after[c] < eta[c]:
                return False
    return True


@njit(cache=True, nogil=True)
def arriving(eta, before, after) -> bool:
    """Whether a contact (C,) that moves on as it did from `before` to `after` would be inside by the next step."""
    for c in range(eta.size):
        if after[c] - eta[c] < before[c] - after[c]:
            return True
    return False


@njit(cache=True, nogil=True, fastmath=FAST)
def advance_substepped(
    n_steps: int, dt: float, sub: Substeps, coef, shapes, eta, q, v, u, force, finger: Finger, watch, divide,
    wq, wv, out_q, out_v, rec_force, free, after, parts, none, work: Work,
) -> int:  # fmt: skip
    """n steps Δt over any number of contacts, divided in K where needed; no finger (`finger` says so). An `lcp` status.

    coef (6, ≥N) over the whole step; shapes (C, ≥N); u (C,) S q, in and out; force (C,) of the last part; watch as in
    `kernels.advance`; divide (1,) whether the next step must be divided, in and out; wq (P, ≥N), wv (R, ≥N), out_q
    (n, P), out_v (n, R) outputs; rec_force (n, C) mean force over each step; work space free (≥2, N), after (C,),
    parts (K, C), none (0, N).
    """
    n, count = q.size, sub.parts
    status = SOLVED
    law = int(np.int64(EXACT_HOLD))  # a literal would have `advance` compiled once more
    for t in range(n_steps):
        rec_force[t] = 0.0
        touched = False
        if divide[0] == 0 and clear_step(coef, shapes, eta, q, v, watch, u, free, after):
            for j in range(n):
                q[j] = free[0, j]
                v[j] = free[1, j]
            force[:] = 0.0
        else:
            bad = advance(
                law, count, dt / count, 1.0, sub.coef, shapes, eta, sub.g, q, v, u, u, force, finger, watch,
                none, none, none, none, parts, none, work,
            )  # fmt: skip
            if bad != SOLVED:
                status = bad
            for c in range(eta.size):
                after[c] = dot(shapes[c], q)
                for k in range(count):
                    rec_force[t, c] += parts[k, c] / count
                    touched = touched or parts[k, c] > 0.0
        divide[0] = 1 if touched or arriving(eta, u, after) else 0
        u[:] = after
        for p in range(wq.shape[0]):
            out_q[t, p] = dot(wq[p], q)
        for p in range(wv.shape[0]):
            out_v[t, p] = dot(wv[p], v)
    return status
