"""MPE zones: they come, go and yield (M1-100-UM)."""

from __future__ import annotations

from numba import int64, njit

from synth.engine.layout import CORE
from synth.engine.voices.channels import MEMBER_BEND, PLAIN_BEND, manager
from synth.engine.voices.notes import give_up, sustain
from synth.engine.voices.voice_table import state_seen
from synth.jit.entries import kernel
from synth.midi.zones import LOWER, UPPER, master_of, yielded

_master_of, _yielded = njit(**CORE)(master_of), njit(**CORE)(yielded)


@kernel(int64, int64, int64)
def set_zone(voices: int, zone: int, members: int) -> None:
    """Begin, change or end an MPE zone, LOWER or UPPER; the other one yields. Its channels begin anew."""
    state = state_seen(voices)
    channels, zones = state.channels, state.zones
    zones[zone] = members
    zones[1 - zone] = _yielded(members, zones[1 - zone])
    leader = manager(zone)
    for c in range(channels.size):
        master = _master_of(c, zones[LOWER], zones[UPPER])
        if master == channels[c].master and master != leader:
            continue
        sustain(voices, c, 0)
        give_up(voices, c)
        channels[c].bend_range = PLAIN_BEND if master == c else MEMBER_BEND
        channels[c].bend_raw = 0.0
        channels[c].pressure = 0.0
        channels[c].wheel = 0.0
        channels[c].articulation = 0
        channels[c].ruled = -1
        channels[c].timbre = 64
        channels[c].master = master
    for p in range(state.part_state.size):
        state.part_state[p].channel = channels[state.part_state[p].channel].master
