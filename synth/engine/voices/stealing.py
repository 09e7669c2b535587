"""Who yields where as many strings sound as may."""

from __future__ import annotations

from numba import njit

from synth.engine.layout import CORE, N_STOLEN
from synth.engine.voices.voice_table import cut, go_on, state_seen, voices_of


@njit(**CORE)
def make_room(voices: int) -> None:
    """Before another string begins: where as many sound as are allowed, the quietest is cut, of equals the one plucked
    first."""
    me, state = voices_of(voices), state_seen(voices)
    sounding = 0
    quietest = -1
    for s in range(me.voices.size):
        voice = me.voices[s]
        if voice.awake and not voice.idle and not voice.stolen:
            sounding += 1
            if quietest < 0:
                quietest = s
                continue
            other = me.voices[quietest]
            if voice.level < other.level or (voice.level == other.level and voice.plucked_at < other.plucked_at):
                quietest = s
    if sounding >= me.polyphony and quietest >= 0:
        go_on(voices, quietest)
        me.voices[quietest].stolen = 1
        me.voices[quietest].held = 0
        me.voices[quietest].sustained = 0
        state.counters[N_STOLEN] += 1
        cut(voices, quietest)
