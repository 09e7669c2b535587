"""Tables of what contacts, finger and moving end of a line do to each other, filled when they are first asked for.

A line that touches nothing is advanced by its flight over a frame and by the pull of its end after a kick (`fill_apart`).
All else, its steps within a frame, its contacts' matrix, what they do to the end and the end to them, waits until the line
is looked at (`ensure_tables`): a string that is bent in every control period while it touches nothing never pays for it.
What a table holds depends on the coefficients alone, not on when it is filled.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.certificates import MARGIN, extents
from synth.solver.coupling import (
    APART,
    APART_MODES,
    DUE,
    ENGAGED,
    FELT_MODES,
    FINGER_LEVERAGE,
    HEARD_MODES,
    KICK_REACH,
    LARGEST_LEVERAGE,
    LOOKED_AT,
    RELIEF,
    RESTING,
    coupling_at,
    end_at,
)
from synth.solver.due_responses import fill_step, put_off
from synth.solver.lanes import BLOCK, KQ, KV, P12, P22, padded
from synth.solver.laws import EXACT_HOLD
from synth.solver.quick_coefficients import quick_coefficients
from synth.solver.responses import fill_lags, fill_response, fill_rows
from synth.solver.stringmodel import MOVING, scratch_of, string_model, string_state
from synth.solver.vectors import FAST, INNER

#: End.counts[DUE]: all tables are there; those of end and contacts wait; the coefficients of a step wait, too
READY, TABLES_DUE, ALL_DUE = range(3)


@njit(**INNER)
def set_apart_modes(end: int) -> None:
    """How many modes of a line move while it is not looked at. `fill_apart` goes by it."""
    counts = end_at(end).counts
    counts[APART_MODES] = counts[FELT_MODES] if counts[RESTING] else counts[HEARD_MODES]


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_apart(end: int, scratch_q, scratch_v, spare) -> None:
    """End.own and share of a line that is not looked at, from End.kick, pull and the first APART_MODES modes of flight.
    Work space (≥n,) and (2, K)."""
    e = end_at(end)
    moving, all_modes = e.counts[APART_MODES], e.pull.size
    zero, one = int(np.int64(0)), int(np.int64(1))
    q, v = scratch_q[: padded(moving)], scratch_v[: padded(moving)]
    share = 0.0
    for j in range(q.size):
        q[j] = e.flight[P12, j] * e.kick[j] if j < moving else 0.0
        v[j] = e.flight[P22, j] * e.kick[j] if j < moving else 0.0
        share += e.kick[j] * e.kick[j] if j < moving else 0.0
    e.share[APART] = share
    fill_response(one, e.flight, q, v, e.pull.reshape(1, all_modes), zero, spare, e.own[APART : APART + 1])
    e.single_of[0] = np.nan  # what is float32 is to be made anew


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_looked_at(model: int, end: int, steps: int, scratch_q, scratch_v, spare) -> None:
    """The responses of a line that is looked at, and takes so many steps a frame, to its end, from its model's rows and
    End.kick, pull, flight, leverage, and its share. Work space (≥n,) and (2, K)."""
    m, e = string_model(model), end_at(end)
    rows, n, kick, all_modes = m.rows, m.rows.shape[1], e.kick, e.flight.shape[1]
    zero, one = int(np.int64(0)), int(np.int64(1))
    q, v = scratch_q[:all_modes], scratch_v[:all_modes]
    share = 0.0
    for j in range(all_modes):
        q[j] = e.flight[P12, j] * kick[j] if j < m.modes else 0.0
        v[j] = e.flight[P22, j] * kick[j] if j < m.modes else 0.0
        share += kick[j] * kick[j] if j < m.modes else 0.0
    e.share[LOOKED_AT] = share
    fill_response(one, e.flight, q, v, e.pull.reshape(1, all_modes), zero, spare, e.own[LOOKED_AT : LOOKED_AT + 1])
    q, v, pull = scratch_q[:n], scratch_v[:n], e.pull[:n].reshape(1, n)
    contacts = m.shapes.shape[0]
    if contacts:
        for j in range(n):
            q[j] = rows[P12, j] * kick[j]
            v[j] = rows[P22, j] * kick[j]
        fill_response(zero, rows, q, v, m.shapes, zero, spare, e.moved)
        none = m.matrix.reshape(-1)[:0].reshape(0, 0)
        fill_lags(one, rows, m.shapes, pull, none, q, v, spare, e.pulled)
        for c in range(contacts):
            _fill_reach(steps, m.dt, e.leverage[c], e.pulled[0, c], e.moved[c], e.reach[c], e.drawn[c])
        after = scratch_q[: m.modes]  # extents after a unit push
        extents(m.omega[: m.modes], rows[KQ], rows[KV], after)
        for c in range(contacts):
            own = 0.0
            for j in range(m.modes):
                own += m.shapes[c, j] * m.shapes[c, j] * after[j]
            e.stirred[c] = np.sqrt(MARGIN * own)


@njit(**INNER)
def _fill_reach(steps: int, dt: float, leverage: float, pulled, moved, reach, drawn) -> None:
    """From pulled, the pull after a force by steps: its mean over a frame, reach, and what is left at the ends of this and
    later frames, drawn: number t·K/r + i after a force in step t of the i-th frame before. moved: with the end's own way."""
    frames = BLOCK // steps
    for k in range(BLOCK):
        moved[BLOCK + k] += leverage * dt * (k + 1)
        reach[k] = 0.0
    for t in range(steps):
        reach[t] = leverage / steps - pulled[BLOCK + steps - 1 - t] / (steps * dt)
        for i in range(frames):
            drawn[t * frames + i] = pulled[BLOCK + (i + 1) * steps - 1 - t]


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_finger_end(model: int, state: int, end: int, steps: int, scratch_q, scratch_v, spare) -> None:
    """Responses between the finger whose weights the state has and the end; `fingers.fill_grip` fills its others."""
    m, s, e = string_model(model), string_state(state), end_at(end)
    rows, n = m.rows, m.rows.shape[1]
    q, v = scratch_q[:n], scratch_v[:n]
    finger, zero, one = s.finger_weights[:n].reshape(1, n), int(np.int64(0)), int(np.int64(1))
    for j in range(n):
        q[j] = rows[P12, j] * e.kick[j]
        v[j] = rows[P22, j] * e.kick[j]
    fill_response(zero, rows, q, v, finger, zero, spare, e.finger_moved)
    for j in range(n):
        q[j] = rows[4, j] * finger[0, j]
        v[j] = rows[5, j] * finger[0, j]
    contacts = m.shapes.shape[0]
    pulled = e.pulled[0, contacts:]
    fill_response(one, rows, q, v, e.pull[:n].reshape(1, n), zero, spare, pulled)
    lever = e.numbers[FINGER_LEVERAGE]
    _fill_reach(steps, m.dt, lever, pulled[0], e.finger_moved[0], e.finger_reach[0], e.finger_drawn[0])


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_reach(model: int, end: int) -> None:
    """KICK_REACH and LARGEST_LEVERAGE of a line with the frequencies of a model, which `line_certificates` needs, from
    End.kick and leverage."""
    m, e = string_model(model), end_at(end)
    furthest, largest = 0.0, 0.0
    moved = e.kept[0, : m.modes]  # which holds something within a block only
    for j in range(m.modes):
        moved[j] = abs(e.kick[j]) / m.omega[j]
    for c in range(m.shapes.shape[0]):
        total = 0.0
        for j in range(m.modes):
            total += abs(m.shapes[c, j]) * moved[j]
        furthest = max(furthest, MARGIN * total)
        largest = max(largest, abs(e.leverage[c]))
    e.numbers[KICK_REACH] = furthest
    e.numbers[LARGEST_LEVERAGE] = largest


