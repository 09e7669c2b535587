"""Coupled strings through time, a frame of the bridge after the other: see `coupling`.

In a block of K frames the lines that touch nothing pass over their modes once, as in free flight, and so do those that are
certain to stay clear of their contacts for the block, and the body (`coupled_body`); those whose contacts or finger are
looked at take r passes of K steps, r a line's own, without the contacts that are out of reach (`line_culling`). A pass gives
what the modes would do if the bridge kept its speed; what each frame's kicks and forces do beside that are sums over a few
numbers. So a frame is decided on D = COMPONENTS numbers:

    Δβ = (I + ΓA/H)⁻¹ (β_free − β + Γ (F₀ + J(V))),

F₀ the force on the bridge at V = 0 without contacts, J that of the contacts, which take the bridge to move at V. Newton's
method finds V; whatever root it finds loses no more energy than the losses take and gains none. Where it finds none, the
contacts of that frame hold one force each (`held_forces`), and the problem has one root.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import ADV11, ADV12, BLOCK
from synth.solver.coupled_body import COMPONENTS, begin_body, drive_body, look_at_body, push_body
from synth.solver.coupling import (
    AHEAD,
    APART,
    APART_MODES,
    BY_FRAMES,
    CERTIFIED,
    CLEAR,
    CULLING,
    ENGAGED,
    FAR,
    FRAMES,
    HELD_FRAMES,
    ITERATIONS,
    KEPT,
    KEPT_BY_THE_REST,
    KIND,
    LASTS,
    LINEAR,
    LONG,
    NEAR,
    NEVER,
    PATTERN,
    PUSHED,
    SEVERAL,
    SINGLE,
    STEEPNESS,
    TOUCHED,
    TURNED,
    USED_UP,
    along,
    coupling_at,
    end_at,
    gather_lines,
    invert,
    steps_of,
)
from synth.solver.due_responses import fill_those
from synth.solver.held_forces import hold_forces
from synth.solver.lanes import add_late_of_three, kick, kick_v, padded, padded_single, project_v
from synth.solver.lcp import SOLVED
from synth.solver.line_certificates import is_clear, lasts, look_everywhere, runs_out, spend
from synth.solver.line_culling import cull, follow_none, may_cull, spend_left
from synth.solver.line_forces import (
    answer_by_frames,
    answer_of_line,
    coast_line,
    drive_line,
    follow_line,
    look_at_line,
    settle_line,
    step_line,
)
from synth.solver.line_friction import answer_of_rubbed, rub_where_pressed, rubs
from synth.solver.line_layers import keep_gaps, note_gaps
from synth.solver.line_tables import fill_finger, look_at
from synth.solver.single import fill_single_rows, give_back, round_into, take
from synth.solver.stepwise import fly
from synth.solver.stringmodel import string_model, string_state
from synth.solver.vectors import FAST, INNER, add, put

#: iterations after which the forces are held, and how near to a root they end, of the terms of the equation
MOST_ITERATIONS = 24
CLOSE = 4e-15
#: how near the root of a linear equation is after one iteration: less near, it was not the same equation
SAME = 1e-10
#: rows of Coupling.block.small
FORCE, V, FROM_CONTACTS, MISSING, V_FREE, TURN = range(6)


@njit(cache=True, nogil=True)
def advance_frames(coupling: int, scratch: int, frames: int, stretch: int, out) -> int:
    """Take an instrument through `frames` frames; out (channels, ≥ frames) gets what its body radiates. A status of `lcp`.

    Lines whose End.counts say so are looked at, and others that have contacts as soon as their certificate is used up; a
    finger that is on goes along its End.path. What the bridge sees of its lines must be as they are (`gather_lines`).
    stretch: frames, a multiple of BLOCK if fewer than all, for which a row of Coupling.bridge.held holds; a call for each
    stretch does the same to the bit.
    """
    status = int(np.int64(0))
    blocks = frames // BLOCK
    c = coupling_at(coupling)
    if blocks > 0:
        _take_apart(coupling)
    for t in range(blocks):
        at = t * BLOCK
        until = min(frames, at - at % stretch + stretch)
        if at % stretch == 0:
            _begin_stretch(coupling, at // stretch)
        _look_apart(coupling, t > 0, c.single != 0)
        status = max(status, _certain_block(coupling, scratch, int(np.int64(BLOCK)), at, until, out))
    if blocks > 0:
        _leave_apart(coupling)
    at = blocks * BLOCK
    if at < frames:
        if at % stretch == 0:
            _begin_stretch(coupling, at // stretch)
        _look_apart(coupling, False, False)
        status = max(status, _certain_block(coupling, scratch, frames - at, at, frames, out))
        _step_apart(coupling, frames - at)
    return status


@njit(**INNER)
def _begin_stretch(coupling: int, number: int) -> None:
    """Take over the force that holds the bridge in this stretch of a call; which contacts are out of reach is asked anew."""
    c = coupling_at(coupling)
    if number > 0:
        put(c.bridge.held[0], c.bridge.held[number])
    for line in range(c.lines.end.size):
        end_at(c.lines.end[line]).block.known[LASTS] = 0
        follow_none(c.lines.end[line])


@njit(**INNER)
def _certain_block(coupling: int, scratch: int, frames: int, at: int, until: int, out) -> int:
    """`_block`, again where a line that was not looked at might have touched something; the call ends at frame `until`."""
    c = coupling_at(coupling)
    uncertain = False
    for line in range(c.lines.end.size):
        e = end_at(c.lines.end[line])
        e.counts[KIND] = FAR
        if e.counts[ENGAGED]:
            if rubs(coupling, line):
                clear = end_at(c.lines.end[line - 1]).counts[KIND] < SINGLE
            else:
                clear = string_state(c.lines.state[line]).finger[0].on == 0 and is_clear(coupling, line, scratch)
            e.counts[KIND] = CLEAR if clear else SEVERAL
            contacts = string_model(c.lines.model[line]).contacts.size
            if contacts >= c.culled_from and runs_out(coupling, line, frames):
                look_everywhere(c.lines.end[line])
        e.block.known[CULLING] = LONG if e.counts[KIND] == SEVERAL and _may_pass_over(coupling, line) else NEVER
        uncertain = uncertain or e.counts[KIND] == CLEAR or e.counts[CERTIFIED] > 0 or e.block.known[CULLING] != NEVER
    if uncertain:
        _keep(coupling)
    look_at_body(c.body)
    status = int(np.int64(0))
    again = True
    while again:
        if _look_closer(coupling, scratch, max(BLOCK, until - at)):
            _gather_again(coupling, frames)
        status = _block(coupling, scratch, frames, at)
        again = False
        for line in range(c.lines.end.size):
            e = end_at(c.lines.end[line])
            _kicks_of(c, line, e.block.kicks)
            if _is_used_up(e):
                known = e.block.known
                known[CULLING] = NEVER if e.counts[BY_FRAMES] and known[CULLING] < LONG else known[CULLING] - 1
                again = True
        for line in range(c.lines.end.size if not again else 0):  # else the block was left off
            if c.lines.friction[line] > 0.0:
                if rubs(coupling, line) and end_at(c.lines.end[line - 1]).counts[KIND] >= SINGLE:
                    _begin_to_look(coupling, line, scratch, frames)
                    end_at(c.lines.end[line]).counts[KIND] = SEVERAL
            elif string_model(c.lines.model[line]).contacts.size > 0 and not lasts(coupling, line, frames):
                _begin_to_look(coupling, line, scratch, frames)
                look_everywhere(c.lines.end[line])
                again = True
        if again:
            _take_back(coupling)
            for line in range(c.lines.end.size):
                e = end_at(c.lines.end[line])
                if e.counts[BY_FRAMES]:
                    e.block.known[LASTS] = 0
            _gather_again(coupling, frames)
    for line in range(c.lines.end.size):
        if c.lines.friction[line] == 0.0 and string_model(c.lines.model[line]).contacts.size > 0:
            spend(coupling, line)
    drive_body(c.body, c.frame, frames, at, out)
    return status


@njit(**INNER)
def _gather_again(coupling: int, frames: int) -> None:
    """`gather_lines` as a block of frames begins."""
    c = coupling_at(coupling)
    for line in range(c.lines.end.size):
        if frames == BLOCK and end_at(c.lines.end[line]).counts[ENGAGED] == 0:
            _give_back(coupling, line)
    gather_lines(coupling)
    _sum_apart(coupling)


@njit(inline="always")
def _may_pass_over(coupling: int, line: int) -> bool:
    """Whether contacts of a line that is looked at may be passed over: where that pays, and all where it goes by frames."""
    c = coupling_at(coupling)
    if end_at(c.lines.end[line]).counts[BY_FRAMES]:
        return string_model(c.lines.model[line]).contacts.size > 0
    return may_cull(coupling, line)


@njit(**INNER)
def _look_closer(coupling: int, scratch: int, frames: int) -> bool:
    """Lines that go by frames, but may touch something in the next block, are looked at in their own steps; whether there
    are any. What is certain for so many frames on is not asked again in this call."""
    c = coupling_at(coupling)
    closer = False
    for line in range(c.lines.end.size):
        e = end_at(c.lines.end[line])
        if e.counts[BY_FRAMES] == 0 or string_model(c.lines.model[line]).contacts.size == 0:
            continue
        may_touch = e.block.known[CULLING] == NEVER
        if not may_touch and e.block.known[LASTS] <= 0:
            may_touch = cull(coupling, line, scratch, frames) > 0
        if may_touch:
            look_at(coupling, line, int(np.int64(1)), scratch)
            fill_finger(coupling, line, scratch)
            _keep_line(c, line)  # it still is as the block began
            e.block.known[CULLING] = LONG if may_cull(coupling, line) else NEVER
            e.block.known[LASTS] = 0
            closer = True
    return closer


@njit(**INNER)
def _begin_to_look(coupling: int, line: int, scratch: int, frames: int) -> None:
    """A line that was apart in this block of frames is looked at in it."""
    c = coupling_at(coupling)
    if end_at(c.lines.end[line]).counts[ENGAGED] == 0:
        if frames == BLOCK:
            _give_back(coupling, line)
        look_at(coupling, line, int(np.int64(1)), scratch)
        end_at(c.lines.end[line]).counts[KEPT] = 1  # it still is as the block began
        _keep_line(c, line)


@njit(**INNER)
def _keep(coupling: int) -> None:
    """What a block changes, as it begins."""
    c = coupling_at(coupling)
    put(c.block.kept[0], c.bridge.speed)
    put(c.block.kept[1], c.bridge.beta)
    put(c.block.kept[2], c.bridge.rest)
    put(c.block.kept[3], c.bridge.momentum)
    for line in range(c.lines.end.size):
        counts = end_at(c.lines.end[line]).counts
        counts[KEPT] = counts[ENGAGED]
        if counts[KEPT]:
            _keep_line(c, line)


@njit(**INNER)
def _keep_line(c, line: int) -> None:
    """What a block changes of a line that is looked at, as it begins."""
    e, s = end_at(c.lines.end[line]), string_state(c.lines.state[line])
    n, contacts = string_model(c.lines.model[line]).modes, e.leverage.size
    put(e.kept.modes[0], s.q[:n])
    put(e.kept.modes[1], s.v[:n])
    put(e.kept.contacts, s.force[:contacts])
    e.kept.contacts[contacts] = s.finger[0].here
    e.kept.contacts[contacts + 1] = s.finger[0].push


@njit(**INNER)
def _take_back(coupling: int) -> None:
    """All as the block began; of the body nothing has changed (`coupled_body`)."""
    c = coupling_at(coupling)
    put(c.bridge.speed, c.block.kept[0])
    put(c.bridge.beta, c.block.kept[1])
    put(c.bridge.rest, c.block.kept[2])
    put(c.bridge.momentum, c.block.kept[3])
    for line in range(c.lines.end.size):
        e, s = end_at(c.lines.end[line]), string_state(c.lines.state[line])
        if e.counts[KEPT]:
            n = string_model(c.lines.model[line]).modes
            put(s.q, e.kept.modes[0, :n])
            put(s.v, e.kept.modes[1, :n])
            contacts = e.leverage.size
            put(s.force, e.kept.contacts[:contacts])
            s.finger[0].here = e.kept.contacts[contacts]
            s.finger[0].push = e.kept.contacts[contacts + 1]


@njit(**INNER)
def _kicks_of(c, line: int, kicks) -> None:
    """kicks (K,) of a line's end from those of the bridge."""
    direction, of_bridge = c.lines.direction[line], c.block.kicks
    for k in range(BLOCK):
        total = 0.0
        for i in range(COMPONENTS):
            total += direction[i] * of_bridge[i, k]
        kicks[k] = total


