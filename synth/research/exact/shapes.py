"""Plucked shapes in space, without a sum over modes: what `physics.excitation` gives as modal amplitudes."""

from __future__ import annotations

import numpy as np


def triangle(
    length_m: float,
    position_m: float,
    displacement_m: float,
    x: np.ndarray,
    half_width_m: float = 0.0,
    width_m: float = 0.0,
) -> np.ndarray:
    """u(x) [m] of a triangle whose corner is smoothed by a box of half_width_m or a triangular kernel of base width_m.

    x any shape, in [0, L]. The kernel acts on the shape continued oddly over both ends, as in `physics.excitation`: the
    corner |y|/2 becomes (y² + h²)/(4h) within h, or |y|/2 + (b − |y|)³/(6b²) within b = width/2; neither: sharp.
    Raises ValueError for a point outside the string or kernels wider than the string.
    """
    if not 0.0 < position_m < length_m:
        raise ValueError(f"pluck position must lie between 0 and {length_m:g} m, got {position_m:g} m")
    if half_width_m and width_m:
        raise ValueError("give either half_width_m or width_m")
    reach = half_width_m or 0.5 * width_m
    if not 0.0 <= reach < length_m:
        raise ValueError(f"a kernel must be narrower than the string, got a reach of {reach:g} m on {length_m:g} m")
    x = np.asarray(x, dtype=np.float64)
    rest = length_m - position_m
    u = displacement_m * np.minimum(x / position_m, (length_m - x) / rest)
    if reach == 0.0:
        return u

    def rounding(y: np.ndarray) -> np.ndarray:
        """How far the smoothed |y|/2 lies over the sharp one."""
        left = np.maximum(reach - np.abs(y), 0.0)
        return left**2 / (4.0 * reach) if half_width_m else left**3 / (6.0 * reach**2)

    slope_jump = displacement_m * (1.0 / position_m + 1.0 / rest)
    mirrored = rounding(x + position_m) + rounding(x - 2.0 * length_m + position_m)
    return u - slope_jump * (rounding(x - position_m) - mirrored)
