"""Tables of what contacts, finger and moving end of a line do to each other, filled when they are first asked for.

A line that touches nothing is advanced by its flight over a frame and by the pull of its end after a kick (`fill_apart`).
All else, its steps within a frame, its contacts' matrix, what they do to the end and the end to them, waits until the line
is looked at (`ensure_tables`): a string that is bent in every control period while it touches nothing never pays for it.
What a table holds depends on the coefficients alone, not on when it is filled.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK, KQ, KV, P12, P22
from synth.solver.certificates import MARGIN, extents
from synth.solver.coupling import (
    APART,
    APART_MODES,
    BY_FRAMES,
    DUE,
    ENGAGED,
    FELT_MODES,
    FINGER_LEVERAGE,
    HEARD_MODES,
    HELD_REACH,
    LOOKED_AT,
    NEAR,
    RELIEF,
    RESTING,
    coupling_at,
    end_at,
    moving_modes,
)
from synth.solver.due_responses import ROW_DUE, fill_row, fill_step, put_off, strike
from synth.solver.fingers import fill_grip
from synth.solver.lanes import padded
from synth.solver.laws import EXACT_HOLD
from synth.solver.line_certificates import look_everywhere
from synth.solver.line_culling import cull, fill_held_at_rest, held_at_rest
from synth.solver.quick_coefficients import quick_coefficients
from synth.solver.responses import complete_rows, fill_response, fill_rows
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
    """End.responses.own and share of a line that is not looked at, from End.kick, pull and the first APART_MODES modes of
    flight. Work space (≥n,) and (2, K)."""
    e = end_at(end)
    moving = e.counts[APART_MODES]
    _fill_own(e, APART, moving, scratch_q[: padded(moving)], scratch_v[: padded(moving)], spare)
    e.single.of[0] = np.nan  # what is float32 is to be made anew


@njit(inline="always")
def _fill_own(e, kind: int, moving: int, q, v, spare) -> None:
    """A row of End.responses.own and share, of the first `moving` modes of flight. Work space (≥ moving,)."""
    zero, one = int(np.int64(0)), int(np.int64(1))
    share = 0.0
    for j in range(q.size):
        q[j] = e.flight[P12, j] * e.kick[j] if j < moving else 0.0
        v[j] = e.flight[P22, j] * e.kick[j] if j < moving else 0.0
        share += e.kick[j] * e.kick[j] if j < moving else 0.0
    e.responses.share[kind] = share
    fill_response(one, e.flight, q, v, e.pull.reshape(1, e.pull.size), zero, spare, e.responses.own[kind : kind + 1])


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_looked_at(model: int, end: int, scratch_q, scratch_v, spare) -> None:
    """The responses of a line that is looked at to its end, from its model's rows and End.kick, pull and flight, and its
    share; those of its contacts wait. Work space (≥n,) and (2, K)."""
    m, e = string_model(model), end_at(end)
    all_modes, contacts = e.flight.shape[1], m.contacts.size
    _fill_own(e, LOOKED_AT, m.modes, scratch_q[:all_modes], scratch_v[:all_modes], spare)
    if contacts:
        after = scratch_q[: m.modes]  # extents after a unit push
        extents(m.omega[: m.modes], m.rows[KQ], m.rows[KV], after)
        for c in range(contacts):
            own = 0.0
            for j in range(m.modes):
                own += m.contacts.shapes[c, j] * m.contacts.shapes[c, j] * after[j]
            e.certificate.stirred[c] = np.sqrt(MARGIN * own)
            e.responses.waits[c] = 1


@njit(fastmath=FAST, **INNER)
def fill_contacts_looked_at(model: int, state: int, end: int, steps: int, scratch: int) -> None:
    """What waits of the contacts of a line that are looked at, End.block.near, `steps` a frame: their responses to its end
    and its to them, from its model's rows and End.kick, pull and leverage, and their rows of the matrix. Works in
    Scratch.modes.q and v."""
    m, s, e, w = string_model(model), string_state(state), end_at(end), scratch_of(scratch)
    rows, n, to = m.rows, m.rows.shape[1], e.responses
    zero, one, spare = int(np.int64(0)), int(np.int64(1)), w.rows.spare
    q, v, pull = w.modes.q[:n], w.modes.v[:n], e.pull[:n].reshape(1, n)
    for i in range(e.counts[NEAR]):
        c = e.block.near[i]
        if s.due[c] == ROW_DUE:
            fill_row(model, state, c)
        if to.waits[c]:
            _turn_end(n, rows, e.kick, q, v)
            fill_response(zero, rows, q, v, m.contacts.shapes[c : c + 1], zero, spare, to.moved[c : c + 1])
            strike(m, c, q, v)
            fill_response(one, rows, q, v, pull, zero, spare, e.block.pulled)
            _fill_reach(steps, m.dt, e.leverage[c], e.block.pulled[0], to.moved[c], to.reach[c], to.drawn[c])
            to.waits[c] = 0


@njit(inline="always")
def _turn_end(n: int, rows, kick, q, v) -> None:
    """q, v (n,) after a unit kick of the end and a step by these rows."""
    for j in range(n):
        q[j] = rows[P12, j] * kick[j]
        v[j] = rows[P22, j] * kick[j]


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
    m = string_model(model)
    _fill_finger_end(m.rows, m.rows.shape[1], m.dt, state, end, steps, scratch_q, scratch_v, spare)


@njit(fastmath=FAST, **INNER)
def _fill_finger_end(rows, n: int, dt: float, state: int, end: int, steps: int, scratch_q, scratch_v, spare):
    """The same of n modes with these rows of a step of dt [s], so many a frame."""
    s, e = string_state(state), end_at(end)
    q, v = scratch_q[:n], scratch_v[:n]
    finger, zero, one = s.grip.weights[:n].reshape(1, n), int(np.int64(0)), int(np.int64(1))
    _turn_end(n, rows, e.kick, q, v)
    fill_response(zero, rows, q, v, finger, zero, spare, e.responses.finger_moved)
    for j in range(n):
        q[j] = rows[4, j] * finger[0, j]
        v[j] = rows[5, j] * finger[0, j]
    fill_response(one, rows, q, v, e.pull[:n].reshape(1, n), zero, spare, e.block.pulled)
    lever = e.numbers[FINGER_LEVERAGE]
    to = e.responses
    _fill_reach(steps, dt, lever, e.block.pulled[0], to.finger_moved[0], to.finger_reach[0], to.finger_drawn[0])


@njit(cache=True, nogil=True)
def ensure_tables(coupling: int, line: int, scratch: int) -> None:
    """All that is due of a line is filled. Works in Scratch.modes.q, v and spare."""
    c, w = coupling_at(coupling), scratch_of(scratch)
    model, end = c.lines.model[line], c.lines.end[line]
    m, e = string_model(model), end_at(end)
    if e.counts[DUE] == READY:
        return
    if e.counts[DUE] == ALL_DUE:
        fill_step(model, e.sigma)
        if m.contacts.size > 0:
            put_off(model, c.lines.state[line], e.numbers[RELIEF])
    n = m.modes
    e.flight[:6, n:] = 0.0
    quick_coefficients(EXACT_HOLD, m.omega[:n], e.sigma[:n], m.mu, c.frame, e.flight)
    fill_rows(e.flight)
    fill_looked_at(model, end, w.modes.q, w.modes.v, w.rows.spare)
    e.counts[DUE] = READY


@njit(**INNER)
def _rest_no_more(coupling: int, line: int, scratch: int) -> None:
    """All modes of a line that are heard move again while it is not looked at."""
    c, w = coupling_at(coupling), scratch_of(scratch)
    end = c.lines.end[line]
    e = end_at(end)
    e.counts[RESTING] = 0
    if e.counts[HEARD_MODES] > e.counts[APART_MODES]:
        ensure_tables(coupling, line, scratch)  # the flight of all modes among them
        set_apart_modes(end)
        fill_apart(end, w.modes.q, w.modes.v, w.rows.spare)


@njit(cache=True, nogil=True)
def fill_finger(coupling: int, line: int, scratch: int) -> None:
    """Responses of a line that is looked at in its own steps to the finger on it, whose weights its state has."""
    c, w = coupling_at(coupling), scratch_of(scratch)
    model, state, end = c.lines.model[line], c.lines.state[line], c.lines.end[line]
    ensure_tables(coupling, line, scratch)
    fill_grip(model, state, scratch, int(np.int64(1)))
    fill_finger_end(model, state, end, c.lines.steps[line], w.modes.q, w.modes.v, w.rows.spare)


@njit(cache=True, nogil=True, fastmath=FAST)
def go_by_frames(coupling: int, line: int, scratch: int) -> bool:
    """Look at a line, on which something lies, a frame at a time, in the modes that are heard, if all of its contacts are
    out of reach for a block of frames; whether they are. `gather_lines` then. Its End.flight must be as its modes are.
    """
    c, w = coupling_at(coupling), scratch_of(scratch)
    model, state, end = c.lines.model[line], c.lines.state[line], c.lines.end[line]
    m, s, e = string_model(model), string_state(state), end_at(end)
    before, held = e.counts[BY_FRAMES], w.modes.moved[2]
    e.counts[BY_FRAMES] = 1
    fill_held_at_rest(c, line, held)
    if m.contacts.size > 0 and cull(coupling, line, scratch, int(np.int64(BLOCK))) > 0:
        e.counts[BY_FRAMES] = before
        return False
    if e.counts[RESTING]:
        e.counts[RESTING] = 0
        set_apart_modes(end)
        n = e.counts[APART_MODES]
        quick_coefficients(EXACT_HOLD, m.omega[:n], e.sigma[:n], m.mu, c.frame, e.flight)
        complete_rows(e.flight, padded(n))
        fill_apart(end, w.modes.q, w.modes.v, w.rows.spare)
        fill_held_at_rest(c, line, held)
    look_everywhere(end)
    e.counts[ENGAGED] = 1
    residual, finger_at = 0.0, s.finger[0]
    if before:  # what rests is in it already
        finger_at.here -= (s.grip.own[0, BLOCK] - finger_at.own) * finger_at.push
    for j in range(e.counts[APART_MODES], m.modes):  # which follow the finger as if at rest
        residual += s.grip.weights[j] * held[j]
        if j < s.counts[MOVING]:
            finger_at.here -= s.grip.weights[j] * s.q[j]
    finger_at.here += residual * finger_at.push
    _rest_above(c, line)
    # what it does to its end is that of a line that is apart, and what it does in its own steps waits
    e.responses.share[LOOKED_AT] = e.responses.share[APART]
    for k in range(2 * BLOCK):
        e.responses.own[LOOKED_AT, k] = e.responses.own[APART, k]
    if e.counts[DUE] == READY:
        e.counts[DUE] = TABLES_DUE
    n = padded(moving_modes(m, e))
    q, v, finger = w.modes.q[:n], w.modes.v[:n], s.grip.weights[:n].reshape(1, n)
    own = 0.0
    for j in range(n):
        q[j], v[j] = e.flight[KQ, j] * finger[0, j], e.flight[KV, j] * finger[0, j]
        own += finger[0, j] * q[j]
    zero = int(np.int64(0))
    fill_response(zero, e.flight, q, v, finger, zero, w.rows.spare, s.grip.own)
    finger_at.own = own
    s.grip.own[0, BLOCK] = own + residual
    extents(m.omega[:n], q, v, q)
    for k in range(m.contacts.size):
        total = 0.0
        for j in range(n):
            total += abs(m.contacts.shapes[k, j]) * q[j]
        s.grip.far[k] = MARGIN * (total + e.numbers[HELD_REACH])
    _fill_finger_end(e.flight, n, c.frame, state, end, int(np.int64(1)), w.modes.q, w.modes.v, w.rows.spare)
    return True


@njit(cache=True, nogil=True)
def look_at(coupling: int, line: int, engaged: int, scratch: int) -> None:
    """Begin to look at the contacts of a line, or leave off; `gather_lines` once all are so. What is above the band of one
    that is not looked at comes to rest."""
    c = coupling_at(coupling)
    e, s = end_at(c.lines.end[line]), string_state(c.lines.state[line])
    went_by_frames = e.counts[BY_FRAMES] != 0
    e.counts[ENGAGED] = engaged
    e.counts[BY_FRAMES] = 0
    if engaged:
        if e.counts[RESTING]:
            _rest_no_more(coupling, line, scratch)
        ensure_tables(coupling, line, scratch)
        s.counts[MOVING] = string_model(c.lines.model[line]).modes
        if went_by_frames:
            _bend_above(c, line)
        return
    _rest_above(c, line)


@njit(inline="always")
def _rest_above(c, line: int) -> None:
    """The modes of a line that move only while it is looked at in its own steps come to rest."""
    e, s = end_at(c.lines.end[line]), string_state(c.lines.state[line])
    for j in range(e.counts[APART_MODES], s.counts[MOVING]):
        s.q[j] = 0.0
        s.v[j] = 0.0
    s.counts[MOVING] = e.counts[APART_MODES]


@njit(inline="always")
def _bend_above(c, line: int) -> None:
    """The modes of a line that rested while it went by frames are where the finger's last push holds them."""
    e, s, m = end_at(c.lines.end[line]), string_state(c.lines.state[line]), string_model(c.lines.model[line])
    push = s.finger[0].push
    if push == 0.0:
        return
    look_everywhere(c.lines.end[line])  # no certificate knows of them
    for j in range(e.counts[APART_MODES], m.modes):
        s.q[j] = push * held_at_rest(m, s, j)
        s.v[j] = 0.0
