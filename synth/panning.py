"""Where a sound stands between left and right, with the same power everywhere."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray


def shares(pan: ArrayLike) -> NDArray[np.float64]:
    """(2, …) shares of left and right for pans (…) from −1 (left) to 1 (right); their squares add up to 1. √2 times them is
    unity in the middle. The mix of channels computes the same, compiled (`engine.mix`)."""
    angle = 0.25 * math.pi * (1.0 + np.asarray(pan, np.float64))
    return np.array([np.cos(angle), np.sin(angle)])
