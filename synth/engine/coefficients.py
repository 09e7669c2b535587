"""A string's working coefficients: those of its model, the damping hand, the pitch bend and the obstacle's height."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.core import bank_of, scratch_of, settings_of, state_of
from synth.engine.layout import CORE, NO_FINGER, RESPONSE
from synth.solver.blocks import fill_lags, fill_rows
from synth.solver.fingers import Grip, fill_grip
from synth.solver.lanes import ROWS
from synth.solver.laws import EXACT_HOLD, contact_matrix, step_coefficients
from synth.units import LN_1000

#: T60 of a stolen or silenced string, and of what a bend carries beyond half the internal rate [s]
CUT_S = 0.03


@njit(inline="always")
def rows_of(core: int, s: int):
    """(ROWS, cap) coefficients of a string as it is now; see `lanes`."""
    bank, state = bank_of(core), state_of(core)
    me = state.sounding[s]
    model = bank.models[me.model]
    if me.altered:
        own = ROWS * bank.strings[s].off
        return state.rows[own : own + ROWS * model.cap].reshape(ROWS, model.cap)
    return bank.rows[ROWS * model.off : ROWS * (model.off + model.cap)].reshape(ROWS, model.cap)


@njit(inline="always")
def omega_of(core: int, s: int):
    """(cap,) angular frequencies of a string's modes as it is now: its model's, or bent."""
    bank, state = bank_of(core), state_of(core)
    me = state.sounding[s]
    model = bank.models[me.model]
    if me.bend != 0.0:
        own = bank.strings[s].off
        return state.omega[own : own + model.cap]
    return bank.omega[model.off : model.off + model.cap]


@njit(inline="always")
def shapes_of(core: int, s: int):
    """(C, cap) mode shapes at the contacts."""
    bank, state = bank_of(core), state_of(core)
    model = bank.models[state.sounding[s].model]
    return bank.shapes[model.soff : model.soff + model.contacts * model.cap].reshape(model.contacts, model.cap)


@njit(inline="always")
def matrix_of(core: int, s: int):
    """(C, C) contact matrix of one step."""
    bank, state = bank_of(core), state_of(core)
    me = state.sounding[s]
    model = bank.models[me.model]
    c = model.contacts
    if me.altered:
        own = bank.strings[s].goff
        return state.matrix[own : own + c * c].reshape(c, c)
    return bank.matrix[model.goff : model.goff + c * c].reshape(c, c)


@njit(inline="always")
def lags_of(core: int, s: int):
    """(C, C, 2K) responses of the contacts to each other over a block."""
    bank, state = bank_of(core), state_of(core)
    me = state.sounding[s]
    model = bank.models[me.model]
    c = model.contacts
    if me.altered:
        own = RESPONSE * bank.strings[s].goff
        return state.lags[own : own + RESPONSE * c * c].reshape(c, c, RESPONSE)
    return bank.lags[RESPONSE * model.goff : RESPONSE * (model.goff + c * c)].reshape(c, c, RESPONSE)


@njit(inline="always")
def out_lags_of(core: int, s: int, first: int, count: int):
    """(count, C, 2K) responses to the contacts of the outputs from number `first` on: on q, on v."""
    bank, state = bank_of(core), state_of(core)
    me = state.sounding[s]
    model = bank.models[me.model]
    c = model.contacts
    size = RESPONSE * c
    if me.altered:
        own = 2 * RESPONSE * bank.strings[s].coff + first * size
        return state.out_lags[own : own + count * size].reshape(count, c, RESPONSE)
    own = 2 * RESPONSE * model.coff + first * size
    return bank.out_lags[own : own + count * size].reshape(count, c, RESPONSE)


@njit(inline="always")
def weights_of(core: int, s: int, first: int, count: int):
    """(count, cap) weights of the outputs from number `first` on: on q, on v."""
    bank, state = bank_of(core), state_of(core)
    model = bank.models[state.sounding[s].model]
    own = 2 * model.off + first * model.cap
    return bank.weights[own : own + count * model.cap].reshape(count, model.cap)


@njit(**CORE)
def _set_coefficients(core: int, desk: int, s: int) -> None:
    """Put the string's working coefficients and heights in line with model, hand, bend and height."""
    bank, state = bank_of(core), state_of(core)
    me = state.sounding[s]
    fixed = bank.strings[s]
    model = bank.models[me.model]
    for k in range(model.contacts):
        state.eta[fixed.coff + k] = bank.eta[model.coff + k] + me.height
    me.free = 0
    me.certain = 0
    me.n = model.n
    set_rest(core, me, model)
    me.altered = 1 if me.hand != 0.0 or me.bend != 0.0 else 0
    if me.altered:
        _alter(core, desk, s)


@njit(**CORE)
def damping(sigma: float, hand: float, turn: float) -> float:
    """σ of a mode under a hand; `turn` = ω dt. Bent above half the internal rate, it would be heard mirrored: it is cut."""
    return sigma + hand + (LN_1000 / CUT_S if turn > math.pi else 0.0)


