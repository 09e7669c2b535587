"""Strings that share a bridge through time: an instrument goes frame by frame, all of its strings together."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from synth.engine.advance import follow_first, follow_quantum, goes_on, make_path, moves_like_a_string
from synth.engine.coefficients import refresh, rest_state
from synth.engine.core import (
    bank_of,
    flight_of,
    hand_of,
    is_held,
    knock_of,
    line_address,
    model_of,
    motion_of,
    progress_of,
    scratch_of,
    settings_of,
    shared_of,
    span_of,
    string_of,
    stroke_of,
    tally_of,
    voice_of,
)
from synth.engine.ends import may_go_by_frames, refresh_end
from synth.engine.knocks import knock_on
from synth.engine.layout import (
    BEGIN,
    BLOWN_UP,
    CHECK_EVERY,
    CORE,
    FIRST_QUANTUM,
    HIT,
    NO_FINGER,
    PLAIN,
    QUANTA,
    QUANTUM,
    SLEEP_BELOW,
    STRETCH,
    TASK,
    TOUCHED,
    UNTIL,
)
from synth.engine.output import BASE_S
from synth.engine.pressed_flight import presses_on, stand, take_off_pressed
from synth.engine.strings import finger_done, sleep
from synth.engine.strokes import has_bounced
from synth.solver.coupling import (
    APART_MODES,
    BY_FRAMES,
    ENGAGED,
    FELT_MODES,
    LEAST,
    REACH_OF,
    RESTING,
    SPENT,
    coupling_at,
    end_at,
    gather_lines,
)
from synth.solver.frames import advance_frames
from synth.solver.lcp import SOLVED
from synth.solver.line_certificates import CLEAR_ENOUGH, certify_line
from synth.solver.line_tables import fill_finger, go_by_frames, look_at
from synth.solver.stringmodel import MOVING, string_model
from synth.solver.vectors import FAST, INNER, dot, put

#: levels are taken, and whether all is silent is asked, every so many quanta: a multiple of CHECK_EVERY
SLEEP_EVERY = 4 * CHECK_EVERY
#: modes that would not be felt at the bridge rest once their sum at the output is certain to stay below this (−120 dBFS)
REST_BELOW = 0.1 * SLEEP_BELOW
#: of a pull on the bridge that is about to be counted as nothing, what is nothing [N]
LEAST_PULL_N = 1e-9


def work_together(core: int, thread: int, i: int, _: int) -> None:
    """`tasks.work_on` of an instrument whose strings share a bridge."""
    task = shared_of(core).task
    instrument = bank_of(core).instruments[i]
    first, end, kind = instrument.first_string, instrument.end_string, task[TASK]
    _find_models(core, i)
    if kind == BEGIN:
        if voice_of(core, first).awake:
            _begin_quantum(core, thread, i, int(np.int64(0)))
    elif kind == STRETCH:
        begin, until = progress_of(core, first).reached, task[UNTIL]
        for s in range(first, end):
            progress_of(core, s).reached = until
        if voice_of(core, first).awake and begin < until:
            _advance(core, thread, i, begin, until - begin)
    else:
        k = int(np.int64(0))
        while k < task[QUANTA]:
            count = int(np.int64(1))
            if voice_of(core, first).awake:
                _begin_quantum(core, thread, i, k)
            if voice_of(core, first).awake:
                while k + count < task[QUANTA] and _goes_on(core, i, k + count):
                    _follow_rest(core, i, count)
                    count += 1
                _advance(core, thread, i, k * QUANTUM, count * QUANTUM)
            k += count


@njit(**CORE)
def _goes_on(core: int, i: int, k: int) -> bool:
    """Whether neither `_begin_quantum` of quantum k nor `_refresh_lines` would change anything about an instrument, but for
    what forces are counted from, and no hand is at it."""
    bank = bank_of(core)
    for s in range(bank.instruments[i].first_string, bank.instruments[i].end_string):
        hand, counts = hand_of(core, s), end_at(shared_of(core).end_at[s]).counts
        if not goes_on(core, s, k) or knock_of(core, s).steps != 0 or motion_of(core, s).stale:
            return False
        if counts[BY_FRAMES] or (counts[ENGAGED] and bank.models[hand.model].contacts == 0):
            return False  # a finger has just left it, or its first direction
        if bank.strings[s].friction > 0.0:
            return False
    return True


@njit(**CORE)
def _find_models(core: int, i: int) -> None:
    """Addresses of the models that the lines now have, for the solver."""
    instrument, coupling = bank_of(core).instruments[i], coupling_at(shared_of(core).coupling_at[i])
    for s in range(instrument.first_string, instrument.end_string):
        coupling.lines.model[s - instrument.first_string] = line_address(core, s)


@njit(**CORE)
def _begin_quantum(core: int, thread: int, i: int, k: int) -> None:
    """What is decided about an instrument that is awake at the start of quantum k of the span."""
    bank = bank_of(core)
    instrument = bank.instruments[i]
    for s in range(instrument.first_string, instrument.end_string):
        if not bank.strings[s].of_first:
            follow_quantum(core, s, k)
        else:
            follow_first(core, s)
    _follow_rest(core, i, int(np.int64(0)))
    if (shared_of(core).task[FIRST_QUANTUM] + k) % CHECK_EVERY != 0:
        return
    fingered = False
    for s in range(instrument.first_string, instrument.end_string):
        fingered = fingered or NO_FINGER < hand_of(core, s).phase < TOUCHED
    if not fingered and (shared_of(core).task[FIRST_QUANTUM] + k) % SLEEP_EVERY == 0 and _falls_asleep(core, thread, i):
        return
    _certify_lines(core, thread, i)


@njit(**CORE)
def _falls_asleep(core: int, thread: int, i: int) -> bool:
    """Levels of an instrument's strings; whether it is silent, and sleeps."""
    bank = bank_of(core)
    instrument = bank.instruments[i]
    coupling, scratch = coupling_at(shared_of(core).coupling_at[i]), scratch_of(thread)
    swinging = 0.0
    for m in range(coupling.body.motion.p.size):
        w = coupling.body.omega[m] * coupling.body.motion.p[m]
        swinging += coupling.body.mass[m] * (coupling.body.motion.speed[m] * coupling.body.motion.speed[m] + w * w)
    loudest = instrument.output_bound * math.sqrt(swinging)
    for s in range(instrument.first_string, instrument.end_string):
        voice, hand, motion, string = voice_of(core, s), hand_of(core, s), motion_of(core, s), string_of(core, s)
        plain = string_model(shared_of(core).model_at[hand.model, PLAIN])
        n = min(plain.modes, string.counts[MOVING])
        rest_state(core, thread, s, scratch.modes.q)
        if motion.flying:
            plain = flight_of(core, s)
            n = plain.modes
            scratch.modes.q[:n] = 0.0
        end = end_at(shared_of(core).end_at[s])
        felt = end.counts[FELT_MODES]
        voice.level = _level(plain.outputs.weights[0], plain.omega, string.q, string.v, scratch.modes.q, 0, min(n, felt))
        if n > felt:
            above = _level(plain.outputs.weights[0], plain.omega, string.q, string.v, scratch.modes.q, felt, n)
            voice.level += above
            apart = end.counts[ENGAGED] == 0 and hand.phase == NO_FINGER and end.counts[REACH_OF] == hand.model + 1
            if above < REST_BELOW and apart and motion.lift == 0.0:
                end.counts[RESTING] = 1
                motion.stale = 1
        loudest += voice.level
    if loudest < SLEEP_BELOW:
        sleep_together(core, i)
        return True
    return False


