"""One string through time: its internal steps, its output into its row of the span, levels, certificates, sleep.

Every string writes into a row of its own, so that strings can be worked off in any order and by any thread; the rows are
added up elsewhere, in order.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numba import cfunc, njit

from synth.engine.coefficients import (
    damping,
    grip_of,
    lags_of,
    matrix_of,
    omega_of,
    out_lags_of,
    refresh,
    rest_state,
    rows_of,
    shapes_of,
    weights_of,
)
from synth.engine.core import bank_of, scratch_of, settings_of, shared_of, state_of
from synth.engine.expression import bend_of, follow, height_of
from synth.engine.flight import fade, fly, row_of, take_off, touch_down
from synth.engine.layout import (
    BEGIN,
    BLOWN_UP,
    CHECK_EVERY,
    CORE,
    FIRST_QUANTUM,
    NO_FINGER,
    QUANTA,
    QUANTUM,
    SPARE,
    STEP,
    STRETCH,
    TASK,
    UNTIL,
)
from synth.engine.output import collect
from synth.engine.strings import damp, finger_done, sleep
from synth.native.views import call_back
from synth.solver.blocks import CERTIFY_FROM, BlockWork, advance_blocks, fly_blocks, forget, press_blocks
from synth.solver.fingers import advance_under_finger
from synth.solver.kernels import Finger, Work, advance, amplitudes, reach
from synth.solver.lanes import BLOCK, padded
from synth.solver.laws import EXACT_HOLD
from synth.solver.vectors import FAST, dot, put
from synth.units import LN_1000

#: a mode is put to rest when its largest possible output is below this (−160 dBFS)
PRUNE_BELOW = 1e-8
#: …and, where it may be moved by a contact again, when it moves no point of the string further than this [m]
PRUNE_WITHIN_M = 1e-9
#: T60 of a string that is spared [s]
SPARE_S = 0.1
#: a string sleeps when its output is certain to stay below this (−100 dBFS; typically −120)
SLEEP_BELOW = 1e-5
#: a string has blown up when it is displaced by more than so many of its lengths, or moves faster than so many times the
#: speed of its waves (root mean squares along it): at one, slopes are about 1 and no string obeys linear equations any
#: more; plucked strings stay below a hundredth. Only a scheme that gains energy, or a state that is none, comes there
TOO_FAR = 10.0


def _work_on(core: int, desk: int, s: int, _: int) -> None:
    task = shared_of(core).task
    kind = task[TASK]
    if kind == BEGIN:
        _begin_quantum(core, desk, s, 0)
    elif kind == STRETCH:
        me = state_of(core).sounding[s]
        _advance_string(core, desk, s, me.reached, task[UNTIL] - me.reached)
        me.reached = task[UNTIL]
    else:
        for k in range(task[QUANTA]):
            _begin_quantum(core, desk, s, k)
            if not state_of(core).sounding[s].awake:
                break
            _advance_string(core, desk, s, k * QUANTUM, int(np.int64(QUANTUM)))  # a literal would compile it once more
            if not state_of(core).sounding[s].awake:
                break


@cache
def _compiled() -> tuple[Any, Any]:
    """`_work_on` and `_steps` as C functions of four int64, kept for as long as their addresses are in use."""
    compile_entry = cfunc("void(int64, int64, int64, int64)", cache=True)
    return compile_entry(_work_on), compile_entry(_steps)


def entries() -> tuple[int, int]:
    """Addresses of `_work_on` (core, desk, s, –) and `_steps` (core, desk, s, steps), compiled on first use.

    Called by address: every function that contains the kernels takes seconds to compile, so none but `_steps` does, and
    neither `process` nor the loop of a worker contains `_work_on`.
    """
    work_on, steps = _compiled()
    return work_on.address, steps.address


@njit(**CORE)
def _begin_quantum(core: int, desk: int, s: int, k: int) -> None:
    """What is decided about an awake string at the start of quantum k of the span."""
    state, shared = state_of(core), shared_of(core)
    me = state.sounding[s]
    follow(core, s)
    bend = bend_of(core, s, shared.bends[k, me.channel], shared.bends[k, state.channels[me.channel].master])
    height = height_of(core, s, shared.heights[k, bank_of(core).strings[s].part])
    if me.bend != bend or me.height != height:
        _follow_controls(core, s, bend, height)
    if (shared.task[FIRST_QUANTUM] + k) % CHECK_EVERY == 0:
        _check(core, desk, s)


@njit(**CORE)
def _follow_controls(core: int, s: int, bend: float, height: float) -> None:
    """Take over another pitch bend and obstacle height."""
    me = state_of(core).sounding[s]
    me.bend = bend
    me.height = height
    me.n = bank_of(core).models[me.model].n
    me.stale = 1


@njit(**CORE)
def _advance_string(core: int, desk: int, s: int, start: int, frames: int) -> None:
    """`frames` output frames of one awake string from frame `start` of the span, into its row."""
    fixed = bank_of(core).strings[s]
    me = state_of(core).sounding[s]
    if me.flying and (me.stale or not me.free):
        touch_down(core, desk, s)
    if me.flying:
        fly(core, desk, s, start, frames)
    else:
        row = row_of(core, s, start, frames)
        at = 0
        while at < row.size:
            steps = row.size - at
            if me.stale:
                refresh(core, desk, s)
            if me.phase != NO_FINGER:
                steps = min(steps, me.finger_steps - me.finger_step)
            call_back(shared_of(core).task[STEP], core, desk, s, steps)
            me.base = collect(core, desk, s, steps, fixed.factor, me.base, row[at:])
            at += steps
            if me.phase != NO_FINGER and me.finger_step >= me.finger_steps:
                finger_done(core, desk, s)
    fade(core, s, start, frames)
    if not (_moves_like_a_string(core, s) and _sounds(core, s, start)):
        _silence(core, s, start)


@njit(**CORE)
def _moves_like_a_string(core: int, s: int) -> bool:
    """Whether displacement and velocity are finite and within `TOO_FAR`."""
    bank, state = bank_of(core), state_of(core)
    me = state.sounding[s]
    off = bank.strings[s].off
    model = bank.models[me.model]
    q, v = state.q[off : off + me.n], state.v[off : off + me.n]
    length = model.length
    # modes are normalised: ∫u² dx = Σ q², so that the mean square is Σ q²/L; a bend upwards raises the waves' speed
    tension = model.tension * 2.0 ** (max(0.0, me.bend) / 6.0)
    far, fast = TOO_FAR * TOO_FAR * length * length, TOO_FAR * TOO_FAR * tension / model.mu
    return dot(q, q) <= far * length and dot(v, v) <= fast * length


@njit(**CORE)
def _span_of(place: int, begin: int, end: int, start: int):
    """(first, past the last) element of what a row at `place` holds, from `begin` to `end`, not before `start`."""
    first = max(begin, start)
    return place + first, place + max(first, end)


@njit(**CORE)
def _sounds(core: int, s: int, start: int) -> bool:
    """Whether what the string has given since frame `start` of the span is finite and below `BLOWN_UP`."""
    shared = shared_of(core)
    fixed = bank_of(core).strings[s]
    me = state_of(core).sounding[s]
    first, end = _span_of(fixed.row, me.row_from, me.row_to, start * fixed.factor)
    row = shared.rows[first:end]
    first, end = _span_of(fixed.direct, me.direct_from, me.direct_to, start)
    direct = shared.direct[first:end]
    return dot(row, row) <= BLOWN_UP * BLOWN_UP and dot(direct, direct) <= BLOWN_UP * BLOWN_UP


@njit(**CORE)
def _silence(core: int, s: int, start: int) -> None:
    """The string has blown up: what it has given since frame `start` is taken back, and it sleeps until it is plucked."""
    bank, state, shared = bank_of(core), state_of(core), shared_of(core)
    fixed = bank.strings[s]
    me = state.sounding[s]
    first, end = _span_of(fixed.row, me.row_from, me.row_to, start * fixed.factor)
    shared.rows[first:end] = 0.0
    first, end = _span_of(fixed.direct, me.direct_from, me.direct_to, start)
    shared.direct[first:end] = 0.0
    contacts = slice(fixed.coff, fixed.coff + fixed.cmax)
    state.u[contacts] = 0.0
    state.vc[contacts] = 0.0
    state.force[contacts] = 0.0
    state.margin[contacts] = 0.0
    state.bounds[contacts] = 0.0
    state.finger_state[s] = 0.0
    me.base = me.rest
    me.fade_at = me.fade_to = 0
    me.flying = 0
    me.silenced += 1
    sleep(core, s)


def _steps(core: int, desk: int, s: int, steps: int) -> None:
    """Internal steps of one string; its outputs go to Scratch.out, a row of `steps` for each."""
    state = state_of(core)
    me = state.sounding[s]
    moved = me.n
    blocks = steps // BLOCK
    if me.phase != NO_FINGER:
        _follow_path(core, desk, s, steps)
    if blocks > 0:
        _in_blocks(core, desk, s, blocks, steps)
    if blocks * BLOCK < steps:
        if not me.free:
            me.n = bank_of(core).models[me.model].n
        _one_by_one(core, desk, s, blocks * BLOCK, steps)
        me.certain = 0
    me.mode_steps += max(moved, me.n) * steps


@njit(**CORE)
def _follow_path(core: int, desk: int, s: int, steps: int) -> None:
    """Scratch.path: where the finger is before these steps and after each of them."""
    scratch = scratch_of(desk)
    me = state_of(core).sounding[s]
    first = me.finger_step
    turn = math.pi / me.finger_steps
    cosine, sine = math.cos(turn * first), math.sin(turn * first)
    further, aside = math.cos(turn), math.sin(turn)
    half = 0.5 * (me.finger_to - me.finger_from)
    for t in range(steps + 1):
        scratch.path[t] = me.finger_from + half * (1.0 - cosine)
        cosine, sine = cosine * further - sine * aside, sine * further + cosine * aside
    me.finger_step = first + steps


@njit(inline="always")
def _finger_of(core: int, desk: int, s: int, modes: int, begin: int):
    """The string's finger, or none, from step `begin` of the path on."""
    bank, state, scratch = bank_of(core), state_of(core), scratch_of(desk)
    me = state.sounding[s]
    off, coff = bank.strings[s].off, bank.strings[s].coff
    return Finger(
        1 if me.phase != NO_FINGER else 0,
        state.finger_weights[off : off + modes],
        state.finger_coupling[coff : coff + bank.models[me.model].contacts],
        me.finger_own,
        me.finger_k,
        me.finger_r,
        scratch.path[begin:],
        state.finger_state[s],
    )


