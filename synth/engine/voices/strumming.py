"""Chords whose strings follow each other: down from the lowest one, and up the next time.

When a chord's first note comes nobody knows whether others will: it is played at once, and so is a note that stays alone.
Notes that come at the same frame, in any order, or while others still wait are put in the order of their strings: what has
not begun to sound waits until its turn.
"""

from __future__ import annotations

from numba import njit

from synth.engine.layout import CORE, WAIT
from synth.engine.voices.voice_table import go_on, pluck, state_seen, voices_of

#: a note belongs to a chord that began, or of which the last string sounds, so long before it [s]
TOGETHER_S = 0.015


@njit(**CORE)
def take_turn(voices: int, k: int, velocity: int) -> None:
    """HAND.wait of a note that is about to begin at position k, and that of the notes of its chord that come after it.

    The string's record is still that of the note before, but for its articulation.
    """
    me, state = voices_of(voices), state_seen(voices)
    s = me.positions[k].string
    p = me.strings[s].part
    voice, hand, chord, now = me.voices[s], me.hands[s], state.part_state[p], state.event[0].frame
    gap = me.articulations[voice.articulation].strum_s * me.rate_hz
    begun = me.voices[chord.strum_first].plucked_at
    members = 0
    for t in range(me.strings.size):
        if _is_of(voices, t, p, begun):
            members += 1
    late = now - chord.strum_at
    hand.pending_model, hand.pending_velocity = me.positions[k].model, float(velocity)
    hand.wait = 0
    if members == 0 or _is_of(voices, s, p, begun) or late > members * gap + TOGETHER_S * me.rate_hz:
        chord.strum_at, chord.strum_first = now, s
        return
    if members == 1:
        chord.strum_down = 1 - chord.strum_down
    turn = 0
    for t in range(me.strings.size):
        if _is_of(voices, t, p, begun):
            if (t < s) == (chord.strum_down != 0):
                turn += 1
            else:
                _put_off(voices, t, p, s, begun, gap)
    hand.wait = max(0, int(turn * gap + 0.5) - late)


@njit(**CORE)
def _is_of(voices: int, t: int, p: int, begun: int) -> bool:
    """Whether a string is one of part p's chord whose first note had the number `begun`."""
    me = voices_of(voices)
    voice = me.voices[t]
    strummed = me.articulations[voice.articulation].strum_s > 0.0
    return me.strings[t].part == p and begun > 0 and voice.awake != 0 and voice.plucked_at >= begun and strummed


@njit(**CORE)
def _put_off(voices: int, t: int, p: int, s: int, begun: int, gap: float) -> None:
    """String t of a chord, of which string s is now one, too, and comes before it, has its turn later, if it is not over."""
    me, state = voices_of(voices), state_seen(voices)
    hand, chord, now = me.hands[t], state.part_state[p], state.event[0].frame
    if now > chord.strum_at:
        go_on(voices, t)
        if hand.phase != WAIT:
            return
    turn = 1  # after s
    for other in range(me.strings.size):
        if other != t and _is_of(voices, other, p, begun) and other != s and (other < t) == (chord.strum_down != 0):
            turn += 1
    for k in range(me.parts[p].first_position, me.parts[p].end_position):
        if me.positions[k].string == t and me.positions[k].model == hand.pending_model:
            hand.wait = max(1, int(turn * gap + 0.5) - (now - chord.strum_at))
            pluck(voices, k, int(hand.pending_velocity), False)
            return