@njit(**INNER)
def _take_apart(coupling: int) -> None:
    """The modes of lines that are not looked at become float32 for some blocks, where they may."""
    c = coupling_at(coupling)
    if not c.single:
        return
    for line in range(c.lines.end.size):
        e, s = end_at(c.lines.end[line]), string_state(c.lines.state[line])
        if not e.counts[ENGAGED]:
            n = e.counts[APART_MODES]
            _ensure_singles(e, n)
            whole = padded_single(n)
            take(s.q, s.v, n, e.single.q[:whole], e.single.v[:whole])


@njit(**INNER)
def _ensure_singles(e, n: int) -> None:
    """End.single.flight, kick and pull are those of the first n modes of its flight."""
    of, flight = e.single.of, e.flight
    last = n - 1
    same = of[0] == flight[ADV11, 0] and of[1] == flight[ADV12, 0] and of[2] == flight[ADV11, last]
    if same and of[3] == flight[ADV12, last] and of[4] == e.kick[last]:
        return
    of[0], of[1], of[2], of[3] = flight[ADV11, 0], flight[ADV12, 0], flight[ADV11, last], flight[ADV12, last]
    of[4] = e.kick[last]
    whole = padded_single(n)
    fill_single_rows(flight, int(np.int64(0)), n, e.single.flight)
    round_into(e.kick, n, e.single.kick[:whole])
    round_into(e.pull, n, e.single.pull[:whole])


