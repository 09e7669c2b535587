"""Tables of responses to contacts, filled contact by contact when one presses for the first time.

What bends or damps a string gives it coefficients of its own, and all its responses with them; most contacts of a string
that is bent or damped press nothing until it is bent again. StringState.due says which contacts still wait. An entry
depends on the coefficients alone, not on when it is filled: it is what `responses.fill_lags` would have put there.

The response at l = 0, StringModel.matrix, is in the table from the start (`put_off`): what asks which contacts press needs
no other.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK, KQ, KV
from synth.solver.laws import EXACT_HOLD, contact_matrix
from synth.solver.quick_coefficients import quick_coefficients
from synth.solver.responses import fill_response, fill_rows
from synth.solver.stringmodel import scratch_of, string_model, string_state
from synth.solver.vectors import INNER


@njit(**INNER)
def fill_step(model: int, sigma, relief: float) -> None:
    """Coefficients of a step and the contacts' matrix of a string that is bent or damped, from its own ω and these σ (≥N,)
    [1/s]; relief: share of the residual compliance, which goes with 1/T, that a bend has added."""
    m = string_model(model)
    n, rows, matrix = m.modes, m.rows, m.matrix
    rows[:6, n:] = 0.0
    quick_coefficients(m.law, m.omega[:n], sigma[:n], m.mu, m.dt, rows)
    fill_rows(rows)
    contacts = m.shapes.shape[0]
    if contacts == 0:
        return
    contact_matrix(m.law, rows, m.shapes, m.residual, matrix)
    if m.law == EXACT_HOLD:
        for a in range(contacts):
            for b in range(contacts):
                matrix[a, b] += relief * m.residual[a, b]


@njit(cache=True, nogil=True)
def put_off(model: int, state: int) -> None:
    """All responses to contacts of a model whose rows and matrix are there are to be filled when they are needed."""
    m, s = string_model(model), string_state(state)
    contacts = m.lags.shape[0]
    for c in range(contacts):
        s.due[c] = 1
        for d in range(contacts):
            m.lags[c, d, BLOCK] = m.matrix[c, d]


@njit(**INNER)
def _strike(m, c: int, q, v) -> None:
    """q, v (n,) after a unit force at a contact."""
    for j in range(m.rows.shape[1]):
        q[j] = m.rows[KQ, j] * m.shapes[c, j]
        v[j] = m.rows[KV, j] * m.shapes[c, j]


@njit(**INNER)
def _mirror(m, c: int, d: int) -> None:
    """lags of d by c, where c is at most d, have been filled: both are mutual."""
    m.lags[d, c, BLOCK] = m.matrix[d, c]
    for k in range(2 * BLOCK):
        m.lags[c, d, k] = m.lags[d, c, k]


@njit(cache=True, nogil=True)
def fill_due(model: int, state: int, scratch: int, c: int) -> None:
    """Responses of contacts and outputs to a force at contact c: lags[:, c], out_lags[:, c], and lags[c], which are mutual.

    Works in Scratch.q, v and moved.
    """
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    n, contacts = m.rows.shape[1], m.shapes.shape[0]
    q, v, spare = w.q[:n], w.v[:n], w.moved.reshape(-1)[: 2 * BLOCK].reshape(2, BLOCK)
    velocity = 0 if m.law == EXACT_HOLD else 1
    zero, one = int(np.int64(0)), int(np.int64(1))  # literals would have it compiled once more for each
    for d in range(c):  # an earlier contact's force moves this one as this one's would move that
        if s.due[d]:
            _strike(m, d, q, v)
            fill_response(velocity, m.rows, q, v, m.shapes[c : c + 1], zero, spare, m.lags[c : c + 1, d])
            _mirror(m, d, c)
    _strike(m, c, q, v)
    fill_response(velocity, m.rows, q, v, m.shapes, c, spare, m.lags[:, c])
    for d in range(c, contacts):
        _mirror(m, c, d)
    for p in range(m.first, m.first + m.points):
        on_v = one if p >= m.first + m.on_q else zero
        fill_response(on_v, m.rows, q, v, m.weights[p : p + 1], zero, spare, m.out_lags[p : p + 1, c])
    s.due[c] = 0


@njit(inline="always")
def fill_those(model: int, state: int, scratch: int, near, count: int) -> None:
    """`fill_due` of those of near[:count] that still wait."""
    for i in range(count):
        if string_state(state).due[near[i]]:
            fill_due(model, state, scratch, near[i])
