"""A string over an elastic board at playing speed: `wall`'s impulses at the nodes of the modal grid, fingers, blocks.

The scheme is that of `wall`: exact flights from instant to instant, at each an impulse of its own for every node that is
under the board's surface (`wall.after_contact`), with the account of the energy that it took. Here the string is plucked
and damped while it touches (a finger's force is held over the step, as in `stepwise`), its speaking length may change from
call to call, and not every instant is looked at everywhere. Energy of string, finger's spring and accounts never grows.

Over a block of K steps, τ = K Δt, the string is flown to the end with its finger's pushes p_k and looked at there and at the
beginning, by two sine transforms. In between a node is nowhere lower than on the straight line between the two by more than

    √(2/ℓ) · min(Σ_j d_j, sin(πi/n) Σ_j j d_j),
    d_j = min(2, (1 + 2σ_j/ω_j)(ω_jτ)²/8) (|q_j − p̄ w_j/(μω_j²)| + |v_j|/ω_j) + 2 |w_j| Σ_k |p_k − p̄| Δt min(τ, 1/ω_j)/μ,

n the grid's intervals, i the node, w_j the finger's weights, p̄ the mean push: a mode's energy about the place where the
mean push holds it does not grow, and |sin jx| ≤ j |sin x|. A node for which that leaves it open has its displacement worked
out at all K steps; a block in which one comes under the surface, or in which one was under it when it began, goes step by
step with transforms, one for two steps while nothing touches. So no impulse depends on what is looked at, and what is
decided of a block on nothing but the string.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK, KQ, KV
from synth.solver.blocks import fly_blocks
from synth.solver.board_table import BY_PUSH, BY_Q, BY_V, HOLDING, SPEAKING, STEPPED, STRUCK, board_at, room_of
from synth.solver.certificates import MARGIN
from synth.solver.lanes import add_forced, any_below, coast, drive, grip_sequence, padded, project_q, project_qv
from synth.solver.laws import EXACT_HOLD
from synth.solver.lcp import SOLVED
from synth.solver.sine import Sine, transform
from synth.solver.stepwise import finger_blend, finger_target, fly, push_modes
from synth.solver.stringmodel import FREE, MOVING, scratch_of, string_model, string_state
from synth.solver.vectors import FAST, INNER, dot
from synth.solver.wall import after_contact

#: written into its caller: compiled for that alone, and not with what `wall` compiles of it
_after_contact = njit(inline="always")(after_contact.py_func)


@njit(fastmath=FAST, **INNER)
def _deviation(slack, omega, mu: float, q, v, touch, mean: float, strength: float):
    """Σ d_j and Σ j d_j of the module's docstring; touch (n,) the finger's weights, strength Σ|p − p̄|."""
    everywhere, slope = 0.0, 0.0
    by_q, by_v, by_push = slack[BY_Q], slack[BY_V], slack[BY_PUSH]
    if mean == 0.0 and strength == 0.0:
        for j in range(q.size):
            d = by_q[j] * abs(q[j]) + by_v[j] * abs(v[j])
            everywhere += d
            slope += (j + 1.0) * d
    else:
        for j in range(q.size):
            held = q[j] - mean * touch[j] / (mu * omega[j] * omega[j])
            d = by_q[j] * abs(held) + by_v[j] * abs(v[j]) + by_push[j] * abs(touch[j]) * strength
            everywhere += d
            slope += (j + 1.0) * d
    return everywhere, slope


@njit(inline="always")
def _transform(b, room, x, y, nodes_x, nodes_y) -> None:
    """`sine.transform` by a Board's tables."""
    transform(Sine(b.half, b.twiddles, b.matrix, room.work), x, y, nodes_x, nodes_y)


@njit(**INNER)
def _strike(board: int, q, v, mu: float, dt: float) -> bool:
    """Impulses of one instant at all nodes; whether there were any."""
    b, room = board_at(board), room_of(board)
    n = b.eta.size
    u, w, change = room.nodes[0], room.nodes[1], room.nodes[2]
    _transform(b, room, q[:n], v[:n], u, w)
    scale = math.sqrt(2.0 / b.numbers[SPEAKING])
    hit, holding = False, 0
    for c in range(n):
        change[c] = 0.0
        gap = scale * u[c] - b.eta[c]
        if gap < 0.0 or b.touching[c] != 0:
            speed = scale * w[c]
            after, touching, account, _ = _after_contact(gap, speed, b.touching[c], b.account[c], b.kappa, b.restitution, dt)
            b.touching[c] = touching
            b.account[c] = account
            holding += touching
            change[c] = after - speed
            hit = hit or after != speed
    b.counts[HOLDING] = holding
    if hit:
        b.counts[STRUCK] += 1
        _kick(b, room, change, b.numbers[SPEAKING] / b.half.size * scale, v)
    return hit


