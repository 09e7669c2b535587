"""Free flight at the output rate: a string that can touch nothing needs no internal rate.

Its modes are advanced by the exact propagator over whole frames, and only those that the decimator does not stop, each
with the decimator's gain at its frequency; their sum goes to a bus of the output rate, which is late by the same frames as
the others. To change over without a click the sound so far fades out of one bus as it fades into the other, over `FADE`
frames: x·w and x·(1 − w), where w falls slowly enough that the decimator does the same to x·w as to x. For that the
string's free continuation from the moment of the change is worked out at both rates and kept, weighed with w, to be added to
one and taken from the other:

    taking off    internal + w·x_internal,   direct: own − w·x_direct
    touching down internal: own − w·x_internal,   direct + w·x_direct

What lies on a string, and has settled, goes with it: it only takes energy, so that no contact is reached any more that all
of the energy, that of the finger's spring included, could not reach.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from synth.engine.coefficients import alter_flight, alter_steps
from synth.engine.core import (
    bank_of,
    flight_address,
    flight_of,
    hand_of,
    is_held,
    model_of,
    motion_of,
    progress_of,
    scratch_of,
    shared_of,
    span_of,
    stream_of,
    string_of,
    stroke_of,
    tally_of,
)
from synth.engine.hold import grip_anew
from synth.engine.layout import CORE, FADE, FLYING, QUANTUM, STEPS_DUE
from synth.engine.output import collect
from synth.solver.block_rows import BLOCK
from synth.solver.blocks import fly_blocks, fly_modes
from synth.solver.fingers import fill_grip
from synth.solver.lanes import padded
from synth.solver.step import advance
from synth.solver.stepwise import advance_free
from synth.solver.stringmodel import CERTAIN, FREE, MOVING


@njit(**CORE)
def take_off(core: int, thread: int, s: int) -> None:
    """From here on at the output rate. Modes that the decimator stops end."""
    hand, motion, string = hand_of(core, s), motion_of(core, s), string_of(core, s)
    audible = bank_of(core).models[hand.model].audible
    if motion.altered:
        alter_flight(core, thread, s)
    _keep_fade(core, thread, s, 1.0)
    for j in range(audible, string.counts[MOVING]):
        if is_held(hand):  # what lies on it finds it as it is without them
            string.finger[0].here -= string.grip.weights[j] * string.q[j]
        string.q[j] = 0.0
        string.v[j] = 0.0
    string.counts[MOVING] = min(string.counts[MOVING], audible)
    motion.flying = FLYING
    if is_held(hand):
        fill_grip(flight_address(core, s), shared_of(core).string_at[s], thread, int(np.int64(1)))


@njit(**CORE)
def touch_down(core: int, thread: int, s: int) -> None:
    """Back to the internal rate: before anything changes the string."""
    hand, motion = hand_of(core, s), motion_of(core, s)
    if motion.flying == STEPS_DUE and motion.altered:
        alter_steps(core, thread, s)
    _keep_fade(core, thread, s, -1.0)
    motion.flying = 0
    string = string_of(core, s)
    if string.counts[FREE] == 0:
        string.counts[MOVING] = bank_of(core).models[hand.model].n
    if is_held(hand):
        grip_anew(core, s)


@njit(**CORE)
def _keep_fade(core: int, thread: int, s: int, sign: float) -> None:
    """Add what the string would go on to do, weighed with w, to what is still to fade of earlier changes."""
    bank, stream, scratch, string = bank_of(core), stream_of(core), scratch_of(thread), string_of(core, s)
    hand, motion = hand_of(core, s), motion_of(core, s)
    fixed = bank.strings[s]
    moving, row = string.counts[MOVING], scratch.path
    for direct in range(2):
        factor = 1 if direct else fixed.factor
        model = flight_of(core, s) if direct else model_of(core, s)
        points = model.outputs.points
        n = min(moving, bank.models[hand.model].audible) if direct else moving
        kept = stream.direct_fade[s] if direct else stream.fade[fixed.fade : fixed.fade + FADE * factor]
        left = max(0, motion.fade_to - motion.fade_at) * factor
        first = motion.fade_at * factor
        for k in range(left):
            kept[k] = kept[first + k]
        kept[left:] = 0.0
        q, v = scratch.modes.q[: model.omega.size], scratch.modes.v[: model.omega.size]
        q[:] = 0.0
        v[:] = 0.0
        for j in range(n):
            q[j] = string.q[j]
            v[j] = string.v[j]
        base = motion.base
        steps = QUANTUM * factor
        out = scratch.out[: points * steps].reshape(points, steps)
        weights = model.outputs.weights[model.outputs.first : model.outputs.first + points]
        for at in range(0, FADE * factor, steps):
            fly_blocks(steps // BLOCK, padded(n), model.rows, q, v, weights, model.outputs.on_q, out)
            base = collect(core, thread, s, steps, factor, base, row)
            for k in range(steps):
                w = 0.5 + 0.5 * math.cos(math.pi * (at + k + 1) / (FADE * factor))
                kept[at + k] += (-sign if direct else sign) * w * row[k]
    motion.fade_at = 0
    motion.fade_to = FADE


@njit(**CORE)
def fly(core: int, thread: int, s: int, start: int, frames: int) -> None:
    """`frames` frames of a string in flight from frame `start` of the span, into its direct row."""
    scratch, string, model = scratch_of(thread), string_of(core, s), flight_of(core, s)
    hand, stroke, motion, tally = hand_of(core, s), stroke_of(core, s), motion_of(core, s), tally_of(core, s)
    n, points = string.counts[MOVING], model.outputs.points
    out = scratch.out[: points * frames].reshape(points, frames)
    blocks = frames // BLOCK
    rest = frames - blocks * BLOCK
    if is_held(hand):
        scratch.path[: frames + 1] = 0.0
        string.finger[0].on = 1
        advance(flight_address(core, s), shared_of(core).string_at[s], thread, frames, int(np.int64(1)))
        string.counts[CERTAIN] = 0  # of its contacts it has none in flight
        stroke.finger_step += frames * bank_of(core).strings[s].factor
        rest = int(np.int64(0))
    else:
        fly_modes(flight_address(core, s), thread, string.q, string.v, n, blocks, out)
    if rest > 0:
        begin, heard = blocks * BLOCK, model.outputs
        advance_free(
            rest, model.rows, string.q[:n], string.v[:n], heard.weights[0], heard.weights[1], heard.on_q,
            points - heard.on_q, out[0, begin:], out[points - 1, begin:],
        )  # fmt: skip
    tally.mode_steps += n * frames
    motion.base = collect(core, thread, s, frames, 1, motion.base, direct_row(core, s, start, frames))


@njit(**CORE)
def row_of(core: int, s: int, start: int, frames: int):
    """Where a string's steps of these frames of the span go; what lies between them and earlier ones is nothing."""
    fixed = bank_of(core).strings[s]
    progress = progress_of(core, s)
    row = span_of(core).rows[fixed.row :]
    at = start * fixed.factor
    if progress.row_from == progress.row_to:
        progress.row_from = at
    elif progress.row_to < at:
        row[progress.row_to : at] = 0.0
    progress.row_to = at + frames * fixed.factor
    return row[at : progress.row_to]