@njit(fastmath=FAST, **INNER)
def _level(weights, omega, q, v, q_rest, first: int, end: int) -> float:
    """What modes `first` … `end` may come to at the output, together, while they fly free."""
    total = 0.0
    for j in range(first, end):
        away, swing = q[j] - q_rest[j], v[j] / omega[j]
        total += weights[j] * math.sqrt(away * away + swing * swing)
    return total


@njit(**CORE)
def _certify_lines(core: int, thread: int, i: int) -> None:
    """Strings that are certain to touch nothing for a while are not looked at; others that may touch something are."""
    instrument, shared = bank_of(core).instruments[i], shared_of(core)
    changed = lifted = False
    for s in range(instrument.first_string, instrument.end_string):
        line, end = s - instrument.first_string, end_at(shared.end_at[s])
        if bank_of(core).strings[s].friction > 0.0:
            first = end_at(shared.end_at[s - 1]).counts[ENGAGED]
            if first != end.counts[ENGAGED]:
                look_at(shared.coupling_at[i], line, first, thread)
                changed = True
        elif motion_of(core, s).stale or end.counts[BY_FRAMES]:  # as it is refreshed, and from block to block
            continue
        elif motion_of(core, s).flying:
            if not presses_on(core, thread, s):
                stand(core, thread, s)
        elif take_off_pressed(core, thread, s):
            lifted = changed = True
        elif may_go_by_frames(core, s) and go_by_frames(shared.coupling_at[i], line, thread):
            changed = True
        elif end.counts[ENGAGED] == 0 and end.numbers[LEAST] > CLEAR_ENOUGH * end.numbers[SPENT]:
            continue
        elif model_of(core, s).contacts.size > 0:
            near = certify_line(shared.coupling_at[i], line, thread)
            engaged = 1 if near > 0 or is_held(hand_of(core, s)) else 0
            if engaged != end.counts[ENGAGED]:
                look_at(shared.coupling_at[i], line, engaged, thread)
                changed = True
    if lifted:
        _find_models(core, i)
        _count_forces(core, i, int(np.int64(0)))
    if changed:
        gather_lines(shared.coupling_at[i])


