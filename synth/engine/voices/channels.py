"""What holds on a channel: its zone, its pedal, legato, its part, the timbre of its next note."""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.engine.layout import CORE
from synth.engine.voices.voice_table import state_seen, voices_of
from synth.midi.zones import manager_of

#: pitch bend range that members of a zone and other channels begin with [semitones]
MEMBER_BEND, PLAIN_BEND = 48.0, 2.0
#: number of a registered parameter that is none
RPN_NONE = 0x3FFF

manager = njit(**CORE)(manager_of)


def power_up(channels: np.ndarray) -> None:
    """CHANNEL records, of zeros, as they begin."""
    channels["volume"] = channels["expression"] = 1.0
    channels["bend_range"] = PLAIN_BEND
    channels["rpn"] = RPN_NONE
    channels["timbre"] = 64
    channels["ruled"] = -1
    channels["master"] = np.arange(channels.size)


@njit(**CORE)
def belongs(voices: int, c: int, to: int) -> bool:
    """Whether what is said on channel `to` is said to channel c: itself, or the master of its zone."""
    return c == to or state_seen(voices).channels[c].master == to


@njit(**CORE)
def pedal(voices: int, c: int) -> int:
    """Whether the sustain pedal of channel c or of its zone is down."""
    channels = state_seen(voices).channels
    return channels[c].sustain | channels[channels[c].master].sustain


@njit(**CORE)
def legato_on(voices: int, c: int) -> bool:
    """Whether the legato switch of channel c or of its zone is on."""
    channels = state_seen(voices).channels
    return channels[c].legato != 0 or channels[channels[c].master].legato != 0


@njit(**CORE)
def part_of(voices: int, c: int) -> int:
    """The part that channel c plays now, −1 for none: of a member of a zone that of its master."""
    me, state = voices_of(voices), state_seen(voices)
    leader = state.channels[c].master
    return me.program_map[leader, state.channels[leader].program]


@njit(**CORE)
def claim(voices: int, c: int) -> None:
    """The part that a channel plays heeds the channel's level and pan, where several channels play it."""
    state = state_seen(voices)
    p = part_of(voices, c)
    if p >= 0:
        state.part_state[p].channel = state.channels[c].master


@njit(**CORE)
def timbre_of(voices: int, c: int) -> float:
    """Controller 74 of a channel in a zone, added to its master's: −1 … 1; 0 outside of zones."""
    state = state_seen(voices)
    master = state.channels[c].master
    if master == c:
        zoned = False
        for zone in range(2):
            zoned = zoned or (c == manager(zone) and state.zones[zone] > 0)
        if not zoned:
            return 0.0
    value = state.channels[c].timbre - 64
    if master != c:
        value += state.channels[master].timbre - 64
    return max(-1.0, value / 64.0) if value < 0 else min(1.0, value / 63.0)
