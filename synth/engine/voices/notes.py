"""Beginning, holding and ending notes."""

from __future__ import annotations

from numba import njit

from synth.engine.layout import CORE, N_NOTES, N_TAKEN
from synth.engine.voices.channels import belongs, legato_on, part_of, pedal, timbre_of
from synth.engine.voices.choice import choose_position
from synth.engine.voices.stealing import make_room
from synth.engine.voices.voice_table import cut, go_on, let_go, pluck, voices_of


@njit(**CORE)
def note_on(voices: int, c: int, note: int, velocity: int) -> None:
    """velocity : 1 … 127; more counts as 127."""
    me = voices_of(voices)
    if not 0 <= note <= 127:
        return
    velocity = min(velocity, 127)
    me.counters[N_NOTES] += 1
    p = part_of(voices, c)
    if p < 0:
        me.unplayed[me.parts.size, note] += 1
        return
    chosen = choose_position(voices, p, c, note)
    if chosen < 0:
        me.unplayed[p, note] += 1
        return
    position = me.positions[chosen]
    voice = me.sounding[position.string]
    go_on(voices, position.string)
    if not voice.awake or voice.idle or voice.stolen:
        make_room(voices)
    legato = legato_on(voices, c) and voice.held != 0 and voice.awake != 0 and voice.model != position.model
    if voice.held and voice.awake and not legato and (voice.note != note or voice.channel != c):
        me.counters[N_TAKEN] += 1
    voice.note = note
    voice.channel = c
    voice.held = 1
    voice.sustained = 0
    voice.stolen = 0
    voice.plucked_at = me.counters[N_NOTES]
    voice.retune_to = me.tuning[note]
    voice.key_pressure = 0.0
    voice.timbre = timbre_of(voices, c)
    me.part_state[p].channel = me.channels[c].master
    if position.fret > 0:
        me.part_state[p].hand = position.fret
    pluck(voices, chosen, velocity, legato)


@njit(**CORE)
def note_off(voices: int, c: int, note: int) -> None:
    sounding = voices_of(voices).sounding
    for s in range(sounding.size):
        voice = sounding[s]
        if voice.held and voice.channel == c and voice.note == note:
            go_on(voices, s)
            voice.held = 0
            voice.sustained = pedal(voices, c)
            let_go(voices, s)


@njit(**CORE)
def press_key(voices: int, c: int, note: int, pressure: int) -> None:
    """Pressure on a key alone, 0 … 127."""
    sounding = voices_of(voices).sounding
    for s in range(sounding.size):
        voice = sounding[s]
        if voice.note == note and voice.held and belongs(voices, voice.channel, c):
            voice.key_pressure = min(max(pressure, 0), 127) / 127.0


@njit(**CORE)
def release_all(voices: int, c: int) -> None:
    """All notes off: as if every key of the channel, or of its zone, were let go."""
    sounding = voices_of(voices).sounding
    for s in range(sounding.size):
        voice = sounding[s]
        if (voice.held or voice.sustained) and belongs(voices, voice.channel, c):
            go_on(voices, s)
            if voice.held:
                voice.sustained = pedal(voices, voice.channel)
            voice.held = 0
            let_go(voices, s)


@njit(**CORE)
def sustain(voices: int, c: int, value: int) -> None:
    """The pedal of a channel or zone: down from 64 on."""
    me = voices_of(voices)
    me.channels[c].sustain = 1 if value >= 64 else 0
    if value < 64:
        for s in range(me.sounding.size):
            voice = me.sounding[s]
            if voice.sustained and belongs(voices, voice.channel, c) and not pedal(voices, voice.channel):
                go_on(voices, s)
                voice.sustained = 0
                let_go(voices, s)


@njit(**CORE)
def silence(voices: int, c: int) -> None:
    """All sound off: cut short what the channel, or its zone, sounds."""
    sounding = voices_of(voices).sounding
    for s in range(sounding.size):
        voice = sounding[s]
        if voice.awake and belongs(voices, voice.channel, c):
            go_on(voices, s)
            voice.held = 0
            voice.sustained = 0
            cut(voices, s)


@njit(**CORE)
def give_up(voices: int, c: int) -> None:
    """Nothing holds any longer what channel c alone has begun."""
    sounding = voices_of(voices).sounding
    for s in range(sounding.size):
        if sounding[s].channel == c:
            go_on(voices, s)
            sounding[s].held = 0
            sounding[s].sustained = 0
            let_go(voices, s)
