"""What is set from outside of MIDI's channels: live parameters of parts, pitches of keys."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.layout import CORE, GAIN, HEIGHT, NO_FINGER, PARAMETER_RANGES
from synth.engine.voices.voice_table import go_on, state_seen, voices_of

#: no key is tuned further away from its compiled pitch [semitones]
MOST_RETUNING = 24.0


@njit(**CORE)
def set_parameter(voices: int, p: int, index: int, value: float) -> None:
    """A live parameter of part p, brought back into its range."""
    me, state = voices_of(voices), state_seen(voices)
    if index != GAIN and index != HEIGHT:  # what a finger already at work is yet to read
        for s in range(me.strings.size):
            voice, hand = me.voices[s], me.hands[s]
            if me.strings[s].part == p and voice.awake and hand.phase != NO_FINGER:
                go_on(voices, s)
    low, high = PARAMETER_RANGES[index]
    state.parameters[p, index] = min(max(value, low), high)


@njit(**CORE)
def tune(voices: int, key: int, pitch: float, at_once: int) -> None:
    """Another pitch for a key, in semitones; its compiled one where that is no number."""
    me, state = voices_of(voices), state_seen(voices)
    if not 0 <= key < state.tuning.size:
        return
    offset = 0.0
    if math.isfinite(pitch):
        offset = max(-MOST_RETUNING, min(MOST_RETUNING, pitch - me.pitch[key]))
    before = state.tuning[key]
    state.tuning[key] = offset
    if at_once:
        for s in range(me.voices.size):
            if me.voices[s].note == key:
                voice = me.voices[s]
                if voice.pull_to != 0.0:  # the string's own fret keeps its tuning
                    voice.pull_to += offset - before
                else:
                    voice.retune_to = offset
