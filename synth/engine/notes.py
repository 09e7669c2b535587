"""What an event means: which string takes a note, and the controllers of a channel."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.coefficients import CUT_S
from synth.engine.core import bank_of, settings_of, shared_of, state_of
from synth.engine.events import (
    BEND,
    CONTROL,
    KEY_PRESSURE,
    NOTE_OFF,
    NOTE_ON,
    PARAMETER,
    PRESSURE,
    PROGRAM,
    TUNING,
)
from synth.engine.expression import MOST_RETUNING, belongs, pedal, timbre_of
from synth.engine.layout import (
    AWAKE,
    CORE,
    GAIN,
    HEIGHT,
    MOST_AWAKE,
    N_NOTES,
    N_STOLEN,
    N_TAKEN,
    NO_FINGER,
    PARAMETER_RANGES,
    PRESS,
    RATIO,
    SQUARE,
    UNTIL,
    WORK_ON,
)
from synth.engine.strings import damp, let_go, pluck
from synth.engine.zones import CONFIGURATION, LOWER, MOST_MEMBERS, UPPER, manager_of, master_of, yielded
from synth.native.views import call_back

#: widest pitch bend that can be asked for [semitones], and what members of an MPE zone and other channels begin with
WIDEST_BEND, MEMBER_BEND, PLAIN_BEND = 96, 48.0, 2.0
#: numbers of registered parameters: pitch bend sensitivity, MPE configuration, none
RPN_BEND, RPN_ZONE, RPN_NONE = 0, CONFIGURATION, 0x3FFF

_manager_of, _master_of, _yielded = njit(**CORE)(manager_of), njit(**CORE)(master_of), njit(**CORE)(yielded)


@njit(**CORE)
def catch_up(core: int, desk: int, s: int) -> None:
    """Let a string that is about to be touched go on to the frame of the event: before anything changes that it reads."""
    shared = shared_of(core)
    me = state_of(core).sounding[s]
    if me.awake and me.reached < shared.task[UNTIL]:
        call_back(shared.task[WORK_ON], core, desk, s, 0)
        if not me.awake:  # it had blown up
            state_of(core).counters[AWAKE] -= 1
    me.reached = shared.task[UNTIL]


@njit(**CORE)
def handle(core: int, desk: int, event) -> None:
    state = state_of(core)
    kind, c = event.kind, event.channel
    if kind == PARAMETER:
        if 0 <= c < state.parameters.shape[0] and 0 <= event.a < state.parameters.shape[1]:
            if math.isfinite(event.value):
                _set_parameter(core, desk, c, event.a, event.value)
        return
    if kind == TUNING:
        _tune(core, event.a, event.value, event.b)
        return
    if not 0 <= c < state.channels.size:
        return
    if kind == NOTE_ON and event.b > 0:
        _note_on(core, desk, c, event.a, event.b)
    elif kind == NOTE_OFF or kind == NOTE_ON:
        _note_off(core, desk, c, event.a)
    elif kind == CONTROL:
        _control(core, desk, c, event.a, event.b)
    elif kind == BEND:
        state.channels[c].bend_raw = max(-1.0, min(1.0, event.a / 8192.0))
    elif kind == PROGRAM:
        state.channels[c].program = event.a & 127
    elif kind == PRESSURE:
        state.channels[c].pressure = min(max(event.b, 0), 127) / 127.0
    elif kind == KEY_PRESSURE:
        for s in range(state.sounding.size):
            me = state.sounding[s]
            if me.note == event.a and me.held and belongs(core, me.channel, c):
                me.key_pressure = min(max(event.b, 0), 127) / 127.0


@njit(**CORE)
def _set_parameter(core: int, desk: int, p: int, index: int, value: float) -> None:
    bank, state = bank_of(core), state_of(core)
    if index != GAIN and index != HEIGHT:  # what a finger already at work is yet to read
        for s in range(bank.strings.size):
            me = state.sounding[s]
            if bank.strings[s].part == p and me.awake and me.phase != NO_FINGER:
                catch_up(core, desk, s)
    low, high = PARAMETER_RANGES[index]
    state.parameters[p, index] = min(max(value, low), high)


@njit(**CORE)
def _tune(core: int, key: int, pitch: float, at_once: int) -> None:
    """Another pitch for a key, in semitones; its compiled one where that is no number."""
    bank, state = bank_of(core), state_of(core)
    if not 0 <= key < state.tuning.size:
        return
    offset = 0.0
    if math.isfinite(pitch):
        offset = max(-MOST_RETUNING, min(MOST_RETUNING, pitch - bank.pitch[key]))
    state.tuning[key] = offset
    if at_once:
        for s in range(state.sounding.size):
            if state.sounding[s].note == key:
                state.sounding[s].retune_to = offset


@njit(**CORE)
def _part_of(core: int, c: int) -> int:
    """The part that channel c plays now, −1 for none: of a member of a zone that of its master."""
    state = state_of(core)
    leader = state.channels[c].master
    return bank_of(core).program_map[leader, state.channels[leader].program]


@njit(**CORE)
def _note_on(core: int, desk: int, c: int, note: int, velocity: int) -> None:
    bank, state = bank_of(core), state_of(core)
    if not 0 <= note <= 127:
        return
    velocity = min(velocity, 127)
    state.counters[N_NOTES] += 1
    p = _part_of(core, c)
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
    catch_up(core, desk, s)
    if not me.awake or me.stolen:
        _make_room(core, desk)
    if not me.awake:
        state.counters[AWAKE] += 1
        state.counters[MOST_AWAKE] = max(state.counters[MOST_AWAKE], state.counters[AWAKE])
    legato = _legato(core, c) and me.held != 0 and me.awake != 0 and me.model != position.model
    if me.held and me.awake and not legato and (me.note != note or me.channel != c):
        state.counters[N_TAKEN] += 1
    me.note = note
    me.channel = c
    me.held = 1
    me.sustained = 0
    me.plucked_at = state.counters[N_NOTES]
    me.retune_to = state.tuning[note]
    me.key_pressure = 0.0
    me.timbre = timbre_of(core, c)
    state.part_state[p].channel = state.channels[c].master
    if position.fret > 0:
        state.part_state[p].hand = position.fret
    pluck(core, desk, s, position.model, velocity, legato)


@njit(**CORE)
def _legato(core: int, c: int) -> bool:
    channels = state_of(core).channels
    return channels[c].legato != 0 or channels[channels[c].master].legato != 0


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
            elif me.awake and me.held and me.channel == c and _legato(core, c):
                cost -= 500.0  # hammered on or pulled off, on the string that sounds
            elif me.awake and me.held:
                cost += 1000.0
        age = me.plucked_at
        if best < 0 or cost < best_cost or (cost == best_cost and age < best_age):
            best, best_cost, best_age = k, cost, age
    return best


@njit(**CORE)
def _make_room(core: int, desk: int) -> None:
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
        catch_up(core, desk, quietest)
        state.sounding[quietest].stolen = 1
        state.sounding[quietest].held = 0
        state.sounding[quietest].sustained = 0
        state.sounding[quietest].phase = 0
        state.counters[N_STOLEN] += 1
        damp(core, quietest, CUT_S)


@njit(**CORE)
def _note_off(core: int, desk: int, c: int, note: int) -> None:
    bank, state = bank_of(core), state_of(core)
    for s in range(bank.strings.size):
        me = state.sounding[s]
        if me.held and me.channel == c and me.note == note:
            catch_up(core, desk, s)
            me.held = 0
            me.sustained = pedal(core, c)
            let_go(core, s)


@njit(**CORE)
def _release_all(core: int, desk: int, c: int) -> None:
    bank, state = bank_of(core), state_of(core)
    for s in range(bank.strings.size):
        me = state.sounding[s]
        if (me.held or me.sustained) and belongs(core, me.channel, c):
            catch_up(core, desk, s)
            if me.held:
                me.sustained = pedal(core, me.channel)
            me.held = 0
            let_go(core, s)


@njit(**CORE)
def _sustain(core: int, desk: int, c: int, value: int) -> None:
    bank, state = bank_of(core), state_of(core)
    state.channels[c].sustain = 1 if value >= 64 else 0
    if value < 64:
        for s in range(bank.strings.size):
            me = state.sounding[s]
            if me.sustained and belongs(core, me.channel, c) and not pedal(core, me.channel):
                catch_up(core, desk, s)
                me.sustained = 0
                let_go(core, s)


@njit(**CORE)
def _silence(core: int, desk: int, c: int) -> None:
    """All sound off: cut short what the channel, or its zone, sounds."""
    bank, state = bank_of(core), state_of(core)
    for s in range(bank.strings.size):
        me = state.sounding[s]
        if me.awake and belongs(core, me.channel, c):
            catch_up(core, desk, s)
            me.held = 0
            me.sustained = 0
            me.phase = 0
            damp(core, s, CUT_S)


@njit(**CORE)
def _reset_controllers(core: int, desk: int, c: int) -> None:
    """Of a channel, or of a whole zone by its master, as the recommended practice RP-015 has it: levels, pan, program and
    sound controllers stay."""
    bank, state = bank_of(core), state_of(core)
    for k in range(state.channels.size):
        if belongs(core, k, c):
            channel = state.channels[k]
            channel.expression = 1.0
            channel.legato = 0
            channel.rpn = RPN_NONE
            channel.bend_raw = 0.0
            channel.pressure = 0.0
            _sustain(core, desk, k, 0)
    for s in range(bank.strings.size):
        if belongs(core, state.sounding[s].channel, c):
            state.sounding[s].key_pressure = 0.0


@njit(**CORE)
def _bend_range(core: int, c: int, semitones: float, cents: float) -> None:
    """Whole semitones or cents of the bend range, the other negative; of a member of a zone it is that of all."""
    channels = state_of(core).channels
    master = channels[c].master
    for k in range(channels.size):
        if k == c or (master != c and channels[k].master == master and k != master):
            whole = math.floor(channels[k].bend_range)
            if semitones >= 0.0:
                channels[k].bend_range = semitones + (channels[k].bend_range - whole)
            else:
                channels[k].bend_range = whole + cents / 100.0


@njit(cache=True, nogil=True)
def set_zone(core: int, desk: int, zone: int, members: int) -> None:
    """Begin, change or end an MPE zone, LOWER or UPPER; the other one yields. Its channels begin anew."""
    state = state_of(core)
    channels = state.channels
    state.zones[zone] = members
    state.zones[1 - zone] = _yielded(members, state.zones[1 - zone])
    manager = _manager_of(zone)
    for c in range(channels.size):
        master = _master_of(c, state.zones[LOWER], state.zones[UPPER])
        if master == channels[c].master and master != manager:
            continue
        _sustain(core, desk, c, 0)
        for s in range(state.sounding.size):
            if state.sounding[s].channel == c:
                catch_up(core, desk, s)
                state.sounding[s].held = 0
                state.sounding[s].sustained = 0
                let_go(core, s)
        channels[c].bend_range = PLAIN_BEND if master == c else MEMBER_BEND
        channels[c].bend_raw = 0.0
        channels[c].pressure = 0.0
        channels[c].timbre = 64
        channels[c].master = master
    for p in range(state.part_state.size):
        state.part_state[p].channel = channels[state.part_state[p].channel].master


@njit(**CORE)
def _bound(core: int, desk: int, c: int, first: int, end: int, value: int) -> None:
    """Set live parameters of the parts that a channel plays from a controller's value."""
    bank, state = bank_of(core), state_of(core)
    x = value / 127.0
    leader = state.channels[c].master
    for i in range(first, end):
        row = bank.bindings[i]
        if bank.plays[leader, row.part]:
            if row.curve == RATIO:
                _set_parameter(core, desk, row.part, row.index, row.low * (row.high / row.low) ** x)
            elif row.curve == SQUARE:
                _set_parameter(core, desk, row.part, row.index, row.low + (row.high - row.low) * x * x)
            else:
                _set_parameter(core, desk, row.part, row.index, row.low + (row.high - row.low) * x)


