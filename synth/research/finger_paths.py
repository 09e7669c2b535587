"""Ways of a finger: it draws the string aside and holds it there; then the string slides off.

Sliding off takes time, in which the finger's force fades as half a cosine. That takes from the partials above the inverse of
that time (Chadefaux et al., JASA 133(4), 2013, 2444, on the harp). As in `engine.strokes` the finger then is a spring so
soft, `LEAST_STIFFNESS`, that its path is a force that is given.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from synth.research.case import FingerTable
from synth.solver.stepwise import LEAST_STIFFNESS


def slip_begin(finger: FingerTable) -> float:
    """When the string begins to slide off a finger [s]."""
    return finger.start_s + finger.draw_s + finger.hold_s


def finger_end(finger: FingerTable) -> float:
    """When a finger has left the string [s]."""
    return slip_begin(finger) + finger.slip_s


def last_steps(finger: FingerTable, begin: int, dt: float) -> tuple[int, int]:
    """Steps of dt [s] at which the string begins to slide off a finger that holds it from step `begin` on, and leaves it."""
    slips = max(begin + 1, round(slip_begin(finger) / dt))
    return slips, max(slips, round(finger_end(finger) / dt))


@dataclass(frozen=True)
class Way:
    """From `here` to `there` [m] as half a cosine, in so many seconds from step `begin` on; there the finger stays."""

    begin: int
    here: float
    there: float
    seconds: float

    def path(self, start: int, steps: int, dt: float, parts: int) -> np.ndarray:
        """(steps·parts + 1,) where it is at the start of step `start` and after each part of so many steps of dt [s]."""
        since = (start - self.begin) * parts + np.arange(steps * parts + 1)
        share = np.clip(since * dt / parts / self.seconds, 0.0, 1.0)
        return self.here + (self.there - self.here) * 0.5 * (1.0 - np.cos(np.pi * share))


def sliding_off(begin: int, end: int, force_n: float, dt: float) -> Way:
    """The way of a finger of stiffness `LEAST_STIFFNESS` whose force fades from force_n [N] to 0 between two steps."""
    return Way(begin, force_n / LEAST_STIFFNESS, 0.0, (end - begin) * dt)
