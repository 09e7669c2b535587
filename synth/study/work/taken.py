"""What a run gave, as measures see it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Taken:
    """A run of a case, or a rendered note.

    settings     the row's parameters by name
    signals      (n, P) float64: displacement at the case's P outputs [m]; of a note left and right, full scale ±1
    rate_hz      of its rows; row 0 is t = 0
    expected_hz  where the first partial should be: c/2L of the case's string, the note's pitch; None: not known
    cpu_s        CPU time of a case's steps, of a note's engine; wall_s by a clock on the wall [s]
    result       of a case: `Result` or `CoupledResult`
    reference    the run that it is compared with, None where the study has none
    """

    settings: dict[str, Any]
    signals: np.ndarray = field(repr=False)
    rate_hz: float
    expected_hz: float | None = None
    cpu_s: float = 0.0
    wall_s: float = 0.0
    result: Any = field(default=None, repr=False)
    reference: Taken | None = field(default=None, repr=False)

    @property
    def duration_s(self) -> float:
        """From the first row to the last."""
        return max(0, len(self.signals) - 1) / self.rate_hz

    def signal(self, output: int | None = None) -> np.ndarray:
        """(n,): an output's displacement; of a note the mean of left and right unless a side (0, 1) is asked for.

        Raises ValueError for an output that there is not.
        """
        if output is None:
            return self.signals[:, 0] if self.result is not None else self.signals.mean(axis=1)
        if not 0 <= output < self.signals.shape[1]:
            raise ValueError(f"output must be from 0 to {self.signals.shape[1] - 1}, got {output}")
        return self.signals[:, output]
