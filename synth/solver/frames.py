"""Coupled strings through time, a frame of the bridge after the other: see `coupling`.

In a block of K frames the lines that touch nothing pass over their modes once, as in free flight, and so do those that are
certain to stay clear of their contacts for the block; those whose contacts or finger are looked at take r passes of K
steps, r a line's own, without the contacts that are out of reach (`line_culling`). A pass gives what the modes would do if
the bridge kept its speed; what each frame's kicks and forces do beside that are sums over a few numbers. So a frame is
decided on D numbers:

    Δβ = (I + ΓA/H)⁻¹ (β_free − β + Γ (F₀ + J(V))),

F₀ the force on the bridge at V = 0 without contacts, J that of the contacts, which take the bridge to move at V. Newton's
method finds V; whatever root it finds loses no more energy than the losses take and gains none. Where it finds none, the
contacts of that frame hold one force each (`held_forces`), and the problem has one root.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.coupling import (
    AHEAD,
    APART,
    APART_MODES,
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
    look_at,
)
from synth.solver.due_responses import fill_those
from synth.solver.held_forces import hold_forces
from synth.solver.lanes import BLOCK, add_late, kick, kick_v, padded, project_v
from synth.solver.lcp import SOLVED
from synth.solver.line_certificates import is_clear, look_everywhere, runs_out, spend
from synth.solver.line_culling import cull, may_cull, spend_left
from synth.solver.line_forces import (
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
from synth.solver.stepwise import fly
from synth.solver.stringmodel import string_model, string_state
from synth.solver.vectors import FAST, INNER, add, dot, put

#: iterations after which the forces are held, and how near to a root they end, of the terms of the equation
MOST_ITERATIONS = 24
CLOSE = 4e-15
#: how near the root of a linear equation is after one iteration: less near, it was not the same equation
SAME = 1e-10
#: rows of Coupling.small
FREE, FORCE, V, FROM_CONTACTS, MISSING, V_FREE, PULL, TURN = range(8)


@njit(cache=True, nogil=True)
def advance_frames(coupling: int, scratch: int, frames: int, out) -> int:
    """Take an instrument through `frames` frames; out (channels, ≥ frames) gets what its body radiates. A status of `lcp`.

    Lines whose End.counts say so are looked at, and others that have contacts as soon as their certificate is used up; a
    finger that is on goes along its End.path. What the bridge sees of its lines must be as they are (`gather_lines`).
    """
    status = int(np.int64(0))
    blocks = frames // BLOCK
    for t in range(blocks):
        _look_apart(coupling, t > 0)
        status = max(status, _certain_block(coupling, scratch, int(np.int64(BLOCK)), t * BLOCK, out))
    if blocks > 0:
        _leave_apart(coupling)
    for t in range(blocks * BLOCK, frames):
        _look_apart(coupling, False)
        status = max(status, _certain_block(coupling, scratch, int(np.int64(1)), t, out))
        _step_apart(coupling)
    return status


@njit(**INNER)
def _certain_block(coupling: int, scratch: int, frames: int, at: int, out) -> int:
    """`_block`, again where a line that was not looked at might have touched something."""
    c = coupling_at(coupling)
    uncertain = False
    for line in range(c.line_end.size):
        e = end_at(c.line_end[line])
        e.counts[KIND] = FAR
        if e.counts[ENGAGED]:
            if rubs(coupling, line):
                clear = end_at(c.line_end[line - 1]).counts[KIND] < SINGLE
            else:
                clear = string_state(c.line_state[line]).finger[0].on == 0 and is_clear(coupling, line, scratch)
            e.counts[KIND] = CLEAR if clear else SEVERAL
            if string_model(c.line_model[line]).shapes.shape[0] >= c.culled_from and runs_out(coupling, line, frames):
                look_everywhere(c.line_end[line])
        e.known[CULLING] = LONG if e.counts[KIND] == SEVERAL and may_cull(coupling, line) else NEVER
        uncertain = uncertain or e.counts[KIND] == CLEAR or e.counts[CERTIFIED] > 0 or e.known[CULLING] != NEVER
    if uncertain:
        _keep(coupling)
    status = int(np.int64(0))
    again = True
    while again:
        status = _block(coupling, scratch, frames, at, out)
        again = False
        for line in range(c.line_end.size):
            known = end_at(c.line_end[line]).known
            if known[CULLING] != NEVER and known[LASTS] == USED_UP:
                known[CULLING] -= 1
                again = True
            if c.friction[line] > 0.0:
                if rubs(coupling, line) and end_at(c.line_end[line - 1]).counts[KIND] >= SINGLE:
                    look_at(coupling, line, int(np.int64(1)))
                    end_at(c.line_end[line]).counts[KIND] = SEVERAL
            elif string_model(c.line_model[line]).shapes.shape[0] > 0 and not spend(coupling, line, frames):
                if end_at(c.line_end[line]).counts[ENGAGED] == 0:
                    look_at(coupling, line, int(np.int64(1)))
                look_everywhere(c.line_end[line])
                again = True
        if again:
            _take_back(coupling)
            gather_lines(coupling)
            _sum_apart(coupling)
    return status


@njit(**INNER)
def _keep(coupling: int) -> None:
    """What a block changes, as it begins."""
    c = coupling_at(coupling)
    put(c.kept_body[0], c.p)
    put(c.kept_body[1], c.p_speed)
    put(c.kept[0], c.speed)
    put(c.kept[1], c.beta)
    put(c.kept[2], c.rest)
    put(c.kept[3], c.momentum)
    for line in range(c.line_end.size):
        e, s = end_at(c.line_end[line]), string_state(c.line_state[line])
        e.counts[KEPT] = e.counts[ENGAGED]
        if e.counts[KEPT]:
            n = string_model(c.line_model[line]).modes
            put(e.kept[0], s.q[:n])
            put(e.kept[1], s.v[:n])
            contacts = e.leverage.size
            put(e.kept_contacts, s.force[:contacts])
            e.kept_contacts[contacts] = s.finger[0].here
            e.kept_contacts[contacts + 1] = s.finger[0].push


@njit(**INNER)
def _take_back(coupling: int) -> None:
    """All as the block began."""
    c = coupling_at(coupling)
    put(c.p, c.kept_body[0])
    put(c.p_speed, c.kept_body[1])
    put(c.speed, c.kept[0])
    put(c.beta, c.kept[1])
    put(c.rest, c.kept[2])
    put(c.momentum, c.kept[3])
    for line in range(c.line_end.size):
        e, s = end_at(c.line_end[line]), string_state(c.line_state[line])
        if e.counts[KEPT]:
            n = string_model(c.line_model[line]).modes
            put(s.q, e.kept[0, :n])
            put(s.v, e.kept[1, :n])
            contacts = e.leverage.size
            put(s.force, e.kept_contacts[:contacts])
            s.finger[0].here = e.kept_contacts[contacts]
            s.finger[0].push = e.kept_contacts[contacts + 1]


@njit(**INNER)
def _kicks_of(c, line: int, kicks) -> None:
    """kicks (K,) of a line's end from those of the bridge."""
    for k in range(BLOCK):
        total = 0.0
        for i in range(c.beta.size):
            total += c.direction[line, i] * c.kicks[i, k]
        kicks[k] = total


