"""Flight of a string on a moving bridge that presses on one point without a break: `physics.pressed_modes`.

It goes a frame at a time like one that touches nothing, with z in the place of q and MOTION.flying set. So long as

    Σ |∂λ/∂z_j| E_j + |∂λ/∂b · b|,    E_j = √(z_j² + ż_j²/ω_j²),

is less than the force λ at rest, free flight does not lift it; what the bridge adds until this is asked again has the margin
between `LEAVE` and 1. While it flies, whatever is done to it makes it stand on its point again first (`stand`).

Bank.settled of a model of N modes, M of them while it presses: T/L′, L′, λ at rest, ∂λ/∂b, number of the point; c′ (M,),
∂λ/∂z (M,), q₀ (N,), a (N,), V (M, N).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from synth.engine.core import (
    bank_of,
    expression_of,
    flight_of,
    hand_of,
    motion_of,
    scratch_of,
    settings_of,
    shared_of,
    string_of,
)
from synth.engine.ends import bridge_under
from synth.engine.layout import CORE, FLYING, LANDED, NO_FINGER, PLAIN, SLEEP_BELOW
from synth.physics.pressed_modes import PressedModes
from synth.solver.certificates import extents, reach
from synth.solver.coupling import (
    APART_MODES,
    BY_FRAMES,
    ENGAGED,
    FELT_MODES,
    HEARD_MODES,
    LENGTH,
    REACH_OF,
    RESTING,
    TENSION,
    end_at,
)
from synth.solver.lanes import padded
from synth.solver.line_certificates import look_everywhere
from synth.solver.line_tables import fill_apart
from synth.solver.responses import complete_rows
from synth.solver.stringmodel import MOVING, string_model
from synth.solver.vectors import FAST, INNER, dot

#: shares of the force at rest that motion may make up, where flight begins and where it ends
ENTER, LEAVE = 0.5, 0.75
#: what flight leaves out may come to at the output, at most, if all of its modes in the audible band are in phase (−80 dBFS)
LEFT_OUT_BELOW = 10.0 * SLEEP_BELOW
#: numbers of a string in Bank.settled
N_PRESSED = 5


def pressed_numbers(pressed: PressedModes, point: int) -> np.ndarray:
    """The numbers in Bank.settled of a string that presses on this one of its contacts."""
    own = [pressed.stiffness, pressed.mass_length_m, pressed.force_n, pressed.force_of_end, point]
    return np.concatenate(
        [own, pressed.ramp, pressed.force_of_modes, pressed.rest, pressed.follows, pressed.modes.reshape(-1)]
    )


@njit(inline="always")
def _numbers(core: int, s: int):
    """(stiffness, length, force, its slope by b, point; c′; ∂λ/∂z; q₀; a; V) of a string's model."""
    bank = bank_of(core)
    model = bank.models[hand_of(core, s).model]
    at, n, m = model.pressed, model.n, model.pressed_modes
    own, at = bank.settled[at : at + N_PRESSED], at + N_PRESSED
    ramp, slopes, at = bank.settled[at : at + m], bank.settled[at + m : at + 2 * m], at + 2 * m
    rest, follows, at = bank.settled[at : at + n], bank.settled[at + n : at + 2 * n], at + 2 * n
    return own, ramp, slopes, rest, follows, bank.settled[at : at + m * n].reshape(m, n)


@njit(**CORE)
def take_off_pressed(core: int, thread: int, s: int) -> bool:
    """A string that a hand has left as compiled flies from here on, if it is certain to press for a while and what flight
    leaves out is not heard; whether it does. `gather_lines` then."""
    hand, expression, motion, string = hand_of(core, s), expression_of(core, s), motion_of(core, s), string_of(core, s)
    end, m = end_at(shared_of(core).end_at[s]), bank_of(core).models[hand.model].pressed_modes
    if m == 0 or settings_of(core).economy == 0 or hand.phase != NO_FINGER or motion.stale or motion.altered:
        return False
    if expression.height != 0.0 or end.counts[ENGAGED] == 0:
        return False
    own, _, slopes, rest, follows, modes = _numbers(core, s)
    scratch, flight, n = scratch_of(thread), flight_of(core, s), rest.size
    b, speed = bridge_under(core, s)
    away, rate = scratch.modes.moved[0, :n], scratch.modes.moved[1, :n]
    for j in range(n):
        away[j] = string.q[j] - rest[j] - follows[j] * b
        rate[j] = string.v[j] - follows[j] * speed
    least = ENTER * own[2] - abs(own[3] * b)
    for k in range(m):
        z, moves = dot(modes[k], away), dot(modes[k], rate)
        swing = moves / flight.omega[k]
        least -= abs(slopes[k]) * math.sqrt(z * z + swing * swing)
        if least <= 0.0:
            return False
        scratch.modes.q[k], scratch.modes.v[k] = z, moves
    plain = string_model(shared_of(core).model_at[hand.model, PLAIN])
    weights = plain.outputs.weights[0, : bank_of(core).models[hand.model].audible]
    if _left_out(weights, plain.omega, modes, scratch.modes.q[:m], scratch.modes.v[:m], away, rate) > LEFT_OUT_BELOW:
        return False
    for j in range(string.q.size):
        string.q[j] = scratch.modes.q[j] if j < m else 0.0
        string.v[j] = scratch.modes.v[j] if j < m else 0.0
    string.counts[MOVING] = m
    motion.flying = FLYING
    _fly_apart(core, thread, s)
    return True


