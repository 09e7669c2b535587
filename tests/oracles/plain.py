"""Exact-hold over one contact, a step after the other: what `blocks.press_blocks` is judged by and measured against."""

from __future__ import annotations

from numba import njit

from synth.solver.stepwise import push_modes
from synth.solver.vectors import FAST, dot


@njit(cache=True, nogil=True, fastmath=FAST)
def advance_one(n_steps: int, coef, shape, eta: float, g: float, q, v, wq, wv, use_q: int, use_v: int, out_q, out_v):
    """Exact-hold with one contact and no finger: λ = max(0, (η − u_free)/G). Returns the number of steps in contact.

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
