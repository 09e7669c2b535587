"""What a string gives to its bus, from the displacement and velocity that its output weights see."""

from __future__ import annotations

from numba import njit

from synth.engine.core import bank_of, hand_of, motion_of, scratch_of, settings_of
from synth.engine.layout import CORE

#: nearest that a string comes to a magnet, in parts of its distance at rest, as a pickup hears it
NEAREST = 0.2
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
    hand, motion = hand_of(core, s), motion_of(core, s)
    part = bank.parts[bank.strings[s].part]
    if part.use_v and not part.use_q:
        for t in range(steps):
            row[t] = out[t]
        return base
    line = bank.models[hand.model].line_output
    follow = 1.0 / (BASE_S * settings.rate_hz * factor)
    if base + follow * (motion.rest - base) == base:
        follow = 0.0
    if part.use_v:  # pickup: flux ∝ 1/(1 + u/d)², voltage ∝ v/(1 + u/d)³
        for t in range(steps):
            base += follow * (motion.rest - base)
            near = max(NEAREST, 1.0 + (out[t] + (line - base)) / part.pickup_distance)
            row[t] = out[steps + t] / (near * near * near)
        return base
    if follow == 0.0:
        for t in range(steps):
            row[t] = out[t] + line - base
    else:
        for t in range(steps):
            base += follow * (motion.rest - base)
            row[t] = out[t] + line - base
    bend = bank.strings[s].flux_bend
    if bend != 0.0:
        _bend(row[:steps], bend)
    return base


@njit(**CORE)
def _bend(row, bend: float) -> None:
    """Displacements, in whatever unit, into the flux that a magnet has by them, `bend` the inverse of its distance.

    The flux goes as 1/(1 + u/d)², so that what stays u where u is small is (1 − 1/(1 + u/d)²)·d/2. Nearer than `NEAREST` it
    goes on straight.
    """
    for t in range(row.size):
        moved = row[t] * bend
        near = max(NEAREST, 1.0 + moved)
        flux = 0.5 * (1.0 - 1.0 / (near * near)) + (1.0 + moved - near) / (near * near * near)
        row[t] = flux / bend