@njit(fastmath=FAST, **INNER)
def _left_out(weights, omega, modes, z, moves, away, rate) -> float:
    """What a string's motion, away (N,) from rest and rate (N,), without its modes z and their speeds (M,), may come to by
    weights (audible,)."""
    for k in range(z.size):
        for j in range(away.size):
            away[j] -= z[k] * modes[k, j]
            rate[j] -= moves[k] * modes[k, j]
    total = 0.0
    for j in range(weights.size):
        swing = rate[j] / omega[j]
        total += weights[j] * math.sqrt(away[j] * away[j] + swing * swing)
    return total


@njit(**CORE)
def _fly_apart(core: int, thread: int, s: int) -> None:
    """The end of a string as it begins to fly: that of one which touches nothing."""
    own, ramp, _, _, _, _ = _numbers(core, s)
    shared, scratch, flight = shared_of(core), scratch_of(thread), flight_of(core, s)
    end, m = end_at(shared.end_at[s]), ramp.size
    for j in range(end.kick.size):
        c = ramp[j] if j < m else 0.0
        end.kick[j] = -c
        end.pull[j] = flight.mu * c
    end.numbers[TENSION], end.numbers[LENGTH] = own[0], own[1]
    end.counts[HEARD_MODES] = end.counts[FELT_MODES] = end.counts[APART_MODES] = m
    end.counts[ENGAGED] = end.counts[BY_FRAMES] = end.counts[RESTING] = end.counts[REACH_OF] = 0
    look_everywhere(shared.end_at[s])
    for row in range(6):
        for j in range(padded(m)):
            end.flight[row, j] = flight.rows[row, j]
    complete_rows(end.flight, padded(m))
    fill_apart(shared.end_at[s], scratch.modes.q, scratch.modes.v, scratch.rows.spare)


@njit(**CORE)
def presses_on(core: int, thread: int, s: int) -> bool:
    """Whether a string in flight is certain to press for a while."""
    own, _, slopes, _, _, _ = _numbers(core, s)
    flight, string, m = flight_of(core, s), string_of(core, s), slopes.size
    extent = scratch_of(thread).modes.amplitude[:m]
    extents(flight.omega[:m], string.q[:m], string.v[:m], extent)
    return reach(slopes, extent) + abs(own[3] * bridge_under(core, s)[0]) < LEAVE * own[2]


@njit(**CORE)
def standing_motion(core: int, s: int, q, v) -> None:
    """q, v (N,) of a string in flight as it would have them standing, and the force on its point, as its state's."""
    own, _, slopes, rest, follows, modes = _numbers(core, s)
    string, n, m = string_of(core, s), rest.size, slopes.size
    b, speed = bridge_under(core, s)
    for j in range(n):
        q[j] = rest[j] + follows[j] * b
        v[j] = follows[j] * speed
    for k in range(m):
        for j in range(n):
            q[j] += string.q[k] * modes[k, j]
            v[j] += string.v[k] * modes[k, j]
    string.force[:] = 0.0
    string.force[int(own[4])] = max(0.0, own[2] + own[3] * b + dot(slopes, string.q[:m]))


@njit(**CORE)
def stand(core: int, thread: int, s: int) -> None:
    """A string flies no more, if it did: before anything changes it."""
    motion = motion_of(core, s)
    if motion.flying == LANDED:
        return
    scratch, string, n = scratch_of(thread), string_of(core, s), bank_of(core).models[hand_of(core, s).model].n
    standing_motion(core, s, scratch.modes.q[:n], scratch.modes.v[:n])
    for j in range(n):
        string.q[j] = scratch.modes.q[j]
        string.v[j] = scratch.modes.v[j]
    string.counts[MOVING] = n
    motion.flying = LANDED
    motion.stale = 1
