"""High frets, from the heights of all of them: what stands above the smooth neck.

A neck is a straight line, a bow and perhaps a fall-away towards the body. The smooth neck is fitted in least absolute
deviations, which one high fret does not move; what stands out of it by more than the frets' own scatter is high.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: a fret is high from so much on [m], and from so many times the scatter of the others
LEAST_M, SCATTERS = 20e-6, 4.0
#: standard deviations in a median absolute deviation
_MAD = 1.4826
#: first fret from which a neck may fall away; frets behind the last; what this must improve the fit by (relative)
_FIRST_KNEE, _BEHIND, _WORTH = 5, 2, 0.25
#: a neck is bent backwards from so much on [m]
BACKBOW_M = 0.02e-3
#: frets fewer than that have no smooth neck to be told apart from
FEWEST = 8


@dataclass(frozen=True)
class Neck:
    """A neck as measured.

    excess_m     (F,) by how much each fret stands above the smooth neck [m]
    relief_m     hollow of the smooth neck half way between first and last fret [m]; negative: backbow
    fall_away_m  how far the last fret lies below the line of the frets before the fall-away [m]
    high         numbers of the high frets, from 1
    """

    excess_m: np.ndarray
    relief_m: float
    fall_away_m: float
    high: tuple[int, ...]


def neck_of(positions_m: np.ndarray, heights_m: np.ndarray) -> Neck:
    """The smooth neck under frets at positions from the nut with heights over any straight line, (F,) [m] each.

    Raises ValueError for fewer than eight frets.
    """
    x, h = np.asarray(positions_m, dtype=np.float64), np.asarray(heights_m, dtype=np.float64)
    if x.size < FEWEST:
        raise ValueError(f"frets must be {FEWEST} or more to tell a high one from the neck's shape, got {x.size}")
    s = (x - x[0]) / (x[-1] - x[0])
    plain = np.stack([np.ones_like(s), s, -4.0 * s * (1.0 - s)], axis=1)
    fit, loss = _least_absolute(plain, h)
    columns, best = plain, loss
    for knee in range(_FIRST_KNEE, x.size - _BEHIND + 1):
        beyond = -np.maximum(0.0, s - s[knee - 1]) / (1.0 - s[knee - 1])
        other = np.column_stack([plain, beyond])
        values, here = _least_absolute(other, h)
        if here < (1.0 - _WORTH) * loss and here < best and values[3] > 0.0:
            fit, best, columns = values, here, other
    high = _standing_out(h - columns @ fit)
    if high.sum() < x.size - columns.shape[1] - 1:  # without them the neck is fitted by least squares, which scatter less
        fit = np.linalg.lstsq(columns[~high], h[~high], rcond=None)[0]
        high = _standing_out(h - columns @ fit)
    excess = h - columns @ fit
    return Neck(
        excess,
        float(fit[2]),
        float(fit[3]) if fit.size > 3 else 0.0,
        tuple(int(k) + 1 for k in np.flatnonzero(high)),
    )


def _standing_out(excess: np.ndarray) -> np.ndarray:
    """(F,) whether each fret stands above the neck by more than the scatter of all explains."""
    scatter = _MAD * float(np.median(np.abs(excess - np.median(excess))))
    return np.asarray(excess > max(LEAST_M, SCATTERS * scatter))


def _least_absolute(columns: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, float]:
    """c that minimises Σ|columns c − values|, and that sum."""
    from scipy.optimize import linprog

    rows, count = columns.shape
    unit = float(np.abs(values - values.mean()).max()) or 1.0
    cost = np.concatenate([np.zeros(count), np.ones(rows)])
    eye = np.eye(rows)
    found = linprog(
        cost,
        A_ub=np.block([[columns, -eye], [-columns, -eye]]),
        b_ub=np.concatenate([values, -values]) / unit,
        bounds=[(None, None)] * count + [(0.0, None)] * rows,
        method="highs",
    )
    return unit * found.x[:count], unit * float(found.fun)