@njit(**INNER)
def _give_back(coupling: int, line: int) -> None:
    """The modes of a line that is not looked at are float64 again."""
    c = coupling_at(coupling)
    if c.single:
        e, s = end_at(c.lines.end[line]), string_state(c.lines.state[line])
        give_back(e.single.q, e.single.v, e.counts[APART_MODES], s.q, s.v)


@njit(**INNER)
def _look_apart(coupling: int, kicked: bool, single: bool) -> None:
    """The free pull over K frames of the lines that are not looked at, where kicked after those of the block before.

    single: whether their modes are float32 now (`_take_apart`).
    """
    c = coupling_at(coupling)
    for line in range(c.lines.end.size):
        e, s = end_at(c.lines.end[line]), string_state(c.lines.state[line])
        if e.counts[ENGAGED]:
            continue
        n = e.counts[APART_MODES]
        if kicked:
            if single:
                kick_v(
                    padded_single(n),
                    e.single.flight,
                    e.single.q,
                    e.single.v,
                    e.single.kick,
                    e.block.kicks,
                    e.single.pull,
                    e.block.row,
                )
            else:
                kick_v(padded(n), e.flight, s.q, s.v, e.kick, e.block.kicks, e.pull, e.block.row)
        elif single:
            project_v(padded_single(n), e.single.flight, e.single.q, e.single.v, e.single.pull, e.block.row)
        else:
            project_v(padded(n), e.flight, s.q, s.v, e.pull, e.block.row)
    _sum_apart(coupling)


