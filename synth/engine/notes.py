"""What an event means: which string takes a note, and the controllers of a channel."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.coefficients import CUT_S
from synth.engine.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, PROGRAM
from synth.engine.layout import (
    AWAKE,
    CORE,
    MOST_AWAKE,
    N_NOTES,
    N_STOLEN,
    N_TAKEN,
    PARAMETER_RANGES,
    PRESS,
)
from synth.engine.strings import damp, let_go, pluck
from synth.engine.views import bank_of, settings_of, state_of


@njit(**CORE)
def handle(core: int, desk: int, event) -> None:
    state = state_of(core)
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
        _note_on(core, desk, c, event.a, event.b)
    elif kind == NOTE_OFF or kind == NOTE_ON:
        _note_off(core, c, event.a)
    elif kind == CONTROL:
        _control(core, c, event.a, event.b)
    elif kind == BEND:
        state.channels[c].bend_raw = max(-1.0, min(1.0, event.a / 8192.0))
    elif kind == PROGRAM:
        state.channels[c].program = event.a & 127


@njit(**CORE)
def _note_on(core: int, desk: int, c: int, note: int, velocity: int) -> None:
    bank, state = bank_of(core), state_of(core)
    if not 0 <= note <= 127:
        return
    velocity = min(velocity, 127)
    state.counters[N_NOTES] += 1
    p = bank.program_map[c, state.channels[c].program]
    if p < 0:
        state.unplayed[bank.parts.size, note] += 1
        return
    chosen = _choose_position(core, p, c, note)
    if chosen < 0:
        state.unplayed[p, note] += 1
        return
    position = bank.positions[chosen]
    s = position.string
    me = state.sounding[s]
    if not me.awake or me.stolen:
        _make_room(core)
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
    pluck(core, desk, s, position.model, velocity, legato)


@njit(**CORE)
def _choose_position(core: int, p: int, c: int, note: int) -> int:
    """The place a player would take: the string already playing the note, else a string that is not held, nearest to
    the hand; among equals the one plucked longest ago. −1 where the note is on no string."""
    bank, state = bank_of(core), state_of(core)
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
def _make_room(core: int) -> None:
    """Where as many strings sound as are allowed, the quietest is cut."""
    bank, state, settings = bank_of(core), state_of(core), settings_of(core)
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
        damp(core, quietest, CUT_S)


@njit(**CORE)
def _note_off(core: int, c: int, note: int) -> None:
    bank, state = bank_of(core), state_of(core)
    for s in range(bank.strings.size):
        me = state.sounding[s]
        if me.held and me.channel == c and me.note == note:
            me.held = 0
            me.sustained = state.channels[c].sustain
            let_go(core, s)


@njit(**CORE)
def _release_all(core: int, c: int) -> None:
    bank, state = bank_of(core), state_of(core)
    for s in range(bank.strings.size):
        me = state.sounding[s]
        if me.channel == c and (me.held or me.sustained):
            if me.held:
                me.sustained = state.channels[c].sustain
            me.held = 0
            let_go(core, s)


@njit(**CORE)
def _sustain(core: int, c: int, value: int) -> None:
    bank, state = bank_of(core), state_of(core)
    state.channels[c].sustain = 1 if value >= 64 else 0
    if value < 64:
        for s in range(bank.strings.size):
            me = state.sounding[s]
            if me.channel == c and me.sustained:
                me.sustained = 0
                let_go(core, s)


@njit(**CORE)
def _control(core: int, c: int, controller: int, value: int) -> None:
    bank, state = bank_of(core), state_of(core)
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
        _sustain(core, c, value)
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
                damp(core, s, CUT_S)
    elif controller == 121:
        channel.expression = 1.0
        channel.legato = 0
        channel.rpn = 0x3FFF
        channel.bend_raw = 0.0
        _sustain(core, c, 0)
    elif controller >= 123:
        _release_all(core, c)
