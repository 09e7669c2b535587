"""The native core: everything between an event and a sample, without the interpreter, locks or allocation.

Time counts from the start of the stream in frames of the output. Strings advance in quanta of QUANTUM frames, cut at
the frames of events and nowhere else, so that the host's block size changes nothing. A quantum is computed when all of
its events are known, which costs QUANTUM frames of latency.
"""

from __future__ import annotations

import math

from numba import njit

from synth.dsp.body import body_filter
from synth.dsp.decimator import decimate
from synth.dsp.denormals import enable_ftz, restore
from synth.dsp.limiter import LOOKAHEAD, limit
from synth.engine.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, PROGRAM
from synth.engine.layout import (
    AWAKE,
    CHECK_EVERY,
    CORE,
    GAIN,
    HEIGHT,
    MOST_AWAKE,
    N_DROPPED,
    N_NOTES,
    N_STOLEN,
    N_TAKEN,
    NOW,
    PARAMETER_RANGES,
    PENDING,
    PRESS,
    PRODUCED,
    QUANTUM,
    RING,
)
from synth.engine.strings import CUT_S, advance_string, check, damp, follow_controls, let_go, pluck

#: pitch bend and obstacle height follow their controls with this time constant [s]
CONTROL_S = 0.01


@njit(cache=True, nogil=True)
def process(bank, state, settings, scratch, events, out, stems) -> None:
    """One block: `events` (EVENT, frames from the block's start, in order), `out` (frames, 2), `stems` (parts or 0,
    frames, 2). Output is late by QUANTUM + the decimator's latency + the limiter's look-ahead."""
    saved = enable_ftz()
    now = state.counters[NOW]
    for i in range(events.size):
        at = state.counters[PENDING]
        if at >= state.pending.size:
            state.counters[N_DROPPED] += events.size - i
            break
        state.pending[at].frame = now + events[i].frame
        state.pending[at].kind = events[i].kind
        state.pending[at].channel = events[i].channel
        state.pending[at].a = events[i].a
        state.pending[at].b = events[i].b
        state.pending[at].value = events[i].value
        state.counters[PENDING] = at + 1
    peak = state.meters[0]
    for i in range(out.shape[0]):
        at = now + i - QUANTUM
        if at < 0:
            out[i, 0] = 0.0
            out[i, 1] = 0.0
        else:
            if at >= state.counters[PRODUCED]:
                _quantum(bank, state, settings, scratch)
            left, right = state.ring[at % RING, 0], state.ring[at % RING, 1]
            out[i, 0] = left
            out[i, 1] = right
            peak = max(peak, abs(left), abs(right))
        late = at - LOOKAHEAD if settings.limiter else at
        for p in range(stems.shape[0]):
            for side in range(2):
                stems[p, i, side] = state.stems[p, late % RING, side] if late >= 0 else 0.0
    state.meters[0] = peak
    state.counters[NOW] = now + out.shape[0]
    restore(saved)


