"""Where the finger on a board is, and what follows from that: length, modes, heights under the string, what the output sees.

The modal grid goes with the finger: in coordinates that are normalised, a string that is stopped a little further on is the
same string with other frequencies, and its shape is stretched over the new length. (q, v) are carried over as by a bend, so
that each mode keeps its energy over its frequency, as under a finger that slides slowly against the speed of waves.
"""

from __future__ import annotations

import math

from numba import njit

from synth.engine.board_tables import open_string
from synth.engine.core import (
    bank_of,
    expression_of,
    hand_of,
    model_of,
    motion_of,
    scratch_of,
    shared_of,
    string_of,
    voice_of,
)
from synth.engine.expression import MOST_BEND
from synth.engine.hand_damping import damping, raise_modes
from synth.engine.layout import CORE, NO_FINGER, PLAIN
from synth.physics.fingerboard import board_height, over_line, pressed_share
from synth.solver.board_table import NO_BOARD_M, SPEAKING, board_at, fill_slack, leave_board
from synth.solver.laws import EXACT_HOLD
from synth.solver.quick_coefficients import quick_coefficients
from synth.solver.responses import fill_rows
from synth.solver.stringmodel import MOVING, string_model

#: a string is heard at most this far from the saddle, as a part of its speaking length
FARTHEST_OUTPUT = 0.98
#: rounds in which the place of a finger is found to 1e-9 of its pitch
_ROUNDS = 6

_board_height, _over_line = njit(**CORE)(board_height), njit(**CORE)(over_line)
_pressed_share = njit(**CORE)(pressed_share)


@njit(inline="always")
def _shortened(linear: int, omega: float, ideal: float, ratio: float) -> float:
    """A mode at ω, `ideal` without stiffness, of a string that is now stopped to 1/ratio of its length: what stiffness
    shifts it by goes with the square of that."""
    if linear:
        return ratio * (ideal + ratio * ratio * (omega - ideal))
    squared = ideal * ideal + ratio * ratio * (omega - ideal) * (omega + ideal)
    return ratio * math.sqrt(max(squared, 1e-6 * ideal * ideal))


@njit(error_model="numpy", **CORE)
def _shorten(linear: int, omega, ideal: float, ratio: float, out) -> None:
    """out (≥N,): `_shortened` of modes ω (N,), in vectors."""
    for j in range(omega.size):
        out[j] = _shortened(linear, omega[j], (j + 1.0) * ideal, ratio)


@njit(**CORE)
def stop_on_board(core: int, thread: int, s: int) -> None:
    """Board and coefficients of a string in line with its model, hand, bend and height.

    A bend moves the finger; what lies beyond the nut or the end of the board is done by the tension.
    """
    bank, scratch = bank_of(core), scratch_of(thread)
    hand, expression, motion = hand_of(core, s), expression_of(core, s), motion_of(core, s)
    address = shared_of(core).board_at[hand.model]
    board, over = board_at(address), open_string(address)
    plain, own = string_model(shared_of(core).model_at[hand.model, PLAIN]), model_of(core, s)
    model = bank.models[hand.model]
    n, dt = plain.modes, plain.dt
    ideal = math.pi / model.length * math.sqrt(model.tension / model.mu)
    wanted = 2.0 ** (expression.bend / 12.0)
    ratio, added = 1.0, 0.0
    if expression.bend != 0.0:
        first = plain.omega[0]
        ratio = wanted
        for _ in range(_ROUNDS):
            ratio *= wanted * first / _shortened(over.linear, first, ideal, ratio)
        ratio = min(max(ratio, model.length / over.length), model.length / (over.length - over.end))
        reached = model.length / over.length < ratio < model.length / (over.length - over.end)
        if not reached:  # a tension change adds the same share of k_1² to every k_j²
            added = (wanted * first) ** 2 - _shortened(over.linear, first, ideal, ratio) ** 2
    speaking = model.length / ratio
    board.numbers[SPEAKING] = speaking
    _lay(address, speaking, expression.height)
    for k in range(2):
        for j in range(n):
            board.weights[k, j] = plain.outputs.weights[k, j]
    if expression.bend != 0.0:
        _listen(address, speaking, n)
    for j in range(n):
        scratch.modes.sigma[j] = plain.sigma[j]
    if motion.altered == 0:
        fill_slack(address, plain.omega[:n], scratch.modes.sigma[:n], plain.mu, dt)
        return
    omega = own.omega
    omega[n:] = 1.0  # divided by
    if expression.bend != 0.0:
        _shorten(over.linear, plain.omega[:n], ideal, ratio, omega)
        if added != 0.0:
            raise_modes(omega[:n], added, omega)
    else:
        for j in range(n):  # a copy of slices could raise an error, whose text takes what portable kernels lack
            omega[j] = plain.omega[j]
    for j in range(n):
        w = omega[j]
        scratch.modes.sigma[j] = damping(plain.sigma[j], expression.hand, w * dt if w > plain.omega[j] else 0.0)
    rows = own.rows
    rows[:6, n:] = 0.0
    quick_coefficients(EXACT_HOLD, omega[:n], scratch.modes.sigma[:n], plain.mu, dt, rows)
    fill_rows(rows)
    fill_slack(address, omega[:n], scratch.modes.sigma[:n], plain.mu, dt)