@njit(**INNER)
def _look_apart(coupling: int, kicked: bool) -> None:
    """The free pull over K frames of the lines that are not looked at, where kicked after those of the block before."""
    c = coupling_at(coupling)
    for line in range(c.line_end.size):
        e, s = end_at(c.line_end[line]), string_state(c.line_state[line])
        if e.counts[ENGAGED]:
            continue
        n = padded(e.counts[APART_MODES])
        if kicked:
            _kicks_of(c, line, e.kicks)
            kick_v(n, e.flight, s.q, s.v, e.kick, e.kicks, e.pull, e.row)
        else:
            project_v(n, e.flight, s.q, s.v, e.pull, e.row)
    _sum_apart(coupling)


@njit(**INNER)
def _sum_apart(coupling: int) -> None:
    """Coupling.pull of the lines that are not looked at, from the rows of each."""
    c = coupling_at(coupling)
    for i in range(c.beta.size):
        for k in range(BLOCK):
            c.pull[i, k] = 0.0
    for line in range(c.line_end.size):
        e = end_at(c.line_end[line])
        if not e.counts[ENGAGED]:
            for i in range(c.beta.size):
                add(c.direction[line, i], e.row, c.pull[i])


@njit(**INNER)
def _leave_apart(coupling: int) -> None:
    """The lines that are not looked at go through the K frames of the last block."""
    c = coupling_at(coupling)
    for line in range(c.line_end.size):
        e, s = end_at(c.line_end[line]), string_state(c.line_state[line])
        if not e.counts[ENGAGED]:
            _kicks_of(c, line, e.kicks)
            kick(padded(e.counts[APART_MODES]), e.flight, s.q, s.v, e.kick, e.kicks)


