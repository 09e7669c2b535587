"""Which articulation a note has: keys switch, controllers rule while they stand in a range, velocities choose."""

from __future__ import annotations

from numba import njit

from synth.engine.layout import CORE
from synth.engine.voices.channels import belongs, part_of
from synth.engine.voices.voice_table import state_seen, voices_of


@njit(**CORE)
def switch(voices: int, c: int, p: int, key: int) -> bool:
    """Whether a key is one that switches articulations of part p, which channel c or its zone plays: it has done so."""
    me, state = voices_of(voices), state_seen(voices)
    part = me.parts[p]
    for number in range(part.first_articulation, part.end_articulation):
        if me.articulations[number].key == key:
            state.channels[state.channels[c].master].articulation = number - part.first_articulation
            return True
    return False


@njit(**CORE)
def rule(voices: int, c: int, controller: int, value: int) -> None:
    """A controller of a channel, or of a zone by its master, comes into a range of an articulation, or leaves it."""
    me, state = voices_of(voices), state_seen(voices)
    p = part_of(voices, c)
    if p < 0:
        return
    part, channel = me.parts[p], state.channels[c]
    for number in range(part.first_articulation, part.end_articulation):
        way, index = me.articulations[number], number - part.first_articulation
        if way.controller == controller and channel.ruled == index and not way.low <= value <= way.high:
            channel.ruled = -1
    for number in range(part.first_articulation, part.end_articulation):
        way = me.articulations[number]
        if way.controller == controller and way.low <= value <= way.high:
            channel.ruled = number - part.first_articulation


@njit(**CORE)
def choose_program(voices: int, c: int, program: int) -> None:
    """A program; where it brings another part, that begins with its normal articulation."""
    channels = state_seen(voices).channels
    before = part_of(voices, c)
    channels[c].program = program
    if part_of(voices, c) != before:
        forget_switches(voices, c)


@njit(**CORE)
def forget_switches(voices: int, c: int) -> None:
    """Neither key nor controller asks for an articulation of a channel, or of a whole zone by its master."""
    channels = state_seen(voices).channels
    for k in range(channels.size):
        if belongs(voices, k, c):
            channels[k].articulation = 0
            channels[k].ruled = -1


@njit(**CORE)
def articulation_of(voices: int, c: int, p: int, velocity: int) -> int:
    """Number in the Bank of the articulation of a note on channel c. A controller goes before a key, that of the channel
    before that of its zone; a velocity chooses where these ask for the normal one."""
    me, state = voices_of(voices), state_seen(voices)
    part, channel = me.parts[p], state.channels[c]
    leader = state.channels[channel.master]
    index = channel.ruled
    if index < 0:
        index = leader.ruled
    if index < 0:
        index = leader.articulation
    number = part.first_articulation + index
    if index > 0 and number < part.end_articulation:
        return number
    for other in range(part.first_articulation + 1, part.end_articulation):
        if me.articulations[other].soft <= velocity <= me.articulations[other].hard:
            return other
    return part.first_articulation
