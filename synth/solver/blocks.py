"""Contact schemes, K = `block_rows.BLOCK` steps at a time: the fast twins of `stepwise`.

K free projections of every contact cost one pass over the modes with everything in registers (`lanes`); the contact
problems of the K steps are then solved one after the other on these numbers alone (`sequence`), and the forces enter the
modes in a second pass, which is also the free flight to the end of the block.

Exact-hold looks only at contacts that can be touched (`certificates`): a certificate, not a guess, so that no sound depends
on it. Moreau–Jean integrates the position of each contact and looks at all.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.native.views import in_rows
from synth.solver.block_rows import BLOCK, ROWS
from synth.solver.certificates import HORIZONS, certify
from synth.solver.due_responses import fill_due
from synth.solver.lanes import (
    add_forced,
    any_below,
    coast,
    coast_q,
    coast_qq,
    coast_qv,
    coast_v,
    drive,
    drive_listed,
    drive_q,
    drive_qq,
    drive_qv,
    padded,
    padded_single,
    press_sequence,
    project_q,
    project_qq,
    project_qv,
    project_v,
    project_vv,
)
from synth.solver.laws import EXACT_HOLD
from synth.solver.lcp import SOLVED
from synth.solver.sequence import end_certificates, gather, note_forces, others_stay_clear, solve_sequence, strike_sequence
from synth.solver.single import fill_single_rows, give_back, take
from synth.solver.stringmodel import CLOCK, MOVING, scratch_of, string_model, string_state
from synth.solver.vectors import INNER

#: what modes go through from one block to the next: nothing yet, free flight, the forces of the block
_NOTHING, _FLIGHT, _FORCES = range(3)


@njit(**INNER)
def observe(n: int, rows, q, v, weights, on_q: int, out) -> None:
    """out (P, K) = weights (P, n) times the free displacements (the first `on_q` rows) or velocities of the next K steps."""
    p = 0
    points = weights.shape[0]
    while p < points:
        if p + 1 < on_q:
            project_qq(n, rows, q, v, weights[p], weights[p + 1], out[p], out[p + 1])
            p += 2
        elif p < on_q and p + 1 < points:
            project_qv(n, rows, q, v, weights[p], weights[p + 1], out[p], out[p + 1])
            p += 2
        elif p < on_q:
            project_q(n, rows, q, v, weights[p], out[p])
            p += 1
        elif p + 1 < points:
            project_vv(n, rows, q, v, weights[p], weights[p + 1], out[p], out[p + 1])
            p += 2
        else:
            project_v(n, rows, q, v, weights[p], out[p])
            p += 1


@njit(cache=True, nogil=True)
def fly_blocks(blocks: int, n: int, rows, q, v, weights, on_q: int, out) -> None:
    """Free flight. out (P, ≥ blocks·K) gets `weights` (P, n) times the state after each step, see `observe`; P ≤ 2."""
    points = weights.shape[0]
    if blocks == 0:
        return
    if points == 0:
        for _ in range(blocks):
            coast(n, rows, q, v)
        return
    first, last = weights[0], weights[points - 1]
    for t in range(blocks):
        at = t * BLOCK
        if points == 2:
            if t == 0:
                project_qv(n, rows, q, v, first, last, out[0, at:], out[1, at:])
            else:
                coast_qv(n, rows, q, v, first, last, out[0, at:], out[1, at:])
        elif on_q:
            if t == 0:
                project_q(n, rows, q, v, first, out[0, at:])
            else:
                coast_q(n, rows, q, v, first, out[0, at:])
        elif t == 0:
            project_v(n, rows, q, v, first, out[0, at:])
        else:
            coast_v(n, rows, q, v, first, out[0, at:])
    coast(n, rows, q, v)


@njit(cache=True, nogil=True)
def fly_modes(model: int, scratch: int, q, v, modes: int, blocks: int, out) -> None:
    """`fly_blocks` with a model's outputs in use, of which it has at most one of each kind; the first `modes` of q, v (≥N,)
    are not zero."""
    m = string_model(model)
    first, behind, on_q = m.outputs.first, m.outputs.first + m.outputs.points, m.outputs.on_q
    if not m.single.on:
        fly_blocks(blocks, padded(modes), m.rows, q, v, m.outputs.weights[first:behind], on_q, out)
        return
    w = scratch_of(scratch)
    n = padded_single(modes)
    single_q, single_v = w.single.q[:n], w.single.v[:n]
    take(q, v, modes, single_q, single_v)
    fly_blocks(blocks, n, _single_rows(m, w, modes), single_q, single_v, m.single.weights[first:behind], on_q, out)
    give_back(single_q, single_v, modes, q, v)


@njit(inline="always")
def _single_rows(m, w, modes: int):
    """(ROWS, padded_single(N)) float32 of a model: its own, or, of so many modes, made in the Scratch where it has none."""
    _fill_own_rows(m, w, int(np.int64(0)), min(modes, m.rows.shape[1]))
    return _rows_in_use(m, w)


@njit(inline="always")
def _fill_own_rows(m, w, first: int, modes: int) -> None:
    """Columns first … modes of the rows in the Scratch, of a model that has none of float32 itself."""
    if m.single.on and m.single.rows.shape[1] == 0:
        fill_single_rows(m.rows, first, modes, in_rows(w.single.rows, ROWS, padded_single(m.modes)))


@njit(inline="always")
def _rows_in_use(m, w):
    """Rows of float32 of a model that `_single_rows` has been asked for."""
    if m.single.rows.shape[1] > 0:
        return m.single.rows
    return in_rows(w.single.rows, ROWS, padded_single(m.modes))


@njit(cache=True, nogil=True)
def press_blocks(model: int, state: int, scratch: int, blocks: int, stride: int) -> int:
    """Exact-hold over one contact, with at most one output of displacement and one of velocity; rows of `stride` steps.

    Returns the number of blocks that touched.
    """
    _begin_press(model, state, scratch)
    # literals would have the kernels that are called with them compiled once more
    before, touched = int(np.int64(_NOTHING)), int(np.int64(0))
    for t in range(blocks):
        _pass_modes(model, state, scratch, t * BLOCK, stride, before)
        before = _solve_block(model, state, scratch, t * BLOCK, stride)
        touched += 1 if before == _FORCES else 0
    _end_press(model, state, scratch, blocks * BLOCK, before)
    return touched


@njit(cache=True, nogil=True)
def press_two(
    model: int, state: int, scratch: int, other_model: int, other_state: int, other_scratch: int, blocks: int, stride: int
) -> None:
    """`press_blocks` of two strings side by side: while the contact problems of the one wait for each other, the modes of
    the other pass. Saves 8 % of the time at 126 modes and 13 % at 50 where every block touches, on a processor of Zen 5."""
    _begin_press(model, state, scratch)
    _begin_press(other_model, other_state, other_scratch)
    before = other_before = int(np.int64(_NOTHING))
    for t in range(blocks):
        _pass_modes(model, state, scratch, t * BLOCK, stride, before)
        _pass_modes(other_model, other_state, other_scratch, t * BLOCK, stride, other_before)
        before = _solve_block(model, state, scratch, t * BLOCK, stride)
        other_before = _solve_block(other_model, other_state, other_scratch, t * BLOCK, stride)
    _end_press(model, state, scratch, blocks * BLOCK, before)
    _end_press(other_model, other_state, other_scratch, blocks * BLOCK, other_before)


@njit(**INNER)
def _begin_press(model: int, state: int, scratch: int) -> None:
    """Modes that are float32 go into Scratch."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    if m.single.on:
        n = padded_single(m.modes)
        take(s.q, s.v, m.modes, w.single.q[:n], w.single.v[:n])
        _single_rows(m, w, m.modes)


