"""What a string gives to its bus, from the displacement and velocity that its output weights see."""

from __future__ import annotations

from numba import njit

from synth.engine.core import bank_of, scratch_of, settings_of, state_of
from synth.engine.layout import CORE

#: how fast the output's rest line follows a change of fret [s]
BASE_S = 0.05


@njit(**CORE)
def collect(core: int, thread: int, s: int, steps: int, factor: int, base: float, row) -> float:
    """row (≥ steps,) from Scratch.out after `steps` steps at `factor` times the output rate.

    A force or displacement is counted from `base`, which slowly follows the string's rest, and so is the displacement that
    moves a string in a pickup's field; returns where it then is.
    """
    bank, settings = bank_of(core), settings_of(core)
    out = scratch_of(thread).out
    me = state_of(core).sounding[s]
    part = bank.parts[bank.strings[s].part]
    if part.use_v and not part.use_q:
        for t in range(steps):
            row[t] = out[t]
        return base
    line = bank.models[me.model].line_output
    follow = 1.0 / (BASE_S * settings.rate_hz * factor)
    if base + follow * (me.rest - base) == base:
        follow = 0.0
    if part.use_v:  # pickup: flux ∝ 1/(1 + u/d)², voltage ∝ v/(1 + u/d)³
        for t in range(steps):
            base += follow * (me.rest - base)
            near = max(0.2, 1.0 + (out[t] + (line - base)) / part.pickup_distance)
            row[t] = out[steps + t] / (near * near * near)
    else:
        if follow == 0.0:
            for t in range(steps):
                row[t] = out[t] + line - base
            return base
        for t in range(steps):
            base += follow * (me.rest - base)
            row[t] = out[t] + line - base
    return base