@njit(**CORE)
def _in_blocks(core: int, desk: int, s: int, blocks: int, steps: int) -> None:
    """The first blocks of `steps` steps."""
    bank, state, settings, scratch = bank_of(core), state_of(core), settings_of(core), scratch_of(desk)
    me = state.sounding[s]
    fixed = bank.strings[s]
    part = bank.parts[fixed.part]
    model = bank.models[me.model]
    c, off, coff, cap = model.contacts, fixed.off, fixed.coff, model.cap
    hold = settings.law == EXACT_HOLD
    q, v = state.q[off : off + cap], state.v[off : off + cap]
    rows, shapes = rows_of(core, s), shapes_of(core, s)
    first, points = 1 - part.use_q, part.use_q + part.use_v
    weights = weights_of(core, s, first, points)
    out = scratch.out[: points * steps].reshape(points, steps)
    fingered = me.phase != NO_FINGER
    if not fingered and (c == 0 or me.free):
        fly_blocks(blocks, padded(me.n), rows, q, v, weights, part.use_q, out)
        return
    eta, lags, out_lags = state.eta[coff : coff + c], lags_of(core, s), out_lags_of(core, s, first, points)
    forces = scratch.forces[: (c + 1) * BLOCK].reshape(c + 1, BLOCK)
    if c == 1 and hold and not fingered:
        press_blocks(
            blocks, cap, rows, shapes[0], eta[0], lags[0, 0], q, v, weights, part.use_q, out_lags, out,
            scratch.block[0], forces[0],
            scratch.path[:0], scratch.path[:0],
        )  # fmt: skip
        state.force[coff] = forces[0, BLOCK - 1]
        return
    u, vc = state.u[coff : coff + c], state.vc[coff : coff + c]
    if not hold:
        for k in range(c):
            u[k] = dot(shapes[k], q)
            vc[k] = dot(shapes[k], v)
    certified = 1 if hold and c >= CERTIFY_FROM else 0
    work = BlockWork(
        scratch.block, scratch.block_u[: (c + 1) * BLOCK].reshape(c + 1, BLOCK), forces, scratch.near,
        state.looked[coff : coff + c], state.until[coff : coff + c], state.margin[coff : coff + c],
        state.bounds[coff : coff + c], state.renewed[coff : coff + c],
        state.clock[s : s + 1], state.moving[s : s + 1], scratch.block_matrix, scratch.b, scratch.z, scratch.a,
        scratch.order, scratch.enabled, scratch.active, scratch.moved[: 3 * cap].reshape(3, cap),
    )  # fmt: skip
    state.moving[s] = padded(me.n)
    if not me.certain:
        forget(work)
        me.certain = 1
    dt = 1.0 / (settings.rate_hz * fixed.factor)
    record = scratch.record.reshape(-1)[: blocks * BLOCK * c].reshape(blocks * BLOCK, c)
    omega = omega_of(core, s)
    if fingered:
        bad = advance_under_finger(
            blocks, settings.law, cap, dt, settings.restitution, rows, omega, shapes, eta, lags, certified, q, v, u, vc,
            _finger_of(core, desk, s, cap, 0), grip_of(core, s, first, points), weights, part.use_q, out_lags, out, record,
            work,
        )  # fmt: skip
    else:
        bad = advance_blocks(
            blocks, settings.law, cap, dt, settings.restitution, rows, omega, shapes, eta, lags, certified, q, v, u, vc,
            weights, part.use_q, out_lags, out, record, record[:0], work,
        )  # fmt: skip
    put(state.force[coff : coff + c], record[blocks * BLOCK - 1])
    me.n = min(model.n, state.moving[s])
    if bad != 0:
        me.unsolved += 1