@njit(**INNER)
def _pass_modes(model: int, state: int, scratch: int, at: int, stride: int, before: int) -> None:
    """Modes go through what the block before has left (`before`); the free displacements of the contact over the next one go
    into Scratch.rows.spare[0], the free outputs into their rows from step `at` on."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    if m.single.on:
        rows, shape, weights = _rows_in_use(m, w), m.single.shapes[0], m.single.weights
        _pass_of(before, at, stride, rows.shape[1], rows, w.single.q, w.single.v, shape, weights, m, w)
    else:
        _pass_of(before, at, stride, m.rows.shape[1], m.rows, s.q, s.v, m.contacts.shapes[0], m.outputs.weights, m, w)


@njit(inline="always")
def _pass_of(before: int, at: int, stride: int, n: int, rows, q, v, shape, all_weights, m, w) -> None:
    """The same with the modes q, v (≥n,) and what they are multiplied with: rows (ROWS, n), shape (n,) of the contact,
    all_weights (·, n)."""
    u, forces = w.rows.spare[0], w.record[max(0, at - BLOCK) :]
    if m.outputs.points == 0:
        if before == _NOTHING:
            project_q(n, rows, q, v, shape, u)
        elif before == _FLIGHT:
            coast_q(n, rows, q, v, shape, u)
        else:
            drive_q(n, rows, q, v, shape, forces, shape, u)
        return
    weights, out = all_weights[m.outputs.first], w.out[at:]
    if m.outputs.on_q:
        if before == _NOTHING:
            project_qq(n, rows, q, v, shape, weights, u, out)
        elif before == _FLIGHT:
            coast_qq(n, rows, q, v, shape, weights, u, out)
        else:
            drive_qq(n, rows, q, v, shape, forces, shape, weights, u, out)
    elif before == _NOTHING:
        project_qv(n, rows, q, v, shape, weights, u, out)
    elif before == _FLIGHT:
        coast_qv(n, rows, q, v, shape, weights, u, out)
    else:
        drive_qv(n, rows, q, v, shape, forces, shape, weights, u, out)
    if m.outputs.points > 1:
        project_v(n, rows, q, v, all_weights[m.outputs.first + 1], w.out[stride + at :])


@njit(**INNER)
def _solve_block(model: int, state: int, scratch: int, at: int, stride: int) -> int:
    """Forces of the block from step `at` on into Scratch.record, and what they add to the outputs; what the modes have to
    go through of it."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    u, forces, lags = w.rows.spare[0], w.record[at:], m.contacts.lags[0, 0]
    after = _FLIGHT
    if any_below(u, s.eta[0]):
        press_sequence(u, s.eta[0], lags, forces)
        for p in range(m.outputs.points):
            add_forced(w.out[p * stride + at :], m.outputs.lags[m.outputs.first + p, 0], forces)
        after = _FORCES
    else:
        for k in range(BLOCK):
            forces[k] = 0.0
    if w.contact_u.size > 0:
        if after == _FORCES:
            add_forced(u, lags, forces)
        contact_u = w.contact_u[at:]
        for k in range(BLOCK):
            contact_u[k] = u[k]
    return after


