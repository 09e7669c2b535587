"""One string through time: its internal steps, its output into its row of the span, levels, certificates, sleep.

Every string writes into a row of its own, so that strings can be worked off in any order and by any thread; the rows are
added up elsewhere, in order.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from numba import cfunc, njit

from synth.engine.coefficients import refresh, rest_state
from synth.engine.layout import (
    BEGIN,
    CHECK_EVERY,
    CORE,
    FIRST_QUANTUM,
    FRAME,
    FRAMES,
    NO_FINGER,
    QUANTA,
    QUANTUM,
    STRETCH,
    TASK,
)
from synth.engine.strings import finger_done, sleep
from synth.engine.views import bank_of, scratch_of, settings_of, shared_of, state_of
from synth.solver.kernels import Finger, Work, advance, advance_free, advance_one, amplitudes, cull, reach
from synth.solver.laws import EXACT_HOLD
from synth.solver.vectors import FAST, dot

#: a mode leaves free flight for good when its largest possible output is below this (−160 dBFS)
PRUNE_BELOW = 1e-8
#: a string sleeps when its output is certain to stay below this (−100 dBFS; typically −120)
SLEEP_BELOW = 1e-5
#: internal steps for which contacts out of reach are not looked at, where a string has this many contacts or more
CULL_STEPS = 32
CULL_FROM = 3
#: how fast the output's rest line follows a change of fret [s]
BASE_S = 0.05


def _work_on(core: int, desk: int, s: int) -> None:
    task = shared_of(core).task
    kind = task[TASK]
    if kind == BEGIN:
        _begin_quantum(core, desk, s, 0)
    elif kind == STRETCH:
        _advance_string(core, desk, s, task[FRAME], task[FRAMES])
    else:
        for k in range(task[QUANTA]):
            _begin_quantum(core, desk, s, k)
            if not state_of(core).sounding[s].awake:
                break
            _advance_string(core, desk, s, k * QUANTUM, QUANTUM)


@cache
def work_on() -> Any:
    """Compiled on first use: a C function of (core, desk, s) that does what Shared.task asks for one awake string.

    Called by its address, so that neither `process` nor the loop of a worker contains the kernels: every function that
    contains them takes seconds to compile.
    """
    return cfunc("void(int64, int64, int64)", cache=True)(_work_on)


@njit(**CORE)
def _begin_quantum(core: int, desk: int, s: int, k: int) -> None:
    """What is decided about an awake string at the start of quantum k of the span."""
    state, shared = state_of(core), shared_of(core)
    me = state.sounding[s]
    bend = shared.bends[k, me.channel]
    height = shared.heights[k, bank_of(core).strings[s].part]
    if me.bend != bend or me.height != height:
        _follow_controls(core, s, bend, height)
    if (shared.task[FIRST_QUANTUM] + k) % CHECK_EVERY == 0:
        _check(core, desk, s)


@njit(**CORE)
def _follow_controls(core: int, s: int, bend: float, height: float) -> None:
    """Take over the pitch bend of the channel and the obstacle height of the part."""
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
    row = shared_of(core).rows[fixed.row :]
    if me.row_from == me.row_to:
        me.row_from = start * fixed.factor
    at = start * fixed.factor
    end = at + frames * fixed.factor
    while at < end:
        steps = end - at
        if me.stale:
            refresh(core, desk, s)
        if me.phase != NO_FINGER:
            steps = min(steps, me.finger_steps - me.finger_step)
        _steps(core, desk, s, steps)
        _collect(core, desk, s, steps, row[at:])
        at += steps
        if me.phase != NO_FINGER and me.finger_step >= me.finger_steps:
            finger_done(core, desk, s)
    me.row_to = end


@njit(**CORE)
def _steps(core: int, desk: int, s: int, steps: int) -> None:
    bank, state, settings, scratch = bank_of(core), state_of(core), settings_of(core), scratch_of(desk)
    me = state.sounding[s]
    fixed = bank.strings[s]
    part = bank.parts[fixed.part]
    model = bank.models[me.model]
    n, c, cap, off, coff = me.n, model.contacts, fixed.cap, fixed.off, fixed.coff
    coef = state.coef[6 * off : 6 * off + 6 * cap].reshape(6, cap)
    q, v = state.q[off : off + n], state.v[off : off + n]
    wq, wv = bank.wq[model.off : model.off + n], bank.wv[model.off : model.off + n]
    fingered = me.phase != NO_FINGER
    me.mode_steps += n * steps
    if not fingered and (c == 0 or me.free):
        advance_free(steps, coef, q, v, wq, wv, part.use_q, part.use_v, scratch.out_q, scratch.out_v)
        return
    eta = state.eta[coff : coff + c]
    if not fingered and c == 1 and settings.law == EXACT_HOLD:
        advance_one(
            steps,
            coef,
            bank.shapes[model.soff : model.soff + n],
            eta[0],
            state.matrix[fixed.goff],
            q,
            v,
            wq,
            wv,
            part.use_q,
            part.use_v,
            scratch.out_q,
            scratch.out_v,
        )
        return
    shapes = bank.shapes[model.soff : model.soff + c * model.n].reshape(c, model.n)
    u, vc = state.u[coff : coff + c], state.vc[coff : coff + c]
    for k in range(c):
        u[k] = dot(shapes[k], q)
        vc[k] = dot(shapes[k], v)
    if fingered:
        first = me.finger_step
        for t in range(steps + 1):
            s01 = (first + t) / me.finger_steps
            scratch.path[t] = me.finger_from + (me.finger_to - me.finger_from) * 0.5 * (1.0 - math.cos(math.pi * s01))
        me.finger_step = first + steps
    finger = Finger(
        1 if fingered else 0,
        state.finger_weights[off : off + n],
        state.finger_coupling[coff : coff + c],
        me.finger_own,
        me.finger_k,
        me.finger_r,
        scratch.path,
        state.finger_state[s],
    )
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
    for k in range(c):
        scratch.active[k] = 1 if state.force[coff + k] > 0.0 else 0
    dt = 1.0 / (settings.rate_hz * fixed.factor)
    matrix = state.matrix[fixed.goff : fixed.goff + c * c].reshape(c, c)
    watch = state.watch[coff : coff + c]
    omega = bank.omega[model.off : model.off + n]
    culling = settings.economy and not fingered and settings.law == EXACT_HOLD and c >= CULL_FROM and me.bend == 0.0
    near = scratch.near[:c] if culling else watch
    out_q, out_v = scratch.out_q.reshape(-1, 1), scratch.out_v.reshape(-1, 1)
    status = 0
    done = 0
    while done < steps:
        part_steps = steps - done
        if culling:
            part_steps = min(part_steps, CULL_STEPS)
            cull(shapes, eta, omega, q, v, part_steps * dt, watch, scratch.amplitude, near)
        bad = advance(
            settings.law,
            part_steps,
            dt,
            settings.restitution,
            coef,
            shapes,
            eta,
            matrix,
            q,
            v,
            u,
            vc,
            state.force[coff : coff + c],
            finger,
            near,
            wq.reshape(1, n)[: part.use_q],
            wv.reshape(1, n)[: part.use_v],
            out_q[done:],
            out_v[done:],
            scratch.record,
            scratch.record,
            work,
        )
        if bad != 0:
            status = bad
        if culling:
            for k in range(c):  # a contact that was certain to be out of reach is so no longer once any is touched
                if near[k] and not watch[k]:
                    watch[k] = 1
        done += part_steps
    if status != 0:
        me.unsolved += 1


@njit(**CORE)
def _collect(core: int, desk: int, s: int, steps: int, row) -> None:
    """The output of the last steps, counted from the slowly followed rest."""
    bank, state, settings, scratch = bank_of(core), state_of(core), settings_of(core), scratch_of(desk)
    me = state.sounding[s]
    fixed = bank.strings[s]
    part = bank.parts[fixed.part]
    if part.use_q and part.use_v:  # pickup: flux ∝ 1/(1 + u/d)², voltage ∝ v/(1 + u/d)³
        for t in range(steps):
            near = max(0.2, 1.0 + scratch.out_q[t] / part.pickup_distance)
            row[t] = scratch.out_v[t] / (near * near * near)
    elif part.use_v:
        for t in range(steps):
            row[t] = scratch.out_v[t]
    else:
        model = bank.models[me.model]
        rest = me.rest
        follow = 1.0 / (BASE_S * settings.rate_hz * fixed.factor)
        base = me.base
        if base + follow * (rest - base) == base:
            for t in range(steps):
                row[t] = scratch.out_q[t] + model.line_output - base
        else:
            for t in range(steps):
                base += follow * (rest - base)
                row[t] = scratch.out_q[t] + model.line_output - base
            me.base = base


@njit(fastmath=FAST, **CORE)
def _energy_norm(omega, q, v, q_rest) -> float:
    total = 0.0
    for j in range(q.size):
        d = omega[j] * (q[j] - q_rest[j])
        total += d * d + v[j] * v[j]
    return math.sqrt(total)


@njit(**CORE)
def _check(core: int, desk: int, s: int) -> None:
    """Level, certificate that contacts are out of reach, pruning of inaudible modes, sleep."""
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
    if not settings.economy or me.bend != 0.0 or me.hand != 0.0 or settings.law != EXACT_HOLD:
        return  # the amplitudes below are those of the model's own ω and σ, and of v = q̇
    if not me.free:  # what is certain to be out of reach stays so until something touches the string
        me.free = 1 if _nothing_in_reach(core, desk, s) else 0
    if me.free:
        while n > 1:
            j = n - 1
            amplitudes(omega[j:n], sigma[j:n], q[j:n], v[j:n], scratch.amplitude)
            heard = (abs(bank.wq[m_off + j]) + abs(bank.wv[m_off + j]) * omega[j]) * scratch.amplitude[0]
            if heard >= PRUNE_BELOW:
                break
            q[j] = 0.0
            v[j] = 0.0
            n -= 1
        me.n = n


@njit(**CORE)
def _nothing_in_reach(core: int, desk: int, s: int) -> bool:
    """Whether free flight touches no contact any more; marks those that it may touch."""
    bank, state = bank_of(core), state_of(core)
    me = state.sounding[s]
    fixed = bank.strings[s]
    model = bank.models[me.model]
    n, off, m_off = me.n, fixed.off, model.off
    amplitude = scratch_of(desk).amplitude[:n]
    if model.contacts:
        amplitudes(
            bank.omega[m_off : m_off + n],
            bank.sigma[m_off : m_off + n],
            state.q[off : off + n],
            state.v[off : off + n],
            amplitude,
        )
    reachable = 0
    for k in range(model.contacts):
        gap = -state.eta[fixed.coff + k]
        if gap <= 0.0:
            reachable += 1
            continue
        shape = bank.shapes[model.soff + k * model.n : model.soff + k * model.n + n]
        near = reach(shape, amplitude) >= 0.999 * gap
        state.watch[fixed.coff + k] = 1 if near else 0
        reachable += near
    return reachable == 0
