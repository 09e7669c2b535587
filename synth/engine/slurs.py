"""Slides along the frets: a finger that stays on the string goes from one to the next, and the string speaks from each."""

from __future__ import annotations

from numba import njit

from synth.engine.core import bank_of, hand_of, shared_of, voice_of
from synth.engine.hold import begin_phase, last
from synth.engine.layout import CORE, WAIT

#: time in which the left hand brings a sounding string to a higher fret [s]
PRESS_S = 0.004


@njit(**CORE)
def sets_out(core: int, s: int, target: int) -> bool:
    """Whether a sounding string's articulation slides to another fret; its finger is then on the way. On a board it slides
    as that says."""
    voice, hand = voice_of(core, s), hand_of(core, s)
    if bank_of(core).articulations[voice.articulation].slide_s == 0.0 or shared_of(core).board_at[target] != 0:
        return False
    hand.glide_to = target
    return is_on_the_way(core, s)


@njit(**CORE)
def is_on_the_way(core: int, s: int) -> bool:
    """Whether the finger has further to go than the fret where it has come to; it then stays there for its time."""
    bank = bank_of(core)
    voice, hand, second = voice_of(core, s), hand_of(core, s), bank.strings[s].second
    if hand.glide_to < 0 or hand.glide_to == hand.model:
        hand.glide_to = -1
        return False
    higher = hand.glide_to > hand.model  # a string's models stand in the order of its frets
    hand.pending_model = hand.model + (1 if higher else -1)
    hand.pending_velocity = 0.0
    if second >= 0:
        hand_of(core, second).pending_model = hand.pending_model + bank.strings[s].second_models
    last(core, s, bank.articulations[voice.articulation].slide_s - (PRESS_S if higher else 0.0))
    begin_phase(core, s, WAIT)
    return True
