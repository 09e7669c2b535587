"""Contacts and finger of one line over the steps of a frame, in which its end moves at a given speed: forces, and how they
change with that speed. See `coupling` and `frames`.

As in `blocks` and `fingers` every row (a contact looked at, the finger) is what free flight makes of it plus sums over the
forces; here it also has the kicks at the start of each frame, and ξ times the motion of the end.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import ADV11, ADV21, BLOCK, P21
from synth.solver.blocks import look
from synth.solver.coupling import (
    AHEAD,
    BY_FRAMES,
    CLEAR,
    CULLING,
    FEW,
    FINGER_LEVERAGE,
    KIND,
    LINEAR,
    LOOKED_AT,
    NEAR,
    NEVER,
    OF_SETS,
    PUSHED,
    SEVERAL,
    SINGLE,
    STEEPNESS,
    TURNED,
    end_at,
    moving_modes,
)
from synth.solver.due_responses import fill_due
from synth.solver.few_contacts import answer_of_few, note_matrix
from synth.solver.lanes import (
    add_late,
    coast,
    drive,
    drive_kicked,
    drive_listed,
    drive_listed_and_one,
    drive_listed_and_one_kicked,
    drive_listed_kicked,
    drive_q,
    grip_sequence,
    kick,
    padded,
    project_q,
    project_qq,
    project_qv,
    project_v,
)
from synth.solver.laws import EXACT_HOLD
from synth.solver.lcp import SOLVED, factorise, pivot, substitute
from synth.solver.line_layers import answer_of_soft_line
from synth.solver.line_rows import LEAST_PIVOT, MIX, act_on_rows, begin_rows, push_of_finger
from synth.solver.line_tables import fill_contacts_looked_at
from synth.solver.stepwise import finger_blend, finger_target, fly, push_modes
from synth.solver.stringmodel import scratch_of, string_model, string_state
from synth.solver.vectors import FAST, INNER, add, dot

#: steps of a frame from which on a line's pull is worked out for the ends of frames alone: there are two at most in a pass
_PULLED_BY_FRAMES = 4


@njit(**INNER)
def look_at_line(
    model: int, state: int, end: int, scratch: int, steps: int, dt: float, speed: float, height: float
) -> None:  # fmt: skip
    """The free rows of a line's contacts, finger and pull over K steps of dt [s] from its state, and the matrix of its
    contacts. Tables of contacts that are looked at for the first time are filled, in Scratch.modes.q and v.

    speed, height: of the end [m/s, m], as if it went on so.
    """
    m, s, e = string_model(model), string_state(state), end_at(end)
    rows, n, contacts = _rows_of(m, e), _moving(m, e), m.contacts.size
    several, culled = int(np.int64(0)), e.block.known[CULLING] != NEVER
    for c in range(contacts):
        if e.certificate.clearance[c] <= 0.0 and not (culled and e.block.left[c] > 0.0):
            e.block.near[several] = c
            several += 1
        else:
            s.force[c] = 0.0
    e.counts[NEAR] = several
    fill_contacts_looked_at(model, state, end, steps, scratch)
    finger = s.finger[0]
    e.counts[KIND] = SINGLE if several == 1 and finger.on == 0 and m.contacts.layers.shape[1] == 0 else SEVERAL
    look(n, rows, m.contacts.shapes, s.q, s.v, 0, e.block.near, several // 2 * 2, e.block.u)
    touch, last = s.grip.weights[:n], several - 1
    finger_too = finger.on != 0 and e.block.known[AHEAD] == 0
    e.block.known[AHEAD] = 0
    by_steps = steps < _PULLED_BY_FRAMES
    if not by_steps:
        for frame in range(BLOCK // steps):
            early = steps * (frame + 1) < BLOCK
            e.block.row[frame] = _pull_after(n, e.pull, e.flight[P21:ADV11] if early else rows[ADV21:], s.q, s.v)
    if several % 2 == 1:
        shape = m.contacts.shapes[e.block.near[last]]
        if by_steps:
            project_qv(n, rows, s.q, s.v, shape, e.pull, e.block.u[last], e.block.row)
            if finger_too:
                project_q(n, rows, s.q, s.v, touch, e.block.u[contacts])
        elif finger_too:
            project_qq(n, rows, s.q, s.v, shape, touch, e.block.u[last], e.block.u[contacts])
        else:
            project_q(n, rows, s.q, s.v, shape, e.block.u[last])
    elif finger_too and by_steps:
        project_qv(n, rows, s.q, s.v, touch, e.pull, e.block.u[contacts], e.block.row)
    elif finger_too:
        project_q(n, rows, s.q, s.v, touch, e.block.u[contacts])
    elif by_steps:
        project_v(n, rows, s.q, s.v, e.pull, e.block.row)
    if finger.on:
        _add_way(e.numbers[FINGER_LEVERAGE], 0.0, dt, speed, height, e.block.u[contacts], e.block.forces[contacts])
    for i in range(several):
        c = e.block.near[i]
        _add_way(e.leverage[c], s.eta[c], dt, speed, height, e.block.u[i], e.block.forces[i])
    if by_steps:
        for frame in range(BLOCK // steps):
            e.block.row[frame] = e.block.row[(frame + 1) * steps - 1]
    for k in range(BLOCK):
        e.block.kicks[k] = 0.0
    if e.counts[KIND] == SINGLE:
        return
    note_matrix(model, end)
    if finger.on:
        e.block.known[OF_SETS] = 0  # which have tables without a finger only
        matrix = e.block.matrix[: several * several].reshape(several, several)
        _, compliance = finger_blend(EXACT_HOLD, m.dt, finger.stiffness, finger.resistance)
        total = s.grip.own[0, BLOCK] + compliance
        for i in range(several):
            for d in range(several):
                matrix[i, d] -= s.grip.contacts[e.block.near[i], BLOCK] * s.grip.contacts[e.block.near[d], BLOCK] / total


@njit(inline="always")
def _rows_of(m, e):
    """Coefficient rows of a line that is looked at: of a step, or of a frame where it goes by frames."""
    return e.flight if e.counts[BY_FRAMES] else m.rows


@njit(inline="always")
def _moving(m, e) -> int:
    """How many modes of it move, in whole vectors: all, or those that are heard where it goes by frames."""
    return padded(moving_modes(m, e))


@njit(fastmath=FAST, **INNER)
def _pull_after(n: int, pull, rows, q, v) -> float:
    """Pull of modes once they have flown as the two rows say that begin `rows` (·, ≥n), of velocities."""
    total = 0.0
    for j in range(n):
        total += pull[j] * (rows[0, j] * q[j] + rows[1, j] * v[j])
    return total


@njit(inline="always")
def _add_way(leverage: float, eta: float, dt: float, speed: float, height: float, row, forces) -> None:
    """To a row of displacements what its end does, less the height of what is there; no forces yet."""
    for k in range(BLOCK):
        row[k] += leverage * (height + speed * (dt * (k + 1))) - eta
        forces[k] = 0.0


@njit(**INNER)
def coast_line(model: int, state: int, end: int) -> None:
    """The free pull of a line that is clear of all contacts over K frames."""
    m, s, e = string_model(model), string_state(state), end_at(end)
    project_v(padded(m.modes), e.flight, s.q, s.v, e.pull, e.block.row)
    for k in range(BLOCK):
        e.block.kicks[k] = 0.0
    for c in range(s.force.size):
        s.force[c] = 0.0


@njit(inline="always")
def answer_of_line(
    model: int, state: int, end: int, scratch: int, first: int, at: int, steps: int, turn: float
) -> tuple[float, float, int, int]:
    """Forces of a frame's `steps` steps, number `first` of the block on: (mean force on the bridge, its slope, a number that
    says which contacts press in which steps, status).

    turn: what the end's speed changes by at the start [m/s]; at: number of the frame's first step along End.path. The slope
    is that of the force by the speed, with the contacts that press as they are.
    """
    e = end_at(end)
    e.block.known[LINEAR] = 1
    if e.counts[KIND] == SINGLE:
        force, slope, pattern = _one_contact(model, state, scratch, e, first, steps, turn)
        return force, slope, pattern, SOLVED
    if string_model(model).contacts.layers.shape[1] > 0:
        e.block.known[LINEAR] = 0
        return answer_of_soft_line(model, state, end, scratch, first, at, steps, turn)
    fingered = string_state(state).finger[0].on != 0
    if e.counts[NEAR] == 0 and steps == BLOCK and fingered:
        force, slope = _finger_alone(model, state, end, scratch, at, turn)
        return force, slope, 0, SOLVED
    if 1 < e.counts[NEAR] <= FEW and not fingered:
        force, slope, pattern, status = answer_of_few(model, state, end, scratch, first, steps, turn)
        if status == SOLVED:
            return force, slope, pattern, status
    return _contacts_and_finger(model, state, end, scratch, first, at, steps, turn)


@njit(**INNER)
def follow_line(model: int, state: int, end: int, first: int, steps: int, turn: float) -> bool:
    """What `answer_of_line` gave last, at another `turn`; whether that is its answer: the same contacts press, no others."""
    e = end_at(end)
    if e.block.known[LINEAR] == 0:
        return False
    more = turn - e.block.answer[TURNED]
    holds = True
    for i in range(e.counts[NEAR]):
        for t in range(first, first + steps):
            e.block.forces[i, t] += more * e.block.slopes[i, t]
            e.block.apart[i, t] += more * e.block.opening[i, t]
            holds = holds and e.block.forces[i, t] >= 0.0 and e.block.apart[i, t] >= 0.0
    if not holds:
        return False
    if string_state(state).finger[0].on != 0:
        finger = string_model(model).contacts.size
        for t in range(first, first + steps):
            e.block.forces[finger, t] += more * e.block.slopes[finger, t]
    e.block.answer[TURNED] = turn
    e.block.answer[PUSHED] += more * e.block.answer[STEEPNESS]
    return True


@njit(inline="always")
def _one_contact(model: int, state: int, scratch: int, e, first: int, steps: int, turn: float):
    c = e.block.near[0]
    lags, moved, reach = string_model(model).contacts.lags[c, c], e.responses.moved[c], e.responses.reach[c]
    stiffness = 1.0 / lags[BLOCK]
    rows = e.block
    u, forces, slopes, apart, opening = rows.u[0], rows.forces[0], rows.slopes[0], rows.apart[0], rows.opening[0]
    force, slope, pattern = 0.0, 0.0, 0
    for t in range(steps):
        gap, change = u[first + t] + moved[BLOCK + t] * turn, moved[BLOCK + t]
        if pattern:
            for i in range(t):
                gap += lags[BLOCK + t - i] * forces[first + i]
                change += lags[BLOCK + t - i] * slopes[first + i]
        if gap < 0.0:
            if string_state(state).due[c]:
                fill_due(model, state, scratch, c)
            pressed, steeper = -gap * stiffness, -change * stiffness
            pattern |= 1 << t
            force += reach[t] * pressed
            slope += reach[t] * steeper
            forces[first + t], slopes[first + t] = pressed, steeper
            apart[first + t] = opening[first + t] = 0.0
        else:
            forces[first + t] = slopes[first + t] = 0.0
            apart[first + t], opening[first + t] = gap, change
    return force, slope, pattern


@njit(inline="always")
def answer_by_frames(model: int, state: int, end: int, frame: int, at: int, steps: int, dt: float, turn: float):
    """Mean force and slope of a finger on a line in one frame, number `frame` of the block, of dt [s].

    The finger takes `steps` steps along End.path, from number `at` on. In each of them the string gives way by an equal part
    of what it gives over the frame, and the modes that rest follow at once.
    """
    m, s, e = string_model(model), string_state(state), end_at(end)
    e.block.known[LINEAR] = 1
    finger, contacts, path, share = s.finger[0], m.contacts.size, e.path, 1.0 / steps
    gives, at_once = max(0.0, finger.own) * share, max(0.0, s.grip.own[0, BLOCK] - finger.own)
    change = e.responses.finger_moved[0, BLOCK] * share
    string = finger.here - at_once * finger.push
    drift = (e.block.u[contacts, frame] - string) * share + change * turn
    drag = finger.resistance * steps / dt
    blend = finger.stiffness + drag
    stiff = 1.0 / ((gives + at_once) * blend + 1.0)
    # of what the string is before a step and of the push then, what pushes in it: a chain of two products a step
    of_string, of_push = (drag - blend) * stiff, drag * at_once * stiff
    of_drift, of_change = blend * stiff * drift, blend * stiff * change
    force, push, more, slope, steeper = finger.push, 0.0, 0.0, 0.0, 0.0
    for t in range(at, at + steps):
        target = stiff * (finger.stiffness * path[t + 1] + drag * (path[t + 1] - path[t])) - of_drift
        force = target + of_string * string + of_push * force
        string += drift + gives * force
        push += force
        more = of_string * steeper + of_push * more - of_change
        steeper += change + gives * more
        slope += more
    push *= share
    slope *= share
    e.block.forces[contacts, frame], e.block.slopes[contacts, frame] = push, slope
    return e.responses.finger_reach[0, 0] * push, e.responses.finger_reach[0, 0] * slope


@njit(**INNER)
def _finger_alone(model: int, state: int, end: int, scratch: int, at: int, turn: float) -> tuple[float, float]:
    """Force and slope of a finger without contacts over K steps that are one frame."""
    m, s, e, w = string_model(model), string_state(state), end_at(end), scratch_of(scratch)
    finger, contacts, pull, y = s.finger[0], m.contacts.size, w.rows.spare[0], w.rows.spare[1]
    blend, compliance = finger_blend(EXACT_HOLD, m.dt, finger.stiffness, finger.resistance)
    stiff = 1.0 / (s.grip.own[0, BLOCK] + compliance)
    follow = finger.resistance / m.dt / blend * stiff
    moved = e.responses.finger_moved[0, BLOCK:]
    for k in range(BLOCK):
        target = finger_target(
            EXACT_HOLD, m.dt, finger.stiffness, finger.resistance, e.path[at + k], e.path[at + k + 1], 0.0
        )
        pull[k] = target / blend * stiff
        y[k] = e.block.u[contacts, k] + moved[k] * turn
    grip_sequence(pull, (stiff, follow, finger.here), y, s.grip.own[0], e.block.forces[contacts], w.rows.spare[2])
    for k in range(BLOCK):
        pull[k] = 0.0
    grip_sequence(pull, (stiff, follow, 0.0), moved, s.grip.own[0], e.block.slopes[contacts], w.rows.spare[2])
    reach = e.responses.finger_reach[0]
    return dot(reach, e.block.forces[contacts]), dot(reach, e.block.slopes[contacts])


@njit(**INNER)
def _contacts_and_finger(
    model: int, state: int, end: int, scratch: int, first: int, at: int, steps: int, turn: float
) -> tuple[float, float, int, int]:
    m, s, e, w = string_model(model), string_state(state), end_at(end), scratch_of(scratch)
    several, near, grip, finger = e.counts[NEAR], e.block.near, s.grip.contacts, s.finger[0]
    forces, slopes, apart, opening, fingered = e.block.forces, e.block.slopes, e.block.apart, e.block.opening, finger.on != 0
    gaps, moves = w.rows.u, w.rows.forces  # of the rows over these steps, and by the speed
    begin_rows(m, s, e, w, first, steps, turn)
    matrix = e.block.matrix[: several * several].reshape(several, several)
    enabled, active, z, b = w.pivot.enabled[:several], w.pivot.active[:several], w.z[:several], w.pivot.b[:several]
    for i in range(several):
        enabled[i] = 1
        active[i] = 1 if s.force[near[i]] > 0.0 else 0  # in the step before
    push, push_slope, total = 0.0, 0.0, 1.0
    here, here_slope = finger.here, 0.0
    force, slope, pattern, status, held = 0.0, 0.0, 0, SOLVED, int(np.int64(0))
    for t in range(steps):
        if fingered:
            push, push_slope, total = push_of_finger(s, e, w, m.dt, at + t, t, here, here_slope)
        touching = False
        for i in range(several):
            b[i] = gaps[i, t] + (grip[near[i], BLOCK] * push if fingered else 0.0)
            touching = touching or b[i] < 0.0
            apart[i, first + t] = b[i]
            opening[i, first + t] = moves[i, t] + (grip[near[i], BLOCK] * push_slope if fingered else 0.0)
            forces[i, first + t] = slopes[i, first + t] = 0.0
        if touching:
            bad, _, held = pivot(matrix, b, enabled, active, z, w.pivot.factor, w.pivot.order, held)
            status = max(status, bad)
            for i in range(several):
                forces[i, first + t] = z[i]
                if active[i]:
                    if bad != SOLVED or z[i] == 0.0:
                        e.block.known[LINEAR] = 0
                    if s.due[near[i]]:
                        fill_due(model, state, scratch, near[i])
                    pattern = pattern * MIX + i * BLOCK + t + 1
                b[i] = opening[i, first + t]
            # how they change while the same ones press; contacts solved one by one leave no factor
            count = held if held > 0 else factorise(matrix, active, LEAST_PIVOT, w.pivot.factor, w.pivot.order, held)[0]
            if count > 0:
                substitute(b, count, w.pivot.factor, w.pivot.order, z)
                for i in range(several):
                    slopes[i, first + t] = z[i]
            else:
                e.block.known[LINEAR] = 0
            for d in range(several):
                if active[d]:
                    apart[d, first + t] = opening[d, first + t] = 0.0
                    for i in range(several):
                        if not active[i]:
                            apart[i, first + t] += matrix[i, d] * forces[d, first + t]
                            opening[i, first + t] += matrix[i, d] * slopes[d, first + t]
        more, steeper = act_on_rows(m, s, e, w, first, t, push, push_slope, total, t + 1 < steps)
        force += more
        slope += steeper
        if fingered:
            here, here_slope = gaps[several, t], moves[several, t]
    return force, slope, pattern, status


@njit(**INNER)
def settle_line(model: int, state: int, end: int, frame: int, steps: int, turn: float, looks_back: bool) -> None:
    """A frame of a line is decided, that of this number since it was looked at: its kick and forces act on the rows of later
    steps, and of its own where it looks back, and on the pull at the ends of this and later frames."""
    e = end_at(end)
    kind = e.counts[KIND]
    add_late(e.block.row, e.responses.own[LOOKED_AT], frame, turn)
    if kind == CLEAR:
        e.block.kicks[frame] = turn
        return
    m, s = string_model(model), string_state(state)
    several, contacts, fingered = e.counts[NEAR], m.contacts.size, s.finger[0].on != 0
    near, first = e.block.near, frame * steps
    e.block.kicks[first] = turn
    if looks_back or first + steps < BLOCK:
        for d in range(several):
            add_late(e.block.u[d], e.responses.moved[near[d]], first, turn)
        for t in range(first, first + steps):
            for i in range(several):
                force = e.block.forces[i, t]
                if force != 0.0:
                    for d in range(several):
                        add_late(e.block.u[d], m.contacts.lags[near[d], near[i]], t, force)
            if fingered:
                for d in range(several):
                    add_late(e.block.u[d], s.grip.contacts[near[d]], t, e.block.forces[contacts, t])
    if fingered:
        add_late(e.block.u[contacts], e.responses.finger_moved[0], first, turn)
    for k in range(BLOCK):
        e.block.drew[k] = 0.0
    for i in range(several):
        c = near[i]
        for t in range(steps):
            force = e.block.forces[i, first + t]
            if force != 0.0:
                e.certificate.pushed[1] += force
                if fingered:
                    add_late(e.block.u[contacts], s.grip.contacts[c], first + t, force)
                if steps == 1:
                    for k in range(BLOCK):
                        e.block.drew[k] += e.responses.drawn[c, k] * force
                else:
                    _draw(e.responses.drawn[c], frame, t, steps, force, e.block.row)
        s.force[c] = e.block.forces[i, first + steps - 1]
    if fingered:
        for t in range(steps):
            force = e.block.forces[contacts, first + t]
            e.certificate.pushed[0] += abs(force)
            add_late(e.block.u[contacts], s.grip.own[0], first + t, force)
            _draw(e.responses.finger_drawn[0], frame, t, steps, force, e.block.row)
        finger = s.finger[0]
        finger.push = e.block.forces[contacts, first + steps - 1]
        finger.here = e.block.u[contacts, first + steps - 1]
    if steps == 1:
        for i in range(BLOCK - frame):
            e.block.row[frame + i] += e.block.drew[i]


@njit(inline="always")
def _draw(drawn, frame: int, t: int, steps: int, force: float, pull) -> None:
    """What a force in step t of a frame has done to the pull at the ends of this and later frames."""
    frames = BLOCK // steps
    for i in range(frames - frame):
        pull[frame + i] += drawn[t * frames + i] * force


@njit(inline="always")
def _pressed(e, several: int) -> int:
    """Move the rows that have a force, and their numbers, to the front; returns how many."""
    count = int(np.int64(0))
    for i in range(several):
        any_force = False
        for k in range(BLOCK):
            any_force = any_force or e.block.forces[i, k] != 0.0
        if any_force:
            if count < i:
                e.block.near[count] = e.block.near[i]
                for k in range(BLOCK):
                    e.block.forces[count, k] = e.block.forces[i, k]
            count += 1
    return count


@njit(**INNER)
def drive_line(model: int, state: int, end: int, steps: int, more: bool) -> None:
    """The modes go through K steps with all that acts on them; those of a line that is clear through K frames.

    Where the K steps are one frame its kick comes before them, and if there are `more` frames what is under a finger in the
    next K steps is looked at in the same pass.
    """
    m, s, e = string_model(model), string_state(state), end_at(end)
    n, contacts = _moving(m, e), m.contacts.size
    rows, q, v = _rows_of(m, e), s.q, s.v
    if e.counts[KIND] == CLEAR:
        kick(padded(m.modes), e.flight, q, v, e.kick, e.block.kicks)
        return
    pressed, fingered = _pressed(e, e.counts[NEAR]), s.finger[0].on != 0
    touch, pushes = s.grip.weights[:n], e.block.forces[contacts]
    if steps == BLOCK:
        add(e.block.kicks[0], e.kick[:n], v)
        if fingered and pressed == 0:
            if more:
                drive_q(n, rows, q, v, touch, pushes, touch, e.block.u[contacts])
                e.block.known[AHEAD] = 1
            else:
                drive(n, rows, q, v, touch, pushes)
        elif fingered:
            drive_listed_and_one(n, rows, q, v, pressed, e.block.near, m.contacts.shapes, e.block.forces, touch, pushes)
        elif pressed == 0:
            coast(n, rows, q, v)
        elif pressed == 1:
            drive(n, rows, q, v, m.contacts.shapes[e.block.near[0]], e.block.forces[0])
        else:
            drive_listed(n, rows, q, v, pressed, e.block.near, m.contacts.shapes, e.block.forces)
    elif fingered and pressed == 0:
        drive_kicked(n, rows, q, v, touch, pushes, e.kick, e.block.kicks)
    elif fingered:
        drive_listed_and_one_kicked(
            n, rows, q, v, pressed, e.block.near, m.contacts.shapes, e.block.forces, touch, pushes, e.kick, e.block.kicks
        )
    elif pressed == 0:
        kick(n, rows, q, v, e.kick, e.block.kicks)
    elif pressed == 1:
        drive_kicked(n, rows, q, v, m.contacts.shapes[e.block.near[0]], e.block.forces[0], e.kick, e.block.kicks)
    else:
        drive_listed_kicked(n, rows, q, v, pressed, e.block.near, m.contacts.shapes, e.block.forces, e.kick, e.block.kicks)


@njit(**INNER)
def step_line(model: int, state: int, end: int, steps: int, frames: int) -> None:
    """Advance the modes by so many frames of `steps` steps since they were looked at, fewer than K steps in all, or fewer
    than K frames, as `drive_line` does by all of them."""
    m, s, e = string_model(model), string_state(state), end_at(end)
    rows, contacts, clear = _rows_of(m, e), m.contacts.size, e.counts[KIND] == CLEAR
    n = moving_modes(m, e)
    q, v = s.q[:n], s.v[:n]
    kq, kv = rows[4, :n], rows[5, :n]
    for frame in range(frames):
        first = frame if clear else frame * steps
        add(e.block.kicks[first], e.kick[:n], v)
        if clear:
            fly(e.flight, q, v)
            continue
        for t in range(first, first + steps):
            fly(rows, q, v)
            for i in range(e.counts[NEAR]):
                if e.block.forces[i, t] != 0.0:
                    push_modes(q, v, kq, kv, m.contacts.shapes[e.block.near[i]], e.block.forces[i, t])
            if s.finger[0].on != 0:
                push_modes(q, v, kq, kv, s.grip.weights, e.block.forces[contacts, t])
