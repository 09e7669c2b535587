"""What is counted, and how figures are compared: multiply-adds, ratios of rounds, percentiles, verdicts."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from benchmarks.aims import Aim

#: of one mode's free step: two rows of Φ(Δt), or one of the two-term recurrence and what it saves
FREE_STEP_FMA = 2


def fma_per_mode_step(projections: int) -> int:
    """Multiply-adds that one mode's step is worth: its free step, and one for every row of weights it is summed with."""
    return FREE_STEP_FMA + projections


def part_of_peak(
    fma: float, seconds: Sequence[float], peak_fma: float, peak_seconds: Sequence[float]
) -> tuple[float, float]:
    """Multiply-adds a second over those of the peak measured beside it: (median of the rounds, of the best times)."""
    median, best = times_less(seconds, peak_seconds)
    return median * fma / peak_fma, best * fma / peak_fma


def times_less(seconds: Sequence[float], other_seconds: Sequence[float]) -> tuple[float, float]:
    """How many times less the first takes than the other, measured beside it round by round.

    (median of the rounds' ratios, ratio of the best times). ValueError where rounds do not pair.
    """
    if len(seconds) != len(other_seconds) or not seconds:
        raise ValueError(f"{len(seconds)} rounds do not pair with {len(other_seconds)}")
    rounds = np.asarray(other_seconds) / np.asarray(seconds)
    return float(np.median(rounds)), min(other_seconds) / min(seconds)


def rate(work: float, seconds: Sequence[float]) -> tuple[float, float]:
    """Work over seconds: (median of the rounds, best)."""
    return work / float(np.median(seconds)), work / min(seconds)


def percentile(values: Sequence[float] | np.ndarray, percent: float) -> float:
    """The smallest value that `percent` of all do not exceed (nearest rank: always one that was measured)."""
    ordered = np.sort(np.asarray(values))
    rank = round(percent * ordered.size / 100.0, 6)  # 99.9 % of 1000 are 999, not a rounding more
    return float(ordered[max(0, math.ceil(rank) - 1)])


def block_times(rounds: Sequence[Sequence[float]], block_s: float) -> dict[str, float]:
    """Of the wall-clock times [s] of the same blocks played several times, as parts of a block's own time.

    median, percentile_999 and worst of what repeats, which is each block's least; worst_once: with what the machine adds.
    """
    least = np.min(np.asarray(rounds), axis=0) / block_s
    return {
        "median": float(np.median(least)),
        "percentile_999": percentile(least, 99.9),
        "worst": float(least.max()),
        "worst_once": float(np.max(rounds)) / block_s,
    }


def verdict(reached: float | None, aim: Aim | None) -> str:
    """Whether a figure reaches what was aimed at, or by how much it misses it."""
    if aim is None:
        return ""
    if reached is None or not math.isfinite(reached):
        return "not measured"
    if aim.met(reached):
        return "met"
    missed = reached / aim.value - 1.0 if aim.at_most else 1.0 - reached / aim.value
    return f"missed by {100.0 * missed:.0f} %"