@njit(**CORE)
def sleep_together(core: int, i: int) -> None:
    """The instrument is silent: it costs nothing until one of its strings is touched."""
    bank, coupling = bank_of(core), coupling_at(shared_of(core).coupling_at[i])
    for s in range(bank.instruments[i].first_string, bank.instruments[i].end_string):
        sleep(core, s)
    coupling.body.motion.p[:] = 0.0
    coupling.body.motion.speed[:] = 0.0
    coupling.bridge.beta[:] = 0.0
    coupling.bridge.speed[:] = 0.0
    coupling.bridge.rest[:] = 0.0
    coupling.bridge.momentum[:] = 0.0


@njit(**CORE)
def _advance(core: int, thread: int, i: int, begin: int, frames: int) -> None:
    """Frames of an instrument that is awake, from frame `begin` of the span."""
    bank, shared, span = bank_of(core), shared_of(core), span_of(core)
    instrument = bank.instruments[i]
    address = shared.coupling_at[i]
    out = span.radiated[instrument.body]
    _place(core, i, begin, frames)
    done = int(np.int64(0))
    while done < frames:
        count = _refresh_lines(core, thread, i, frames - done)
        knock_on(core, i, count)
        if advance_frames(address, thread, count, int(np.int64(QUANTUM)), out[:, begin + done :]) != SOLVED:
            tally_of(core, instrument.first_string).unsolved += 1
        done += count
        for s in range(instrument.first_string, instrument.end_string):
            hand, stroke, tally = hand_of(core, s), stroke_of(core, s), tally_of(core, s)
            engaged = end_at(shared.end_at[s]).counts[ENGAGED]
            in_steps = engaged and not end_at(shared.end_at[s]).counts[BY_FRAMES]
            modes = end_at(shared.end_at[s]).counts[APART_MODES]
            if in_steps:
                modes = model_of(core, s).modes * bank.strings[s].factor
            tally.mode_steps += modes * count
            if bank.strings[s].of_first:
                if hand.phase != NO_FINGER and stroke.finger_step >= stroke.finger_steps:
                    hand.phase = NO_FINGER  # the first direction, just before, has decided for both
            elif hand.phase != NO_FINGER and (stroke.finger_step >= stroke.finger_steps or has_bounced(core, s)):
                finger_done(core, thread, s)
    if not _sounds(core, i, begin, frames):
        for channel in range(2):
            for t in range(begin, begin + frames):
                out[channel, t] = 0.0
        tally_of(core, instrument.first_string).silenced += 1
        for s in range(instrument.first_string, instrument.end_string):
            string = string_of(core, s)
            string.force[:] = 0.0
            string.finger[0].here = 0.0
            string.finger[0].push = 0.0
        sleep_together(core, i)


@njit(**CORE)
def _place(core: int, i: int, begin: int, frames: int) -> None:
    """Frames of the span that are about to be there; what lies between them and earlier ones is nothing."""
    span, number = span_of(core), bank_of(core).instruments[i].body
    there = span.radiated_frames[number]
    if there[0] == there[1]:
        there[0] = begin
    else:
        for channel in range(2):
            for t in range(there[1], begin):
                span.radiated[number, channel, t] = 0.0
    there[1] = begin + frames