@njit(**INNER)
def _end_press(model: int, state: int, scratch: int, steps: int, before: int) -> None:
    """After so many steps modes go through what the last block has left, and back into the state."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    forces = w.record[max(0, steps - BLOCK) :]
    if m.single.on:
        n = padded_single(m.modes)
        q, v = w.single.q[:n], w.single.v[:n]
        _leave(before, n, _rows_in_use(m, w), q, v, m.single.shapes[0], forces)
        give_back(q, v, m.modes, s.q, s.v)
    else:
        _leave(before, m.rows.shape[1], m.rows, s.q, s.v, m.contacts.shapes[0], forces)
    if before != _NOTHING:
        s.force[0] = forces[BLOCK - 1]


@njit(inline="always")
def _leave(before: int, n: int, rows, q, v, shape, forces) -> None:
    if before == _FORCES:
        drive(n, rows, q, v, shape, forces)
    elif before == _FLIGHT:
        coast(n, rows, q, v)


@njit(inline="always")
def look(n: int, rows, shapes, q, v, velocity: int, near, m: int, u) -> None:
    """u[:m] (·, K): free displacements, or velocities, of contacts near[:m] over the next K steps."""
    i = 0
    while i < m:
        shape = shapes[near[i]]
        if i + 1 < m:
            other = shapes[near[i + 1]]
            if velocity:
                project_vv(n, rows, q, v, shape, other, u[i], u[i + 1])
            else:
                project_qq(n, rows, q, v, shape, other, u[i], u[i + 1])
        elif velocity:
            project_v(n, rows, q, v, shape, u[i])
        else:
            project_q(n, rows, q, v, shape, u[i])
        i += 2


@njit(cache=True, nogil=True)
def advance_blocks(model: int, state: int, scratch: int, blocks: int, stride: int) -> int:
    """Blocks of K steps of any law over any number of contacts; rows of `stride` steps. Returns a status of `lcp`.

    Contacts out of reach are passed over where the model is `certified` (exact-hold; `certificates.forget` after any change
    from outside), and then there is no contact_u.
    """
    m, s = string_model(model), string_state(state)
    if not m.single.on:
        moving, shapes, weights = padded(s.counts[MOVING]), m.contacts.shapes, m.outputs.weights
        return _advance(model, state, scratch, blocks, stride, moving, m.rows, shapes, weights, s.q, s.v)
    w = scratch_of(scratch)
    n = padded_single(m.modes)
    q, v = w.single.q[:n], w.single.v[:n]
    take(s.q, s.v, m.modes, q, v)
    moving = padded_single(s.counts[MOVING])
    rows = _single_rows(m, w, min(moving, m.modes))
    result = _advance(model, state, scratch, blocks, stride, moving, rows, m.single.shapes, m.single.weights, q, v)
    give_back(q, v, m.modes, s.q, s.v)
    return result


@njit(**INNER)
def _advance(
    model: int, state: int, scratch: int, blocks: int, stride: int, moving: int, rows, shapes, all_weights, q, v
) -> int:  # fmt: skip
    """The same with the modes q, v (n,), of which `moving` may not be zero, and what they are multiplied with: rows
    (ROWS, n), of which the first `moving` columns are there, shapes (C, n), weights (P, n)."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    law, n, points, contacts = m.law, rows.shape[1], m.outputs.points, shapes.shape[0]
    lags, eta = m.contacts.lags, s.eta
    weights = all_weights[m.outputs.first : m.outputs.first + points]
    out = w.out[: points * stride].reshape(points, stride)
    record, watched = w.record, w.contact_u.size > 0
    hold = law == EXACT_HOLD
    near, u, forces, looked = w.rows.near, w.rows.u, w.rows.forces, s.certificates.looked
    result = SOLVED
    if blocks == 0:
        return result
    for t in range(blocks):
        at = t * BLOCK
        if m.certified and hold:
            certify(model, state, scratch, q[:moving], v[:moving])
        else:
            for c in range(contacts):
                looked[c], s.certificates.until[c], s.certificates.renewed[c] = 1, 0, -1
        if points > 0:
            observe(moving, rows, q, v, weights, m.outputs.on_q, out[:, at:])
        for i in range(at * contacts, (at + BLOCK) * contacts):
            record[i] = 0.0
        status = SOLVED
        touched = False
        several = gather(looked[:contacts], near)
        look(moving, rows, shapes, q, v, 0 if hold else 1, near, several, u)
        if hold:
            while True:
                inside = False
                for i in range(several):
                    inside = inside or any_below(u[i], eta[near[i]])
                if not inside:
                    break
                touched = True
                if several == 1:
                    only = near[0]
                    if s.due[only]:
                        fill_due(model, state, scratch, only)
                    press_sequence(u[0], eta[only], lags[only, only], forces[0])
                    add_forced(u[0], lags[only, only], forces[0])
                else:
                    status = solve_sequence(model, state, scratch, several, at)
                until = s.counts[CLOCK] + HORIZONS[1]
                if several == contacts or others_stay_clear(model, state, scratch, several, touched, 0.0, until):
                    break
                several = gather(looked[:contacts], near)  # once more, with those that the forces might reach
                look(moving, rows, shapes, q, v, 0, near, several, u)
        elif several > 0:
            if contacts == 1:
                strike_sequence(model, state, scratch)
            else:
                status = solve_sequence(model, state, scratch, several, at)
            for i in range(several):
                for k in range(BLOCK):
                    touched = touched or forces[i, k] > 0.0
        if status != SOLVED:
            result = status
        s.counts[CLOCK] += BLOCK
        if watched:
            for i in range(several):
                for k in range(BLOCK):
                    w.contact_u[(at + k) * contacts + near[i]] = u[i, k]
        if touched:
            note_forces(model, scratch, several, at, stride)
            if moving < n:
                _fill_own_rows(m, w, moving, m.modes)
            if several == 1:
                drive(n, rows, q, v, shapes[near[0]], forces[0])
            else:
                drive_listed(n, rows, q, v, several, near, shapes, forces)
            moving = n
            end_certificates(model, state, touched, 0.0)
        else:
            coast(moving, rows, q, v)
    s.counts[MOVING] = min(m.modes, moving)
    for c in range(contacts):
        s.force[c] = record[(blocks * BLOCK - 1) * contacts + c]
    return result
