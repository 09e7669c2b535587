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

from typing import NamedTuple

import numpy as np
from numba import njit

from synth.solver.kernels import Finger, Work, advance
from synth.solver.laws import EXACT_HOLD, coefficients, contact_matrix
from synth.solver.lcp import SOLVED
from synth.solver.vectors import FAST, INNER, dot, put


class Substeps(NamedTuple):
    """What the parts of a step need; N modes, C contacts."""

    parts: int  # K
    coef: np.ndarray  # (6, N) over Δt/K
    g: np.ndarray  # (C, C) S diag(kq) Sᵀ + R of these


def make_substeps(count: int, omega, sigma, mu: float, dt: float, shapes, residual) -> Substeps:
    """For modes ω, σ (N,), contacts S (C, N), static compliance R (C, C) and a step Δt in `count` ≥ 1 parts."""
    if count != int(count) or count < 1:
        raise ValueError(f"substeps must be a whole number >= 1, got {count}; 1 leaves the step whole")
    coef = coefficients(EXACT_HOLD, omega, sigma, mu, dt / count)
    g = np.empty((shapes.shape[0], shapes.shape[0]))
    contact_matrix(EXACT_HOLD, coef, shapes, residual, g)
    return Substeps(count, coef, g)


@njit(fastmath=FAST, **INNER)
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


@njit(**INNER)
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
        put(u, after)
        for p in range(wq.shape[0]):
            out_q[t, p] = dot(wq[p], q)
        for p in range(wv.shape[0]):
            out_v[t, p] = dot(wv[p], v)
    return status
