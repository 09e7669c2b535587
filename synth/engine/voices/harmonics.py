"""Where a harmonic is touched: the key is the pitch that is heard."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.layout import CORE
from synth.engine.voices.choice import OCCUPIED, SAME_NOTE, choose_position
from synth.engine.voices.voice_table import voices_of

#: harmonics of open strings that players use: at a half, a third … of the string from the nut
FIRST, LAST = 2, 6
#: a harmonic is a key's where it is no further from it [semitones]: the fifth one is 0.14 flat
NEAR = 0.35


@njit(**CORE)
def choose_harmonic(voices: int, p: int, c: int, note: int) -> tuple[int, float]:
    """(position, node) of a key that is a harmonic; the node from the saddle as a share of the speaking length.

    Of open strings one that is not held, the lowest of its harmonics, plucked longest ago; else a string that is stopped an
    octave below and touched in its middle. (−1, 0) where there is none.
    """
    me = voices_of(voices)
    part = me.parts[p]
    best, best_cost, best_age, node = -1, 0.0, 0, 0.0
    for k in range(part.first_position, part.end_position):
        position = me.positions[k]
        if position.fret != 0 or position.elsewhere:
            continue
        voice = me.voices[position.string]
        for n in range(FIRST, LAST + 1):
            if abs(position.note + 12.0 * math.log2(n) - note) > NEAR:
                continue
            cost = float(n)
            if voice.awake and voice.note == note and voice.node > 0.0:
                cost += SAME_NOTE
            elif voice.awake and voice.held:
                cost += OCCUPIED
            age = voice.plucked_at
            if best < 0 or cost < best_cost or (cost == best_cost and age < best_age):
                best, best_cost, best_age, node = k, cost, age, 1.0 - 1.0 / n
    if best < 0:
        best = choose_position(voices, p, c, note - 12, 1)
        if best >= 0 and me.positions[best].elsewhere:
            best = -1
        node = 0.5 if best >= 0 else 0.0
    return best, node
