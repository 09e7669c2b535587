"""A string's working coefficients: those of its model, the damping hand, the pitch bend and the obstacle's height."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from synth.engine.core import (
    bank_of,
    expression_of,
    flight_of,
    hand_of,
    is_held,
    model_address,
    model_of,
    motion_of,
    scratch_of,
    shared_of,
    string_of,
)
from synth.engine.ends import on_bridge
from synth.engine.hand_damping import damping, raise_modes
from synth.engine.layout import CORE, FLYING, PLAIN, STEPS_DUE
from synth.engine.on_board import stop_on_board
from synth.solver.due_responses import fill_contact_matrix, fill_step, put_off
from synth.solver.fingers import fill_grip
from synth.solver.lanes import padded
from synth.solver.laws import EXACT_HOLD
from synth.solver.layers import settle
from synth.solver.lcp import SOLVED
from synth.solver.quick_coefficients import quick_coefficients
from synth.solver.responses import complete_rows, fill_lags
from synth.solver.stringmodel import CERTAIN, DEPTH, FREE, MOVING, STIFFNESS, string_model


@njit(**CORE)
def _set_coefficients(core: int, thread: int, s: int) -> None:
    """Put the string's working coefficients and heights in line with model, hand, bend and height."""
    hand, expression, motion, string = hand_of(core, s), expression_of(core, s), motion_of(core, s), string_of(core, s)
    model = string_model(shared_of(core).model_at[hand.model, PLAIN])
    _set_heights(core, s)
    string.due[:] = 0
    string.counts[FREE] = 0
    string.counts[CERTAIN] = 0
    set_rest(core, thread, s)
    motion.altered = 1 if expression.hand != 0.0 or expression.bend != 0.0 else 0
    if shared_of(core).board_at[hand.model] != 0:
        stop_on_board(core, thread, s)
    elif motion.altered and on_bridge(
        core, s
    ):  # there what its contacts need waits until they are looked at: `ends.refresh_end`
        _bend(core, s, model.modes)
    elif motion.altered:
        alter_steps(core, thread, s)


@njit(**CORE)
def _set_heights(core: int, s: int) -> None:
    """Heights of the string's contacts, raised as they now are."""
    hand, expression, string = hand_of(core, s), expression_of(core, s), string_of(core, s)
    model = string_model(shared_of(core).model_at[hand.model, PLAIN])
    for k in range(model.contacts.size):
        string.eta[k] = model.contacts.eta[k] + expression.height


@njit(**CORE)
def _bend(core: int, s: int, count: int) -> None:
    """Frequencies of a string under a pitch bend: of its first `count` modes."""
    hand, expression = hand_of(core, s), expression_of(core, s)
    plain, own = string_model(shared_of(core).model_at[hand.model, PLAIN]), model_of(core, s)
    strings_own = min(count, bank_of(core).models[hand.model].own)
    # a tension change adds the same share of ω₁² to every k_j² = j² k₁²; bending stiffness stays
    omega = own.omega
    omega[plain.modes :] = 1.0  # divided by
    bend_ratio = 2.0 ** (expression.bend / 12.0)
    share = bend_ratio * bend_ratio - 1.0
    raise_modes(plain.omega[:strings_own], share * plain.omega[0] * plain.omega[0], omega)
    for j in range(strings_own, count):
        w = plain.omega[j]
        omega[j] = math.sqrt(max(w * w + share * w * w, 1e-6 * w * w))


