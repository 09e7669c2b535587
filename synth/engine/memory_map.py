"""The memory of a prepared engine: its arrays, and the tables by which compiled code finds them.

    inside = engine.memory
    inside.built.bank.strings, inside.sounding.voices, inside.core

For what lays an engine out somewhere else (`plugin.bankfile`) or reads what it is made of. All of it is the engine's own, as
it now is: `prepare`, `observe`, a longer queue of events (`reserve`) and `reset` with a seed put other arrays in its place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from synth.engine.bank import Built, Strings
from synth.engine.effect_chains import Chains
from synth.engine.excite import Excitations
from synth.engine.layout import Effects, Settings, Shared, Sounding, SpanWork, State, Stream
from synth.solver.stringmodel import Scratch


@dataclass(frozen=True)
class EngineMemory:
    """Arrays of an engine, and tables of `native.views` that lead to them.

    built          constants: Bank, models, flights
    state, stream  what events have set; those that wait, and sound on its way out
    sounding       what changes of the strings while they sound, beside their modes and contacts
    shared, span   what threads share, and their work arrays
    strings        what changes of the strings, with the tables of their models, states, ends and boards
    scratch        work arrays of the thread that calls `process`
    core, thread   tables that the native core is called with: `layout.CORE_PARTS`, two Scratch
    voices         table of the voice policy
    effect_tables  table of each effect in `chains.placed`
    """

    built: Built
    state: State
    stream: Stream
    sounding: Sounding
    shared: Shared
    span: SpanWork
    settings: Settings
    effects: Effects
    chains: Chains
    strings: Strings
    excitations: Excitations
    scratch: tuple[Scratch, Scratch]
    core: np.ndarray
    thread: np.ndarray
    voices: np.ndarray
    effect_tables: list[np.ndarray]

    @property
    def changing(self) -> dict[str, np.ndarray]:
        """All that changes while sounding, by name."""
        return {**self.state._asdict(), **self.stream._asdict(), **self.sounding._asdict(), **self.strings.arrays()}
