"""Everything that the native core works on, behind two addresses.

    bank, state, scratch = bank_of(core), state_of(core), scratch_of(desk)

`core` is the table of what the threads of an engine share, `desk` that of one thread's own work arrays.
"""

from __future__ import annotations

from typing import Any

from synth.engine.layout import Bank, Scratch, Settings, Shared, State
from synth.native.views import opener, words

#: what stands in the table of a core, in this order
CORE_PARTS: tuple[Any, ...] = (Bank, State, Shared, Settings)
#: …and how many words it takes
CORE_WORDS = sum(map(words, CORE_PARTS))

bank_of, state_of, shared_of, settings_of = (
    opener(kind, sum(map(words, CORE_PARTS[:before]))) for before, kind in enumerate(CORE_PARTS)
)
scratch_of = opener(Scratch)
