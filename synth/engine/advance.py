"""One string through time: its internal steps, its output into its row of the span, levels, certificates, sleep.

Every string writes into a row of its own, so that strings can be worked off in any order and by any thread; the rows are
added up elsewhere, in order.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from synth.engine.coefficients import fill_sigma, refresh, refresh_in_flight, rest_state
from synth.engine.core import (
    bank_of,
    expression_of,
    hand_of,
    is_held,
    model_address,
    model_of,
    motion_of,
    progress_of,
    scratch_of,
    second_thread,
    settings_of,
    shared_of,
    span_of,
    state_of,
    string_of,
    stroke_of,
    tally_of,
    voice_of,
)
from synth.engine.ends import on_bridge
from synth.engine.expression import bend_of, follow, height_of, is_settled
from synth.engine.free_flight import fade, fly, row_of, take_off, touch_down
from synth.engine.instruments import may_fly, may_sleep
from synth.engine.layout import (
    BLOWN_UP,
    CHECK_EVERY,
    CORE,
    DRAW,
    FIRST_QUANTUM,
    FOLLOW,
    HIT,
    LANDED,
    NO_FINGER,
    OFF_BOARD,
    PLAIN,
    QUANTA,
    QUANTUM,
    SLEEP_BELOW,
    SPARE,
    STEP,
    STEP_TWO,
    TOUCHED,
)
from synth.engine.output import collect
from synth.engine.strings import damp, finger_done, sleep
from synth.engine.strokes import follow_stroke, has_bounced
from synth.engine.tension import bend_with_motion
from synth.engine.touches import lies_still, press_on
from synth.native.views import ask, call_back
from synth.solver.block_rows import BLOCK
from synth.solver.board_table import clear_by_energy, clear_of_board
from synth.solver.certificates import amplitudes, least_reach, reach
from synth.solver.laws import EXACT_HOLD
from synth.solver.lcp import SOLVED
from synth.solver.step import advance, advance_two, presses
from synth.solver.stringmodel import CERTAIN, FREE, MOVING, string_model
from synth.solver.vectors import FAST, dot, squares
from synth.units import LN_1000

#: a mode is put to rest when its largest possible output is below this (−160 dBFS)
PRUNE_BELOW = 1e-8
#: …and, where it may be moved by a contact again, when it moves no point of the string further than this [m]
PRUNE_WITHIN_M = 1e-9
#: T60 of a string that is spared [s]
SPARE_S = 0.1
#: a string has blown up when it is displaced by more than so many of its lengths, or moves faster than so many times the
#: speed of its waves (root mean squares along it): at one, slopes are about 1 and no string obeys linear equations any
#: more; plucked strings stay below a hundredth. Only a scheme that gains energy, or a state that is none, comes there
TOO_FAR = 10.0


@njit(**CORE)
def begin_quantum(core: int, thread: int, s: int, k: int) -> None:
    """What is decided about an awake string at the start of quantum k of the span."""
    if bank_of(core).strings[s].of_first:
        follow_first(core, s)
    else:
        follow_quantum(core, s, k)
    if (shared_of(core).task[FIRST_QUANTUM] + k) % CHECK_EVERY == 0:
        _check(core, thread, s)


@njit(**CORE)
def unchanged_quanta(core: int, thread: int, s: int, k: int) -> int:
    """Quanta of the span from k on that an awake string goes through as one stretch: behind the first one there is nothing
    to decide and no control to follow, and the arrays of a thread have room for them. `begin_quantum` has been for k."""
    shared, motion, fixed = shared_of(core), motion_of(core, s), bank_of(core).strings[s]
    if fixed.second >= 0 or fixed.of_first:
        return 1
    if not motion.flying and (motion.stale or not presses(model_address(core, s), shared.string_at[s])):
        return 1
    scratch = scratch_of(thread)
    room = min(scratch.out.size // 2, scratch.record.size) // (QUANTUM * fixed.factor)
    most = max(1, min(room, shared.task[QUANTA] - k))
    count = int(np.int64(1))
    while count < most and goes_on(core, s, k + count):
        count += 1
    return count


@njit(**CORE)
def goes_on(core: int, s: int, k: int) -> bool:
    """Whether `begin_quantum` of quantum k would change nothing about a string in one direction, and no finger is at it."""
    shared, span, state = shared_of(core), span_of(core), state_of(core)
    if hand_of(core, s).phase != NO_FINGER or bank_of(core).strings[s].axial_stiffness > 0.0:
        return False
    if (shared.task[FIRST_QUANTUM] + k) % CHECK_EVERY == 0 or not is_settled(core, s):
        return False
    voice, expression = voice_of(core, s), expression_of(core, s)
    bend = bend_of(core, s, k, span.bends[k, voice.channel], span.bends[k, state.channels[voice.channel].master])
    return (
        bend == expression.bend and height_of(core, s, span.heights[k, bank_of(core).strings[s].part]) == expression.height
    )


@njit(**CORE)
def follow_quantum(core: int, s: int, k: int) -> None:
    """A string's bend and the height of its obstacle in quantum k of the span."""
    state, shared, span = state_of(core), shared_of(core), span_of(core)
    voice, hand, expression = voice_of(core, s), hand_of(core, s), expression_of(core, s)
    follow(core, s)
    press_on(core, s)
    bend = bend_of(core, s, k, span.bends[k, voice.channel], span.bends[k, state.channels[voice.channel].master])
    height = height_of(core, s, span.heights[k, bank_of(core).strings[s].part])
    if bank_of(core).strings[s].axial_stiffness > 0.0:
        bend = bend_with_motion(core, s, k, bend)
    if bank_of(core).models[hand.model].contacts == 0 and shared.board_at[hand.model] == 0:
        expression.height = height  # nothing is under it that could be raised
    if expression.bend != bend or expression.height != height:
        _follow_controls(core, s, bend, height)