@njit(**INNER)
def _sum_apart(coupling: int) -> None:
    """Coupling.block.pull of the lines that are not looked at, from the rows of each."""
    c = coupling_at(coupling)
    pull = c.block.pull
    for i in range(COMPONENTS):
        for k in range(BLOCK):
            pull[i, k] = 0.0
    for line in range(c.lines.end.size):
        e = end_at(c.lines.end[line])
        if not e.counts[ENGAGED]:
            row, direction = e.block.row, c.lines.direction[line]
            for i in range(COMPONENTS):
                share = direction[i]
                if share != 0.0:
                    for k in range(BLOCK):
                        pull[i, k] += share * row[k]


@njit(**INNER)
def _leave_apart(coupling: int) -> None:
    """The lines that are not looked at go through the K frames of the last block."""
    c = coupling_at(coupling)
    for line in range(c.lines.end.size):
        e, s = end_at(c.lines.end[line]), string_state(c.lines.state[line])
        if not e.counts[ENGAGED]:
            n = e.counts[APART_MODES]
            if c.single:
                kick(padded_single(n), e.single.flight, e.single.q, e.single.v, e.single.kick, e.block.kicks)
                _give_back(coupling, line)
            else:
                kick(padded(n), e.flight, s.q, s.v, e.kick, e.block.kicks)