@njit(**CORE)
def _lay(address: int, speaking: float, raised: float) -> None:
    """Board.eta under a string that is stopped to `speaking`, the board raised by so much [m]."""
    b, over = board_at(address), open_string(address)
    x_f = over.length - speaking
    stop = _pressed_share(x_f) * (_board_height(x_f, over.nut, over.slope, over.relief, over.end) + raised)
    for c in range(b.eta.size):
        xi = speaking * (c + 1.0) / b.half.size
        b.eta[c] = NO_BOARD_M
        if x_f + xi <= over.end:
            surface = _board_height(x_f + xi, over.nut, over.slope, over.relief, over.end) + raised
            b.eta[c] = _over_line(xi, speaking, surface, stop)


@njit(**CORE)
def _listen(address: int, speaking: float, n: int) -> None:
    """Board.weights of an output that stays where it is."""
    b, over = board_at(address), open_string(address)
    x = speaking - min(over.heard_at, FARTHEST_OUTPUT * speaking)
    scale = math.sqrt(2.0 / speaking)
    # sines and cosines of multiples of two angles, each from the last by a rotation
    turn, half_turn = math.pi * x / speaking, 0.5 * math.pi * over.aperture / speaking
    step_sine, step_cosine, half_sine, half_cosine = math.sin(turn), math.cos(turn), math.sin(half_turn), math.cos(half_turn)
    sine, cosine, side, along = 0.0, 1.0, 0.0, 1.0
    for j in range(n):
        k = (j + 1) * math.pi / speaking
        sine, cosine = sine * step_cosine + cosine * step_sine, cosine * step_cosine - sine * step_sine
        side, along = side * half_cosine + along * half_sine, along * half_cosine - side * half_sine
        if over.heard_by_force:
            seen = scale * (over.tension * k + over.bending_stiffness * k * k * k) * cosine
        else:
            half = (j + 1) * half_turn
            seen = scale * sine * (side / half if half > 1e-9 else 1.0)
        b.weights[0, j] = over.gain_q * seen
        b.weights[1, j] = over.gain_v * seen


@njit(**CORE)
def leave(core: int, model: int) -> None:
    """A string begins on a model anew: it touches nothing of a board that lies under it."""
    address = shared_of(core).board_at[model]
    if address != 0:
        leave_board(address)


@njit(**CORE)
def may_slide(core: int, s: int, target: int) -> bool:
    """Whether the finger that stops a sounding string slides to another note: on a board, from and to stopped ones."""
    hand, bank, shared = hand_of(core, s), bank_of(core), shared_of(core)
    if shared.board_at[target] == 0 or hand.phase != NO_FINGER:
        return False
    stopped = bank.models[hand.model].rest_height < 0.0 and bank.models[target].rest_height < 0.0
    return stopped and open_string(shared.board_at[target]).slide_s > 0.0


@njit(**CORE)
def slide(core: int, s: int, target: int) -> None:
    """The finger sets out for another note, whose model the string has from now on, bent back to where it is.

    On a coarser grid the modes beyond it are lost, and so is what the nodes hold where the grid is another.
    """
    shared, string = shared_of(core), string_of(core, s)
    voice, hand, expression, motion = voice_of(core, s), hand_of(core, s), expression_of(core, s), motion_of(core, s)
    old = string_model(shared.model_at[hand.model, PLAIN])
    new = string_model(shared.model_at[target, PLAIN])
    back = 12.0 * math.log2(old.omega[0] / new.omega[0])
    expression.slide += back + expression.pull
    expression.pull = voice.pull_to = 0.0
    expression.bend = max(-MOST_BEND, min(MOST_BEND, expression.bend + back))  # from now on, not from the next quantum on
    for j in range(new.modes, string.q.size):
        string.q[j] = 0.0
        string.v[j] = 0.0
    if shared.board_at[target] != shared.board_at[hand.model]:
        leave(core, target)
    hand.model = target
    string.counts[MOVING] = new.modes
    motion.stale = 1
