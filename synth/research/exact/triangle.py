"""An ideal string plucked to a triangle, over a point at mid-string and over a flat wall: closed forms.

x any shape in [0, L] [m], t any shape [s]; they broadcast. At t = 0 the string is at rest.

Over a point: H. Cabannes, "Cordes vibrantes avec obstacles", Acustica 55, 1984. Over a wall: L. Amerio, "Su un problema di
vincoli unilaterali per l'equazione non omogenea della corda vibrante", IAC 1976; A. Haraux and H. Cabannes, "Almost periodic
motion of a string vibrating against a straight fixed obstacle", Nonlinear Analysis 7(2), 1983.
"""

from __future__ import annotations

import numpy as np


def free(
    x: np.ndarray, t: np.ndarray, length_m: float, speed_m_s: float, position_m: float, displacement_m: float
) -> np.ndarray:
    """u(x, t) of the free string: the mean of the odd, 2L-periodic continuations at x − ct and x + ct."""
    way = speed_m_s * np.asarray(t, dtype=np.float64)
    shape = _odd_triangle
    return 0.5 * (
        shape(x - way, length_m, position_m, displacement_m) + shape(x + way, length_m, position_m, displacement_m)
    )


def _odd_triangle(x: np.ndarray, length: float, position: float, displacement: float) -> np.ndarray:
    x = np.mod(np.asarray(x, dtype=np.float64) + length, 2.0 * length) - length
    y = np.abs(x)
    return np.copysign(displacement * np.minimum(y / position, (length - y) / (length - position)), x * displacement)


def cabannes(
    x: np.ndarray, t: np.ndarray, length_m: float, speed_m_s: float, displacement_m: float, height: float
) -> np.ndarray:
    """u(x, t) of a centred triangle over a point at L/2, `height` ∈ (−1, 1) times the pluck's displacement > 0.

    Periodic with `cabannes_period`. In units of L, L/c and the pluck: mid-string comes down by 1 − 2t and lies on the point
    from t₁ = (1 − h)/2 until t = 1, when what left the point at t₁ is still on its way back; until then the point has sent
    out p(t) = min(max(0, 2t − 1 + h), 1 + h), so that at a distance d from the middle
    u = free + p(t − d) − p(t − (1 − d)).
    Raises ValueError for other heights and for displacement_m ≤ 0.
    """
    h = _checked_height(height, displacement_m)
    now = np.mod(np.asarray(t, dtype=np.float64) * speed_m_s / length_m, (3.0 - h) / 2.0)
    z = np.asarray(x, dtype=np.float64) / length_m
    d = np.abs(z - 0.5)

    def sent(s: np.ndarray) -> np.ndarray:
        return np.clip(2.0 * s - 1.0 + h, 0.0, 1.0 + h)

    return displacement_m * (free(z, now, 1.0, 1.0, 0.5, 1.0) + sent(now - d) - sent(now - (1.0 - d)))


def cabannes_impulse(
    t: np.ndarray, length_m: float, tension_n: float, speed_m_s: float, displacement_m: float, height: float
) -> np.ndarray:
    """Impulse of the point on the string from 0 to t [N s]: a force 4TA/L in each period from (1 − h)/2 to 1 (units L/c)."""
    h = _checked_height(height, displacement_m)
    period = (3.0 - h) / 2.0
    now = np.asarray(t, dtype=np.float64) * speed_m_s / length_m
    touched = 0.5 * (1.0 + h) * np.floor(now / period) + np.clip(np.mod(now, period) - 0.5 * (1.0 - h), 0.0, 0.5 * (1.0 + h))
    return 4.0 * tension_n * displacement_m / speed_m_s * touched


def cabannes_period(length_m: float, speed_m_s: float, height: float) -> float:
    """(3 − h)/2 · L/c [s]."""
    return 0.5 * (3.0 - _checked_height(height, 1.0)) * length_m / speed_m_s


