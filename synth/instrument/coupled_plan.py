"""What a quality means for strings that share a bridge and a body: steps of a frame, and what was measured of them.

A frame of the bridge is a frame of the output; a string that may touch something takes 1, 2, 4 or 8 steps in each, at least
as many as `plan` gives a string with ends at rest. What that keeps was measured on random instruments whose strings share
random bodies (tools/calibrate-coupled): points that a string rolls on keep what is promised with ends at rest; blows, of
which eight steps cannot resolve what is promised of `standard`, keep a multiple of it; strings that touch nothing are
exact but for the bridge's ramp. Held against instruments that were not used to calibrate (tests/test_coupled_promise.py).
"""

from __future__ import annotations

import math
from dataclasses import replace

from synth.instrument.coupled_calibration import FREE_ERROR, HELD, PITCHES_HZ
from synth.instrument.plan import (
    BRIDGE_ERROR,
    FREE,
    IMPACT_BANDS_DB,
    IMPACT_DISTANCE_DB,
    IMPACT_ONSET_ERROR,
    IMPACTS,
    IN_HOW_MANY,
    choose_factor,
)
from synth.instrument.planfile import Measured
from synth.instrument.soundboard import step_count
from synth.solver.coupling import MOST_STEPS


def choose_steps(
    fundamental_hz: float, kind: str, quality: str, rate_hz: float, internal_rate_hz: float | None = None
) -> tuple[int, str]:
    """(steps of a frame, promise) of a string that shares a body, arguments as of `plan.choose_factor`. Raises
    ValueError."""
    factor, error = choose_factor(fundamental_hz, kind, quality, rate_hz, internal_rate_hz)
    return step_count(factor), error if internal_rate_hz is not None else promise_together(kind, quality, fundamental_hz)


def measured_together(found: Measured, rate_hz: float) -> Measured | None:
    """What was measured of a string, in steps that divide a frame evenly; None where a frame has not so many."""
    wanted = max(1, math.ceil(found.rate_hz / rate_hz - 1e-9))
    return replace(found, rate_hz=step_count(wanted) * rate_hz) if wanted <= MOST_STEPS else None


def limits_together(kind: str, quality: str) -> dict[str, float]:
    """Largest measures of a scene: e, or e_onset, lsd_db and bands_db. Of `reference`, which has no more steps, those of
    fine."""
    if kind == FREE:
        return {"e": FREE_ERROR}
    whose, times = HELD[kind]["fine" if quality == "reference" else quality]
    if kind == IMPACTS:
        found = {"lsd_db": times * IMPACT_DISTANCE_DB[whose], "bands_db": times * IMPACT_BANDS_DB[whose]}
        return ({"e_onset": times * IMPACT_ONSET_ERROR[whose]} if whose in IMPACT_ONSET_ERROR else {}) | found
    return {"e": times * BRIDGE_ERROR[whose]}


def promise_together(kind: str, quality: str, fundamental_hz: float) -> str:
    """What was measured, in words; `fundamental_hz` of the open string."""
    if kind != FREE and kind not in HELD:
        return "not measured where strings share a body"
    kept = limits_together(kind, quality)
    low, high = PITCHES_HZ
    beyond = "" if low / 1.06 <= fundamental_hz <= 1.06 * high or kind == FREE else f", measured from {low:g} to {high:g} Hz"
    if kind != IMPACTS:
        return f"e < {kept['e']:g} over 3 s {IN_HOW_MANY}{beyond}"
    onset = f"e < {kept['e_onset']:g} over 0.1 s, " if "e_onset" in kept else ""
    return (
        f"{onset}log-spectral distance < {kept['lsd_db']:g} dB, "
        f"where chaotic third octaves within {kept['bands_db']:g} dB, {IN_HOW_MANY}{beyond}"
    )
