"""An ideal lossless string over rigid points, by d'Alembert's waves.

    μ u_tt − T u_xx = Σ_c F_c(t) δ(x − x_c),   0 ≤ u(x_c, t) − η_c ⊥ F_c ≥ 0,   c = √(T/μ)

On a grid with Δt = Δx/c waves only shift. At a point obstacle the incoming waves a, b meet what the point has pushed so
far, off: where u_f = a + b + off < η it pushes by d = η − u_f more, off ← off + d, and what leaves is a + off to the right
and b + off to the left; its force is 2√(Tμ) d/Δt. Every grid value is exact where every kink, instants of touch
included, falls on the grid; otherwise the error is of first order in Δx. There is no restitution to choose: a point on an
ideal string reflects by a first-order law, u = w + max(0, sup_{s≤t}(η − w(s))), w the sum of the incoming waves
[Amerio and Prouse 1975; Cabannes 1984]. `reflection` solves that law as it stands, as a check that shares
nothing with the grid of waves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit

#: how far from a node, in Δx, a point may lie
_ROUNDING = 1e-6


class Waves(NamedTuple):
    """What `run` gives; rows of times 0, every·Δt, …, C points, P outputs. SI units."""

    u: np.ndarray  # (n, P)
    contact_u: np.ndarray  # (n, C)
    contact_force: np.ndarray  # (n, C) mean since the row before
    energy: np.ndarray  # (n,) T Σ (Δr² + Δl²)/Δx over all cells
    contact_steps: int
    last_contact_step: int  # −1: none
    right: np.ndarray  # (N + 1,) at the end, what leaves each node to the right
    left: np.ndarray  # (N + 1,)
    pushed: np.ndarray  # (N + 1,) what the point at a node has pushed so far


def cells(length_m: float, speed_m_s: float, rate_hz: float) -> int:
    """N = L·rate/c, the cells of a grid with Δt = Δx/c; ValueError names the nearest rates where N is not whole."""
    exact = length_m * rate_hz / speed_m_s
    n = round(exact)
    if n < 2 or abs(exact - n) > 1e-9 * exact:
        below, above = max(2, math.floor(exact)), max(3, math.floor(exact) + 1)
        near = " or ".join(f"{k * speed_m_s / length_m:.12g}" for k in (below, above))
        raise ValueError(
            f"the string must be a whole number of cells c/rate long (at least 2), got {exact:.9g}; "
            f"the nearest rates are {near} Hz"
        )
    return n


def nodes(what: str, positions_m: np.ndarray, length_m: float, n: int) -> np.ndarray:
    """Indices (C,) int64 of the grid nodes at positions_m; ValueError names the nearest nodes of one that is off."""
    places = np.asarray(positions_m, dtype=np.float64) * n / length_m
    found = np.rint(places).astype(np.int64)
    for place, position in zip(places, positions_m, strict=True):
        if abs(place - round(place)) > _ROUNDING * max(1.0, place * 1e-6):
            below = math.floor(place)
            raise ValueError(
                f"{what} must lie on a node of the grid of {n} cells, got {position:.12g} m; "
                f"the nearest nodes are at {below * length_m / n:.12g} and {(below + 1) * length_m / n:.12g} m"
            )
    return found


def travelling(u: np.ndarray, velocity_integral: np.ndarray | None, speed_m_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Waves (right, left), each (N + 1,), of a start u(x), ∫₀ˣ u_t dx on the nodes: ½u ∓ ∫u_t/(2c)."""
    moving = np.zeros_like(u) if velocity_integral is None else velocity_integral / (2.0 * speed_m_s)
    return 0.5 * u - moving, 0.5 * u + moving


def run(
    right: np.ndarray,
    left: np.ndarray,
    points: np.ndarray,
    eta: np.ndarray,
    outputs: np.ndarray,
    steps: int,
    every: int,
    tension_n: float,
    length_m: float,
    pushed: np.ndarray | None = None,
) -> Waves:
    """`steps` steps of Δt = L/(Nc) from waves right, left (N + 1,); points (C,), outputs (P,) node indices, eta (C,).

    pushed : (N + 1,) where another run ended in these waves, which then goes on.
    Raises ValueError where the start lies under a point: it has waves that no motion of the string brings.
    """
    points, outputs = np.asarray(points, np.int64), np.asarray(outputs, np.int64)
    eta = np.asarray(eta, dtype=np.float64)
    n_rows, contacts, n = steps // every + 1, points.size, right.size - 1
    off = np.zeros(n + 1) if pushed is None else np.array(pushed)
    start = right + left - off
    under = eta - start[points]
    if np.any(under > 1e-12 * np.abs(start).max(initial=0.0)):
        worst = int(np.argmax(under))
        raise ValueError(
            f"the string must start clear of its obstacle, got {under[worst]:.3g} m under point {worst + 1}; lower the point"
        )
    result = Waves(
        np.zeros((n_rows, outputs.size)), np.zeros((n_rows, contacts)), np.zeros((n_rows, contacts)), np.zeros(n_rows),
        0, -1, np.array(right), np.array(left), off,
    )  # fmt: skip
    stiffness = tension_n * n / length_m
    touched, last = _run(result.right, result.left, points, eta, outputs, steps, every, stiffness, off, result[:4])
    return result._replace(contact_steps=touched, last_contact_step=last)


