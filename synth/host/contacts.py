"""When, where and how hard a string touches: the forces of a tape, step by step, put together to contacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

#: pauses shorter than this, and than this share of a period, are no pause: the string chatters on the point [s]
PAUSE_S, PAUSE_PERIODS = 5e-4, 0.1


@dataclass(frozen=True)
class Forces:
    """The steps in which points of C were touched: step numbers (k,), which point (k,), force (k,) [N]."""

    step: np.ndarray
    point: np.ndarray
    force: np.ndarray
    step_s: float


@dataclass(frozen=True)
class Contact:
    """One touch of one point."""

    point: int
    start_s: float
    end_s: float
    peak_n: float
    impulse_ns: float


def touches(first: int, force: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(step, point, force) of the touched steps among those whose force is (K, C), the first of them number `first`."""
    step, point = np.nonzero(force > 0.0)
    return first + step, point, force[step, point]


def gather(parts: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], step_s: float) -> Forces:
    """All of a note's `touches`."""
    step, point, force = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return Forces(step, point, force, step_s)


def before(forces: Forces, seconds: float) -> Forces:
    """The touches of the steps that begin before `seconds`."""
    early = forces.step * forces.step_s < seconds
    return Forces(forces.step[early], forces.point[early], forces.force[early], forces.step_s)


def contacts_of(forces: Forces, period_s: float) -> list[Contact]:
    """Every contact, in order of time."""
    pause = max(1, round(min(PAUSE_S, PAUSE_PERIODS * period_s) / forces.step_s))
    out = []
    for point in np.unique(forces.point):
        mine = forces.point == point
        step, force = forces.step[mine], forces.force[mine]
        begins = np.flatnonzero(np.diff(step, prepend=step[0] - pause - 1) > pause)
        peaks = np.maximum.reduceat(force, begins)
        sums = np.add.reduceat(force, begins) * forces.step_s
        ends = np.append(begins[1:], step.size) - 1
        for begin, end, peak, impulse in zip(begins, ends, peaks, sums, strict=True):
            start_s, end_s = step[begin] * forces.step_s, (step[end] + 1) * forces.step_s
            out.append(Contact(int(point), float(start_s), float(end_s), float(peak), float(impulse)))
    return sorted(out, key=lambda contact: (contact.start_s, contact.point))


def binned(forces: Forces, points: int, bin_s: float, bins: int) -> tuple[np.ndarray, np.ndarray]:
    """(points, bins) impulse [N s] and largest force [N] of every point in each stretch of time."""
    impulse, peak = np.zeros((points, bins)), np.zeros((points, bins))
    at = np.minimum((forces.step * (forces.step_s / bin_s)).astype(np.int64), bins - 1)
    np.add.at(impulse, (forces.point, at), forces.force * forces.step_s)
    np.maximum.at(peak, (forces.point, at), forces.force)
    return impulse, peak