@njit(**CORE)
def direct_row(core: int, s: int, start: int, frames: int):
    """The same for its frames in flight."""
    fixed = bank_of(core).strings[s]
    progress = progress_of(core, s)
    row = span_of(core).direct[fixed.direct :]
    if progress.direct_from == progress.direct_to:
        progress.direct_from = start
    elif progress.direct_to < start:
        row[progress.direct_to : start] = 0.0
    progress.direct_to = start + frames
    return row[start : progress.direct_to]


@njit(**CORE)
def fade(core: int, s: int, start: int, frames: int) -> None:
    """Add what still fades of the last changes during these frames of the span, behind what the string has given."""
    bank, stream, span = bank_of(core), stream_of(core), span_of(core)
    motion = motion_of(core, s)
    count = min(frames, motion.fade_to - motion.fade_at)
    if count <= 0:
        return
    fixed = bank.strings[s]
    factor = fixed.factor
    if motion.flying:
        row_of(core, s, start, count)[:] = 0.0
    else:
        direct_row(core, s, start, count)[:] = 0.0
    row = span.rows[fixed.row + start * factor :]
    kept = stream.fade[fixed.fade + motion.fade_at * factor :]
    for k in range(count * factor):
        row[k] += kept[k]
    direct = span.direct[fixed.direct + start :]
    direct_kept = stream.direct_fade[s, motion.fade_at :]
    for i in range(count):
        direct[i] += direct_kept[i]
    motion.fade_at += count