@njit(inline="always")
def _kick(b, room, change, gain: float, v) -> None:
    """v (≥n,) += gain times the sine transform of the nodes' changes of speed (n,): one by one where these are few."""
    n, count = change.size, 0
    for c in range(n):
        if change[c] != 0.0 and count < room.struck.size:
            room.struck[count] = c
            count += 1
    if count < room.struck.size:
        for i in range(count):
            strength, shape = gain * change[room.struck[i]], b.shapes[room.struck[i]]
            for j in range(n):
                v[j] += strength * shape[j]
        return
    kick, spare = room.nodes[3], room.nodes[4]
    _transform(b, room, change, change, kick, spare)
    for j in range(n):
        v[j] += gain * kick[j]


@njit(**INNER)
def _lies_clear(board: int, q, later) -> bool:
    """Whether no node is under the surface at q (≥n,), nor at `later`: two states are as dear as one."""
    b, room = board_at(board), room_of(board)
    n, u, w = b.eta.size, room.nodes[0], room.nodes[1]
    _transform(b, room, q[:n], later[:n], u, w)
    scale, under = math.sqrt(2.0 / b.numbers[SPEAKING]), 0
    for c in range(n):
        under += scale * min(u[c], w[c]) < b.eta[c]
    return under == 0


@njit(fastmath=FAST, **INNER)
def _step(model: int, state: int, scratch: int, t: int) -> None:
    """Step number t of a free flight, with the finger that is on."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    n, dt, rows = m.rows.shape[1], m.dt, m.rows
    q, v = s.q[:n], s.v[:n]
    fly(rows, q, v)
    finger, touch = s.finger[0], s.grip.weights[:n]
    if finger.on != 0:
        blend, compliance = finger_blend(EXACT_HOLD, dt, finger.stiffness, finger.resistance)
        target = finger_target(EXACT_HOLD, dt, finger.stiffness, finger.resistance, w.path[t], w.path[t + 1], finger.here)
        push = (target / blend - dot(touch, q)) / (finger.own + compliance)
        push_modes(q, v, rows[KQ], rows[KV], touch, push)
        finger.push = push
        finger.here = dot(touch, q)


@njit(fastmath=FAST, **INNER)
def _hear(model: int, state: int, weights, out, t: int) -> None:
    """out (points, ≥t + 1): the outputs in use of the string as it is, at t."""
    m, s = string_model(model), string_state(state)
    n = m.rows.shape[1]
    for p in range(m.outputs.points):
        out[p, t] = dot(weights[p], s.q[:n]) if p < m.outputs.on_q else dot(weights[p], s.v[:n])


@njit(cache=True, nogil=True)
def _one_by_one(model: int, state: int, scratch: int, board: int, begin: int, stride: int, steps: int) -> None:
    """`steps` steps from number `begin` of rows of `stride`, looked at everywhere after each: two at a time while the string
    lies clear, and the second is taken back where the first does not."""
    m, s, w, b = string_model(model), string_state(state), scratch_of(scratch), board_at(board)
    room = room_of(board)
    n, points, end = m.rows.shape[1], m.outputs.points, begin + steps
    q, v, finger = s.q[:n], s.v[:n], s.finger[0]
    out = w.out[: points * stride].reshape(points, stride)
    weights = b.weights[m.outputs.first : m.outputs.first + points]
    s.counts[MOVING] = m.modes
    t, clear = begin, True
    while t < end:
        _step(model, state, scratch, t)
        _hear(model, state, weights, out, t)
        two = clear and b.counts[HOLDING] == 0 and t + 1 < end
        if two:
            here, push = finger.here, finger.push
            for j in range(n):
                room.before[0, j] = q[j]
                room.before[1, j] = v[j]
            _step(model, state, scratch, t + 1)
            if _lies_clear(board, room.before[0], q):
                _hear(model, state, weights, out, t + 1)
                t += 2
                continue
            for j in range(n):
                q[j] = room.before[0, j]
                v[j] = room.before[1, j]
            finger.here, finger.push = here, push
        hit = _strike(board, q, v, m.mu, m.dt)
        if hit:
            _hear(model, state, weights, out, t)
        clear = not hit and not two
        t += 1


@njit(**INNER)
def _stays_clear(
    board: int, model: int, n: int, before, q, fingered: bool, pushed, pushes, everywhere: float, slope: float
) -> bool:
    """Whether the string, at (q, v) = before (2, n) a block ago and at q now, touches nothing in between or at its end.

    Nodes that the bound leaves open are looked at step by step, as long as they are few. fingered: whether a finger has
    pushed it, with pushes (K,) [N]; by the end of its step 1 N moves it to pushed (2, n).
    """
    m, b, room = string_model(model), board_at(board), room_of(board)
    u, later = room.nodes[0], room.nodes[1]
    nodes = b.eta.size
    _transform(b, room, before[0, :nodes], q[:nodes], u, later)
    scale = math.sqrt(2.0 / b.numbers[SPEAKING])
    by_place, by_slope = MARGIN * scale * everywhere, MARGIN * scale * slope
    count = 0
    for c in range(nodes):
        if scale * min(u[c], later[c]) - b.eta[c] <= min(by_place, by_slope * b.half[c + 1]):
            if scale * later[c] < b.eta[c] or count == room.followed.size:
                return False
            room.followed[count] = c
            count += 1
    for i in range(count):
        c = room.followed[i]
        project_q(n, m.rows, before[0], before[1], b.shapes[c], room.row)
        if fingered:
            room.response[BLOCK] = dot(b.shapes[c, :n], pushed[0])
            project_q(n, m.rows, pushed[0], pushed[1], b.shapes[c], room.response[BLOCK + 1 :])
            add_forced(room.row, room.response, pushes)
        if any_below(room.row, b.eta[c] / scale):
            return False
    return True


@njit(cache=True, nogil=True)
def _block(model: int, state: int, scratch: int, board: int, at: int, stride: int) -> bool:
    """One block from step `at` on, of a string that no finger holds. False: it touches, and nothing is done."""
    m, s, w, b = string_model(model), string_state(state), scratch_of(scratch), board_at(board)
    room = room_of(board)
    n, points = padded(s.counts[MOVING]), m.outputs.points
    rows, q, v, before = m.rows, s.q, s.v, room.before
    if b.counts[HOLDING] > 0:
        return False
    everywhere, slope = _deviation(b.slack[:, :n], m.omega[:n], m.mu, q[:n], v[:n], q[:n], 0.0, 0.0)
    whole = b.eta.size
    for j in range(before.shape[1]):
        before[0, j] = q[j]
        before[1, j] = v[j]
    coast(n, rows, q, v)
    if not _stays_clear(board, model, n, before, q[:whole], False, before, room.row, everywhere, slope):
        for j in range(n):
            q[j] = before[0, j]
            v[j] = before[1, j]
        return False
    out = w.out[: points * stride].reshape(points, stride)
    _observe(n, m, b, room, before, out, at)
    return True


@njit(inline="always")
def _observe(n: int, m, b, room, before, out, at: int) -> None:
    """Outputs of the free flight of a block from `before`."""
    if m.outputs.points == 2:
        project_qv(n, m.rows, before[0], before[1], b.weights[0], b.weights[1], out[0, at:], out[1, at:])
    elif m.outputs.on_q == 1:
        project_q(n, m.rows, before[0], before[1], b.weights[0], out[0, at:])
    else:
        _observe_v(n, m.rows, before[0], before[1], b.weights[1], room.row, out[0, at:])


@njit(cache=True, nogil=True)
def _observe_v(n: int, rows, q, v, weights, spare, out) -> None:
    project_qv(n, rows, q, v, weights, weights, spare, out)


@njit(cache=True, nogil=True)
def _block_under_finger(model: int, state: int, scratch: int, board: int, at: int, stride: int) -> bool:
    """`_block` of a string that a finger holds along Scratch.path."""
    m, s, w, b = string_model(model), string_state(state), scratch_of(scratch), board_at(board)
    room = room_of(board)
    n, dt, points, rows, q, v, before = m.rows.shape[1], m.dt, m.outputs.points, m.rows, s.q, s.v, room.before
    if b.counts[HOLDING] > 0:
        return False
    finger, touch, own = s.finger[0], s.grip.weights[:n], s.grip.own[0]
    stiffness, resistance = finger.stiffness, finger.resistance
    blend, compliance = finger_blend(EXACT_HOLD, dt, stiffness, resistance)
    stiff = 1.0 / (own[BLOCK] + compliance)
    follow = finger_target(EXACT_HOLD, dt, stiffness, resistance, 0.0, 0.0, 1.0) / blend * stiff
    y, true, pull, pushes = w.rows.spare[0], w.rows.spare[1], w.rows.spare[2], w.rows.forces[0]
    for k in range(BLOCK):
        target = finger_target(EXACT_HOLD, dt, stiffness, resistance, w.path[at + k], w.path[at + k + 1], 0.0)
        pull[k] = target / blend * stiff
    project_q(n, rows, q, v, touch, y)
    grip_sequence(pull, (stiff, follow, finger.here), y, own, pushes, true)
    mean, strength = 0.0, 0.0
    for k in range(BLOCK):
        mean += pushes[k] / BLOCK
    for k in range(BLOCK):
        strength += abs(pushes[k] - mean)
    everywhere, slope = _deviation(b.slack[:, :n], m.omega[:n], m.mu, q[:n], v[:n], touch, mean, strength)
    for j in range(n):
        before[0, j] = q[j]
        before[1, j] = v[j]
    drive(n, rows, q, v, touch, pushes)
    for j in range(n):
        room.pushed[0, j] = rows[KQ, j] * touch[j]
        room.pushed[1, j] = rows[KV, j] * touch[j]
    if not _stays_clear(board, model, n, before, q, True, room.pushed, pushes, everywhere, slope):
        for j in range(n):
            q[j] = before[0, j]
            v[j] = before[1, j]
        return False
    out = w.out[: points * stride].reshape(points, stride)
    _observe(n, m, b, room, before, out, at)
    for p in range(points):
        add_forced(out[p, at:], s.grip.outputs[m.outputs.first + p], pushes)
    finger.here = true[BLOCK - 1]
    finger.push = pushes[BLOCK - 1]
    s.counts[MOVING] = m.modes
    return True


@njit(cache=True, nogil=True)
def advance_on_board(model: int, state: int, scratch: int, board: int, steps: int) -> int:
    """`steps` steps of a string over its board. A status of `lcp`: always SOLVED.

    As `step.advance`: Scratch.out gets the outputs in use, a row of `steps` for each, and a finger that is on goes along
    Scratch.path. Board.eta, weights, slack and numbers are those of the string's model.
    """
    m, s, w, b = string_model(model), string_state(state), scratch_of(scratch), board_at(board)
    blocks, points = steps // BLOCK, m.outputs.points
    out = w.out[: points * steps].reshape(points, steps)
    fingered = s.finger[0].on != 0
    if not fingered and s.counts[FREE] != 0:
        n = padded(s.counts[MOVING])
        weights = b.weights[m.outputs.first : m.outputs.first + points]
        fly_blocks(blocks, n, m.rows, s.q, s.v, weights, m.outputs.on_q, out)
        for t in range(blocks * BLOCK, steps):
            fly(m.rows, s.q[:n], s.v[:n])
            for p in range(points):
                out[p, t] = dot(weights[p, :n], s.q[:n]) if p < m.outputs.on_q else dot(weights[p, :n], s.v[:n])
        return SOLVED
    for t in range(blocks):
        at = t * BLOCK
        done = False
        if fingered:
            done = _block_under_finger(model, state, scratch, board, at, steps)
        else:
            done = _block(model, state, scratch, board, at, steps)
        if not done:
            b.counts[STEPPED] += 1
            _one_by_one(model, state, scratch, board, at, steps, int(np.int64(BLOCK)))
    if blocks * BLOCK < steps:
        _one_by_one(model, state, scratch, board, blocks * BLOCK, steps, steps - blocks * BLOCK)
    return SOLVED