@njit(**CORE)
def _quantum(bank, state, settings, scratch) -> None:
    start = state.counters[PRODUCED]
    _smooth_controls(bank, state, settings)
    scratch.bus[:] = 0.0
    # what a step ends with belongs to the instant after it, whatever the step: the last one to the next quantum
    for b in range(bank.buses.size):
        scratch.bus[b, 0] = state.carry[b]
    awake = 0
    looking = (start // QUANTUM) % CHECK_EVERY == 0
    for s in range(bank.strings.size):
        me = state.sounding[s]
        if me.awake:
            moved = me.bend != state.channels[me.channel].bend
            if moved or me.height != state.part_state[bank.strings[s].part].height:
                follow_controls(bank, state, s)
            if looking:
                check(bank, state, settings, scratch, s)
            awake += state.sounding[s].awake
    state.counters[AWAKE] = awake
    taken = 0
    frame = 0
    while frame < QUANTUM:
        while taken < state.counters[PENDING] and state.pending[taken].frame <= start + frame:
            _handle(bank, state, settings, scratch, state.pending[taken])
            taken += 1
        until = QUANTUM
        if taken < state.counters[PENDING]:
            until = min(until, state.pending[taken].frame - start)
        for s in range(bank.strings.size):
            if state.sounding[s].awake:
                advance_string(bank, state, settings, scratch, s, frame, until - frame)
        frame = until
    left = state.counters[PENDING] - taken
    if taken > 0:
        for i in range(left):
            state.pending[i].frame = state.pending[i + taken].frame
            state.pending[i].kind = state.pending[i + taken].kind
            state.pending[i].channel = state.pending[i + taken].channel
            state.pending[i].a = state.pending[i + taken].a
            state.pending[i].b = state.pending[i + taken].b
            state.pending[i].value = state.pending[i + taken].value
        state.counters[PENDING] = left
    for b in range(bank.buses.size):
        state.carry[b] = scratch.bus[b, QUANTUM * bank.buses[b].factor]
    _mix(bank, state, settings, scratch, start)
    state.counters[PRODUCED] = start + QUANTUM


@njit(**CORE)
def _smooth_controls(bank, state, settings) -> None:
    share = 1.0 - math.exp(-QUANTUM / (CONTROL_S * settings.rate_hz))
    for c in range(state.channels.size):
        channel = state.channels[c]
        target = channel.bend_raw * channel.bend_range
        if channel.bend != target:
            channel.bend += share * (target - channel.bend)
            if abs(channel.bend - target) < 1e-4:
                channel.bend = target
    for p in range(bank.parts.size):
        part = state.part_state[p]
        target = 1e-6 * state.parameters[p, HEIGHT]
        if part.height != target:
            part.height += share * (target - part.height)
            if abs(part.height - target) < 1e-10:
                part.height = target


@njit(**CORE)
def _mix(bank, state, settings, scratch, start: int) -> None:
    mix = scratch.mix
    mix[:] = 0.0
    for p in range(bank.parts.size):
        part = bank.parts[p]
        me = state.part_state[p]
        mono, frame = scratch.mono, scratch.frame
        mono[:] = 0.0
        for b in range(part.first_bus, part.end_bus):
            bus = bank.buses[b]
            decimate(
                bank.taps[bus.taps : bus.taps + bus.n_taps],
                bus.factor,
                state.history[bus.off : bus.off + bus.n_taps - 1],
                scratch.bus[b, : QUANTUM * bus.factor],
                scratch.decimator,
                frame,
            )
            for i in range(QUANTUM):
                mono[i] += frame[i]
        if part.body_n > 0:
            for i in range(QUANTUM):
                frame[i] = part.direct * mono[i]
            body_filter(
                bank.body[:, part.body_off : part.body_off + part.body_n],
                state.body[:, part.body_off : part.body_off + part.body_n],
                mono,
                frame,
            )
            for i in range(QUANTUM):
                mono[i] = frame[i]
        channel = state.channels[part.channel]
        level = channel.volume * channel.expression * state.parameters[p, GAIN] * settings.gain
        angle = 0.25 * math.pi * (1.0 + channel.pan)
        to_left = level * math.sqrt(2.0) * math.cos(angle)
        to_right = level * math.sqrt(2.0) * math.sin(angle)
        left, right, before, high = me.left, me.right, me.dc_in, me.dc_out
        for i in range(QUANTUM):
            high = mono[i] - before + settings.dc * high
            before = mono[i]
            left += settings.smoothing * (to_left - left)
            right += settings.smoothing * (to_right - right)
            place = (start + i) % RING
            state.stems[p, place, 0] = left * high
            state.stems[p, place, 1] = right * high
            mix[i, 0] += left * high
            mix[i, 1] += right * high
        me.left, me.right, me.dc_in, me.dc_out = left, right, before, high
    if settings.limiter:
        limit(
            state.delay,
            state.required,
            state.released,
            state.limiter_counters,
            state.limiter_levels,
            settings.ceiling,
            settings.limiter_release,
            mix,
        )
    for i in range(QUANTUM):
        place = (start + i) % RING
        state.ring[place, 0] = mix[i, 0]
        state.ring[place, 1] = mix[i, 1]


@njit(**CORE)
def _handle(bank, state, settings, scratch, event) -> None:
    kind, c = event.kind, event.channel
    if kind == PARAMETER:
        if 0 <= c < state.parameters.shape[0] and 0 <= event.a < state.parameters.shape[1]:
            if math.isfinite(event.value):
                low, high = PARAMETER_RANGES[event.a]
                state.parameters[c, event.a] = min(max(event.value, low), high)
        return
    if not 0 <= c < state.channels.size:
        return
    if kind == NOTE_ON and event.b > 0:
        _note_on(bank, state, settings, scratch, c, event.a, event.b)
    elif kind == NOTE_OFF or kind == NOTE_ON:
        _note_off(bank, state, c, event.a)
    elif kind == CONTROL:
        _control(bank, state, c, event.a, event.b)
    elif kind == BEND:
        state.channels[c].bend_raw = max(-1.0, min(1.0, event.a / 8192.0))
    elif kind == PROGRAM:
        state.channels[c].program = event.a & 127


@njit(**CORE)
def _note_on(bank, state, settings, scratch, c: int, note: int, velocity: int) -> None:
    if not 0 <= note <= 127:
        return
    velocity = min(velocity, 127)
    state.counters[N_NOTES] += 1
    p = bank.program_map[c, state.channels[c].program]
    if p < 0:
        state.unplayed[bank.parts.size, note] += 1
        return
    chosen = _choose_position(bank, state, p, c, note)
    if chosen < 0:
        state.unplayed[p, note] += 1
        return
    position = bank.positions[chosen]
    s = position.string
    me = state.sounding[s]
    if not me.awake or me.stolen:
        _make_room(bank, state, settings)
    if not me.awake:
        state.counters[AWAKE] += 1
        state.counters[MOST_AWAKE] = max(state.counters[MOST_AWAKE], state.counters[AWAKE])
    legato = state.channels[c].legato != 0 and me.held != 0 and me.awake != 0 and me.model != position.model
    if me.held and me.awake and not legato and (me.note != note or me.channel != c):
        state.counters[N_TAKEN] += 1
    me.note = note
    me.channel = c
    me.held = 1
    me.sustained = 0
    me.plucked_at = state.counters[N_NOTES]
    if position.fret > 0:
        state.part_state[p].hand = position.fret
    pluck(bank, state, settings, scratch, s, position.model, velocity, legato)


@njit(**CORE)
def _choose_position(bank, state, p: int, c: int, note: int) -> int:
    """The place a player would take: the string already playing the note, else a string that is not held, nearest to
    the hand; among equals the one plucked longest ago. −1 where the note is on no string."""
    part = bank.parts[p]
    hand = state.part_state[p].hand
    best, best_cost, best_age = -1, 0.0, 0
    for k in range(part.first_position, part.end_position):
        position = bank.positions[k]
        if position.note != note:
            continue
        me = state.sounding[position.string]
        cost = 0.0
        if bank.strings[position.string].positions > 1:
            cost = abs(position.fret - hand) if position.fret > 0 else 1.0
            stopped_at = me.pending_model if me.phase == PRESS else me.model
            if me.awake and stopped_at == position.model:
                cost -= 1000.0
            elif me.awake and me.held and state.channels[c].legato and me.channel == c:
                cost -= 500.0  # hammered on or pulled off, on the string that sounds
            elif me.awake and me.held:
                cost += 1000.0
        age = me.plucked_at
        if best < 0 or cost < best_cost or (cost == best_cost and age < best_age):
            best, best_cost, best_age = k, cost, age
    return best


@njit(**CORE)
def _make_room(bank, state, settings) -> None:
    """Where as many strings sound as are allowed, the quietest is cut."""
    sounding = 0
    quietest = -1
    for s in range(bank.strings.size):
        me = state.sounding[s]
        if me.awake and not me.stolen:
            sounding += 1
            if quietest < 0:
                quietest = s
                continue
            other = state.sounding[quietest]
            if me.level < other.level or (me.level == other.level and me.plucked_at < other.plucked_at):
                quietest = s
    if sounding >= settings.polyphony and quietest >= 0:
        state.sounding[quietest].stolen = 1
        state.sounding[quietest].held = 0
        state.sounding[quietest].sustained = 0
        state.sounding[quietest].phase = 0
        state.counters[N_STOLEN] += 1
        damp(state, quietest, CUT_S)


@njit(**CORE)
def _note_off(bank, state, c: int, note: int) -> None:
    for s in range(bank.strings.size):
        me = state.sounding[s]
        if me.held and me.channel == c and me.note == note:
            me.held = 0
            me.sustained = state.channels[c].sustain
            let_go(bank, state, s)


@njit(**CORE)
def _release_all(bank, state, c: int) -> None:
    for s in range(bank.strings.size):
        me = state.sounding[s]
        if me.channel == c and (me.held or me.sustained):
            if me.held:
                me.sustained = state.channels[c].sustain
            me.held = 0
            let_go(bank, state, s)


@njit(**CORE)
def _sustain(bank, state, c: int, value: int) -> None:
    state.channels[c].sustain = 1 if value >= 64 else 0
    if value < 64:
        for s in range(bank.strings.size):
            me = state.sounding[s]
            if me.channel == c and me.sustained:
                me.sustained = 0
                let_go(bank, state, s)


@njit(**CORE)
def _control(bank, state, c: int, controller: int, value: int) -> None:
    channel = state.channels[c]
    value = min(max(value, 0), 127)
    x = value / 127.0
    if controller == 7:  # unity at the power-up value of 100; the curve is the recommended 40 log₁₀
        channel.volume = (127.0 * x / 100.0) ** 2
    elif controller == 11:
        channel.expression = x * x
    elif controller == 10:
        channel.pan = max(-1.0, (value - 64) / 63.0)
    elif controller == 64:
        _sustain(bank, state, c, value)
    elif controller == 68:
        channel.legato = 1 if value >= 64 else 0
    elif controller == 100:
        channel.rpn = (channel.rpn & ~0x7F) | (value & 0x7F)
    elif controller == 101:
        channel.rpn = (channel.rpn & 0x7F) | ((value & 0x7F) << 7)
    elif controller == 98 or controller == 99:
        channel.rpn = 0x3FFF
    elif controller == 6 and channel.rpn == 0:
        channel.bend_range = min(value, 48) + (channel.bend_range - math.floor(channel.bend_range))
    elif controller == 38 and channel.rpn == 0:
        channel.bend_range = math.floor(channel.bend_range) + min(value, 99) / 100.0
    elif controller == 120:
        for s in range(bank.strings.size):
            me = state.sounding[s]
            if me.channel == c and me.awake:
                me.held = 0
                me.sustained = 0
                me.phase = 0
                damp(state, s, CUT_S)
    elif controller == 121:
        channel.expression = 1.0
        channel.legato = 0
        channel.rpn = 0x3FFF
        channel.bend_raw = 0.0
        _sustain(bank, state, c, 0)
    elif controller >= 123:
        _release_all(bank, state, c)
