"""The excitations of an engine's parts: their constants, and what is compiled of them, where the core finds it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from synth.engine.layout import BEGIN_HOLD, CONSTANTS, FOLLOW, Shared
from synth.instrument.excitations import EXCITATIONS, Excitation
from synth.instrument.preset import Preset
from synth.jit.entries import entry
from synth.native.views import table


class Excitations:
    """Those of some parts; none for a part that plucks. Must be kept as long as the engine plays."""

    def __init__(self, parts: Sequence[Preset]) -> None:
        self._of: list[tuple[Excitation, Any] | None] = []
        for preset in parts:
            settings = preset.excitation
            if settings is None or settings.kind == "pluck":
                self._of.append(None)
            else:
                found = EXCITATIONS.get(settings.kind)
                self._of.append((found, found.made(settings)))
        self.tables = [np.zeros(0, np.int64) if each is None else table(each[1]) for each in self._of]

    def point(self, shared: Shared) -> None:
        """Put the addresses where the core looks for them."""
        for part, (each, constants) in enumerate(zip(self._of, self.tables, strict=True)):
            if each is not None:
                shared.excitation[part, BEGIN_HOLD] = entry(each[0].begin, 4).address
                shared.excitation[part, FOLLOW] = entry(each[0].follow, 4).address
                shared.excitation[part, CONSTANTS] = constants.ctypes.data
