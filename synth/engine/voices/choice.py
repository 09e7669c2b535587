"""The place where a player would take a note."""

from __future__ import annotations

from numba import njit

from synth.engine.layout import CORE, PRESS
from synth.engine.voices.channels import legato_on
from synth.engine.voices.voice_table import voices_of

#: a fret's way of the hand costs 1; what outweighs any way: a string that is held costs more than any other, one that sounds
#: the note already less, and one to be hammered on or pulled off lies between
OCCUPIED, SAME_NOTE, SLURRED = 1000.0, -1000.0, -500.0


@njit(**CORE)
def choose_position(voices: int, p: int, c: int, note: int) -> int:
    """The string already playing the note, else a string that is not held, nearest to the hand; among equals the one
    plucked longest ago. −1 where the note is on no string of part p."""
    me = voices_of(voices)
    part = me.parts[p]
    hand = me.part_state[p].hand
    best, best_cost, best_age = -1, 0.0, 0
    for k in range(part.first_position, part.end_position):
        position = me.positions[k]
        if position.note != note:
            continue
        voice = me.sounding[position.string]
        cost = 0.0
        if me.strings[position.string].positions > 1:
            cost = abs(position.fret - hand) if position.fret > 0 else 1.0
            stopped_at = voice.pending_model if voice.phase == PRESS else voice.model
            if voice.awake and stopped_at == position.model:
                cost += SAME_NOTE
            elif voice.awake and voice.held and voice.channel == c and legato_on(voices, c):
                cost += SLURRED
            elif voice.awake and voice.held:
                cost += OCCUPIED
        age = voice.plucked_at
        if best < 0 or cost < best_cost or (cost == best_cost and age < best_age):
            best, best_cost, best_age = k, cost, age
    return best
