"""Tables of responses to contacts, filled contact by contact when one presses for the first time.

What bends or damps a string gives it coefficients of its own, and all its responses with them; most contacts of a string
that is bent or damped press nothing until it is bent again. StringState.due says which contacts still wait. An entry
depends on the coefficients alone, not on when it is filled: it is what `responses.fill_lags` would have put there.

The response at l = 0, ContactTables.matrix, is what asks which contacts press needs: of two or more at a time. Each row
waits until its contact is asked beside another, and the diagonal alone is there.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK, KQ, KV
from synth.solver.laws import EXACT_HOLD, contact_matrix
from synth.solver.quick_coefficients import quick_coefficients
from synth.solver.responses import fill_response, fill_rows
from synth.solver.stringmodel import scratch_of, string_model, string_state
from synth.solver.vectors import FAST, INNER

#: StringState.due: all is there; responses wait; the row of the matrix waits, too
READY, RESPONSES_DUE, ROW_DUE = range(3)


@njit(**INNER)
def fill_step(model: int, sigma) -> None:
    """Coefficients of a step of a string that is bent or damped, from its own ω and these σ (≥N,) [1/s]."""
    m = string_model(model)
    n, rows = m.modes, m.rows
    rows[:6, n:] = 0.0
    quick_coefficients(m.law, m.omega[:n], sigma[:n], m.mu, m.dt, rows)
    fill_rows(rows)


@njit(cache=True, nogil=True)
def fill_contact_matrix(model: int, relief: float) -> None:
    """All of the matrix of a model with contacts whose rows are there; relief: share of the residual compliance, which goes
    with 1/T, that a bend has added."""
    m = string_model(model)
    under = m.contacts
    contact_matrix(m.law, m.rows, under.shapes, under.residual, under.matrix)
    if m.law == EXACT_HOLD:
        for a in range(under.size):
            for b in range(under.size):
                under.matrix[a, b] += relief * under.residual[a, b]


@njit(fastmath=FAST, **INNER)
def _moved(gain, here, there) -> float:
    """Σ φ_j κ_j φ′_j: what a unit force at one of two contacts moves the other by within its step."""
    total = 0.0
    for j in range(here.size):
        total += here[j] * gain[j] * there[j]
    return total


@njit(cache=True, nogil=True)
def put_off(model: int, state: int, relief: float) -> None:
    """All responses to contacts of an exact-hold model whose rows are there are to be filled when they are needed, and its
    matrix but for the diagonal, too. Below that stands what relief adds to a pair's entry."""
    m, s = string_model(model), string_state(state)
    under = m.contacts
    for c in range(under.size):
        s.due[c] = ROW_DUE
        for d in range(c):
            under.matrix[c, d] = relief * under.residual[c, d]
        entry = _moved(m.rows[KQ], under.shapes[c], under.shapes[c]) + under.residual[c, c]
        under.matrix[c, c] = entry + relief * under.residual[c, c]
        under.lags[c, c, BLOCK] = under.matrix[c, c]


@njit(cache=True, nogil=True)
def fill_row(model: int, state: int, c: int) -> None:
    """The row and column of contact c in the matrix and, at l = 0, in the responses, of which they have waited."""
    m, s = string_model(model), string_state(state)
    under = m.contacts
    for d in range(under.size):
        if d != c and s.due[d] == ROW_DUE:
            a, b = max(c, d), min(c, d)
            entry = _moved(m.rows[KQ], under.shapes[a], under.shapes[b]) + under.residual[a, b] + under.matrix[a, b]
            under.matrix[a, b] = under.matrix[b, a] = entry
            under.lags[a, b, BLOCK] = under.lags[b, a, BLOCK] = entry
    s.due[c] = RESPONSES_DUE


@njit(cache=True, nogil=True)
def fill_all_rows(model: int, state: int) -> None:
    """The whole matrix, for what goes step by step."""
    for c in range(string_model(model).contacts.size):
        if string_state(state).due[c] == ROW_DUE:
            fill_row(model, state, c)


@njit(**INNER)
def strike(m, c: int, q, v) -> None:
    """q, v (n,) after a unit force at a contact."""
    for j in range(m.rows.shape[1]):
        q[j] = m.rows[KQ, j] * m.contacts.shapes[c, j]
        v[j] = m.rows[KV, j] * m.contacts.shapes[c, j]


@njit(**INNER)
def _mirror(under, c: int, d: int) -> None:
    """lags of d by c, where c is at most d, have been filled: both are mutual."""
    under.lags[d, c, BLOCK] = under.matrix[d, c]
    for k in range(2 * BLOCK):
        under.lags[c, d, k] = under.lags[d, c, k]


@njit(cache=True, nogil=True)
def fill_due(model: int, state: int, scratch: int, c: int) -> None:
    """Responses of contacts and outputs of an exact-hold model to a force at contact c: lags[:, c], out_lags[:, c], and
    lags[c], which are mutual.

    Works in Scratch.modes.q, v and moved.
    """
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    n, under, outputs = m.rows.shape[1], m.contacts, m.outputs
    q, v, spare = w.modes.q[:n], w.modes.v[:n], w.modes.moved.reshape(-1)[: 2 * BLOCK].reshape(2, BLOCK)
    if s.due[c] == ROW_DUE:
        fill_row(model, state, c)
    zero, one = int(np.int64(0)), int(np.int64(1))  # literals would have it compiled once more for each
    for d in range(c):  # an earlier contact's force moves this one as this one's would move that
        if s.due[d]:
            strike(m, d, q, v)
            fill_response(zero, m.rows, q, v, under.shapes[c : c + 1], zero, spare, under.lags[c : c + 1, d])
            _mirror(under, d, c)
    strike(m, c, q, v)
    fill_response(zero, m.rows, q, v, under.shapes, c, spare, under.lags[:, c])
    for d in range(c, under.size):
        _mirror(under, c, d)
    for p in range(outputs.first, outputs.first + outputs.points):
        on_v = one if p >= outputs.first + outputs.on_q else zero
        fill_response(on_v, m.rows, q, v, outputs.weights[p : p + 1], zero, spare, outputs.lags[p : p + 1, c])
    s.due[c] = READY


@njit(inline="always")
def fill_those(model: int, state: int, scratch: int, near, count: int) -> None:
    """`fill_due` of those of near[:count] that still wait."""
    for i in range(count):
        if string_state(state).due[near[i]]:
            fill_due(model, state, scratch, near[i])