@njit(**INNER)
def _step_apart(coupling: int) -> None:
    """The same for one frame."""
    c = coupling_at(coupling)
    for line in range(c.line_end.size):
        e, s = end_at(c.line_end[line]), string_state(c.line_state[line])
        if not e.counts[ENGAGED]:
            n = e.counts[APART_MODES]
            q, v = s.q[:n], s.v[:n]
            for i in range(c.beta.size):
                add(c.direction[line, i] * c.kicks[i, 0], e.kick[:n], v)
            fly(e.flight, q, v)


@njit(inline="always")
def _within(c, e, line: int, number: int) -> tuple[int, int]:
    """(frames that a line goes before it is driven, which of them this frame of the block is)."""
    frames = BLOCK if e.counts[KIND] == CLEAR else BLOCK // c.steps[line]
    return frames, number & (frames - 1)


@njit(**INNER)
def _block(coupling: int, scratch: int, frames: int, at: int, out) -> int:
    """K frames, or one, from number `at` of the call on. A line that is looked at takes K steps of its own at a time."""
    c = coupling_at(coupling)
    status = int(np.int64(0))
    touching = int(np.int64(0))
    for line in range(c.line_end.size):
        e = end_at(c.line_end[line])
        e.pushed[0] = e.pushed[1] = 0.0
        e.known[AHEAD] = 0
        if e.counts[KIND] != FAR:
            touching += 1
            c.touching[touching] = line
    c.touching[0] = touching
    for number in range(frames):
        for place in range(1, touching + 1):
            line = c.touching[place]
            end = c.line_end[line]
            e = end_at(end)
            if _within(c, e, line, number)[1] == 0:
                if e.counts[KIND] == CLEAR:
                    coast_line(c.line_model[line], c.line_state[line], end)
                else:
                    if c.friction[line] > 0.0:
                        rub_where_pressed(coupling, line, end_at(c.line_end[line - 1]).counts[KIND] >= SINGLE)
                    if _looks_back(c, line):
                        note_gaps(coupling, line)
                    if e.known[CULLING] != NEVER and (number == 0 or e.known[LASTS] == 0):
                        cull(coupling, line, scratch, (frames - number) * c.steps[line])
                    if e.known[LASTS] > 0:
                        e.known[LASTS] -= BLOCK if frames > 1 else e.known[LASTS]
                    speed, height = along(c, line, c.speed), along(c, line, c.beta)
                    look_at_line(c.line_model[line], c.line_state[line], end, c.steps[line], speed, height)
        status = max(status, _frame(coupling, scratch, number, at, out))
        for place in range(1, touching + 1):
            line = c.touching[place]
            end = c.line_end[line]
            e = end_at(end)
            every, within = _within(c, e, line, number)
            if within == every - 1:
                drive_line(c.line_model[line], c.line_state[line], end, c.steps[line], number + 1 < frames)
            elif frames == 1:
                step_line(c.line_model[line], c.line_state[line], end, c.steps[line])
    return status


@njit(inline="always")
def _looks_back(c, line: int) -> bool:
    """Whether what contacts do in a step hangs on where they were before: those that rub, and soft ones."""
    return c.friction[line] > 0.0 or string_model(c.line_model[line]).layers.shape[1] > 0


