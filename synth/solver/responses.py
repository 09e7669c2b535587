"""What a force at one shape does to a string over a block of K steps: rows of coefficients, tables of responses."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import float64, int64, njit

from synth.jit.entries import kernel
from synth.native.arrays import aligned
from synth.solver.block_rows import ADV11, BLOCK, KQ, KQ_LATE, KV, KV_LATE, MINUS_DET, P11, P12, P21, P22, ROWS, TRACE
from synth.solver.lanes import padded, project_q, project_qq, project_v, project_vv
from synth.solver.vectors import FAST, INNER, dot


def padded_rows(rows: np.ndarray, modes: int, kind: Any = np.float64) -> np.ndarray:
    """An aligned copy of (…, N) arrays with zeros up to `modes`; kind: of its numbers."""
    out = aligned((*rows.shape[:-1], modes), kind)
    out[..., : rows.shape[-1]] = rows
    return out


@njit(fastmath=FAST, **INNER)
def complete_rows(rows, modes: int) -> None:
    """`fill_rows` of the first `modes` columns."""
    p11, p12, p21, p22, kq, kv = rows[P11], rows[P12], rows[P21], rows[P22], rows[KQ], rows[KV]
    for j in range(modes):
        a, b, c, d = p11[j], p12[j], p21[j], p22[j]
        trace = a + d
        rows[TRACE, j] = trace
        rows[MINUS_DET, j] = b * c - a * d
        rows[KQ_LATE, j] = b * kv[j] - d * kq[j]
        rows[KV_LATE, j] = c * kq[j] - a * kv[j]
        for _ in range(3):  # Φ → Φ²: three times for 8 steps
            cross = b * c
            a, b, c, d = a * a + cross, b * (a + d), c * (a + d), d * d + cross
        rows[ADV11, j] = a
        rows[ADV11 + 1, j] = b
        rows[ADV11 + 2, j] = c
        rows[ADV11 + 3, j] = d


@kernel(float64[:, ::1], fastmath=FAST)
def fill_rows(rows) -> None:
    """Complete rows (ROWS, n) whose first six are the step coefficients of `laws`; padding is zero there."""
    complete_rows(rows, rows.shape[1])


@njit(fastmath=FAST, **INNER)
def fill_response(velocity: int, rows, q, v, weights, first: int, spare, out) -> None:
    """out (P, 2K) from row `first` on: the sums `weights` (P, ≥n) over a free motion from (q, v) (n,), l steps on, at K + l.

    velocity: whether weights are on velocities. spare (2, K) is work space.
    """
    n, points = q.size, weights.shape[0]
    for p in range(first, points, 2):
        both = p + 1 < points
        if velocity:
            if both:
                project_vv(n, rows, q, v, weights[p], weights[p + 1], spare[0], spare[1])
            else:
                project_v(n, rows, q, v, weights[p], spare[0])
        elif both:
            project_qq(n, rows, q, v, weights[p], weights[p + 1], spare[0], spare[1])
        else:
            project_q(n, rows, q, v, weights[p], spare[0])
        for i in range(2 if both else 1):
            for k in range(BLOCK):
                out[p + i, k] = 0.0
            out[p + i, BLOCK] = dot(weights[p + i], v if velocity else q)
            for k in range(1, BLOCK):
                out[p + i, BLOCK + k] = spare[i, k - 1]


@kernel(int64, *[float64[:, ::1]] * 4, *[float64[::1]] * 2, float64[:, ::1], float64[:, :, ::1], fastmath=FAST)
def fill_lags(velocity: int, rows, shapes, weights, own, q, v, spare, out) -> None:
    """out (P, C, 2K): what a unit force at each of C shapes (C, n) has done to the sums `weights` (P, n), l steps on.

    Place K + l of the last axis is l steps after the force's own step, the first K are zero.
    velocity: whether weights are on velocities. own (C, C) is l = 0 where weights are the shapes themselves, whose responses
    to each other are mutual; or (0, 0). q, v (n,) and spare (2, K) are work space.
    """
    mutual = own.size > 0
    for c in range(shapes.shape[0]):
        for j in range(rows.shape[1]):
            q[j] = rows[KQ, j] * shapes[c, j]
            v[j] = rows[KV, j] * shapes[c, j]
        fill_response(velocity, rows, q, v, weights, c if mutual else 0, spare, out[:, c])
        if mutual:
            for p in range(c, weights.shape[0]):
                out[p, c, BLOCK] = own[p, c]
                for k in range(2 * BLOCK):
                    out[c, p, k] = out[p, c, k]


def make_rows(coef: np.ndarray) -> np.ndarray:
    """Rows (ROWS, n) of a block from step coefficients (6, N); n = padded(N)."""
    rows = aligned((ROWS, padded(coef.shape[1])))
    rows[:6, : coef.shape[1]] = coef
    fill_rows(rows)
    return rows


def make_lags(velocity: bool, rows: np.ndarray, shapes: np.ndarray, weights: np.ndarray, own=None) -> np.ndarray:
    """`fill_lags` with arrays of its own: (P, C, 2K) for shapes (C, n), weights (P, n)."""
    n = rows.shape[1]
    out = np.zeros((weights.shape[0], shapes.shape[0], 2 * BLOCK))
    given = np.zeros((0, 0)) if own is None else np.ascontiguousarray(own)
    fill_lags(int(velocity), rows, shapes, weights, given, aligned(n), aligned(n), aligned((2, BLOCK)), out)
    return out