@njit(cache=True, nogil=True)
def _run(right, left, points, eta, outputs, steps, every, stiffness, off, made):
    """stiffness T/Δx; right and left hold what leaves a node, off (N + 1,) what its point has pushed so far; made: u,
    contact_u, contact_force, energy of `Waves`."""
    u, contact_u, contact_force, energy = made
    n = right.size - 1
    touched, last = 0, -1
    for step in range(steps + 1):
        if step > 0:
            for i in range(n, 0, -1):
                right[i] = right[i - 1]
            for i in range(n):
                left[i] = left[i + 1]
            right[0] = -left[0]
            left[n] = -right[n]
            pushed = False
            row = (step + every - 1) // every
            for c in range(points.size):
                i = points[c]
                push = eta[c] - (right[i] + left[i] + off[i])
                if push > 0.0:
                    off[i] += push
                    pushed = True
                    if row < u.shape[0]:
                        contact_force[row, c] += 2.0 * stiffness * push / every
                right[i] += off[i]
                left[i] += off[i]
            if pushed:
                touched += 1
                last = step
        if step % every == 0:
            row = step // every
            # u counts the push once, each wave that leaves has it
            for p in range(outputs.size):
                i = outputs[p]
                u[row, p] = right[i] + left[i] - off[i]
            for c in range(points.size):
                i = points[c]
                contact_u[row, c] = right[i] + left[i] - off[i]
            total = 0.0
            for i in range(n):
                rise = right[i + 1] - off[i + 1] - right[i]
                fall = left[i + 1] - left[i] + off[i]
                total += rise * rise + fall * fall
            energy[row] = stiffness * total
    return touched, last


def reflection(
    free: Callable[[np.ndarray], np.ndarray],
    height_m: float,
    position_m: float,
    length_m: float,
    speed_m_s: float,
    dt: float,
    steps: int,
) -> tuple[np.ndarray, np.ndarray]:
    """(u(x_c, t), p(t)), each (steps + 1,) at t = 0, Δt, …, of one point by the first-order law itself.

    u = w + p, p(t) = max(0, sup_{s≤t}(η − w(s))). What the point sends out comes back from the ends,
    w(t) = free(t) + Σ_{m≥1} 2 p(t − 2mL/c) − Σ_{m≥0} [p(t − (2x_c + 2mL)/c) + p(t − (2(L − x_c) + 2mL)/c)],
    free(t) the motion of x_c without the point. No waves are stepped and no grid in x is needed: the delays need not be
    whole steps (p is interpolated between steps), only longer than one. The force is 2√(Tμ) dp/dt.
    Raises ValueError where dt is longer than the shortest delay.
    """
    trip = 2.0 * length_m / speed_m_s
    near, far = 2.0 * position_m / speed_m_s, 2.0 * (length_m - position_m) / speed_m_s
    if not 0.0 < dt <= min(near, far):
        raise ValueError(f"dt must be > 0 and at most the shortest way back, {min(near, far):.6g} s, got {dt:.6g} s")
    t = np.arange(steps + 1) * dt
    images = []
    for m in range(int(t[-1] / trip) + 1):
        images += [(near + m * trip, -1.0), (far + m * trip, -1.0)]
        if m:
            images.append((m * trip, 2.0))
    w = np.array(free(t), dtype=np.float64)
    push = np.zeros(steps + 1)
    _delays(w, push, height_m, np.array([d / dt for d, _ in images]), np.array([g for _, g in images]))
    return w + push, push


@njit(cache=True, nogil=True)
def _delays(w, push, height: float, lags, gains) -> None:
    for n in range(w.size):
        for k in range(lags.size):
            place = n - lags[k]
            if place > 0.0:
                i = min(int(place), n - 1)
                part = place - i
                w[n] += gains[k] * ((1.0 - part) * push[i] + (part * push[i + 1] if part > 0.0 else 0.0))
        push[n] = max(push[n - 1] if n else 0.0, height - w[n])
