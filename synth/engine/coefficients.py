"""A string's working coefficients: those of its model, the damping hand, the pitch bend and the obstacle's height."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.layout import CORE, NO_FINGER
from synth.engine.views import bank_of, scratch_of, settings_of, state_of
from synth.solver.kernels import finger_row
from synth.solver.laws import EXACT_HOLD, contact_matrix, step_coefficients

#: T60 of a stolen or silenced string, and of what a bend carries beyond half the internal rate [s]
CUT_S = 0.03
LN_1000 = math.log(1000.0)


@njit(**CORE)
def _set_coefficients(core: int, desk: int, s: int) -> None:
    """Put the string's working coefficients, contact matrix and heights in line with model, hand, bend and height."""
    bank, state, settings, scratch = bank_of(core), state_of(core), settings_of(core), scratch_of(desk)
    me = state.sounding[s]
    fixed = bank.strings[s]
    model = bank.models[me.model]
    n, c = model.n, model.contacts
    cap, off, m_off = fixed.cap, fixed.off, model.off
    for k in range(c):
        state.eta[fixed.coff + k] = bank.eta[model.coff + k] + me.height
        state.watch[fixed.coff + k] = 1
    me.free = 0
    set_rest(core, me, model)
    bend_ratio = 1.0
    if me.hand == 0.0 and me.bend == 0.0:
        for row in range(6):
            for j in range(n):
                state.coef[6 * off + row * cap + j] = bank.coef[6 * m_off + row * n + j]
        for k in range(c * c):
            state.matrix[fixed.goff + k] = bank.matrix[model.goff + k]
    else:
        dt = 1.0 / (settings.rate_hz * fixed.factor)
        # a tension change adds the same share of ω₁² to every k_j² = j² k₁²; bending stiffness stays
        bend_ratio = 2.0 ** (me.bend / 12.0)
        added = (bend_ratio * bend_ratio - 1.0) * bank.omega[m_off] * bank.omega[m_off]
        for j in range(n):
            w = bank.omega[m_off + j]
            more = added * (j + 1.0) * (j + 1.0) if j < model.own else (bend_ratio * bend_ratio - 1.0) * w * w
            scratch.omega[j] = math.sqrt(max(w * w + more, 1e-6 * w * w))
            scratch.sigma[j] = bank.sigma[m_off + j] + me.hand
            if scratch.omega[j] * dt > math.pi:  # bent above half the internal rate, where it would be heard mirrored
                scratch.sigma[j] += LN_1000 / CUT_S
        coef = state.coef[6 * off : 6 * off + 6 * cap].reshape(6, cap)
        step_coefficients(settings.law, scratch.omega[:n], scratch.sigma[:n], model.mu, dt, coef)
        if c > 0:
            shapes = bank.shapes[model.soff : model.soff + c * n].reshape(c, n)
            residual = bank.residual[model.goff : model.goff + c * c].reshape(c, c)
            matrix = state.matrix[fixed.goff : fixed.goff + c * c].reshape(c, c)
            contact_matrix(settings.law, coef, shapes, residual, matrix)
            if settings.law == EXACT_HOLD:  # the residual compliance goes with 1/T
                relief = 1.0 / (bend_ratio * bend_ratio) - 1.0
                for a in range(c):
                    for b in range(c):
                        matrix[a, b] += relief * residual[a, b]


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
        _couple_finger(core, s)
    me.stale = 0


@njit(**CORE)
def _couple_finger(core: int, s: int) -> None:
    bank, state, settings = bank_of(core), state_of(core), settings_of(core)
    me = state.sounding[s]
    fixed = bank.strings[s]
    model = bank.models[me.model]
    n, c = model.n, model.contacts
    coef = state.coef[6 * fixed.off : 6 * fixed.off + 6 * fixed.cap].reshape(6, fixed.cap)
    shapes = bank.shapes[model.soff : model.soff + c * n].reshape(c, n)
    me.finger_own = finger_row(
        settings.law,
        coef,
        shapes,
        state.finger_weights[fixed.off : fixed.off + n],
        state.finger_coupling[fixed.coff : fixed.coff + c],
    )