@njit(inline="always")
def _pulls(c, number: int, out) -> None:
    """out (D,): pull of all lines at the end of a frame, as far as its kicks and forces are known."""
    for i in range(c.beta.size):
        out[i] = c.pull[i, number]
    for place in range(1, c.touching[0] + 1):
        line = c.touching[place]
        e = end_at(c.line_end[line])
        pull = e.row[_within(c, e, line, number)[1]]
        for i in range(c.beta.size):
            out[i] += c.direction[line, i] * pull


@njit(fastmath=FAST, **INNER)
def _frame(coupling: int, scratch: int, number: int, begin: int, out) -> int:
    """Frame `number` of the block, out[:, begin + number]."""
    c = coupling_at(coupling)
    d, frame, modes = c.beta.size, c.frame, c.p.size
    small, free, body, force = c.small, c.body_free, c.body, c.body_free[2]
    for j in range(modes):
        free[0, j] = body[0, j] * c.p[j] + body[1, j] * c.p_speed[j]
        free[1, j] = body[2, j] * c.p[j] + body[3, j] * c.p_speed[j]
    per_frame = 1.0 / frame
    _pulls(c, number, small[PULL])
    for i in range(d):
        total = c.momentum[i] - small[PULL, i]
        for k in range(d):
            total += (c.own[0, i, k, BLOCK] + c.own[1, i, k, BLOCK]) * c.speed[k]
            total += (1.0 + KEPT_BY_THE_REST) * c.rest_mass[i, k] * c.rest[k]
        total *= per_frame
        for k in range(d):
            total -= c.tension[i, k] * c.beta[k]
        small[FORCE, i] = total - c.held[i]
        small[FREE, i] = dot(c.shape[i], free[0]) - c.beta[i]
    for i in range(d):
        total = 0.0
        for k in range(d):
            total += c.inverse[i, k] * small[FREE, k] + c.answer[i, k] * small[FORCE, k]
        small[V_FREE, i] = total * per_frame
    status = _bridge_speed(coupling, scratch, number, begin)
    for j in range(modes):
        force[j] = 0.0
    for i in range(d):
        total = small[FORCE, i] + small[FROM_CONTACTS, i]
        for k in range(d):
            total -= c.drag[i, k] * small[V, k]
        add(total, c.shape[i], force)
    for j in range(modes):
        p_speed = free[1, j] + body[5, j] * force[j]
        c.p[j] = free[0, j] + body[4, j] * force[j]
        free[1, j] = (p_speed - c.p_speed[j]) * per_frame
        c.p_speed[j] = p_speed
    for channel in range(out.shape[0]):
        out[channel, begin + number] = dot(c.radiation[channel], free[1])
    _settle(coupling, number)
    for i in range(d):
        c.beta[i] = dot(c.shape[i], c.p)
    return status


@njit(**INNER)
def _settle(coupling: int, number: int) -> None:
    """The bridge's speed of this frame acts on lines, pulls and the modes left out."""
    c = coupling_at(coupling)
    d, small = c.beta.size, c.small
    for i in range(d):
        turn = small[V, i] - c.speed[i]
        c.kicks[i, number] = turn
        small[TURN, i] = turn
        c.rest[i] = (1.0 + KEPT_BY_THE_REST) * small[V, i] - KEPT_BY_THE_REST * c.rest[i]
    for i in range(d):
        for k in range(d):
            add_late(c.pull[i], c.own[APART, i, k], number, small[TURN, k])
    for place in range(1, c.touching[0] + 1):
        line = c.touching[place]
        end = c.line_end[line]
        e = end_at(end)
        within = _within(c, e, line, number)[1]
        back = _looks_back(c, line)
        turn = along(c, line, small[TURN])
        settle_line(c.line_model[line], c.line_state[line], end, within, c.steps[line], turn, back)
        if e.known[CULLING] != NEVER:
            spend_left(coupling, line, within * c.steps[line], turn, along(c, line, small[V]))
        if e.counts[KIND] >= SINGLE and back:
            keep_gaps(c.line_state[line], end, (within + 1) * c.steps[line] - 1)
    _pulls(c, number, c.momentum)
    for i in range(d):
        for k in range(d):
            c.momentum[i] += c.share[i, k] * small[V, k]
    for i in range(d):
        c.speed[i] = small[V, i]
    c.counts[FRAMES] += 1