@njit(**INNER)
def _step_apart(coupling: int, frames: int) -> None:
    """Advance the lines that are not looked at by so many frames of the last block, fewer than K."""
    c = coupling_at(coupling)
    for line in range(c.lines.end.size):
        e, s = end_at(c.lines.end[line]), string_state(c.lines.state[line])
        if not e.counts[ENGAGED]:
            n = e.counts[APART_MODES]
            q, v = s.q[:n], s.v[:n]
            for frame in range(frames):
                for i in range(COMPONENTS):
                    add(c.lines.direction[line, i] * c.block.kicks[i, frame], e.kick[:n], v)
                fly(e.flight, q, v)


@njit(inline="always")
def _within(c, e, line: int, number: int) -> tuple[int, int]:
    """(frames that a line goes before it is driven, which of them this frame of the block is)."""
    frames = BLOCK if e.counts[KIND] == CLEAR else BLOCK // steps_of(c, e, line)
    return frames, number & (frames - 1)


@njit(**INNER)
def _block(coupling: int, scratch: int, frames: int, at: int) -> int:
    """At most K frames from number `at` of the call on; a line that is looked at takes K steps of its own at a time. Left
    off where a contact was passed over that might have been touched."""
    c = coupling_at(coupling)
    status = int(np.int64(0))
    touching = int(np.int64(0))
    for line in range(c.lines.end.size):
        e = end_at(c.lines.end[line])
        e.certificate.pushed[0] = e.certificate.pushed[1] = 0.0
        e.block.known[AHEAD] = 0
        if e.counts[KIND] != FAR:
            touching += 1
            c.block.touching[touching] = line
    c.block.touching[0] = touching
    begin_body(c.body, frames, at)
    for number in range(frames):
        for place in range(1, touching + 1):
            line = c.block.touching[place]
            end = c.lines.end[line]
            e = end_at(end)
            if _within(c, e, line, number)[1] == 0:
                if e.counts[KIND] == CLEAR:
                    coast_line(c.lines.model[line], c.lines.state[line], end)
                else:
                    if c.lines.friction[line] > 0.0:
                        rub_where_pressed(coupling, line, end_at(c.lines.end[line - 1]).counts[KIND] >= SINGLE)
                    if _looks_back(c, line):
                        note_gaps(coupling, line)
                    by_frames = e.counts[BY_FRAMES] != 0  # `_look_closer` has asked
                    if e.block.known[CULLING] != NEVER and not by_frames and (number == 0 or e.block.known[LASTS] == 0):
                        cull(coupling, line, scratch, (frames - number) * c.lines.steps[line])
                    e.block.known[LASTS] = max(0, e.block.known[LASTS] - BLOCK)
                    speed, height = along(c, line, c.bridge.speed), along(c, line, c.bridge.beta)
                    dt = c.frame if by_frames else string_model(c.lines.model[line]).dt
                    model, state, steps = c.lines.model[line], c.lines.state[line], steps_of(c, e, line)
                    look_at_line(model, state, end, scratch, steps, dt, speed, height)
        status = max(status, _frame(coupling, scratch, number, at))
        for place in range(1, touching + 1):
            if _is_used_up(end_at(c.lines.end[c.block.touching[place]])):
                return status
        for place in range(1, touching + 1):
            line = c.block.touching[place]
            end = c.lines.end[line]
            e = end_at(end)
            every, within = _within(c, e, line, number)
            if within == every - 1:
                drive_line(c.lines.model[line], c.lines.state[line], end, steps_of(c, e, line), number + 1 < frames)
            elif number == frames - 1:
                step_line(c.lines.model[line], c.lines.state[line], end, steps_of(c, e, line), within + 1)
    return status


