"""From sweeps of random scenes to the internal rate that keeps each promise at the least cost."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from promise.runs import RATE_HZ
from synth.fit.plan_measures import judged
from synth.instrument.plan import BRIDGE, FAR, IMPACTS
from synth.instrument.planfile import PROMISED

#: the part of the calibration's scenes that keeps the promise, and the worst miss of the others. 95 % and a factor 2 are
#: promised over all scenes: the margin is in bridges, and in what fewer scenes can judge; some misses among impacts are
#: chance that no rate removes
HOLD = {
    **dict.fromkeys((BRIDGE, FAR), dict.fromkeys(PROMISED, 0.98)),
    IMPACTS: {"draft": 0.95, "standard": 0.95, "fine": 0.97},
}
#: The references of many bridges plucked from afar do not stand well enough to judge fine; as those are the harder ones, the
#: others may miss nothing and keep a margin.
WORST = {BRIDGE: 1.8, FAR: 0.75, IMPACTS: 1.8}
#: internal steps per period: a string an octave higher with as many modes is the same problem at twice the speed
STEPS = tuple(float(f"{100.0 * 2.0 ** (k / 6.0):.2g}") for k in range(43))  # 100 to 13000


def row_at(scene: dict[str, Any], rate_hz: float) -> dict[str, Any]:
    """What a plan for this rate would have run: the last one swept at or below the multiple of 44.1 kHz above it."""
    factor = max(1, math.ceil(rate_hz / RATE_HZ - 1e-9))
    return [row for row in scene["rows"] if row["factor"] <= factor][-1]


def ratios(scenes: list[dict[str, Any]], quality: str, rate: Callable[[float], float]) -> np.ndarray:
    """Of every scene that can be judged the worst error over promise."""
    found = []
    for scene in scenes:
        row = row_at(scene, rate(scene["f0_hz"]))
        promised = judged(scene["kind"], quality, scene["stands"])
        if promised:
            found.append(max(row[measure] / limit for measure, limit in promised))
    return np.array(found)


def law(steps: float) -> Callable[[float], float]:
    """Internal rate by fundamental, as `synth.instrument.plan.wanted_rate_hz` has it."""
    return lambda f0: steps * f0


def keeps(scenes: list[dict[str, Any]], quality: str, steps: float) -> bool:
    """Whether the law and the two next higher ones keep the promise together: one lucky rate proves nothing."""
    found = [ratios(scenes, quality, law(higher)) for higher in [s for s in STEPS if s >= steps][:3]]
    every = np.concatenate(found)
    if not found[0].size:
        return False
    return bool(
        min(np.mean(found[0] < 1.0), np.mean(every < 1.0)) >= HOLD[scenes[0]["kind"]][quality]
        and every.max() < WORST[scenes[0]["kind"]]
    )


def choose(scenes: list[dict[str, Any]]) -> dict[str, float]:
    """quality → steps per period, the least that keeps the promise; each quality more than the one before.

    Raises ValueError where none does.
    """
    found: dict[str, float] = {}
    lowest = 0.0
    for quality in PROMISED:
        kept = [steps for steps in STEPS if steps > lowest and keeps(scenes, quality, steps)]
        if not kept:
            raise ValueError(f"no number of steps keeps the promise of {quality} in these scenes")
        found[quality] = kept[0]
        lowest = 1.2 * kept[0]
    return found


def distribution(scenes: list[dict[str, Any]], quality: str, steps: float) -> str:
    """How many of the scenes can be judged, by what, and how the errors are spread."""
    parts = []
    for measure in ("e", "e_onset", "lsd_db", "bands_db"):
        values, limit = [], math.nan
        for scene in scenes:
            for name, highest in judged(scene["kind"], quality, scene["stands"]):
                if name == measure:
                    limit = highest
                    values.append(row_at(scene, law(steps)(scene["f0_hz"]))[measure])
        if values:
            middle, high, worst = np.quantile(values, [0.5, 0.95, 1.0])
            kept = 100.0 * np.mean(np.array(values) < limit)
            parts.append(
                f"{measure} < {limit:g}: {len(values)} scenes, median {middle:.2g}, 95 % {high:.2g}, "
                f"worst {worst:.2g}, kept {kept:.0f} %"
            )
    left = len(scenes) - ratios(scenes, quality, law(steps)).size
    if left:
        parts.append(f"{left} of {len(scenes)} chaotic beyond judgement")
    return "; ".join(parts)