@njit(**CORE)
def alter_steps(core: int, thread: int, s: int) -> None:
    """Frequencies and coefficients of a step of a string under a damping hand or a pitch bend."""
    scratch = scratch_of(thread)
    hand, expression = hand_of(core, s), expression_of(core, s)
    plain, own = string_model(shared_of(core).model_at[hand.model, PLAIN]), model_of(core, s)
    n, c, cap, dt, omega = plain.modes, plain.contacts.size, plain.omega.size, plain.dt, own.omega
    _bend(core, s, n)
    bend_ratio = 2.0 ** (expression.bend / 12.0)
    for j in range(n):
        scratch.modes.sigma[j] = damping(plain.sigma[j], expression.hand, omega[j] * dt)
    relief = 1.0 / (bend_ratio * bend_ratio) - 1.0
    fill_step(model_address(core, s), scratch.modes.sigma)
    if c == 0:
        return
    rows, matrix = own.rows, own.contacts.matrix
    if plain.law == EXACT_HOLD and c > 1:
        put_off(model_address(core, s), shared_of(core).string_at[s], relief)
        return
    fill_contact_matrix(model_address(core, s), relief)
    q, v, spare = scratch.modes.q[:cap], scratch.modes.v[:cap], scratch.rows.spare
    shapes, outputs = plain.contacts.shapes, plain.outputs
    fill_lags(0 if plain.law == EXACT_HOLD else 1, rows, shapes, shapes, matrix, q, v, spare, own.contacts.lags)
    none = matrix.reshape(-1)[:0].reshape(0, 0)
    for k in range(outputs.first, outputs.first + outputs.points):  # output 0 is on displacements, 1 on velocities
        fill_lags(k, rows, shapes, outputs.weights[k : k + 1], none, q, v, spare, own.outputs.lags[k : k + 1])


@njit(**CORE)
def fill_sigma(core: int, thread: int, s: int, n: int) -> None:
    """Scratch.modes.sigma of the first n modes of a string, with the frequencies that it has: under its hand, and where a
    bend takes them too high."""
    hand, expression = hand_of(core, s), expression_of(core, s)
    sigma, omega = scratch_of(thread).modes.sigma, model_of(core, s).omega
    plain = string_model(shared_of(core).model_at[hand.model, PLAIN])
    for j in range(n):
        sigma[j] = damping(plain.sigma[j], expression.hand, omega[j] * plain.dt if expression.bend != 0.0 else 0.0)


@njit(**CORE)
def alter_flight(core: int, thread: int, s: int) -> None:
    """Coefficients of a frame of a string in flight under a damping hand or a pitch bend, whose frequencies are as they are
    to be: of the modes that move, to which none is added before it lands."""
    flight, omega = flight_of(core, s), model_of(core, s).omega
    n, rows = flight.modes, flight.rows
    if not is_held(hand_of(core, s)):  # which moves all of them
        n = min(n, string_of(core, s).counts[MOVING])
    fill_sigma(core, thread, s, n)
    rows[:6, n : padded(n)] = 0.0
    quick_coefficients(EXACT_HOLD, omega[:n], scratch_of(thread).modes.sigma[:n], flight.mu, flight.dt, rows)
    complete_rows(rows, padded(n))


@njit(**CORE)
def refresh_in_flight(core: int, thread: int, s: int) -> None:
    """`refresh` of a string in flight, over no board and with nothing on it, that is to go on so: coefficients of its steps
    and frequencies of modes at rest wait until it lands."""
    hand, expression, motion, string = hand_of(core, s), expression_of(core, s), motion_of(core, s), string_of(core, s)
    _set_heights(core, s)
    set_rest(core, thread, s)
    string.counts[MOVING] = min(string.counts[MOVING], bank_of(core).models[hand.model].audible)
    string.counts[CERTAIN] = 0
    string.due[:] = 0
    motion.altered = 1 if expression.hand != 0.0 or expression.bend != 0.0 else 0
    motion.flying = STEPS_DUE if motion.altered else FLYING
    if motion.altered:
        _bend(core, s, string.counts[MOVING])
        alter_flight(core, thread, s)
    motion.stale = 0


