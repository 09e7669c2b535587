"""From which displacement on a note buzzes: the least one at which B reaches a level, and how certain that is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from synth.setup.audible import AUDIBLE_DB

#: relative width of the last interval of a search, of the threshold and of the ends of its interval
_WITHIN, _EDGE_WITHIN = 1e-3, 5e-3
#: first step above the touch, in parts of it, and by what steps grow
_FIRST_STEP, _GROWTH = 1e-3, 3.0
#: displacements are not told apart further [m]
_FINEST_M = 1e-9
#: a string that lies on a contact is plucked from such a part of the limit on, in such steps
_FROM, _STEP = 1e-3, 1.5
#: displacements beyond the threshold at which a buzz is looked for again, in parts of the threshold
_BEYOND = (1.03, 1.1, 1.25)
#: what a quality leaves open of the level of a third octave [dB]: `instrument.plan`, and `reference`'s own
UNCERTAIN_DB = {"draft": 4.0, "standard": 2.5, "fine": 2.5, "reference": 0.5}


@dataclass(frozen=True)
class Threshold:
    """Displacements [m], inf where no stroke up to the limit does it.

    touch_m     at which the string touches
    buzz_m      at which a buzz is heard
    low_m, high_m    between which that lies, for what the quality leaves open of its level
    returns_m   largest displacement tried beyond it at which no buzz is heard again, as chaotic motion has it; else nan
    """

    touch_m: float
    buzz_m: float
    low_m: float
    high_m: float
    returns_m: float


def threshold(
    level: Callable[[float], float], touch_m: float, most_m: float, uncertain_db: float, audible_db: float = AUDIBLE_DB
) -> Threshold:
    """The threshold of a note whose stroke of a displacement [m] gives `level` dB, looked for up to `most_m`."""
    known: dict[float, float] = {}

    def at(displacement: float) -> float:
        if displacement not in known:
            known[displacement] = level(displacement)
        return known[displacement]

    if touch_m > most_m:
        return Threshold(touch_m, math.inf, math.inf, math.inf, math.nan)
    lower = max(0.25 * audible_db, audible_db - uncertain_db)
    low = first_reaching(at, touch_m, most_m, lower, _EDGE_WITHIN)
    buzz = first_reaching(at, touch_m, most_m, audible_db, _WITHIN)
    high = first_reaching(at, touch_m, most_m, audible_db + uncertain_db, _EDGE_WITHIN)
    returns = math.nan
    if math.isfinite(buzz):
        for factor in _BEYOND:
            beyond = factor * max(high if math.isfinite(high) else buzz, buzz)
            if beyond <= most_m and at(beyond) < lower:
                returns = beyond
    return Threshold(touch_m, buzz, min(low, buzz), max(high, buzz), returns)


def first_reaching(at: Callable[[float], float], touch_m: float, most_m: float, wanted: float, within: float) -> float:
    """The least displacement [m] at which `at` reaches `wanted`: on a grid that widens from the touch on, then by
    halving, to a relative width; inf where it does not up to `most_m`."""
    below = touch_m
    above = touch_m * (1.0 + _FIRST_STEP) if touch_m > 0.0 else _FROM * most_m
    step = above - below if touch_m > 0.0 else above * (_STEP - 1.0)
    while at(min(above, most_m)) < wanted:
        if above >= most_m:
            return math.inf
        step *= _GROWTH if touch_m > 0.0 else _STEP
        below, above = above, (touch_m if touch_m > 0.0 else above) + step
    above = min(above, most_m)
    while above > below * (1.0 + within) and above - below > _FINEST_M:
        middle = 0.5 * (below + above)
        if at(middle) >= wanted:
            above = middle
        else:
            below = middle
    return above
