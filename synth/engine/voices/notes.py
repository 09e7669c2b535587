"""Beginning, holding and ending notes."""

from __future__ import annotations

from numba import njit

from synth.engine.layout import CORE, N_NOTES, N_TAKEN
from synth.engine.voices.channels import belongs, legato_on, part_of, pedal, timbre_of
from synth.engine.voices.choice import choose_position
from synth.engine.voices.harmonics import choose_harmonic
from synth.engine.voices.slurring import has_begun, position_held_below, slur
from synth.engine.voices.stealing import make_room
from synth.engine.voices.strumming import take_turn
from synth.engine.voices.switching import articulation_of, switch
from synth.engine.voices.voice_table import cut, go_on, let_go, pluck, state_seen, voices_of

#: what a slur back to a key is asked with, which has no loudness of its own
RELEASE_VELOCITY = 64


@njit(**CORE)
def note_on(voices: int, c: int, note: int, velocity: int) -> None:
    """velocity : 1 … 127; more counts as 127."""
    me, state = voices_of(voices), state_seen(voices)
    if not 0 <= note <= 127:
        return
    p = part_of(voices, c)
    if p >= 0 and switch(voices, c, p, note):
        return
    velocity = min(velocity, 127)
    state.counters[N_NOTES] += 1
    state.keys[c, note] = state.counters[N_NOTES]
    if p < 0:
        state.unplayed[me.parts.size, note] += 1
        return
    way = articulation_of(voices, c, p, velocity)
    if me.articulations[way].harmonic:
        chosen, node = choose_harmonic(voices, p, c, note)
        if chosen >= 0:
            _begin(voices, p, c, note, velocity, chosen, way, node)
            return
        way = me.parts[p].first_articulation  # too low for one
    played = False
    for choir in range(1, me.parts[p].choirs + 1):
        chosen = choose_position(voices, p, c, note, choir)
        if chosen >= 0:
            _begin(voices, p, c, note, velocity, chosen, way, 0.0)
            played = True
    if not played:
        state.unplayed[p, note] += 1


@njit(**CORE)
def _begin(voices: int, p: int, c: int, note: int, velocity: int, chosen: int, way: int, node: float) -> None:
    """The note on one position of part p, by this articulation; touched at `node` for a harmonic, 0 for none."""
    me, state = voices_of(voices), state_seen(voices)
    position = me.positions[chosen]
    voice, hand = me.voices[position.string], me.hands[position.string]
    go_on(voices, position.string)
    if not voice.awake or voice.idle or voice.stolen:
        make_room(voices)
    elsewhere = hand.model != position.model or voice.pull_to != 0.0 or hand.glide_to >= 0
    legato = legato_on(voices, c) and node == 0.0 and voice.held != 0 and has_begun(voices, position.string) and elsewhere
    if voice.held and voice.awake and not legato and (voice.note != note or voice.channel != c):
        state.counters[N_TAKEN] += 1
    voice.articulation = way
    voice.node = node
    hand.wait = 0
    if me.articulations[way].strum_s > 0.0 and not legato:
        take_turn(voices, chosen, velocity)
    voice.note = note
    voice.channel = c
    voice.held = 1
    voice.sustained = 0
    voice.stolen = 0
    voice.plucked_at = state.counters[N_NOTES]
    voice.retune_to = state.tuning[position.note]
    voice.key_pressure = 0.0
    voice.timbre = timbre_of(voices, c)
    state.part_state[p].channel = state.channels[c].master
    if position.fret > 0:
        state.part_state[p].hand = position.fret
    if legato:
        slur(voices, chosen, velocity)
    else:
        voice.pull_to = 0.0
        pluck(voices, chosen, velocity, False)


@njit(**CORE)
def note_off(voices: int, c: int, note: int) -> None:
    me, state = voices_of(voices), state_seen(voices)
    if not 0 <= note <= 127:
        return
    state.keys[c, note] = 0
    for s in range(me.voices.size):
        voice = me.voices[s]
        if voice.held and voice.channel == c and voice.note == note:
            go_on(voices, s)
            below = position_held_below(voices, s)
            if below >= 0:
                _go_back(voices, s, below)
                continue
            voice.held = 0
            voice.sustained = pedal(voices, c)
            let_go(voices, s)


@njit(**CORE)
def _go_back(voices: int, s: int, k: int) -> None:
    """A string whose key is let go goes back to a key that is still held."""
    me, state = voices_of(voices), state_seen(voices)
    position, voice = me.positions[k], me.voices[s]
    voice.note = position.note
    voice.retune_to = state.tuning[position.note]
    voice.key_pressure = 0.0
    if position.fret > 0:
        state.part_state[me.strings[s].part].hand = position.fret
    slur(voices, k, RELEASE_VELOCITY)


@njit(**CORE)
def press_key(voices: int, c: int, note: int, pressure: int) -> None:
    """Pressure on a key alone, 0 … 127."""
    me = voices_of(voices)
    for s in range(me.voices.size):
        voice = me.voices[s]
        if voice.note == note and voice.held and belongs(voices, voice.channel, c):
            voice.key_pressure = min(max(pressure, 0), 127) / 127.0


@njit(**CORE)
def release_all(voices: int, c: int) -> None:
    """All notes off: as if every key of the channel, or of its zone, were let go."""
    me = voices_of(voices)
    _forget_keys(voices, c)
    for s in range(me.voices.size):
        voice = me.voices[s]
        if (voice.held or voice.sustained) and belongs(voices, voice.channel, c):
            go_on(voices, s)
            if voice.held:
                voice.sustained = pedal(voices, voice.channel)
            voice.held = 0
            let_go(voices, s)


@njit(**CORE)
def sustain(voices: int, c: int, value: int) -> None:
    """The pedal of a channel or zone: down from 64 on."""
    me, state = voices_of(voices), state_seen(voices)
    state.channels[c].sustain = 1 if value >= 64 else 0
    if value < 64:
        for s in range(me.voices.size):
            voice = me.voices[s]
            if voice.sustained and belongs(voices, voice.channel, c) and not pedal(voices, voice.channel):
                go_on(voices, s)
                voice.sustained = 0
                let_go(voices, s)


@njit(**CORE)
def silence(voices: int, c: int) -> None:
    """All sound off: cut short what the channel, or its zone, sounds."""
    me = voices_of(voices)
    _forget_keys(voices, c)
    for s in range(me.voices.size):
        voice = me.voices[s]
        if voice.awake and belongs(voices, voice.channel, c):
            go_on(voices, s)
            voice.held = 0
            voice.sustained = 0
            cut(voices, s)


@njit(**CORE)
def give_up(voices: int, c: int) -> None:
    """Nothing holds any longer what channel c alone has begun."""
    me, state = voices_of(voices), state_seen(voices)
    state.keys[c] = 0
    for s in range(me.voices.size):
        if me.voices[s].channel == c:
            go_on(voices, s)
            me.voices[s].held = 0
            me.voices[s].sustained = 0
            let_go(voices, s)


@njit(**CORE)
def _forget_keys(voices: int, c: int) -> None:
    """No key of the channel, or of its zone, is down any more."""
    state = state_seen(voices)
    for k in range(state.channels.size):
        if belongs(voices, k, c):
            state.keys[k] = 0
