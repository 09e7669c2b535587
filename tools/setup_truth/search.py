"""Thresholds of a scene by runs of `synth.simulate`, one for every displacement that is tried."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

import synth
from setup_truth.measure import buzz_db, heard
from setup_truth.scene import Scene
from synth.research.result import Result

#: relative width of the last bracket
WITHIN = 3e-3
#: first step above the touch in parts of it, growth of the steps, and their largest
_STEP, _GROWTH, _MOST_STEP = 2e-3, 1.2, 5e-3
#: level from which a buzz is heard [dB]
AUDIBLE_DB = 3.0


@dataclass
class Search:
    """The runs of a scene at a quality of `simulate`."""

    scene: Scene
    quality: str = "reference"
    runs: int = 0
    _free: tuple[np.ndarray, float] | None = field(default=None, repr=False)

    def _run(self, displacement_m: float) -> Result:
        self.runs += 1
        result = synth.simulate(self.scene.case(displacement_m), quality=self.quality)
        assert isinstance(result, Result)
        return result

    def touches(self, displacement_m: float) -> bool:
        """Whether a stroke of this displacement touches a fret at any time."""
        return bool(self._run(displacement_m).contact_force.max() > 0.0)

    def level_db(self, displacement_m: float) -> float:
        """B of a stroke."""
        result = self._run(displacement_m)
        if self._free is None:  # linear: one run, at the same rate and with the same modes, holds all strokes
            run = {"internal_rate_hz": result.metadata["internal_rate_hz"], "modes": result.metadata["modes"]}
            over_nothing = synth.simulate(self.scene.case(1e-3, frets=False), **run)
            assert isinstance(over_nothing, Result)
            bands, whole = heard(self.scene, over_nothing.t, over_nothing.u)
            self._free = 1e6 * bands, 1e6 * whole
        free, whole = self._free
        square = displacement_m**2
        return buzz_db(heard(self.scene, result.t, result.u)[0], square * free, square * whole)

    def touch_m(self) -> float:
        """Least displacement that touches; inf: none up to the limit."""
        below, above = 0.0, self.scene.limit_m
        if not self.touches(above):
            return math.inf
        while above > below * (1.0 + WITHIN):
            middle = 0.5 * (below + above)
            below, above = (below, middle) if self.touches(middle) else (middle, above)
        return 0.5 * (below + above)

    def buzz_m(self, touch_m: float) -> float:
        """Least displacement at which B reaches the level, looked for upwards from the touch; inf: none up to the limit."""
        limit, below, share = self.scene.limit_m, touch_m * (1.0 - WITHIN), _STEP
        above = touch_m
        while self.level_db(above) < AUDIBLE_DB:
            if above >= limit:
                return math.inf
            below, above = above, min(above * (1.0 + share), limit)
            share = min(_GROWTH * share, _MOST_STEP)
        while above > below * (1.0 + WITHIN):
            middle = 0.5 * (below + above)
            below, above = (below, middle) if self.level_db(middle) >= AUDIBLE_DB else (middle, above)
        return 0.5 * (below + above)
