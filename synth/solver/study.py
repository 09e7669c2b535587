"""The steps of a run with its rows and its energy ledger, compiled: what `driver` prepares."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numba import njit

from synth.native.arrays import f8
from synth.native.views import opener, words
from synth.solver.block_rows import BLOCK
from synth.solver.certificates import amplitudes, reach
from synth.solver.energy import impulse_work, spring, stored
from synth.solver.laws import EXACT_HOLD, MOREAU_JEAN_FILTERED
from synth.solver.layers import held_by_layers
from synth.solver.lcp import SOLVED
from synth.solver.problem import Results
from synth.solver.step import advance
from synth.solver.stepwise import has_answer, one_by_one
from synth.solver.stringmodel import (
    CERTAIN,
    DEPTH,
    place_of,
    scratch_of,
    string_model,
    string_state,
)
from synth.solver.substeps import advance_substepped, arriving, clear_step
from synth.solver.vectors import INNER, dot, put

# places in Results.sums
STORED, SPRING, VISCOUS, CONTACT, INJECTED, INITIAL = 0, 1, 2, 3, 4, 5
PENETRATION, RISE, LEAST_VISCOUS, LEAST_CONTACT = 6, 7, 8, 9
SUMS = 10
# places in Results.counts
STEPS, PHASE, ROW, LAST_CONTACT, BAD_STEPS, CONTACT_STEPS, DIVIDE = 0, 1, 2, 3, 4, 5, 6
COUNTS = 7
#: where rows are few steps apart, contacts out of reach are looked for that often; they stay so until one is touched
_CERTIFY_STEPS = 32
#: blocks of one call of the block kernel, at most
BLOCKS = 64
#: columns of Results.energy
ENERGY_COLUMNS = ("stored", "residual", "viscous", "contact", "injected")


class RunTables(NamedTuple):
    """What the kernels of a run work with: addresses of models, of the state and of what they step with. Results follow."""

    watched: int
    apart: int
    whole: int
    part: int
    lifted: int
    state: int
    stepping: int  # scratch of steps one by one, …
    parting: int  # … of parts of a step, …
    blocks: int  # … of blocks, …
    watching: int  # … and of blocks with displacements of the contacts
    factor: Annotated[np.ndarray, f8("modes")]
    heights: Annotated[np.ndarray, f8("heights")]  # (n + 1,) of the obstacle [m], or none
    records: Annotated[np.ndarray, f8("steps, contacts")]
    part_records: Annotated[np.ndarray, f8("parts, contacts")]
    before: Annotated[np.ndarray, f8("3, modes")]
    risen: Annotated[np.ndarray, f8("1")]


run_tables, results_of = opener(RunTables), opener(Results, words(RunTables))


@njit(cache=True, nogil=True)
def write_output(study: int) -> None:
    """One row of every result, from the state as it is and the contact forces recorded since the row before."""
    r, out = run_tables(study), results_of(study)
    m, s = string_model(r.watched), string_state(r.state)
    row, contacts, q = out.counts[ROW], m.contacts.size, s.q[: m.modes]
    for p in range(m.outputs.points):
        out.u[row, p] = dot(m.outputs.weights[p], q)
    for c in range(contacts):
        out.contact_u[row, c] = place_of(m, s, c, q)
    _close_row(study)


@njit(inline="always")
def _softness(m, c: int) -> float:
    """How deep a contact gives way before it is rigid [m]."""
    return m.contacts.layers[DEPTH, c] if m.contacts.layers.shape[1] > 0 else 0.0


@njit(**INNER)
def _close_row(study: int) -> None:
    """What a row has besides displacements: forces, penetration, energies."""
    r, out = run_tables(study), results_of(study)
    m, s = string_model(r.whole), string_state(r.state)
    row = out.counts[ROW]
    scale = 1.0 if m.law == EXACT_HOLD else 1.0 / m.dt
    steps = out.counts[PHASE]
    for c in range(m.contacts.size):
        out.sums[PENETRATION] = max(out.sums[PENETRATION], s.eta[c] - _softness(m, c) - out.contact_u[row, c])
        total = 0.0
        for t in range(steps):
            total += r.records[t, c]
        out.contact_force[row, c] = total / steps * scale if steps > 0 else s.force[c]
    if out.energy.shape[0] > 0:
        for k in range(5):
            out.energy[row, k] = out.sums[k]
    out.counts[ROW] = row + 1
    out.counts[PHASE] = 0


@njit(cache=True, nogil=True)
def certify_watch(study: int) -> None:
    """Clear Scratch.watch of contacts that free motion cannot reach from here; exact-hold only."""
    r = run_tables(study)
    m, s, w = string_model(r.whole), string_state(r.state), scratch_of(r.stepping)
    contacts, q, v = m.contacts.size, s.q[: m.modes], s.v[: m.modes]
    for c in range(contacts):
        w.watch[c] = 1
    if m.law == EXACT_HOLD and contacts > 1:
        amplitude = w.modes.amplitude[: m.modes]
        amplitudes(m.omega, m.sigma, q, v, amplitude)
        for c in range(contacts):
            # the bound is a sum of N roundings too: leave it a margin
            if reach(m.contacts.shapes[c], amplitude) * (1.0 + 1e-9) < -m.contacts.eta[c]:
                w.watch[c] = 0
            elif r.part_records.shape[0] > 1:
                s.u[c] = dot(m.contacts.shapes[c], q)


@njit(cache=True, nogil=True)
def advance_study(study: int, n_steps: int) -> None:
    """`driver.run`, compiled: n steps, or as many as there are rows for."""
    r, out = run_tables(study), results_of(study)
    m, s, w = string_model(r.whole), string_state(r.state), scratch_of(r.stepping)
    every, contacts, fingered = r.records.shape[0], m.contacts.size, s.finger[0].on != 0
    ledger = out.energy.shape[0] > 0
    moves = r.heights.size > 0
    count = 1 if moves else r.part_records.shape[0]
    for c in range(contacts):  # model and finger may be others than in the call before
        w.watch[c] = 1
    blocks = string_model(r.watched)
    tabled = not has_answer(blocks) and blocks.contacts.lags.shape[0] == contacts
    in_blocks = tabled and not (ledger or moves or fingered) and (count == 1 or contacts == 1)
    s.counts[CERTAIN] = 0
    done = int(np.int64(0))  # literals would have kernels that are called with it compiled once more
    while done < n_steps and out.counts[ROW] < out.u.shape[0]:
        if in_blocks:
            some = _run_blocks(study, n_steps - done, count)
            if some > 0:
                done += some
                continue
            s.counts[CERTAIN] = 0
            for c in range(contacts):  # blocks before may have touched what was out of reach
                w.watch[c] = 1
        phase = out.counts[PHASE]
        some = int(np.int64(1))
        if count > 1 and (ledger or fingered or contacts == 1):
            divided_step(study, done * count)
        elif ledger:
            w.watch[:] = 1
            weighed_step(study, r.whole, r.stepping, done, phase)
        elif count > 1:
            some = min(n_steps - done, every - phase)
            if some > 8 or out.counts[STEPS] % _CERTIFY_STEPS == 0:
                certify_watch(study)
            record = r.records[phase : phase + some]
            status = advance_substepped(r.whole, r.part, r.state, r.parting, count, out.counts[DIVIDE : DIVIDE + 1], record)
            if status != SOLVED:
                out.counts[BAD_STEPS] += 1
        else:
            some = min(n_steps - done, every - phase)
            model = r.whole
            if moves:
                some = int(np.int64(1))
                _rise(study, r.heights[done], r.heights[done + 1])
                if m.law != EXACT_HOLD:
                    model = r.lifted
            if moves or fingered:
                w.watch[:] = 1
            elif some > 8 or out.counts[STEPS] % _CERTIFY_STEPS == 0:
                certify_watch(study)
            status = one_by_one(model, r.state, r.stepping, done, phase, some)
            if moves:
                _risen(study, r.heights[done], r.heights[done + 1])
            if status != SOLVED:
                out.counts[BAD_STEPS] += 1
        for t in range(some):
            touched = False
            for c in range(contacts):
                if r.records[phase + t, c] > 0.0:
                    touched = True
            if touched:
                out.counts[LAST_CONTACT] = out.counts[STEPS] + t + 1
                out.counts[CONTACT_STEPS] += 1
        done += some
        out.counts[STEPS] += some
        out.counts[PHASE] += some
        if out.counts[PHASE] == every:
            write_output(study)


@njit(**INNER)
def _run_blocks(study: int, n_steps: int, parts: int) -> int:
    """As many of the next n steps, each of `parts` parts, as one call can do in blocks; how many these are.

    Blocks whose last part is a row's give nothing but forces on the way (`apart`): no row may lie within a block, so one
    call goes on to a row at the latest and row and block must begin together; where they are not, the kernel gives what
    belongs into a row at every step.
    """
    r, out = run_tables(study), results_of(study)
    every, contacts, points = r.records.shape[0], r.records.shape[1], out.u.shape[1]
    phase = out.counts[PHASE]
    apart = every * parts % BLOCK == 0
    if apart and phase * parts % BLOCK != 0:
        return 0
    most = min(n_steps, (out.u.shape[0] - out.counts[ROW]) * every - phase)
    if apart:
        most = min(most, every - phase)
    blocks = min(BLOCKS, most * parts // BLOCK)
    while blocks * BLOCK % parts != 0:
        blocks -= 1
    if blocks <= 0:
        return 0
    steps = blocks * BLOCK
    w = scratch_of(r.blocks if apart else r.watching)
    carried = int(np.int64(0))
    if apart:
        status = advance(r.apart, r.state, r.blocks, steps, carried)
    else:
        status = advance(r.watched, r.state, r.watching, steps, carried)
    if status != SOLVED:
        out.counts[BAD_STEPS] += 1
    force = w.record
    for t in range(steps // parts):
        last = (t + 1) * parts - 1
        touched = False
        for c in range(contacts):
            total = 0.0
            for k in range(t * parts, last + 1):
                total += force[k * contacts + c]
            r.records[out.counts[PHASE], c] = total / parts
            touched = touched or total > 0.0
        out.counts[STEPS] += 1
        out.counts[PHASE] += 1
        if touched:
            out.counts[LAST_CONTACT] = out.counts[STEPS]
            out.counts[CONTACT_STEPS] += 1
        if out.counts[PHASE] == every:
            if apart:
                write_output(study)
            else:
                row = out.counts[ROW]
                for p in range(points):
                    out.u[row, p] = w.out[p * steps + last]
                for c in range(contacts):
                    out.contact_u[row, c] = w.contact_u[last * contacts + c]
                _close_row(study)
    return steps // parts


@njit(**INNER)
def divided_step(study: int, begin: int) -> None:
    """One step, in parts where `substeps` says so or a finger is on, which is at path[begin]; weighed if asked for."""
    r, out = run_tables(study), results_of(study)
    m, s, w = string_model(r.whole), string_state(r.state), scratch_of(r.stepping)
    phase, count, contacts, q = out.counts[PHASE], r.part_records.shape[0], m.contacts.size, s.q[: m.modes]
    ledger = out.energy.shape[0] > 0
    w.watch[:] = 1
    after = w.modes.after[:contacts]
    whole = s.finger[0].on == 0 and contacts > 1 and out.counts[DIVIDE] == 0
    if whole and clear_step(r.whole, r.state, r.stepping):
        weighed_step(study, r.whole, r.stepping, begin, phase)
    else:
        for k in range(count):
            if ledger:
                weighed_step(study, r.part, r.parting, begin + k, k)
            else:
                status = one_by_one(r.part, r.state, r.parting, begin + k, k, int(np.int64(1)))
                if status != SOLVED:
                    out.counts[BAD_STEPS] += 1
        for c in range(contacts):
            r.records[phase, c] = 0.0
            for k in range(count):
                r.records[phase, c] += r.part_records[k, c] / count
            after[c] = dot(m.contacts.shapes[c], q)
    touched = False
    for c in range(contacts):
        touched = touched or r.records[phase, c] > 0.0
    out.counts[DIVIDE] = 1 if touched or arriving(contacts, s.eta, s.u, after) else 0
    put(s.u, after)


@njit(**INNER)
def _raise(study: int, displacement: float) -> None:
    m, s = string_model(run_tables(study).whole), string_state(run_tables(study).state)
    for c in range(m.contacts.size):
        s.eta[c] = m.contacts.eta[c] + displacement


@njit(**INNER)
def _rise(study: int, before: float, after: float) -> None:
    """Heights for a step in which the obstacle goes from `before` to `after` [m].

    Exact-hold takes the heights at the end of the step. Moreau–Jean's law is one of velocities relative to the obstacle,
    whose own is w⁻ over the step before and w⁺ over this one:

        0 ≤ (S v⁺ − w⁺) + e (S v − w⁻)  ⊥  p ≥ 0,   active where the gap now, or predicted with S v − w⁻, is closed.

    For the kernel that is restitution 1 (RunTables.lifted) after the velocity e (S v − w⁻) − w⁺, over heights that leave the
    gap the same. `_risen` belongs behind the step.
    """
    r = run_tables(study)
    m, s = string_model(r.whole), string_state(r.state)
    if m.law == EXACT_HOLD:
        _raise(study, after)
        return
    old, new = r.risen[0] / m.dt, (after - before) / m.dt
    for c in range(m.contacts.size):
        relative = s.v_contact[c] - old
        s.v_contact[c] = m.restitution * relative - new
        s.eta[c] = m.contacts.eta[c] + before
        if m.law == MOREAU_JEAN_FILTERED:
            s.eta[c] += 0.5 * m.dt * (s.v_contact[c] - relative)


@njit(**INNER)
def _risen(study: int, before: float, after: float) -> None:
    """The obstacle as it is after the step that `_rise` prepared."""
    _raise(study, after)
    run_tables(study).risen[0] = after - before


@njit(**INNER)
def weighed_step(study: int, model: int, scratch: int, begin: int, at: int) -> None:
    """One step with its place in the energy ledger; heights from number `begin` on, forces to row `at` of the record."""
    r, out = run_tables(study), results_of(study)
    m, s = string_model(model), string_state(r.state)
    n, contacts = m.modes, m.contacts.size
    omega, gain, factor = m.omega[:n], m.rows[5, :n], r.factor
    q, v, weights, finger = s.q[:n], s.v[:n], s.grip.weights[:n], s.finger[0]
    hold = m.law == EXACT_HOLD
    before_q, before_v, w_free = r.before[0], r.before[1], r.before[2]
    put(before_q, q)
    put(before_v, v)
    finger_u = dot(weights, q) if finger.on else 0.0
    moves = r.heights.size > 0
    stepped = model
    if moves:
        _rise(study, r.heights[begin], r.heights[begin + 1])
        if not hold:
            stepped = r.lifted
    status = one_by_one(stepped, r.state, scratch, begin, at, int(np.int64(1)))
    if moves:
        _risen(study, r.heights[begin], r.heights[begin + 1])
    if status != SOLVED:
        out.counts[BAD_STEPS] += 1
    worked = 0.0
    injected = 0.0  # by the finger
    lifted = 0.0  # by the obstacle
    if not hold:
        for j in range(n):
            w_free[j] = m.rows[2, j] * before_q[j] + m.rows[3, j] * before_v[j]
    for c in range(contacts):
        shape = m.contacts.shapes[c, :n]
        after = dot(shape, q)
        depth = s.eta[c] - after
        for d in range(contacts):
            depth -= m.contacts.residual[c, d] * s.force[d]
        out.sums[PENETRATION] = max(out.sums[PENETRATION], depth - _softness(m, c))
        strength = s.force[c]
        if strength > 0.0:
            if moves:
                mean = strength if hold else strength / m.dt
                lifted += mean * (s.eta[c] - (m.contacts.eta[c] + r.heights[begin]))
            if hold:
                worked += strength * (after - dot(shape, before_q))
            else:
                worked += impulse_work(shape, gain, omega, factor, m.mu, m.dt, before_q, w_free, v, strength)
    if finger.on:
        push = finger.push
        if hold:
            injected = push * (dot(weights, q) - finger_u)
        else:
            injected = impulse_work(weights, gain, omega, factor, m.mu, m.dt, before_q, w_free, v, push)
    after_stored = stored(m.law, omega, factor, m.mu, m.dt, q, v)
    after_spring = spring(m.contacts.residual, s.force) + held_by_layers(model, r.state)
    sums = out.sums
    rise = after_stored + after_spring - sums[STORED] - sums[SPRING] - injected - lifted
    viscous = sums[STORED] - after_stored + worked + injected
    contact = lifted - worked - (after_spring - sums[SPRING])
    sums[STORED] = after_stored
    sums[SPRING] = after_spring
    sums[VISCOUS] += viscous
    sums[CONTACT] += contact
    sums[INJECTED] += injected + lifted
    # a finger or obstacle that brings energy raises the scale only as far as it did
    scale = sums[INITIAL] + max(0.0, sums[INJECTED])
    if scale > 0.0:
        sums[RISE] = max(sums[RISE], rise / scale)
        sums[LEAST_VISCOUS] = min(sums[LEAST_VISCOUS], viscous / scale)
        sums[LEAST_CONTACT] = min(sums[LEAST_CONTACT], contact / scale)