@njit(inline="always")
def _is_used_up(e) -> bool:
    """Whether a contact of a line was passed over that might have been touched: the block is gone through once more."""
    return e.block.known[CULLING] != NEVER and e.block.known[LASTS] == USED_UP


@njit(inline="always")
def _looks_back(c, line: int) -> bool:
    """Whether what contacts do in a step hangs on where they were before: those that rub, and soft ones."""
    return c.lines.friction[line] > 0.0 or string_model(c.lines.model[line]).contacts.layers.shape[1] > 0


@njit(inline="always")
def _triple(x) -> tuple[float, float, float]:
    """The components of x (D,)."""
    return x[0], x[1], x[2]


@njit(inline="always")
def _times(a, x) -> tuple[float, float, float]:
    """A x of a matrix (D, D) and a triple."""
    return (
        a[0, 0] * x[0] + a[0, 1] * x[1] + a[0, 2] * x[2],
        a[1, 0] * x[0] + a[1, 1] * x[1] + a[1, 2] * x[2],
        a[2, 0] * x[0] + a[2, 1] * x[1] + a[2, 2] * x[2],
    )


@njit(inline="always")
def _put(into, x) -> None:
    """Put a triple into (D,)."""
    into[0], into[1], into[2] = x[0], x[1], x[2]


@njit(inline="always")
def _pulls(c, number: int) -> tuple[float, float, float]:
    """Pull of all lines at the end of a frame (D,), as far as its kicks and forces are known."""
    pull, direction = c.block.pull, c.lines.direction
    x, y, z = pull[0, number], pull[1, number], pull[2, number]
    for place in range(1, c.block.touching[0] + 1):
        line = c.block.touching[place]
        e = end_at(c.lines.end[line])
        more = e.block.row[_within(c, e, line, number)[1]]
        x += direction[line, 0] * more
        y += direction[line, 1] * more
        z += direction[line, 2] * more
    return x, y, z