def _checked_height(height: float, displacement: float) -> float:
    if not -1.0 < height < 1.0:
        raise ValueError(f"the point's height must lie between −1 and 1 times the pluck's, got {height:g}")
    if not displacement > 0.0:
        raise ValueError(f"displacement_m must be > 0 m, got {displacement:g} m; turn the picture over")
    return height


def wall(
    x: np.ndarray,
    t: np.ndarray,
    length_m: float,
    speed_m_s: float,
    position_m: float,
    displacement_m: float,
    height_m: float,
) -> np.ndarray:
    """u(x, t) of a triangle over an elastic flat wall at height_m ≤ 0 under the whole string.

    At rest height, for a triangle at any place, u = |free|: its zeros run along the string faster than c, so that the wall
    only pushes (c²u_x² < u_t² there), and the frequency doubles. Lower, at −hA, for a centred triangle: the part that lands
    lies flat and lands all at once, at t₁ = (1 + h)/2 · L/c, with the rest of the string standing still: turning its
    velocity round turns time round, u(t₁ + s) = u(t₁ − s), and the period is 2t₁ = (1 + h)L/c. At h ≥ 1 nothing touches.
    Raises ValueError where neither holds.
    """
    _check_wall(length_m, position_m, displacement_m, height_m)
    t = np.asarray(t, dtype=np.float64)
    if height_m == 0.0:
        return np.abs(free(x, t, length_m, speed_m_s, position_m, displacement_m))
    h = -height_m / displacement_m
    if h < 1.0:
        period = (1.0 + h) * length_m / speed_m_s
        t = np.mod(t, period)
        t = np.minimum(t, period - t)
    return free(x, t, length_m, speed_m_s, position_m, displacement_m)


def wall_impulses(
    x: np.ndarray,
    start_s: float,
    end_s: float,
    length_m: float,
    tension_n: float,
    speed_m_s: float,
    position_m: float,
    displacement_m: float,
    height_m: float,
) -> np.ndarray:
    """Impulse of the wall per length of string at x [N s/m] over the times start_s < t ≤ end_s.

    A front that crosses x with u_t, u_x before leaves 2μ(u_t² − c²u_x²)/|u_t| there; for every triangle 4μcA/L.
    """
    _check_wall(length_m, position_m, displacement_m, height_m)
    x = np.asarray(x, dtype=np.float64)
    blow = 4.0 * tension_n * displacement_m / (speed_m_s * length_m)

    def crossings(first: np.ndarray | float, period: float) -> np.ndarray:
        return np.floor((end_s - first) / period) - np.floor((np.maximum(start_s, 0.0) - first) / period)

    if height_m == 0.0:
        # the moving middle part falls through zero at x; half a period later as the mirror image of itself
        here = ((length_m - position_m) * x + position_m * (length_m - x)) / (length_m * speed_m_s)
        there = ((length_m - position_m) * (length_m - x) + position_m * x) / (length_m * speed_m_s)
        trip = length_m / speed_m_s
        return blow * (crossings(here, 2.0 * trip) + crossings(there + trip, 2.0 * trip))
    h = -height_m / displacement_m
    if h >= 1.0:
        return np.zeros_like(x)
    lands = np.abs(x - 0.5 * length_m) < 0.5 * (1.0 - h) * length_m
    period = (1.0 + h) * length_m / speed_m_s
    return np.where(lands, blow * crossings(0.5 * period, period), 0.0)


def _check_wall(length: float, position: float, displacement: float, height: float) -> None:
    if not displacement > 0.0:
        raise ValueError(f"displacement_m must be > 0 m over a wall, got {displacement:g} m")
    if height > 0.0:
        raise ValueError(f"the wall must lie at or below the string's ends, got a height of {height:g} m; lower it")
    if not 0.0 < position < length:
        raise ValueError(f"pluck position must lie between 0 and {length:g} m, got {position:g} m")
    if height < 0.0 and abs(position - 0.5 * length) > 1e-9 * length:
        raise ValueError(
            f"over a wall below the string at rest the pluck must be at mid-string, {0.5 * length:g} m, got {position:g} m; "
            "only a wall at height 0 has a closed form for every place"
        )