@njit(**CORE)
def _one_by_one(core: int, desk: int, s: int, begin: int, end: int) -> None:
    """Steps number `begin` to `end`, one at a time: what is left over of a block."""
    bank, state, settings, scratch = bank_of(core), state_of(core), settings_of(core), scratch_of(desk)
    me = state.sounding[s]
    fixed = bank.strings[s]
    part = bank.parts[fixed.part]
    model = bank.models[me.model]
    n, c, off, coff = me.n, model.contacts, fixed.off, fixed.coff
    steps = end - begin
    q, v = state.q[off : off + n], state.v[off : off + n]
    shapes = shapes_of(core, s)
    points = part.use_q + part.use_v
    out = scratch.out[: points * end].reshape(points, end)
    weights = weights_of(core, s, 0, 2)
    u, vc = state.u[coff : coff + c], state.vc[coff : coff + c]
    for k in range(c):
        u[k] = dot(shapes[k], q)
        vc[k] = dot(shapes[k], v)
        scratch.watch[k] = 0 if me.free else 1
        scratch.active[k] = 1 if state.force[coff + k] > 0.0 else 0
    work = Work(
        scratch.y[:c],
        scratch.b[:c],
        scratch.z[:c],
        scratch.a,
        scratch.factor,
        scratch.order,
        scratch.enabled[:c],
        scratch.active[:c],
    )
    bad = advance(
        settings.law,
        steps,
        1.0 / (settings.rate_hz * fixed.factor),
        settings.restitution,
        rows_of(core, s),
        shapes,
        state.eta[coff : coff + c],
        matrix_of(core, s),
        q,
        v,
        u,
        vc,
        state.force[coff : coff + c],
        _finger_of(core, desk, s, n, begin),
        scratch.watch[:c],
        weights[: part.use_q],
        weights[2 - part.use_v :],
        out[0, begin:].reshape(steps, 1),
        out[points - 1, begin:].reshape(steps, 1),
        scratch.record[:0],
        scratch.record[:0],
        work,
    )
    if bad != 0:
        me.unsolved += 1