@njit(fastmath=FAST, **INNER)
def _frame(coupling: int, scratch: int, number: int, begin: int) -> int:
    """Frame `number` of the block, which begins with frame `begin` of the call."""
    c = coupling_at(coupling)
    small, per_frame = c.block.small, 1.0 / c.frame
    bridge, goes = c.bridge, c.body.ahead.goes
    beta, speed, rest, momentum = _triple(bridge.beta), _triple(bridge.speed), _triple(bridge.rest), _triple(bridge.momentum)
    gone, held = (goes[0, number], goes[1, number], goes[2, number]), bridge.held[0]
    there = (gone[0] - beta[0], gone[1] - beta[1], gone[2] - beta[2])
    pull, stays, left = _pulls(c, number), _times(c.load.moving, speed), _times(c.load.rest_mass, rest)
    stiff, twice = _times(c.load.tension, beta), 1.0 + KEPT_BY_THE_REST
    force = (
        (momentum[0] - pull[0] + stays[0] + twice * left[0]) * per_frame - stiff[0] - held[0],
        (momentum[1] - pull[1] + stays[1] + twice * left[1]) * per_frame - stiff[1] - held[1],
        (momentum[2] - pull[2] + stays[2] + twice * left[2]) * per_frame - stiff[2] - held[2],
    )
    moved, pushed = _times(c.load.inverse, there), _times(c.load.answer, force)
    v = (
        (moved[0] + pushed[0]) * per_frame,
        (moved[1] + pushed[1]) * per_frame,
        (moved[2] + pushed[2]) * per_frame,
    )
    contact = (0.0, 0.0, 0.0)
    status = int(np.int64(0))
    _put(small[FORCE], force)
    if c.block.touching[0] > 0:
        _put(small[V_FREE], v)
        status = _bridge_speed(coupling, scratch, number, begin)
        v, contact = _triple(small[V]), _triple(small[FROM_CONTACTS])
    else:
        _put(small[V], v)
        _put(small[FROM_CONTACTS], contact)
    against = _times(c.load.drag, v)
    total = (
        force[0] + contact[0] - against[0],
        force[1] + contact[1] - against[1],
        force[2] + contact[2] - against[2],
    )
    push_body(c.body, number, total)
    _settle(coupling, c, number, v, speed, rest)
    given = _times(c.body.gamma, total)
    _put(c.bridge.beta, (gone[0] + given[0], gone[1] + given[1], gone[2] + given[2]))
    return status


@njit(inline="always")
def _settle(coupling: int, c, number: int, v, before, rest) -> None:
    """The bridge's speed v of this frame, `before` in the one before, acts on lines, pulls and modes left out, `rest`."""
    small, kicks = c.block.small, c.block.kicks
    turn = (v[0] - before[0], v[1] - before[1], v[2] - before[2])
    kicks[0, number], kicks[1, number], kicks[2, number] = turn
    _put(small[TURN], turn)
    keeps, twice = KEPT_BY_THE_REST, 1.0 + KEPT_BY_THE_REST
    _put(c.bridge.rest, (twice * v[0] - keeps * rest[0], twice * v[1] - keeps * rest[1], twice * v[2] - keeps * rest[2]))
    for i in range(COMPONENTS):
        own = c.load.own[APART, i]
        add_late_of_three(c.block.pull[i], own[0], own[1], own[2], number, turn)
    for place in range(1, c.block.touching[0] + 1):
        line = c.block.touching[place]
        end = c.lines.end[line]
        e = end_at(end)
        within = _within(c, e, line, number)[1]
        of_line = along(c, line, small[TURN])
        back = _looks_back(c, line)
        steps = steps_of(c, e, line)
        settle_line(c.lines.model[line], c.lines.state[line], end, within, steps, of_line, back)
        if e.block.known[CULLING] != NEVER:
            spend_left(coupling, line, within * steps, of_line, along(c, line, small[V]))
        if e.counts[KIND] >= SINGLE and back:
            keep_gaps(c.lines.state[line], end, (within + 1) * steps - 1)
    pull, share = _pulls(c, number), _times(c.load.share, v)
    _put(c.bridge.momentum, (pull[0] + share[0], pull[1] + share[1], pull[2] + share[2]))
    _put(c.bridge.speed, v)
    c.counts[FRAMES] += 1


