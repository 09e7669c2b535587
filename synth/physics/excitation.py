"""Pluck shapes as modal amplitudes.

A string drawn aside at one point is a triangle; a finger or plectrum has a width, so the corner is smoothed
by convolution with a kernel of that width, which multiplies mode j by the kernel's transform at k_j = jπ/L.
The convolution is that of the shape continued oddly over both ends: the ends stay at rest however wide the
kernel is. It takes the tip off the corner and is *not* made up for: the crest of a smoothed triangle lies
lower than displacement_m in proportion to the width, the flanks are where the sharp triangle has them.
"""

import math

import numpy as np

from synth.physics.modes import mode_shapes


def sharp_triangle(length_m: float, position_m: float, displacement_m: float, n: int) -> np.ndarray:
    """q (n,) [m·√m] of the triangle from (0, 0) over (position_m, displacement_m) to (L, 0)."""
    _check_point(length_m, position_m)
    k = np.arange(1, n + 1) * (math.pi / length_m)
    # A corner of slope jump −s at x0 gives q_j = s φ_j(x0)/k²
    slope_jump = displacement_m * length_m / (position_m * (length_m - position_m))
    return slope_jump * mode_shapes(length_m, position_m, n)[0] / k**2


def triangle_pluck(length_m: float, position_m: float, displacement_m: float, width_m: float, n: int) -> np.ndarray:
    """q (n,) [m·√m] of a pluck: a triangle smoothed by a triangular kernel of base width_m [m].

    Mode j carries (sin κ/κ)², κ = jπw/(4L). The crest lies lower than displacement_m by w/12 times the
    corner's change of slope. Raises ValueError unless 0 < position_m < length_m and width_m >= 0.
    """
    return sharp_triangle(length_m, position_m, displacement_m, n) * _kernel(length_m, width_m, n)


def pluck_weights(length_m: float, position_m: float, width_m: float, n: int) -> np.ndarray:
    """φ_j(x)(sin κ/κ)², κ = jπw/(4L), (n,) [1/√m]: the string as a finger of width_m at x feels it.

    Displacement averaged over the finger is Σ_j weight_j q_j; a force λ spread over it drives mode j by
    weight_j λ.
    """
    _check_point(length_m, position_m)
    return mode_shapes(length_m, position_m, n)[0] * _kernel(length_m, width_m, n)


def rounded_triangle(length_m: float, position_m: float, displacement_m: float, half_width_m: float, n: int) -> np.ndarray:
    """q (n,) [m·√m] of a triangle whose corner is a parabola over position_m ± half_width_m.

    That is convolution with a box of that half width h: mode j carries sin(k_j h)/(k_j h), and the crest lies
    lower than displacement_m by h/4 times the corner's change of slope: a 1.8 mm triangle in the middle of
    1.002 m, rounded over ±7 mm, the start of IA2018's two-point bridge, is 1.787 mm high.
    """
    _check_width("half_width_m", half_width_m)
    j = np.arange(1, n + 1)
    return sharp_triangle(length_m, position_m, displacement_m, n) * np.sinc(j * half_width_m / length_m)


def _kernel(length_m: float, width_m: float, n: int) -> np.ndarray:
    """(sin κ/κ)², κ = jπw/(4L): transform of a triangle of base w and unit area."""
    _check_width("width_m", width_m)
    return np.sinc(np.arange(1, n + 1) * width_m / (4.0 * length_m)) ** 2  # np.sinc(z) = sin(πz)/(πz)


def _check_point(length_m: float, position_m: float) -> None:
    if not 0.0 < position_m < length_m:
        raise ValueError(
            f"pluck position must lie between 0 and the string's {length_m:g} m, got {position_m:g} m; count it from the nut"
        )


def _check_width(name: str, width_m: float) -> None:
    if not (width_m >= 0.0 and math.isfinite(width_m)):
        raise ValueError(f"{name} must be >= 0 m, got {width_m}; 0 is a mathematical corner")