@njit(**CORE)
def _refresh_lines(core: int, thread: int, i: int, frames: int) -> int:
    """Bring all lines in line with what has been done to them; how many frames they go on so, at most so many."""
    bank, shared = bank_of(core), shared_of(core)
    instrument, coupling = bank.instruments[i], coupling_at(shared.coupling_at[i])
    changed = False
    count = frames
    for s in range(instrument.first_string, instrument.end_string):
        hand, stroke, motion, end = hand_of(core, s), stroke_of(core, s), motion_of(core, s), end_at(shared.end_at[s])
        if motion.stale:
            stand(core, thread, s)
        engaged, changed_it, certain = end.counts[ENGAGED], motion.stale != 0, False
        if motion.stale:
            whole = motion.stale == 1
            refresh(core, thread, s)
            certain = refresh_end(core, thread, s, whole)
            changed = True
        fingered = is_held(hand)
        changed_it = changed_it or (end.counts[BY_FRAMES] != 0 and not fingered)
        contacts = 0 if motion.flying else bank.models[hand.model].contacts
        line = s - instrument.first_string
        coupling.lines.model[line] = line_address(core, s)
        if bank.strings[s].friction > 0.0:
            engaged = end_at(shared.end_at[s - 1]).counts[ENGAGED]
        elif changed_it and contacts > 0 and not certain:
            engaged = 1 if certify_line(shared.coupling_at[i], line, thread) > 0 else 0
        if fingered:
            engaged = 1
        else:
            string_of(core, s).finger[0].push = 0.0
            if contacts == 0:
                engaged = 0
        if end.counts[ENGAGED] != engaged or changed_it:
            changed = True
            if not (may_go_by_frames(core, s) and go_by_frames(shared.coupling_at[i], line, thread)):
                look_at(shared.coupling_at[i], line, engaged, thread)
                if fingered:
                    fill_finger(shared.coupling_at[i], line, thread)
        string_of(core, s).finger[0].on = 1 if fingered else 0
        if hand.phase != NO_FINGER:
            count = min(count, (stroke.finger_steps - stroke.finger_step) // bank.strings[s].factor)
        if hand.phase == HIT:
            count = min(count, 1)
    for s in range(instrument.first_string, instrument.end_string):
        if hand_of(core, s).phase != NO_FINGER:
            make_path(core, thread, s, count * bank.strings[s].factor, end_at(shared.end_at[s]).path)
    if changed:
        _count_forces(core, i, int(np.int64(0)))
        gather_lines(shared.coupling_at[i])
    return count


@njit(**CORE)
def _count_forces(core: int, i: int, ahead: int) -> None:
    """What the forces on the bridge are counted from, so many quanta ahead: those of strings at rest.

    A string that is stopped elsewhere pulls at another angle. The bridge does not feel that as a blow, but the hand's work
    before: that it is counted as nothing comes slowly (`_follow_rest`).
    """
    shared = shared_of(core)
    instrument, coupling = bank_of(core).instruments[i], coupling_at(shared.coupling_at[i])
    held = coupling.bridge.held[ahead]
    for d in range(held.size):
        held[d] = 0.0
    for s in range(instrument.first_string, instrument.end_string):
        motion = motion_of(core, s)
        pull = motion.base - motion.rest
        if motion.lift > 0.0 and not motion.flying:
            pull += end_at(shared.end_at[s]).leverage[0] * motion.lift
        if pull != 0.0:
            for d in range(held.size):
                held[d] += coupling.lines.direction[s - instrument.first_string, d] * pull


@njit(**CORE)
def _follow_rest(core: int, i: int, ahead: int) -> None:
    """Let what the forces on the bridge are counted from, so many quanta ahead, follow the strings at rest by a quantum."""
    instrument = bank_of(core).instruments[i]
    follow = 1.0 - math.exp(-QUANTUM / (BASE_S * settings_of(core).rate_hz))
    changed = False
    for s in range(instrument.first_string, instrument.end_string):
        motion = motion_of(core, s)
        if motion.base != motion.rest:
            motion.base += follow * (motion.rest - motion.base)
            if abs(motion.rest - motion.base) < LEAST_PULL_N:
                motion.base = motion.rest
            changed = True
    if changed:
        _count_forces(core, i, ahead)
    elif ahead > 0:
        held = coupling_at(shared_of(core).coupling_at[i]).bridge.held
        put(held[ahead], held[ahead - 1])


@njit(**CORE)
def _sounds(core: int, i: int, begin: int, frames: int) -> bool:
    """Whether strings move like strings, and what the body has given is finite and below `BLOWN_UP`."""
    bank, span = bank_of(core), span_of(core)
    instrument = bank.instruments[i]
    for s in range(instrument.first_string, instrument.end_string):
        if not moves_like_a_string(core, s):
            return False
    for channel in range(2):
        row = span.radiated[instrument.body, channel, begin : begin + frames]
        if not dot(row, row) <= BLOWN_UP * BLOWN_UP:
            return False
    return True