@njit(fastmath=FAST, **CORE)
def _energy_norm(omega, q, v, q_rest) -> float:
    total = 0.0
    for j in range(q.size):
        d = omega[j] * (q[j] - q_rest[j])
        total += d * d + v[j] * v[j]
    return math.sqrt(total)


@njit(**CORE)
def _check(core: int, desk: int, s: int) -> None:
    """Level, certificate that contacts are out of reach, rest for inaudible modes, flight, sleep."""
    bank, state, settings, scratch = bank_of(core), state_of(core), settings_of(core), scratch_of(desk)
    me = state.sounding[s]
    if me.phase != NO_FINGER or me.stale:
        return
    fixed = bank.strings[s]
    part = bank.parts[fixed.part]
    model = bank.models[me.model]
    n, off, m_off = me.n, fixed.off, model.off
    q, v = state.q[off : off + n], state.v[off : off + n]
    omega, sigma = bank.omega[m_off : m_off + n], bank.sigma[m_off : m_off + n]
    rest_state(core, me, model, scratch.q)
    me.level = model.output_bound * _energy_norm(omega, q, v, scratch.q[:n])
    if part.use_q and not part.use_v:
        me.level += abs(me.base - me.rest)
    if me.level < SLEEP_BELOW:
        sleep(core, s)
        return
    if me.level < state.meters[SPARE] and not me.held and me.hand < LN_1000 / SPARE_S:
        damp(core, s, SPARE_S)
        return
    if not settings.economy or settings.law != EXACT_HOLD:
        return  # the amplitudes below are those of v = q̇
    omega = omega_of(core, s)[:n]
    dt = 1.0 / (settings.rate_hz * fixed.factor)
    for j in range(n):
        scratch.sigma[j] = damping(sigma[j], me.hand, omega[j] * dt if me.bend != 0.0 else 0.0)
    sigma = scratch.sigma[:n]
    amplitude = scratch.amplitude
    if not me.free:  # what is certain to be out of reach stays so until something touches the string
        me.free = 1 if _nothing_in_reach(core, desk, s) else 0
        if me.free == 0 and model.contacts == 1:
            return  # touched again and again, and all modes with it
    peak = math.sqrt(2.0 / model.length)  # of a mode shape
    moved = False
    while n > 1:
        j = n - 1
        amplitudes(omega[j:n], sigma[j:n], q[j:n], v[j:n], amplitude)
        heard = abs(bank.weights[2 * m_off + j]) + abs(bank.weights[2 * m_off + model.cap + j]) * omega[j]
        if heard * amplitude[0] >= PRUNE_BELOW or (me.free == 0 and peak * amplitude[0] >= PRUNE_WITHIN_M):
            break
        moved = moved or q[j] != 0.0 or v[j] != 0.0
        q[j] = 0.0
        v[j] = 0.0
        n -= 1
    if moved:
        me.certain = 0  # if by nanometres
    me.n = n
    if me.free and not me.flying and not me.altered and fixed.direct_bus >= 0:
        take_off(core, desk, s)


@njit(**CORE)
def _nothing_in_reach(core: int, desk: int, s: int) -> bool:
    """Whether free flight, with Scratch.sigma, touches no contact any more."""
    bank, state, scratch = bank_of(core), state_of(core), scratch_of(desk)
    me = state.sounding[s]
    fixed = bank.strings[s]
    model = bank.models[me.model]
    n, off = me.n, fixed.off
    for k in range(model.contacts):
        if state.eta[fixed.coff + k] >= 0.0:
            return False
    amplitude = scratch.amplitude[:n]
    if model.contacts:
        q, v = state.q[off : off + n], state.v[off : off + n]
        amplitudes(omega_of(core, s)[:n], scratch.sigma[:n], q, v, amplitude)
    shapes = shapes_of(core, s)
    for k in range(model.contacts):
        if reach(shapes[k], amplitude) >= -0.999 * state.eta[fixed.coff + k]:
            return False
    return True
