"""Which limits strings that share a body keep, of those that strings with ends at rest are promised."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from promise.runs import RATE_HZ
from synth.fit.plan_measures import STANDS
from synth.instrument.coupled_plan import choose_steps
from synth.instrument.plan import BRIDGE, BRIDGE_ERROR, IMPACT_BANDS_DB, IMPACT_DISTANCE_DB, IMPACT_ONSET_ERROR
from synth.instrument.planfile import PROMISED

MEASURES = ("e_onset", "e", "lsd_db", "bands_db")
#: every how manieth sample of a reference is kept for tests: of bridges e alone is promised
EVERY = {"bridge": 8, "points": 1, "frets": 1}
#: multiples of a promise that are tried, the part of the instruments that must keep it, and the worst miss of the others
TIMES, HOLD, WORST = (1.0, 1.5, 2.0), 0.965, 1.8


def limits_of(kind: str, quality: str, times: float) -> dict[str, float]:
    """A multiple of what is promised with ends at rest."""
    if kind == BRIDGE:
        return {"e": times * BRIDGE_ERROR[quality]}
    found = {"lsd_db": times * IMPACT_DISTANCE_DB[quality], "bands_db": times * IMPACT_BANDS_DB[quality]}
    return ({"e_onset": times * IMPACT_ONSET_ERROR[quality]} if quality in IMPACT_ONSET_ERROR else {}) | found


def judged(limits: dict[str, float], stands: dict[str, float]) -> list[tuple[str, float]]:
    """The limits that a reference which stands so can judge: e; or the onset, and the log-spectral distance or else the
    bands."""
    can = [(name, limit) for name, limit in limits.items() if stands[name] < STANDS * limit]
    whole = [each for each in can if each[0] in ("lsd_db", "bands_db")]
    return [each for each in can if each not in whole] + whole[:1]


def ratios(scenes: list[dict[str, Any]], quality: str, limits: dict[str, float]) -> np.ndarray:
    """Of every scene that can be judged the worst error over limit, with the steps that the plan gives it."""
    found = []
    for scene in scenes:
        steps, _ = choose_steps(scene["f0_hz"], scene["kind"], quality, RATE_HZ)
        row = next(row for row in scene["rows"] if row["factor"] == steps)
        if promised := judged(limits, scene["stands"]):
            found.append(max(row[name] / limit for name, limit in promised))
    return np.array(found)


def choose(scenes: list[dict[str, Any]], kind: str, quality: str) -> tuple[tuple[str, float], np.ndarray]:
    """((whose limits, how many times these), ratios) of the narrowest that are kept. Raises ValueError where none are."""
    for whose in reversed(PROMISED[: PROMISED.index(quality) + 1]):
        for times in TIMES:
            found = ratios(scenes, quality, limits_of(kind, whose, times))
            if found.size and np.mean(found < 1.0) >= HOLD and found.max() < WORST:
                return (whose, times), found
    raise ValueError(f"no limits are kept at {quality} where strings meet {kind}")


def round_above(value: float) -> float:
    """The least of 1, 2, 5 times a power of ten that is above a value."""
    power = 10.0 ** math.floor(math.log10(value))
    return float(f"{next(digit * power for digit in (1, 2, 5, 10) if digit * power > value):g}")