@njit(**INNER)
def _bridge_speed(coupling: int, scratch: int, number: int, begin: int) -> int:
    """The frame's V and the contacts' force on the bridge into Coupling.block.small, all lines' forces too: status of `lcp`.

    Newton's method from V without contacts on V − V_free − W J(V)/H = 0. While the same contacts press in the same steps the
    equation is linear, and lines are not solved again (`follow_line`): where they do so twice in a row, V is its root.
    """
    c = coupling_at(coupling)
    d, small = COMPONENTS, c.block.small
    v, contact, missing, turns = small[V], small[FROM_CONTACTS], small[MISSING], small[TURN]
    for i in range(d):
        v[i] = small[V_FREE, i]
    for iteration in range(MOST_ITERATIONS):
        status = int(np.int64(0))
        acts, same = False, iteration > 0
        for i in range(d):
            turns[i] = v[i] - c.bridge.speed[i]
            contact[i] = 0.0
            for k in range(d):
                c.block.jacobian[i, k] = 0.0
        for place in range(1, c.block.touching[0] + 1):
            line = c.block.touching[place]
            end = c.lines.end[line]
            e = end_at(end)
            if e.counts[KIND] >= SINGLE:
                turn, steps, taken = along(c, line, turns), c.lines.steps[line], steps_of(c, e, line)
                first, at = _within(c, e, line, number)[1] * taken, (begin + number) * steps
                if rubs(coupling, line):
                    e.block.known[LINEAR] = 0
                    force, slope, cross, mine, bad = answer_of_rubbed(
                        c.lines.model[line], c.lines.state[line], end, c.lines.end[line - 1], c.lines.friction[line],
                        scratch, first, steps, turn,
                    )  # fmt: skip
                    for i in range(d):
                        for k in range(d):
                            c.block.jacobian[i, k] += c.lines.direction[line, i] * c.lines.direction[line - 1, k] * cross
                elif iteration > 0 and follow_line(c.lines.model[line], c.lines.state[line], end, first, taken, turn):
                    force, slope = e.block.answer[PUSHED], e.block.answer[STEEPNESS]
                    mine, bad = e.block.known[PATTERN], SOLVED
                else:
                    if e.counts[BY_FRAMES]:
                        force, slope = answer_by_frames(
                            c.lines.model[line], c.lines.state[line], end, first, at, steps, c.frame, turn
                        )
                        mine, bad = 0, SOLVED
                    else:
                        force, slope, mine, bad = answer_of_line(
                            c.lines.model[line], c.lines.state[line], end, scratch, first, at, steps, turn
                        )
                    e.block.answer[TURNED], e.block.answer[PUSHED], e.block.answer[STEEPNESS] = turn, force, slope
                status = max(status, bad)
                same = same and mine == e.block.known[PATTERN]
                e.block.known[PATTERN] = mine
                if force != 0.0 or slope != 0.0:
                    acts = True
                    for i in range(d):
                        contact[i] += c.lines.direction[line, i] * force
                        for k in range(d):
                            c.block.jacobian[i, k] += c.lines.direction[line, i] * c.lines.direction[line, k] * slope
        if not acts and iteration == 0:
            return status
        c.counts[ITERATIONS] += 1
        far, size = 0.0, 0.0
        for i in range(d):
            pushed = 0.0
            for k in range(d):
                pushed += c.load.answer[i, k] * contact[k] / c.frame
            missing[i] = v[i] - small[V_FREE, i] - pushed
            far = max(far, abs(missing[i]))
            size = max(size, abs(v[i]), abs(small[V_FREE, i]), abs(pushed))
        if far <= CLOSE * size or (same and far <= SAME * size):
            c.counts[TOUCHED] += 1
            return status
        # I − W J′/H
        for i in range(d):
            for k in range(d):
                total = 1.0 if i == k else 0.0
                for r in range(d):
                    total -= c.load.answer[i, r] * c.block.jacobian[r, k] / c.frame
                c.block.newton[i, k] = total
        invert(c.block.newton, c.block.jacobian)
        for i in range(d):
            for k in range(d):
                v[i] -= c.block.jacobian[i, k] * missing[k]
    c.counts[TOUCHED] += 1
    c.counts[HELD_FRAMES] += 1
    for line in range(c.lines.end.size):
        e = end_at(c.lines.end[line])
        if e.counts[KIND] >= SINGLE:
            fill_those(c.lines.model[line], c.lines.state[line], scratch, e.block.near, e.counts[NEAR])
    return hold_forces(coupling, number, begin, small[V_FREE], v, contact)