@njit(**CORE)
def follow_first(core: int, s: int) -> None:
    """The bend of a string's second direction, which is that of its first, just before."""
    expression, first = expression_of(core, s), expression_of(core, s - 1)
    if expression.bend != first.bend:
        _follow_controls(core, s, first.bend, expression.height)


@njit(**CORE)
def _follow_controls(core: int, s: int, bend: float, height: float) -> None:
    """Take over another pitch bend and obstacle height."""
    hand, expression, motion = hand_of(core, s), expression_of(core, s), motion_of(core, s)
    expression.bend = bend
    expression.height = height
    if on_bridge(core, s) and string_of(core, s).counts[FREE] == 0:
        string_of(core, s).counts[MOVING] = bank_of(core).models[hand.model].n
    motion.stale = 1


@njit(**CORE)
def advance_string(core: int, thread: int, s: int, start: int, frames: int) -> None:
    """`frames` output frames of one awake string from frame `start` of the span, in all of its directions, into their
    rows."""
    fixed = bank_of(core).strings[s]
    hand, stroke, motion, second = hand_of(core, s), stroke_of(core, s), motion_of(core, s), fixed.second
    _land(core, thread, s)
    if second >= 0:
        _land(core, thread, second)
    done = int(np.int64(0))
    while done < frames:
        count = frames - done
        if not motion.flying and hand.phase != NO_FINGER:
            count = min(count, max(1, (stroke.finger_steps - stroke.finger_step) // fixed.factor))
            if hand.phase == HIT:
                count = min(count, 1)
        _advance_line(core, thread, s, start + done, count)
        if second >= 0:
            _advance_line(core, thread, second, start + done, count)
        done += count
        if (
            not motion.flying
            and hand.phase != NO_FINGER
            and (stroke.finger_step >= stroke.finger_steps or has_bounced(core, s))
        ):
            finger_done(core, thread, s)
    _end_stretch(core, s, start, frames)


@njit(**CORE)
def _end_stretch(core: int, s: int, start: int, frames: int) -> None:
    """End a stretch of a string, in all of its directions: add what still fades, and silence a motion that is no sound, from
    the start of the stretch on. How long that is may hang on blocks and threads, for such a motion alone."""
    tally, second = tally_of(core, s), bank_of(core).strings[s].second
    fade(core, s, start, frames)
    if second >= 0:
        fade(core, second, start, frames)
    if not _is_sound(core, s, start) or (second >= 0 and not _is_sound(core, second, start)):
        _silence(core, s, start)
        tally.silenced += 1
        if second >= 0:
            _silence(core, second, start)


@njit(**CORE)
def advance_two_strings(core: int, thread: int, s: int, other: int, start: int, frames: int) -> None:
    """`advance_string` of two awake strings that share nothing, to the bit; side by side where both only press."""
    strings = bank_of(core).strings
    factor = strings[s].factor
    beside = strings[other].factor == factor and _may_go_beside(core, thread, s, frames)
    if not (beside and _may_go_beside(core, thread, other, frames)):
        advance_string(core, thread, s, start, frames)
        advance_string(core, thread, other, start, frames)
        return
    ask(shared_of(core).task[STEP_TWO], core, thread, s, other, frames * factor)
    for place in range(2):
        line = s if place == 0 else other
        motion, row = motion_of(core, line), row_of(core, line, start, frames)
        motion.base = collect(
            core, thread if place == 0 else second_thread(thread), line, row.size, factor, motion.base, row
        )
        _end_stretch(core, line, start, frames)


@njit(**CORE)
def _may_go_beside(core: int, thread: int, s: int, frames: int) -> bool:
    """Whether these frames of a string are whole blocks of steps over its one contact, and no more."""
    shared, fixed, hand, motion = shared_of(core), bank_of(core).strings[s], hand_of(core, s), motion_of(core, s)
    if fixed.second >= 0 or fixed.of_first or hand.phase != NO_FINGER or frames * fixed.factor % BLOCK != 0:
        return False
    if shared.task[STEP] != shared.task[OFF_BOARD]:  # somebody else makes steps, or looks on
        return False
    _land(core, thread, s)
    if motion.flying:
        return False
    if motion.stale:
        _refresh_keeping_free(core, thread, s)
    string_of(core, s).finger[0].on = 0
    return presses(model_address(core, s), shared.string_at[s])


def make_steps_of_two(core: int, thread: int, s: int, other: int, steps: int) -> None:
    """`make_steps` of two strings that only press; the outputs of the other one go to the second Scratch."""
    string_at = shared_of(core).string_at
    advance_two(
        model_address(core, s), string_at[s], thread,
        model_address(core, other), string_at[other], second_thread(thread), steps // BLOCK,
    )  # fmt: skip
    for place in range(2):
        line = s if place == 0 else other
        tally_of(core, line).mode_steps += string_of(core, line).counts[MOVING] * steps


@njit(**CORE)
def _land(core: int, thread: int, s: int) -> None:
    """A string that flies but may not any more is back at its internal rate."""
    hand, motion = hand_of(core, s), motion_of(core, s)
    if motion.flying == LANDED:
        return
    if motion.stale == 1 and not is_held(hand) and shared_of(core).board_at[hand.model] == 0:
        refresh_in_flight(core, thread, s)
        if not motion.altered:  # else that was part of it
            fill_sigma(core, thread, s, string_of(core, s).counts[MOVING])
        string_of(core, s).counts[FREE] = 1 if _nothing_in_reach(core, thread, s) else 0
    if is_held(hand) and not lies_still(core, s, QUANTUM * bank_of(core).strings[s].factor):
        string_of(core, s).counts[FREE] = 0
    if motion.stale or not string_of(core, s).counts[FREE] or not may_fly(core, s):
        touch_down(core, thread, s)


@njit(**CORE)
def _refresh_keeping_free(core: int, thread: int, s: int) -> None:
    """`refresh`; a string over a board that could touch nothing, and still cannot, goes on as free as it was."""
    hand, motion, string = hand_of(core, s), motion_of(core, s), string_of(core, s)
    was_free, moving = string.counts[FREE] != 0, string.counts[MOVING]
    was_free = was_free and motion.stale == 1 and not is_held(hand) and shared_of(core).board_at[hand.model] != 0
    refresh(core, thread, s)
    if was_free:
        all_modes, string.counts[MOVING] = string.counts[MOVING], moving
        fill_sigma(core, thread, s, moving)
        string.counts[FREE] = 1 if _nothing_in_reach(core, thread, s) else 0
        if string.counts[FREE] == 0:
            string.counts[MOVING] = all_modes


@njit(**CORE)
def _advance_line(core: int, thread: int, s: int, start: int, frames: int) -> None:
    """The same of one direction, while the hand does one and the same thing to it."""
    motion = motion_of(core, s)
    if motion.flying:
        fly(core, thread, s, start, frames)
        return
    row = row_of(core, s, start, frames)
    if motion.stale:
        _refresh_keeping_free(core, thread, s)
    call_back(shared_of(core).task[STEP], core, thread, s, row.size)
    motion.base = collect(core, thread, s, row.size, bank_of(core).strings[s].factor, motion.base, row)


@njit(**CORE)
def _is_sound(core: int, s: int, start: int) -> bool:
    """Whether a string in one direction moves like a string, and what it gives may be a sound."""
    return moves_like_a_string(core, s) and _sounds(core, s, start)


@njit(**CORE)
def moves_like_a_string(core: int, s: int) -> bool:
    """Whether displacement and velocity are finite and within `TOO_FAR`."""
    hand, expression, string = hand_of(core, s), expression_of(core, s), string_of(core, s)
    model = bank_of(core).models[hand.model]
    moving = string.counts[MOVING]
    far, fast = squares(string.q[:moving], string.v[:moving])
    length = model.length
    # modes are normalised: ∫u² dx = Σ q², so that the mean square is Σ q²/L; a bend upwards raises the waves' speed
    tension = model.tension
    if expression.bend > 0.0:
        tension *= 2.0 ** (expression.bend / 6.0)
    most_far, most_fast = TOO_FAR * TOO_FAR * length * length, TOO_FAR * TOO_FAR * tension / model.mu
    return far <= most_far * length and fast <= most_fast * length


@njit(**CORE)
def _span_of(place: int, begin: int, end: int, start: int):
    """(first, past the last) element of what a row at `place` holds, from `begin` to `end`, not before `start`."""
    first = max(begin, start)
    return place + first, place + max(first, end)


@njit(**CORE)
def _sounds(core: int, s: int, start: int) -> bool:
    """Whether what the string has given since frame `start` of the span is finite and below `BLOWN_UP`."""
    span = span_of(core)
    fixed = bank_of(core).strings[s]
    progress = progress_of(core, s)
    first, end = _span_of(fixed.row, progress.row_from, progress.row_to, start * fixed.factor)
    row = span.rows[first:end]
    first, end = _span_of(fixed.direct, progress.direct_from, progress.direct_to, start)
    direct = span.direct[first:end]
    return dot(row, row) <= BLOWN_UP * BLOWN_UP and dot(direct, direct) <= BLOWN_UP * BLOWN_UP


@njit(**CORE)
def _silence(core: int, s: int, start: int) -> None:
    """The string has blown up: what it has given since frame `start` is taken back, and it sleeps until it is plucked."""
    span, string = span_of(core), string_of(core, s)
    fixed = bank_of(core).strings[s]
    motion, progress = motion_of(core, s), progress_of(core, s)
    first, end = _span_of(fixed.row, progress.row_from, progress.row_to, start * fixed.factor)
    span.rows[first:end] = 0.0
    first, end = _span_of(fixed.direct, progress.direct_from, progress.direct_to, start)
    span.direct[first:end] = 0.0
    string.u[:] = 0.0
    string.v_contact[:] = 0.0
    string.force[:] = 0.0
    string.certificates.margin[:] = 0.0
    string.certificates.bounds[:] = 0.0
    string.finger[0].here = 0.0
    string.finger[0].push = 0.0
    motion.base = motion.rest
    motion.fade_at = motion.fade_to = 0
    motion.flying = 0
    sleep(core, s)


def make_steps(core: int, thread: int, s: int, steps: int) -> None:
    """Internal steps of one string; its outputs go to Scratch.out, a row of `steps` for each."""
    hand, tally, string = hand_of(core, s), tally_of(core, s), string_of(core, s)
    moved = string.counts[MOVING]
    string.finger[0].on = 1 if is_held(hand) else 0
    if hand.phase != NO_FINGER:
        step_along_path(core, thread, s, steps)
    if advance(model_address(core, s), shared_of(core).string_at[s], thread, steps, int(np.int64(1))) != SOLVED:
        tally.unsolved += 1
    tally.mode_steps += max(moved, string.counts[MOVING]) * steps


@njit(**CORE)
def step_along_path(core: int, thread: int, s: int, steps: int) -> None:
    """Scratch.path: where a finger, if there is one, is before its next steps and after each of them; it has gone there."""
    hand, stroke = hand_of(core, s), stroke_of(core, s)
    follow = shared_of(core).excitation[bank_of(core).strings[s].part, FOLLOW]
    if follow != 0 and hand.phase == DRAW:
        call_back(follow, core, thread, s, steps)
    elif is_held(hand):
        follow_stroke(core, thread, s, steps)
    stroke.finger_step += steps


@njit(**CORE)
def make_path(core: int, thread: int, s: int, steps: int, path) -> None:
    """The same into `path` (≥ steps + 1,)."""
    step_along_path(core, thread, s, steps)
    scratch = scratch_of(thread)
    for t in range(steps + 1):
        path[t] = scratch.path[t]


@njit(fastmath=FAST, **CORE)
def _energy_norm(omega, q, v, q_rest) -> float:
    total = 0.0
    for j in range(q.size):
        d = omega[j] * (q[j] - q_rest[j])
        total += d * d + v[j] * v[j]
    return math.sqrt(total)


@njit(**CORE)
def _check(core: int, thread: int, s: int) -> None:
    """Level, certificate that contacts are out of reach, rest for inaudible modes, flight, sleep."""
    bank, state, settings, scratch = bank_of(core), state_of(core), settings_of(core), scratch_of(thread)
    voice, hand, expression = voice_of(core, s), hand_of(core, s), expression_of(core, s)
    motion, string = motion_of(core, s), string_of(core, s)
    if NO_FINGER < hand.phase < TOUCHED:
        return
    if motion.stale:  # as when a hand bends it without a stop
        _land(core, thread, s)
        _refresh_keeping_free(core, thread, s)
    fixed = bank.strings[s]
    constants = bank.models[hand.model]
    plain, model = string_model(shared_of(core).model_at[hand.model, PLAIN]), model_of(core, s)
    n = string.counts[MOVING]
    q, v = string.q[:n], string.v[:n]
    rest_state(core, thread, s, scratch.modes.q)
    voice.level = constants.output_bound * _energy_norm(plain.omega[:n], q, v, scratch.modes.q[:n])
    if model.outputs.points == model.outputs.on_q:
        voice.level += abs(motion.base - motion.rest)
    if voice.level < SLEEP_BELOW and not fixed.of_first and may_sleep(core, s):
        sleep(core, s)
        if fixed.second >= 0:
            sleep(core, fixed.second)
        return
    if voice.level < state.meters[SPARE] and not fixed.of_first and not voice.held and expression.hand < LN_1000 / SPARE_S:
        damp(core, s, SPARE_S)
        return
    if not settings.economy or model.law != EXACT_HOLD:
        return  # the amplitudes below are those of v = q̇
    may = motion.flying == LANDED and _may_take_off(core, s)
    if hand.phase != NO_FINGER:
        if motion.flying == LANDED:
            string.counts[FREE] = 1 if may and _has_too_little_energy(core, thread, s) else 0
        if may and string.counts[FREE]:
            _take_off(core, thread, s)
        return
    if string.counts[FREE] == 0 and model.contacts.size == 1 and _is_in_reach(core, s):
        return  # touched again and again, and all modes with it
    omega, sigma = model.omega[:n], scratch.modes.sigma[:n]
    fill_sigma(core, thread, s, n)
    amplitude = scratch.modes.amplitude
    if not string.counts[FREE]:  # what is certain to be out of reach stays so until something touches the string
        string.counts[FREE] = 1 if _nothing_in_reach(core, thread, s) else 0
        if string.counts[FREE] == 0 and model.contacts.size == 1:
            return  # touched again and again, and all modes with it
    free = string.counts[FREE]
    peak = math.sqrt(2.0 / constants.length)  # of a mode shape
    moved = False
    while n > 1:
        j = n - 1
        amplitudes(omega[j:n], sigma[j:n], q[j:n], v[j:n], amplitude)
        heard = abs(model.outputs.weights[0, j]) + abs(model.outputs.weights[1, j]) * omega[j]
        if heard * amplitude[0] >= PRUNE_BELOW or (free == 0 and peak * amplitude[0] >= PRUNE_WITHIN_M):
            break
        moved = moved or q[j] != 0.0 or v[j] != 0.0
        q[j] = 0.0
        v[j] = 0.0
        n -= 1
    if moved:
        string.counts[CERTAIN] = 0  # if by nanometres
    string.counts[MOVING] = n
    if free and may:
        _take_off(core, thread, s)


@njit(**CORE)
def _may_take_off(core: int, s: int) -> bool:
    """Whether a string that can touch nothing has a bus to fly on, with what lies on it, if that lies still."""
    hand, expression, fixed = hand_of(core, s), expression_of(core, s), bank_of(core).strings[s]
    if fixed.direct_bus < 0 or (shared_of(core).board_at[hand.model] != 0 and expression.bend != 0.0):
        return False
    return hand.phase == NO_FINGER or (hand.phase == TOUCHED and lies_still(core, s, CHECK_EVERY * QUANTUM * fixed.factor))


@njit(**CORE)
def _take_off(core: int, thread: int, s: int) -> None:
    """A string flies from here on, and what it is together with, if all of it may."""
    bank = bank_of(core)
    instrument = bank.instruments[bank.strings[s].instrument]
    if not may_fly(core, s):
        return
    first, end = (instrument.first_string, instrument.end_string) if instrument.together else (s, s + 1)
    for other in range(first, end):
        if voice_of(core, other).awake and motion_of(core, other).flying == LANDED and _may_take_off(core, other):
            take_off(core, thread, other)


@njit(**CORE)
def _has_too_little_energy(core: int, thread: int, s: int) -> bool:
    """Whether a string under what lies on it, at rest itself, can touch nothing any more: with E the energy of both, which
    does not grow, no point is displaced by more than √(2 E C), C its static compliance."""
    string, model, hand = string_of(core, s), model_of(core, s), hand_of(core, s)
    constants, n, finger = bank_of(core).models[hand.model], string.counts[MOVING], string_of(core, s).finger[0]
    omega, q, v = model.omega[:n], string.q[:n], string.v[:n]
    twice = finger.stiffness * finger.here * finger.here  # 2 E
    for j in range(n):
        w = omega[j] * q[j]
        twice += model.mu * (v[j] * v[j] + w * w)
    board = shared_of(core).board_at[hand.model]
    if board != 0:
        return clear_by_energy(board, twice / constants.tension)
    for k in range(model.contacts.size):
        compliance = 0.0
        for j in range(n):
            compliance += (model.contacts.shapes[k, j] / omega[j]) ** 2
        if string.eta[k] >= 0.0 or string.force[k] > 0.0 or twice * compliance / model.mu >= 0.99 * string.eta[k] ** 2:
            return False
    return True


@njit(**CORE)
def _is_in_reach(core: int, s: int) -> bool:
    """Whether a string's one contact is in reach by its modes' displacements alone, for whose amplitudes below they are a
    lower bound: what `_nothing_in_reach` denies."""
    string, model, hand = string_of(core, s), model_of(core, s), hand_of(core, s)
    if shared_of(core).board_at[hand.model] != 0:
        return False
    if string.eta[0] >= 0.0 or string.force[0] > 0.0:
        return True
    return least_reach(model.contacts.shapes[0], string.q[: string.counts[MOVING]]) >= -string.eta[0]


@njit(**CORE)
def _nothing_in_reach(core: int, thread: int, s: int) -> bool:
    """Whether free flight, with Scratch.modes.sigma, touches no contact any more."""
    scratch, string, model = scratch_of(thread), string_of(core, s), model_of(core, s)
    n, contacts = string.counts[MOVING], model.contacts.size
    board = shared_of(core).board_at[hand_of(core, s).model]
    if board != 0:
        amplitudes(model.omega[:n], scratch.modes.sigma[:n], string.q[:n], string.v[:n], scratch.modes.amplitude[:n])
        return clear_of_board(board, scratch.modes.amplitude[:n])
    for k in range(contacts):
        if string.eta[k] >= 0.0 or string.force[k] > 0.0:  # where it pressed just now it is, and can be again
            return False
    amplitude = scratch.modes.amplitude[:n]
    if contacts:
        amplitudes(model.omega[:n], scratch.modes.sigma[:n], string.q[:n], string.v[:n], amplitude)
    for k in range(contacts):
        if reach(model.contacts.shapes[k], amplitude) >= -0.999 * string.eta[k]:
            return False
    return True