@njit(**CORE)
def _alter(core: int, desk: int, s: int) -> None:
    """Coefficients of a string under a damping hand or a pitch bend."""
    bank, state, settings, scratch = bank_of(core), state_of(core), settings_of(core), scratch_of(desk)
    me = state.sounding[s]
    fixed = bank.strings[s]
    model = bank.models[me.model]
    n, c, m_off = model.n, model.contacts, model.off
    dt = 1.0 / (settings.rate_hz * fixed.factor)
    # a tension change adds the same share of ω₁² to every k_j² = j² k₁²; bending stiffness stays
    omega = state.omega[fixed.off : fixed.off + model.cap]
    omega[n:] = 1.0  # divided by
    bend_ratio = 2.0 ** (me.bend / 12.0)
    added = (bend_ratio * bend_ratio - 1.0) * bank.omega[m_off] * bank.omega[m_off]
    for j in range(n):
        w = bank.omega[m_off + j]
        more = added * (j + 1.0) * (j + 1.0) if j < model.own else (bend_ratio * bend_ratio - 1.0) * w * w
        omega[j] = math.sqrt(max(w * w + more, 1e-6 * w * w))
        scratch.sigma[j] = damping(bank.sigma[m_off + j], me.hand, omega[j] * dt)
    rows = rows_of(core, s)
    rows[:6, n:] = 0.0
    step_coefficients(settings.law, omega[:n], scratch.sigma[:n], model.mu, dt, rows)
    fill_rows(rows)
    if c == 0:
        return
    shapes, matrix, lags = shapes_of(core, s), matrix_of(core, s), lags_of(core, s)
    residual = bank.residual[model.goff : model.goff + c * c].reshape(c, c)
    contact_matrix(settings.law, rows, shapes, residual, matrix)
    if settings.law == EXACT_HOLD:  # the residual compliance goes with 1/T
        relief = 1.0 / (bend_ratio * bend_ratio) - 1.0
        for a in range(c):
            for b in range(c):
                matrix[a, b] += relief * residual[a, b]
    q, v, spare = scratch.q[: model.cap], scratch.v[: model.cap], scratch.block
    fill_lags(0 if settings.law == EXACT_HOLD else 1, rows, shapes, shapes, matrix, q, v, spare, lags)
    none = matrix.reshape(-1)[:0].reshape(0, 0)
    for k in range(2):
        fill_lags(k, rows, shapes, weights_of(core, s, k, 1), none, q, v, spare, out_lags_of(core, s, k, 1))


@njit(**CORE)
def set_rest(core: int, me, model) -> None:
    """Where the string would come to rest over the obstacle as high as it now is: the contact's force and the output."""
    bank = bank_of(core)
    me.lift = 0.0
    me.rest = model.line_output + model.rest_output
    if model.contacts == 1:
        me.lift = max(0.0, bank.eta[model.coff] + me.height) / model.static_response
        me.rest = model.line_output + me.lift * model.lift_output


@njit(**CORE)
def rest_state(core: int, me, model, q_rest) -> None:
    """q (N,) of the string at rest."""
    bank = bank_of(core)
    for j in range(model.n):
        q_rest[j] = bank.q_rest[model.off + j]
    if model.contacts == 1:
        for j in range(model.n):
            w = bank.omega[model.off + j]
            q_rest[j] = bank.shapes[model.soff + j] * me.lift / (model.mu * w * w)


@njit(**CORE)
def refresh(core: int, desk: int, s: int) -> None:
    """Work out what an event has made stale. Here and nowhere else, once however many events came."""
    state = state_of(core)
    me = state.sounding[s]
    if me.stale == 1:
        _set_coefficients(core, desk, s)
    if me.phase != NO_FINGER:
        _couple_finger(core, desk, s)
    me.stale = 0


@njit(inline="always")
def grip_of(core: int, s: int, first: int, count: int):
    """Responses to the string's finger; of the outputs those from number `first` on: on q, on v."""
    bank, state = bank_of(core), state_of(core)
    c, coff = bank.models[state.sounding[s].model].contacts, bank.strings[s].coff
    contacts = state.grip_contacts[RESPONSE * coff : RESPONSE * (coff + c)].reshape(c, RESPONSE)
    own, outputs = state.grip_points[s, :1], state.grip_points[s, 1 + first : 1 + first + count]
    return Grip(own, contacts, outputs, state.grip_far[coff : coff + c])


@njit(**CORE)
def _couple_finger(core: int, desk: int, s: int) -> None:
    bank, state, settings, scratch = bank_of(core), state_of(core), settings_of(core), scratch_of(desk)
    me = state.sounding[s]
    fixed = bank.strings[s]
    model = bank.models[me.model]
    c, cap = model.contacts, model.cap
    me.finger_own = fill_grip(
        settings.law, rows_of(core, s), omega_of(core, s), shapes_of(core, s),
        state.finger_weights[fixed.off : fixed.off + cap].reshape(1, cap), weights_of(core, s, 0, 2), 1,
        state.finger_coupling[fixed.coff : fixed.coff + c], scratch.q[:cap], scratch.v[:cap], scratch.block,
        grip_of(core, s, 0, 2),
    )  # fmt: skip
