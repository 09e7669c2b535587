"""Everything that the native core works on, behind two addresses.

    bank, state, scratch = bank_of(core), state_of(core), scratch_of(thread)
    model, string = model_of(core, s), string_of(core, s)

`core` is the table of what the threads of an engine share, `thread` that of one thread's own work arrays
(`solver.stringmodel.Scratch`).
"""

from __future__ import annotations

from typing import Any

from numba import njit

from synth.engine.layout import ALTERED_FLIGHT, CONSTANTS, FLIGHT, WAIT, Bank, Effects, Settings, Shared, State
from synth.native.views import opener, words
from synth.solver.stringmodel import Scratch, string_model, string_state
from synth.solver.stringmodel import scratch_of as scratch_of

#: what stands in the table of a core, in this order
CORE_PARTS: tuple[Any, ...] = (Bank, State, Shared, Settings, Effects)
#: …and how many words it takes
CORE_WORDS = sum(map(words, CORE_PARTS))
#: length of a Scratch in the table of a thread
_SCRATCH_BYTES = 8 * words(Scratch)

#: (core) → the Bank, State, … that are there, in compiled code
bank_of, state_of, shared_of, settings_of, effects_of = (
    opener(kind, sum(map(words, CORE_PARTS[:before]))) for before, kind in enumerate(CORE_PARTS)
)


@njit(inline="always")
def second_thread(thread: int) -> int:
    """Work arrays of a thread for a string that it advances beside another: they stand behind the first in its table."""
    return thread + _SCRATCH_BYTES


@njit(inline="always")
def model_address(core: int, s: int) -> int:
    """Address of a string's model as it is now: as compiled, or with coefficients of its own."""
    me = state_of(core).sounding[s]
    return shared_of(core).model_at[me.model, me.altered]


@njit(inline="always")
def model_of(core: int, s: int):
    """The StringModel of a string as it is now."""
    return string_model(model_address(core, s))


@njit(inline="always")
def flight_address(core: int, s: int) -> int:
    """Address of the model of its free flight, a frame at a time: as compiled, or with coefficients of its own."""
    me = state_of(core).sounding[s]
    return shared_of(core).model_at[me.model, ALTERED_FLIGHT if me.altered else FLIGHT]


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
def is_held(me) -> bool:
    """Whether a finger is on a string (SOUNDING)."""
    return me.phase > WAIT
