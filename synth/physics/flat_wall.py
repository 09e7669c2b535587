"""An ideal plucked string over a flat wall: exact solutions, elastic (energy-conserving) impact.

Amerio, Prouse, Rend. Mat. 8, 1975; Schatzman, J. Math. Anal. Appl. 73, 1980;
Cabannes, Haraux, Int. J. Non-Linear Mech. 16, 1981.
"""

from __future__ import annotations

import numpy as np


def free_triangle(x: np.ndarray, t: np.ndarray, length: float, speed: float, position: float, height: float) -> np.ndarray:
    """u(x, t) (t, x) [m] of a triangle let go at rest, no obstacle: d'Alembert."""
    x, t = np.atleast_1d(x)[None, :], np.atleast_1d(t)[:, None]

    def odd(y: np.ndarray) -> np.ndarray:
        y = np.mod(y + length, 2.0 * length) - length
        side = np.abs(y)
        return np.sign(y) * height * np.where(side < position, side / position, (length - side) / (length - position))

    return 0.5 * (odd(x - speed * t) + odd(x + speed * t))


def at_rest_height(x: np.ndarray, t: np.ndarray, length: float, speed: float, position: float, height: float) -> np.ndarray:
    """The string over a wall that just touches it at rest: |free solution|, for a pluck anywhere.

    A centred pluck lands all at once; another one sweeps along the wall at c(1 + r)/(1 − r), r the ratio of its slopes.
    """
    return np.abs(free_triangle(x, t, length, speed, position, height))


def below(x: np.ndarray, t: np.ndarray, length: float, speed: float, height: float, depth: float) -> np.ndarray:
    """A centred triangle over a wall at −depth, 0 ≤ depth ≤ height: the motion turns back at (1 + depth/height)/2 · L/c."""
    period = (1.0 + depth / height) * length / speed
    t = np.mod(np.atleast_1d(t), period)
    return free_triangle(x, np.minimum(t, period - t), length, speed, 0.5 * length, height)
