"""Notes without a stroke of their own: stopped at another fret, pulled across one, and back to a key still held."""

from __future__ import annotations

from numba import njit

from synth.engine.layout import CORE, PRESS, WAIT
from synth.engine.voices.channels import legato_on
from synth.engine.voices.voice_table import pluck, state_seen, voices_of


@njit(**CORE)
def has_begun(voices: int, s: int) -> bool:
    """Whether string s sounds its note, or will without a stroke: it does not wait for one."""
    me = voices_of(voices)
    voice, hand = me.voices[s], me.hands[s]
    return voice.awake != 0 and (hand.phase != WAIT or hand.glide_to >= 0)


@njit(**CORE)
def slur(voices: int, k: int, velocity: int) -> None:
    """The string of position k, which sounds, goes there; where its part's hand can, it is pulled aside instead."""
    me, state = voices_of(voices), state_seen(voices)
    s = me.positions[k].string
    voice, base = me.voices[s], _stopped_at(voices, s)
    if base >= 0:
        aside = _pitch(voices, me.positions[k].note) - _pitch(voices, me.positions[base].note)
        if 0.0 <= aside <= me.parts[me.strings[s].part].meend:
            voice.retune_to = state.tuning[me.positions[base].note]
            voice.pull_to = aside
            return
    pluck(voices, k, velocity, True)


@njit(**CORE)
def _pitch(voices: int, note: int) -> float:
    """Of a key as it is now tuned [semitones]."""
    me, state = voices_of(voices), state_seen(voices)
    return me.pitch[note] + state.tuning[note]


@njit(**CORE)
def _stopped_at(voices: int, s: int) -> int:
    """The position whose fret a string may be pulled across; −1: it is open, or the finger is under way, or slides."""
    me = voices_of(voices)
    part, voice, hand = me.parts[me.strings[s].part], me.voices[s], me.hands[s]
    slides = me.articulations[voice.articulation].slide_s > 0.0
    if part.meend == 0.0 or slides or hand.phase == PRESS or hand.phase == WAIT:
        return -1
    for k in range(part.first_position, part.end_position):
        position = me.positions[k]
        if position.string == s and position.model == hand.model:
            return k if position.fret > 0 else -1
    return -1


@njit(**CORE)
def position_held_below(voices: int, s: int) -> int:
    """Where legato takes string s back to as its key is let go: the lower key still held that was struck last, which this
    string can play and no other one sounds. −1: nowhere."""
    me, state = voices_of(voices), state_seen(voices)
    voice = me.voices[s]
    if me.strings[s].positions == 1 or voice.node > 0.0 or not (has_begun(voices, s) and legato_on(voices, voice.channel)):
        return -1
    part = me.parts[me.strings[s].part]
    best, latest = -1, 0
    for k in range(part.first_position, part.end_position):
        position = me.positions[k]
        if position.string == s and position.note < voice.note:
            struck = state.keys[voice.channel, position.note]
            if struck > latest and not _sounds_elsewhere(voices, s, position.note):
                best, latest = k, struck
    return best


@njit(**CORE)
def _sounds_elsewhere(voices: int, s: int, note: int) -> bool:
    """Whether a key of string s's channel is heard on another string."""
    me = voices_of(voices)
    for t in range(me.voices.size):
        other = me.voices[t]
        if t != s and other.held and other.note == note and other.channel == me.voices[s].channel:
            return True
    return False
