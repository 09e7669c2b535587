"""Which contacts of a line need not be looked at for a few passes, though nothing certifies them: a bound, then checked.

From one pass to another a string moves little. With q_p the shape in which the finger's last push p would hold it at rest,
and E_j the extents (`certificates`) of what it is away from that, free flight under that push moves a contact within τ by

    Σ |φ_j| E_j min(2, ω_j τ)

at most; a string that is being drawn is hardly away from q_p. Beside that come what the finger pushes otherwise than p, what
contacts press, and what the bridge does. None of it is known when the line is looked at: what is left of a contact's gap is
spent by what has come of it, frame by frame, and a block in which it is used up is gone through once more (`frames`), in
which that contact is looked at, as in the rest of the call. So no sound depends on what is passed over here.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK
from synth.solver.certificates import MARGIN
from synth.solver.coupling import (
    APART_MODES,
    BY_FRAMES,
    CULLING,
    FEW,
    FINGERS_PUSH,
    FOLLOWED,
    HELD_REACH,
    KICK_REACH,
    LARGEST_LEVERAGE,
    LARGEST_SHAPE,
    LASTS,
    LATELY,
    LONG,
    NEAR,
    USED_UP,
    along,
    coupling_at,
    end_at,
    moving_modes,
    steps_of,
)
from synth.solver.stringmodel import scratch_of, string_model, string_state
from synth.solver.vectors import FAST, INNER

#: share of a gap that has to be left beyond free flight
_KEPT_BACK = 0.25
#: times what the bridge did in the block before that have to be left
_OF_THE_BRIDGE = 2.0
#: frames like the one in which a gap is used up, that other contacts must outlast not to be looked at, too
_OUTLASTED = 4.0


@njit(cache=True, nogil=True)
def may_cull(coupling: int, line: int) -> bool:
    """Whether it pays: a line with many contacts that are not certified, which do not rub."""
    c = coupling_at(coupling)
    if c.lines.friction[line] > 0.0 or (line + 1 < c.lines.friction.size and c.lines.friction[line + 1] > 0.0):
        return False
    e = end_at(c.lines.end[line])
    several = 0
    for k in range(string_model(c.lines.model[line]).contacts.size):
        several += 1 if e.certificate.clearance[k] <= 0.0 else 0
    return several >= c.culled_from


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def cull(coupling: int, line: int, scratch: int, steps: int) -> int:
    """End.block.left, of the contacts that are not certified: > 0 where one need not be looked at for the line's next K
    steps, or for all `steps` up to the end of the block if few need to even then; how many are to be looked at.

    A line that goes by frames needs all of its contacts out of reach, certified or not.
    """
    c, w = coupling_at(coupling), scratch_of(scratch)
    m, s, e = string_model(c.lines.model[line]), string_state(c.lines.state[line]), end_at(c.lines.end[line])
    by_frames = e.counts[BY_FRAMES] != 0
    n, height, finger = moving_modes(m, e), along(c, line, c.bridge.beta), s.finger[0]
    dt = c.frame if by_frames else m.dt
    whole, soon, omega, q, v = w.modes.moved[0, :n], w.modes.moved[1, :n], m.omega, s.q, s.v
    push = finger.push if finger.on else 0.0
    e.block.answer[FINGERS_PUSH] = push
    per_mass, time, brief = push / m.mu, steps * dt, min(steps, BLOCK) * dt
    for j in range(n):
        period = 1.0 / omega[j]
        away, speed = q[j] - per_mass * s.grip.weights[j] * (period * period), v[j] * period
        extent = MARGIN * np.sqrt(away * away + speed * speed)
        whole[j] = extent * min(2.0, omega[j] * time)
        soon[j] = extent * min(2.0, omega[j] * brief)
    near, near_soon = _left_after(c, line, whole, soon, height, w.pivot.b)
    e.block.known[LASTS] = steps
    if steps > BLOCK and (near > (0 if by_frames else FEW) or e.block.known[CULLING] < LONG):
        for k in range(m.contacts.size):
            e.block.left[k] = w.pivot.b[k]
        e.block.known[LASTS] = BLOCK
        return near_soon
    return near


@njit(fastmath=FAST, **INNER)
def _left_after(c, line: int, whole, soon, height: float, left_soon) -> tuple[int, int]:
    """End.block.left once each mode has moved by as much as in the whole time (n,), and the same by as much as soon; how
    many contacts are to be looked at in either case."""
    m, s, e = string_model(c.lines.model[line]), string_state(c.lines.state[line]), end_at(c.lines.end[line])
    q, near, near_soon = s.q[: whole.size], 0, 0
    reserve, held = _OF_THE_BRIDGE * e.numbers[LATELY], e.numbers[HELD_REACH] * abs(e.block.answer[FINGERS_PUSH])
    for k in range(m.contacts.size):
        if e.block.left[k] == FOLLOWED and e.counts[BY_FRAMES] == 0:
            left_soon[k] = FOLLOWED
            near += 1
            near_soon += 1
            continue
        e.block.left[k] = left_soon[k] = 0.0
        if e.certificate.clearance[k] <= 0.0 or e.counts[BY_FRAMES]:
            shape, here, far, close = m.contacts.shapes[k, : whole.size], 0.0, 0.0, 0.0
            for j in range(whole.size):
                reach = abs(shape[j])
                here += shape[j] * q[j]
                far += reach * whole[j]
                close += reach * soon[j]
            gap = here + e.leverage[k] * height - s.eta[k]
            if e.counts[BY_FRAMES]:
                gap -= held
            least = max(reserve, _KEPT_BACK * gap)
            if gap - far > least:
                e.block.left[k] = gap - far
            else:
                near += 1
            if gap - close > least:
                left_soon[k] = gap - close
            else:
                near_soon += 1
    return near, near_soon


@njit(inline="always")
def held_at_rest(m, s, j: int) -> float:
    """Where a unit push of the finger on a string holds mode j at rest [m·√m/N], of its StringModel m and StringState s."""
    return s.grip.weights[j] / (m.mu * m.omega[j] * m.omega[j])


@njit(fastmath=FAST, **INNER)
def fill_held_at_rest(c, line: int, held) -> None:
    """held (≥ modes,): `held_at_rest` of the modes of a line that rest while it goes by frames; HELD_REACH of them."""
    m, s, e = string_model(c.lines.model[line]), string_state(c.lines.state[line]), end_at(c.lines.end[line])
    total = 0.0
    for j in range(e.counts[APART_MODES], m.modes):
        held[j] = held_at_rest(m, s, j)
        total += abs(held[j])
    e.numbers[HELD_REACH] = e.numbers[LARGEST_SHAPE] * total


@njit(cache=True, nogil=True)
def spend_left(coupling: int, line: int, first: int, turn: float, speed: float) -> None:
    """Take what a frame has done off End.block.left: its line's end turned by `turn` and went at `speed`, and the finger
    and the contacts pushed as they have from step `first` of the block on. End.block.known has it where something is used
    up."""
    c = coupling_at(coupling)
    m, s, e = string_model(c.lines.model[line]), string_state(c.lines.state[line]), end_at(c.lines.end[line])
    steps, contacts, strength = steps_of(c, e, line), m.contacts.size, 0.0
    if s.finger[0].on != 0:
        for t in range(first, first + steps):
            strength += abs(e.block.forces[contacts, t] - e.block.answer[FINGERS_PUSH])
    spent = e.numbers[KICK_REACH] * abs(turn) + e.numbers[LARGEST_LEVERAGE] * c.frame * abs(speed)
    for i in range(e.counts[NEAR]):
        d, pressed = e.block.near[i], 0.0
        for t in range(first, first + steps):
            pressed += e.block.forces[i, t]
        if pressed > 0.0:
            for k in range(contacts):
                if e.block.left[k] > 0.0:
                    reached = e.certificate.stirred[k] * e.certificate.stirred[d] + abs(m.contacts.matrix[k, d])
                    e.block.left[k] -= reached * pressed
                    if e.block.left[k] <= 0.0:
                        e.block.known[LASTS] = USED_UP
    for k in range(contacts):
        if e.block.left[k] > 0.0:
            e.block.left[k] -= _taken(s, k, spent, strength)
            if e.block.left[k] <= 0.0:
                e.block.known[LASTS] = USED_UP
    if e.block.known[LASTS] == USED_UP and e.counts[BY_FRAMES] == 0:
        for k in range(contacts):
            if e.block.left[k] < 0.0 or 0.0 < e.block.left[k] <= _OUTLASTED * _taken(s, k, spent, strength):
                e.block.left[k] = FOLLOWED


@njit(inline="always")
def _taken(s, k: int, spent: float, strength: float) -> float:
    """What a frame takes off a contact's gap: what the bridge does, and the finger's pushes of this strength."""
    return spent + (s.grip.far[k] * strength if strength > 0.0 else 0.0)


@njit(**INNER)
def follow_none(end: int) -> None:
    """No contact is looked at because its gap was used up before."""
    left = end_at(end).block.left
    for k in range(left.size):
        left[k] = max(0.0, left[k])