@njit(**CORE)
def set_rest(core: int, thread: int, s: int) -> None:
    """Where the string would come to rest over the obstacle as high as it now is: the contacts' force and the output."""
    hand, expression, motion = hand_of(core, s), expression_of(core, s), motion_of(core, s)
    model = bank_of(core).models[hand.model]
    motion.lift = 0.0
    motion.rest = model.line_output + model.rest_output
    if model.contacts == 1:
        plain = string_model(shared_of(core).model_at[hand.model, PLAIN])
        height = max(0.0, plain.contacts.eta[0] + expression.height)
        motion.lift = height / model.static_response
        if model.layered:  # it gives way first
            yielding = model.static_response + 1.0 / plain.contacts.layers[STIFFNESS, 0]
            motion.lift = max(height / yielding, (height - plain.contacts.layers[DEPTH, 0]) / model.static_response)
        motion.rest = model.line_output + motion.lift * model.lift_output
    elif model.settling > 0:
        _rest_on_points(core, thread, s)


@njit(**CORE)
def _press(core: int, thread: int, s: int) -> None:
    """Scratch.z: forces of the points of a bridge on the string at rest [N]."""
    hand, expression = hand_of(core, s), expression_of(core, s)
    bank, plain = bank_of(core), string_model(shared_of(core).model_at[hand.model, PLAIN])
    model = bank.models[hand.model]
    rows = model.settling
    matrix = bank.settled[model.settled : model.settled + rows * rows].reshape(rows, rows)
    if settle(matrix, plain.contacts, expression.height, thread) != SOLVED:
        scratch_of(thread).z[: plain.contacts.size] = 0.0


@njit(**CORE)
def _rest_on_points(core: int, thread: int, s: int) -> None:
    """`set_rest` over several points of a bridge."""
    hand, motion = hand_of(core, s), motion_of(core, s)
    bank, plain = bank_of(core), string_model(shared_of(core).model_at[hand.model, PLAIN])
    model, force = bank.models[hand.model], scratch_of(thread).z
    _press(core, thread, s)
    heard = 0.0
    for c in range(plain.contacts.size):
        if force[c] > 0.0:
            motion.lift += force[c] * bank.leverage[model.leverage + c] / bank.leverage[model.leverage]
            if model.lift_output != 0.0:
                heard += force[c] * _lift_output(plain, c)
    motion.rest = model.line_output + heard


@njit(**CORE)
def _lift_output(plain, c: int) -> float:
    """Output of the state at rest under 1 N at contact c."""
    total = 0.0
    for j in range(plain.modes):
        total += plain.outputs.weights[0, j] * plain.contacts.shapes[c, j] / (plain.mu * plain.omega[j] * plain.omega[j])
    return total


@njit(**CORE)
def rest_state(core: int, thread: int, s: int, q_rest) -> None:
    """q (N,) of the string at rest."""
    hand, motion = hand_of(core, s), motion_of(core, s)
    model = string_model(shared_of(core).model_at[hand.model, PLAIN])
    if bank_of(core).models[hand.model].settling > 0:
        _press(core, thread, s)
        force = scratch_of(thread).z
        for j in range(model.modes):
            total = 0.0
            for c in range(model.contacts.size):
                total += model.contacts.shapes[c, j] * force[c]
            q_rest[j] = total / (model.mu * model.omega[j] * model.omega[j])
        return
    lifted = model.contacts.size == 1
    for j in range(model.modes):
        q_rest[j] = 0.0 if lifted else model.q_rest[j]
    if lifted and motion.lift != 0.0:
        for j in range(model.modes):
            w = model.omega[j]
            q_rest[j] = model.contacts.shapes[0, j] * motion.lift / (model.mu * w * w)


@njit(**CORE)
def refresh(core: int, thread: int, s: int) -> None:
    """Work out what an event has made stale. Here and nowhere else, once however many events came."""
    hand, motion = hand_of(core, s), motion_of(core, s)
    if motion.stale == 1:
        _set_coefficients(core, thread, s)
    if is_held(hand) and not on_bridge(core, s):
        fill_grip(model_address(core, s), shared_of(core).string_at[s], thread, int(np.int64(1)))
    motion.stale = 0
