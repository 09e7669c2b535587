"""Everything that the native core works on, behind two addresses.

    bank, state, scratch = bank_of(core), state_of(core), scratch_of(thread)
    voice, hand, motion = voice_of(core, s), hand_of(core, s), motion_of(core, s)
    model, string = model_of(core, s), string_of(core, s)

`core` is the table of what the threads of an engine share, `thread` that of one thread's own work arrays
(`solver.stringmodel.Scratch`).
"""

from __future__ import annotations

from numba import njit

from synth.engine.layout import ALTERED_FLIGHT, CONSTANTS, CORE_PARTS, FLIGHT, WAIT
from synth.native.views import opener, words
from synth.solver.stringmodel import Scratch, string_model, string_state
from synth.solver.stringmodel import scratch_of as scratch_of

#: words that the table of a core takes
CORE_WORDS = sum(map(words, CORE_PARTS))
#: length of a Scratch in the table of a thread
_SCRATCH_BYTES = 8 * words(Scratch)

#: (core) → the Bank, State, … that are there, in compiled code
bank_of, state_of, stream_of, sounding_of, shared_of, span_of, settings_of, effects_of = (
    opener(kind, sum(map(words, CORE_PARTS[:before]))) for before, kind in enumerate(CORE_PARTS)
)


@njit(inline="always")
def second_thread(thread: int) -> int:
    """Work arrays of a thread for a string that it advances beside another: they stand behind the first in its table."""
    return thread + _SCRATCH_BYTES


@njit(inline="always")
def voice_of(core: int, s: int):
    """The VOICE of a string."""
    return sounding_of(core).voices[s]


@njit(inline="always")
def hand_of(core: int, s: int):
    """The HAND of a string."""
    return sounding_of(core).hands[s]


@njit(inline="always")
def stroke_of(core: int, s: int):
    """The STROKE of a string."""
    return sounding_of(core).strokes[s]


@njit(inline="always")
def knock_of(core: int, s: int):
    """The KNOCK of a string."""
    return sounding_of(core).knocks[s]


@njit(inline="always")
def expression_of(core: int, s: int):
    """The EXPRESSION of a string."""
    return sounding_of(core).expressions[s]


@njit(inline="always")
def motion_of(core: int, s: int):
    """The MOTION of a string."""
    return sounding_of(core).motions[s]


@njit(inline="always")
def progress_of(core: int, s: int):
    """The PROGRESS of a string."""
    return sounding_of(core).progress[s]


@njit(inline="always")
def tally_of(core: int, s: int):
    """The TALLY of a string."""
    return sounding_of(core).tallies[s]


@njit(inline="always")
def model_address(core: int, s: int) -> int:
    """Address of a string's model as it is now: as compiled, or with coefficients of its own."""
    return shared_of(core).model_at[hand_of(core, s).model, motion_of(core, s).altered]


@njit(inline="always")
def model_of(core: int, s: int):
    """The StringModel of a string as it is now."""
    return string_model(model_address(core, s))


@njit(inline="always")
def flight_address(core: int, s: int) -> int:
    """Address of the model of its free flight, a frame at a time: as compiled, or with coefficients of its own."""
    altered = motion_of(core, s).altered
    return shared_of(core).model_at[hand_of(core, s).model, ALTERED_FLIGHT if altered else FLIGHT]


@njit(inline="always")
def line_address(core: int, s: int) -> int:
    """Address of the model that a string on a moving bridge is advanced by."""
    return flight_address(core, s) if motion_of(core, s).flying else model_address(core, s)


@njit(inline="always")
def flight_of(core: int, s: int):
    """The StringModel of its free flight."""
    return string_model(flight_address(core, s))


@njit(inline="always")
def excitation_of(core: int, s: int) -> int:
    """Address of the constants of what the right hand does to a string, for what `opener` makes of their kind."""
    return shared_of(core).excitation[bank_of(core).strings[s].part, CONSTANTS]


@njit(inline="always")
def string_of(core: int, s: int):
    """The StringState of a string."""
    return string_state(shared_of(core).string_at[s])


@njit(inline="always")
def is_held(hand) -> bool:
    """Whether a finger is on a string (HAND)."""
    return hand.phase > WAIT
