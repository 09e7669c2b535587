"""The place where a player would take a note."""

from __future__ import annotations

from numba import njit

from synth.engine.layout import CORE, PRESS, WAIT
from synth.engine.voices.channels import legato_on
from synth.engine.voices.voice_table import state_seen, voices_of

#: a fret's way of the hand costs 1; what outweighs any way: a string that is held costs more than any other, one that sounds
#: the note already less, and one to be hammered on or pulled off lies between
OCCUPIED, SAME_NOTE, SLURRED = 1000.0, -1000.0, -500.0


@njit(**CORE)
def choose_position(voices: int, p: int, c: int, note: int, choir: int) -> int:
    """The string already playing the note, else a string that is not held, nearest to the hand; among equals the one
    plucked longest ago. −1 where the note is on no string of this choir of part p."""
    me, state = voices_of(voices), state_seen(voices)
    part = me.parts[p]
    hand = state.part_state[p].hand
    best, best_cost, best_age = -1, 0.0, 0
    for k in range(part.first_position, part.end_position):
        position = me.positions[k]
        if position.note != note or me.strings[position.string].choir != choir:
            continue
        voice = me.voices[position.string]
        cost = 0.0
        if me.strings[position.string].positions > 1:
            cost = abs(position.fret - hand) if position.fret > 0 else 1.0
            if voice.awake and _plays(voices, position.string, k):
                cost += SAME_NOTE
            elif voice.awake and voice.held and voice.channel == c and legato_on(voices, c):
                cost += SLURRED
            elif voice.awake and voice.held:
                cost += OCCUPIED
        age = voice.plucked_at
        if best < 0 or cost < best_cost or (cost == best_cost and age < best_age):
            best, best_cost, best_age = k, cost, age
    return best


@njit(**CORE)
def _plays(voices: int, s: int, k: int) -> bool:
    """Whether string s, which sounds, is stopped at position k, or about to be; one that is pulled aside plays its key."""
    me = voices_of(voices)
    voice, hand, position = me.voices[s], me.hands[s], me.positions[k]
    if voice.pull_to != 0.0:
        return voice.note == position.note
    if hand.phase != PRESS and hand.phase != WAIT:
        return hand.model == position.model
    return (hand.glide_to if hand.glide_to >= 0 else hand.pending_model) == position.model