@njit(**INNER)
def _bridge_speed(coupling: int, scratch: int, number: int, begin: int) -> int:
    """The frame's V and the contacts' force on the bridge into Coupling.small, all lines' forces with it; status of `lcp`.

    Newton's method from V without contacts on V − V_free − W J(V)/H = 0. While the same contacts press in the same steps the
    equation is linear, and lines are not solved again (`follow_line`): where they do so twice in a row, V is its root.
    """
    c = coupling_at(coupling)
    d, small = c.beta.size, c.small
    v, contact, missing, turns = small[V], small[FROM_CONTACTS], small[MISSING], small[TURN]
    for i in range(d):
        v[i] = small[V_FREE, i]
    for iteration in range(MOST_ITERATIONS):
        status = int(np.int64(0))
        acts, same = False, iteration > 0
        for i in range(d):
            turns[i] = v[i] - c.speed[i]
            contact[i] = 0.0
            for k in range(d):
                c.jacobian[i, k] = 0.0
        for place in range(1, c.touching[0] + 1):
            line = c.touching[place]
            end = c.line_end[line]
            e = end_at(end)
            if e.counts[KIND] >= SINGLE:
                turn, steps = along(c, line, turns), c.steps[line]
                first, at = _within(c, e, line, number)[1] * steps, (begin + number) * steps
                if rubs(coupling, line):
                    e.known[LINEAR] = 0
                    force, slope, cross, mine, bad = answer_of_rubbed(
                        c.line_model[line], c.line_state[line], end, c.line_end[line - 1], c.friction[line], scratch, first,
                        steps, turn,
                    )  # fmt: skip
                    for i in range(d):
                        for k in range(d):
                            c.jacobian[i, k] += c.direction[line, i] * c.direction[line - 1, k] * cross
                elif iteration > 0 and follow_line(c.line_model[line], c.line_state[line], end, first, steps, turn):
                    force, slope, mine, bad = e.answer[PUSHED], e.answer[STEEPNESS], e.known[PATTERN], SOLVED
                else:
                    force, slope, mine, bad = answer_of_line(
                        c.line_model[line], c.line_state[line], end, scratch, first, at, steps, turn
                    )
                    e.answer[TURNED], e.answer[PUSHED], e.answer[STEEPNESS] = turn, force, slope
                status = max(status, bad)
                same = same and mine == e.known[PATTERN]
                e.known[PATTERN] = mine
                if force != 0.0 or slope != 0.0:
                    acts = True
                    for i in range(d):
                        contact[i] += c.direction[line, i] * force
                        for k in range(d):
                            c.jacobian[i, k] += c.direction[line, i] * c.direction[line, k] * slope
        if not acts and iteration == 0:
            return status
        c.counts[ITERATIONS] += 1
        far, size = 0.0, 0.0
        for i in range(d):
            pushed = 0.0
            for k in range(d):
                pushed += c.answer[i, k] * contact[k] / c.frame
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
                    total -= c.answer[i, r] * c.jacobian[r, k] / c.frame
                c.newton[i, k] = total
        if d == 1:
            v[0] -= missing[0] / c.newton[0, 0]
            continue
        invert(c.newton, c.jacobian)
        for i in range(d):
            for k in range(d):
                v[i] -= c.jacobian[i, k] * missing[k]
    c.counts[TOUCHED] += 1
    c.counts[HELD_FRAMES] += 1
    for line in range(c.line_end.size):
        e = end_at(c.line_end[line])
        if e.counts[KIND] >= SINGLE:
            fill_those(c.line_model[line], c.line_state[line], scratch, e.near, e.counts[NEAR])
    return hold_forces(coupling, number, begin, small[V_FREE], v, contact)