@njit(cache=True, nogil=True)
def ensure_tables(coupling: int, line: int, scratch: int) -> None:
    """All that is due of a line is filled. Works in Scratch.q, v and spare."""
    c, w = coupling_at(coupling), scratch_of(scratch)
    model, end = c.line_model[line], c.line_end[line]
    m, e = string_model(model), end_at(end)
    if e.counts[DUE] == READY:
        return
    if e.counts[DUE] == ALL_DUE:
        fill_step(model, e.sigma, e.numbers[RELIEF])
        if m.shapes.shape[0] > 0:
            put_off(model, c.line_state[line])
    n = m.modes
    e.flight[:6, n:] = 0.0
    quick_coefficients(EXACT_HOLD, m.omega[:n], e.sigma[:n], m.mu, c.frame, e.flight)
    fill_rows(e.flight)
    fill_looked_at(model, end, c.steps[line], w.q, w.v, w.spare)
    e.counts[DUE] = READY


@njit(**INNER)
def _rest_no_more(coupling: int, line: int, scratch: int) -> None:
    """All modes of a line that are heard move again while it is not looked at."""
    c, w = coupling_at(coupling), scratch_of(scratch)
    end = c.line_end[line]
    e = end_at(end)
    e.counts[RESTING] = 0
    if e.counts[HEARD_MODES] > e.counts[APART_MODES]:
        ensure_tables(coupling, line, scratch)  # the flight of all modes among them
        set_apart_modes(end)
        fill_apart(end, w.q, w.v, w.spare)


@njit(cache=True, nogil=True)
def look_at(coupling: int, line: int, engaged: int, scratch: int) -> None:
    """Begin to look at the contacts of a line, or leave off; `gather_lines` once all are so. What is above the band of one
    that is not looked at comes to rest."""
    c = coupling_at(coupling)
    e, s = end_at(c.line_end[line]), string_state(c.line_state[line])
    e.counts[ENGAGED] = engaged
    if engaged:
        if e.counts[RESTING]:
            _rest_no_more(coupling, line, scratch)
        ensure_tables(coupling, line, scratch)
        s.counts[MOVING] = string_model(c.line_model[line]).modes
        return
    for j in range(e.counts[APART_MODES], s.counts[MOVING]):
        s.q[j] = 0.0
        s.v[j] = 0.0
    s.counts[MOVING] = e.counts[APART_MODES]
