"""Bridges and bodies of an engine, and the ends of the strings on them: what changes, and where the core finds it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from synth.engine.layout import QUANTUM, SPAN, Bank, Shared
from synth.instrument.soundboard import Soundboard
from synth.native.arrays import Pool, allocate, arrays_of
from synth.native.views import table
from synth.solver.coupled_body import coupled_body, in_components
from synth.solver.coupling import COUPLING_SIZES, CULLED_FROM, MOST_STEPS, BridgeLines, Coupling, End
from synth.solver.lanes import padded, padded_single

#: what a block works with and no block leaves behind: records and arrays, by the beginnings of their names
END_ROOM = ("path", "block.", "few.", "kept.", "single.")
COUPLING_ROOM = ("body.ahead.", "block.", "problem.")
#: …and what changes from block to block; all else is constant, or an address
COUPLING_CHANGES = ("body.motion.", "bridge.", "counts", "load.")


class SharedBody(NamedTuple):
    """A body and the instrument whose strings share it."""

    instrument: int
    body: Soundboard


class Bridges:
    """Every Coupling of an engine and the Ends of its strings. As long as it plays, this must stay where it is.

    strings     numbers of the strings that end on a bridge, in their order
    couplings   Coupling of each body
    ends        Pool of End, by place in `strings`
    """

    def __init__(self, bank: Bank, bodies: Sequence[SharedBody], single: Sequence[bool]) -> None:
        """single: of each model, whether its modes may be float32 over frames. Where all of an instrument may, those of its
        strings that touch nothing are, from one control period to the next."""
        self.strings: list[int] = []
        self._of_body: list[range] = []
        self._single: list[bool] = []
        sizes = []
        for shared in bodies:
            instrument = bank.instruments[shared.instrument]
            mine = range(int(instrument["first_string"]), int(instrument["end_string"]))
            self._of_body.append(mine)
            self._single.append(all(single[int(m)] for m in np.flatnonzero(np.isin(bank.models["string"], mine))))
            for s in mine:
                own = bank.models[bank.models["string"] == s]
                path = QUANTUM * MOST_STEPS + 1
                modes, contacts = padded(int(own["n"].max())), int(own["contacts"].max())
                singles = padded_single(modes) if self._single[-1] else 0
                sizes.append(COUPLING_SIZES | {"modes": modes, "singles": singles, "contacts": contacts, "path": path})
                self.strings.append(s)
        self.ends = Pool(End, sizes)
        self.couplings = []
        for shared, mine, single_too in zip(bodies, self._of_body, self._single, strict=True):
            body, lines = shared.body, len(mine)
            soft = int(bank.models["layered"].any())
            rows = lines + (1 + soft) * sum(sizes[self.strings.index(s)]["contacts"] for s in mine)
            struck = body.frame_s * body.hand / body.mass
            extents = COUPLING_SIZES | {"lines": lines, "rows": rows, "stretches": SPAN}
            on_bridge = allocate(
                BridgeLines,
                extents,
                steps=np.ascontiguousarray(bank.strings["factor"][mine.start : mine.stop]),
                direction=in_components(body.direction, 1),
                friction=np.ascontiguousarray(bank.strings["friction"][mine.start : mine.stop]),
            )
            self.couplings.append(
                allocate(
                    Coupling,
                    extents,
                    frame=body.frame_s,
                    single=int(single_too),
                    culled_from=CULLED_FROM,
                    lines=on_bridge,
                    body=coupled_body(body.steps, body.shape, body.radiation, body.mass, body.omega, struck, QUANTUM),
                )
            )
        self.instruments = [shared.instrument for shared in bodies]
        self.end_tables = [table(end) for end in self.ends.items]
        self.coupling_tables = [table(coupling) for coupling in self.couplings]

    def point(self, shared: Shared) -> None:
        """Put the addresses where the core looks for them; those of the strings' states are there."""
        for s, end in zip(self.strings, self.end_tables, strict=True):
            shared.end_at[s] = end.ctypes.data
        for i, mine, coupling, at in zip(self.instruments, self._of_body, self.couplings, self.coupling_tables, strict=True):
            shared.coupling_at[i] = at.ctypes.data
            coupling.lines.state[:] = shared.string_at[mine.start : mine.stop]
            coupling.lines.end[:] = shared.end_at[mine.start : mine.stop]

    @property
    def room(self) -> dict[str, np.ndarray]:
        """Of the ends, what carries nothing from block to block."""
        return {name: array for name, array in self.ends.flat.items() if name.startswith(END_ROOM)}

    def arrays(self) -> dict[str, np.ndarray]:
        """All that changes, by name."""
        ends = {f"end.{name}": array for name, array in self.ends.flat.items() if not name.startswith(END_ROOM)}
        out = dict(ends) if self.strings else {}
        for number, coupling in enumerate(self.couplings):
            for name, array in arrays_of(coupling).items():
                if name.startswith(COUPLING_CHANGES):
                    out[f"body.{number}.{name}"] = array
        return out