@njit(**CORE)
def _control(core: int, desk: int, c: int, controller: int, value: int) -> None:
    bank, state = bank_of(core), state_of(core)
    channel = state.channels[c]
    value = min(max(value, 0), 127)
    x = value / 127.0
    if 0 <= controller < 128 and bank.bound[controller + 1] > bank.bound[controller]:
        _bound(core, desk, c, bank.bound[controller], bank.bound[controller + 1], value)
    elif controller == 7:  # unity at the power-up value of 100; the curve is the recommended 40 log₁₀
        channel.volume = (127.0 * x / 100.0) ** 2
        _claim(core, c)
    elif controller == 11:
        channel.expression = x * x
        _claim(core, c)
    elif controller == 10:
        channel.pan = max(-1.0, (value - 64) / 63.0)
        _claim(core, c)
    elif controller == 64:
        _sustain(core, desk, c, value)
    elif controller == 68:
        channel.legato = 1 if value >= 64 else 0
    elif controller == 74:
        channel.timbre = value
    elif controller == 100:
        channel.rpn = (channel.rpn & ~0x7F) | (value & 0x7F)
    elif controller == 101:
        channel.rpn = (channel.rpn & 0x7F) | ((value & 0x7F) << 7)
    elif controller == 98 or controller == 99:
        channel.rpn = RPN_NONE
    elif controller == 6 and channel.rpn == RPN_BEND:
        _bend_range(core, c, min(value, WIDEST_BEND), -1.0)
    elif controller == 38 and channel.rpn == RPN_BEND:
        _bend_range(core, c, -1.0, min(value, 99))
    elif controller == 6 and channel.rpn == RPN_ZONE:
        for zone in range(2):
            if c == _manager_of(zone):
                set_zone(core, desk, zone, min(value, MOST_MEMBERS))
    elif controller == 120:
        _silence(core, desk, c)
    elif controller == 121:
        _reset_controllers(core, desk, c)
    elif controller >= 123:
        _release_all(core, desk, c)


@njit(**CORE)
def _claim(core: int, c: int) -> None:
    """The part that a channel plays heeds the channel's level and pan, where several channels play it."""
    p = _part_of(core, c)
    if p >= 0:
        state_of(core).part_state[p].channel = state_of(core).channels[c].master
