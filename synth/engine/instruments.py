"""An instrument owns its strings: it is what threads take, what sleeps and what is spared work.

A string that shares nothing with others is an instrument of its own, and decides for itself. Strings that are `together`
advance quantum by quantum side by side, in one thread; none sleeps or flies unless all that are awake may.
"""

from __future__ import annotations

from numba import njit

from synth.engine.core import bank_of, hand_of, is_held, motion_of, string_of, voice_of
from synth.engine.layout import CORE, SLEEP_BELOW
from synth.solver.stringmodel import FREE, MOVING

#: a step under a finger takes about so many times as long as one in flight
FINGER_COST = 2


@njit(**CORE)
def is_awake(core: int, i: int) -> bool:
    """Whether any of its strings is."""
    instrument = bank_of(core).instruments[i]
    for s in range(instrument.first_string, instrument.end_string):
        if voice_of(core, s).awake:
            return True
    return False


@njit(**CORE)
def played_strings(core: int, i: int) -> int:
    """How many of its strings are, and not only because they share a bridge with others."""
    instrument = bank_of(core).instruments[i]
    count = 0
    for s in range(instrument.first_string, instrument.end_string):
        count += voice_of(core, s).awake - voice_of(core, s).idle
    return count


@njit(**CORE)
def cost(core: int, i: int, frames: int) -> int:
    """About how many mode-steps so many frames of it take."""
    bank = bank_of(core)
    total = 0
    for s in range(bank.instruments[i].first_string, bank.instruments[i].end_string):
        voice, hand, motion = voice_of(core, s), hand_of(core, s), motion_of(core, s)
        if voice.awake:
            each = FINGER_COST if is_held(hand) else 1
            factor = 1 if motion.flying else bank.strings[s].factor
            total += each * string_of(core, s).counts[MOVING] * factor * frames
    return total


@njit(**CORE)
def may_sleep(core: int, s: int) -> bool:
    """Whether a string whose level is below SLEEP_BELOW may sleep: what it is together with is as quiet."""
    bank = bank_of(core)
    instrument = bank.instruments[bank.strings[s].instrument]
    if instrument.together:
        for other in range(instrument.first_string, instrument.end_string):
            if voice_of(core, other).awake and voice_of(core, other).level >= SLEEP_BELOW:
                return False
    return True


@njit(**CORE)
def may_fly(core: int, s: int) -> bool:
    """Whether a string that can touch nothing may go on at the output rate: so can nothing that it is together with."""
    bank = bank_of(core)
    instrument = bank.instruments[bank.strings[s].instrument]
    if instrument.together:
        for other in range(instrument.first_string, instrument.end_string):
            if voice_of(core, other).awake and string_of(core, other).counts[FREE] == 0:
                return False
    return True
