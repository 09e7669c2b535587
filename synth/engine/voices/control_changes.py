"""Control changes: levels, pedals, registered parameters, what rules articulations or is bound to live parameters."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.layout import CORE, RATIO, SQUARE
from synth.engine.voices.channels import RPN_NONE, belongs, claim, manager
from synth.engine.voices.mpe import set_zone
from synth.engine.voices.notes import release_all, silence, sustain
from synth.engine.voices.retuning import set_parameter
from synth.engine.voices.switching import forget_switches, rule
from synth.engine.voices.voice_table import state_seen, voices_of
from synth.midi.zones import CONFIGURATION, MOST_MEMBERS

#: widest pitch bend that can be asked for [semitones]
WIDEST_BEND = 96
#: numbers of registered parameters: pitch bend sensitivity, MPE configuration
RPN_BEND, RPN_ZONE = 0, CONFIGURATION


@njit(**CORE)
def control(voices: int, c: int, controller: int, value: int) -> None:
    me, state = voices_of(voices), state_seen(voices)
    channel = state.channels[c]
    value = min(max(value, 0), 127)
    x = value / 127.0
    if 0 <= controller < 128 and me.bound[controller + 1] > me.bound[controller]:
        _set_bound(voices, c, me.bound[controller], me.bound[controller + 1], value)
        return
    rule(voices, c, controller, value)
    if controller == 1:
        channel.wheel = x
    elif controller == 7:  # unity at the power-up value of 100; the curve is the recommended 40 log₁₀
        channel.volume = (127.0 * x / 100.0) ** 2
        claim(voices, c)
    elif controller == 11:
        channel.expression = x * x
        claim(voices, c)
    elif controller == 10:
        channel.pan = max(-1.0, (value - 64) / 63.0)
        claim(voices, c)
    elif controller == 64:
        sustain(voices, c, value)
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
        _bend_range(voices, c, min(value, WIDEST_BEND), -1.0)
    elif controller == 38 and channel.rpn == RPN_BEND:
        _bend_range(voices, c, -1.0, min(value, 99))
    elif controller == 6 and channel.rpn == RPN_ZONE:
        for zone in range(2):
            if c == manager(zone):
                set_zone(voices, zone, min(value, MOST_MEMBERS))
    elif controller == 120:
        silence(voices, c)
    elif controller == 121:
        _reset_controllers(voices, c)
    elif controller >= 123:
        release_all(voices, c)


@njit(**CORE)
def _set_bound(voices: int, c: int, first: int, end: int, value: int) -> None:
    """Set live parameters of the parts that a channel plays from a controller's value."""
    me, state = voices_of(voices), state_seen(voices)
    x = value / 127.0
    leader = state.channels[c].master
    for i in range(first, end):
        row = me.bindings[i]
        if me.plays[leader, row.part]:
            if row.curve == RATIO:
                set_parameter(voices, row.part, row.index, row.low * (row.high / row.low) ** x)
            elif row.curve == SQUARE:
                set_parameter(voices, row.part, row.index, row.low + (row.high - row.low) * x * x)
            else:
                set_parameter(voices, row.part, row.index, row.low + (row.high - row.low) * x)


@njit(**CORE)
def _bend_range(voices: int, c: int, semitones: float, cents: float) -> None:
    """Whole semitones or cents of the bend range, the other negative; of a member of a zone it is that of all."""
    channels = state_seen(voices).channels
    master = channels[c].master
    for k in range(channels.size):
        if k == c or (master != c and channels[k].master == master and k != master):
            whole = math.floor(channels[k].bend_range)
            if semitones >= 0.0:
                channels[k].bend_range = semitones + (channels[k].bend_range - whole)
            else:
                channels[k].bend_range = whole + cents / 100.0


@njit(**CORE)
def _reset_controllers(voices: int, c: int) -> None:
    """Of a channel, or of a whole zone by its master, as the recommended practice RP-015 has it: levels, pan, program and
    sound controllers stay."""
    me, state = voices_of(voices), state_seen(voices)
    forget_switches(voices, c)
    for k in range(state.channels.size):
        if belongs(voices, k, c):
            channel = state.channels[k]
            channel.expression = 1.0
            channel.legato = 0
            channel.rpn = RPN_NONE
            channel.bend_raw = 0.0
            channel.pressure = 0.0
            channel.wheel = 0.0
            sustain(voices, k, 0)
    for s in range(me.voices.size):
        if belongs(voices, me.voices[s].channel, c):
            me.voices[s].key_pressure = 0.0
