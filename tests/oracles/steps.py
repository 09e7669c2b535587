"""Readable twins of the kernels: the same steps derived another way, slow and plain. For tests and for reading.

Exact-hold: each mode with its held force is a linear system of three unknowns, and one matrix exponential holds all six
coefficients. Moreau–Jean: equations 20–33 of Issanchou, Acary, Pérignon, Touzé, Le Carrou, JASA 143(5), 2018
("IA2018"), in the printed form. Both are worked in extended precision where the machine has it, because the printed
forms cancel. The contact problem is solved by trying every set of active contacts on the whole system, modes,
contacts and finger at once; beyond six contacts by Lemke's method.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_MOST_ENUMERATED = 6


@dataclass
class FingerRow:
    """A finger over one step: spring k, dashpot r and its position at the start and the end of the step [m]."""

    weights: Array  # (N,)
    stiffness: float
    resistance: float
    path: tuple[float, float]


@dataclass
class Step:
    """A state after a step, its contact unknowns (C,) and the finger's."""

    q: Array
    v: Array
    contact: Array
    finger: float


# --- exact-hold -------------------------------------------------------------------------------------------------------


def held_force_propagator(omega: float, sigma: float, mu: float, dt: float) -> NDArray[np.longdouble]:
    """exp(A Δt) (3, 3) for (q, q̇, f)' = A (q, q̇, f): q̈ = −ω² q − 2σ q̇ + f/μ, f' = 0.

    By scaling and squaring of the power series, in the dimensionless unknowns (q, q̇Δt, fΔt²/μ).
    """
    x, d = np.longdouble(omega) * dt, np.longdouble(sigma) * dt
    a: NDArray = np.array([[0, 1, 0], [-x * x, -2 * d, 1], [0, 0, 0]], dtype=np.longdouble)
    # the states' own scale, so that no entry dwarfs another
    scale = np.array([1, max(1, x), max(1, x * x)], dtype=np.longdouble)
    a = a * scale[None, :] / scale[:, None]
    squarings = max(0, int(np.ceil(np.log2(float(np.abs(a).sum(axis=1).max())))) + 2)
    a = a / np.longdouble(2) ** squarings
    total: NDArray = np.eye(3, dtype=np.longdouble)
    term = total
    for k in range(1, 25):
        term = term @ a / k
        total = total + term
    for _ in range(squarings):
        total = total @ total
    total = total * scale[:, None] / scale[None, :]
    units = np.array([1, 1 / np.longdouble(dt), np.longdouble(mu) / (np.longdouble(dt) * dt)])
    return total * units[:, None] / units[None, :]


def exact_hold_step(
    omega: Array,
    sigma: Array,
    mu: float,
    dt: float,
    shapes: Array,
    eta: Array,
    residual: Array,
    q: Array,
    v: Array,
    finger: FingerRow | None = None,
) -> Step:
    """One step of 0 ≤ S q⁺ + R λ − η ⊥ λ ≥ 0 with λ held; shapes (C, N), η (C,), R (C, C), q, v (N,)."""
    exponential = [held_force_propagator(w, s, mu, dt) for w, s in zip(omega, sigma, strict=True)]
    p = np.array([m[:2, :2] for m in exponential])
    k = np.array([m[:2, 2] for m in exponential]).astype(np.float64)
    q_free = (p[:, 0, 0] * q + p[:, 0, 1] * v).astype(np.float64)
    v_free = (p[:, 1, 0] * q + p[:, 1, 1] * v).astype(np.float64)
    spring = None
    if finger is not None:
        # λ_f = k (path⁺ − u⁺) + (r/Δt)((path⁺ − path) − (u⁺ − u))
        slope = finger.stiffness + finger.resistance / dt
        here = float(finger.weights @ q)
        constant = finger.stiffness * finger.path[1]
        constant += finger.resistance / dt * (finger.path[1] - finger.path[0] + here)
        spring = (finger.weights, slope, constant)
    contact, pushed = _contact_forces(q_free, k[:, 0], shapes, eta, residual, spring)
    modal = contact @ shapes + (pushed * finger.weights if finger is not None else 0.0)
    return Step(q_free + k[:, 0] * modal, v_free + k[:, 1] * modal, contact, pushed)


def substepped_step(
    omega: Array,
    sigma: Array,
    mu: float,
    dt: float,
    count: int,
    shapes: Array,
    eta: Array,
    residual: Array,
    q: Array,
    v: Array,
    divide: bool,
) -> tuple[Step, bool, Array]:
    """One step in `count` parts where `divide` or a whole one would touch: state, whether to divide the next, forces.

    The forces (C,) are means over the step. See `solver.substeps`; one contact is always divided.
    """
    model = (shapes, eta, residual)
    whole = exact_hold_step(omega, sigma, mu, dt, *model, q, v)
    if eta.size > 1 and not divide and not np.any(whole.contact > 0.0):
        step, means = whole, whole.contact
    else:
        step, means = Step(q, v, np.zeros(eta.size), 0.0), np.zeros(eta.size)
        for _ in range(count):
            step = exact_hold_step(omega, sigma, mu, dt / count, *model, step.q, step.v)
            means = means + step.contact / count
    before, after = shapes @ q, shapes @ step.q
    arrives = after - eta < before - after
    return step, bool(np.any(means > 0.0) or np.any(arrives)), means


def _contact_forces(
    free: Array,
    k: Array,
    shapes: Array,
    eta: Array,
    residual: Array,
    finger: tuple[Array, float, float] | None,
) -> tuple[Array, float]:
    """(λ (C,), λ_f) with x = free + k (Sᵀλ + w λ_f), 0 ≤ S x + R λ − η ⊥ λ ≥ 0 and λ_f = constant − slope·w x."""
    contacts = eta.size
    if contacts > _MOST_ENUMERATED:
        a, b = (shapes * k) @ shapes.T + residual, shapes @ free - eta
        if finger is None:
            return lemke(a, b), 0.0
        weights, slope, constant = finger
        own, coupling = float(weights @ (k * weights)), shapes @ (k * weights)
        # λ_f = (constant − slope (w free + couplingᵀλ))/(1 + slope own)
        alone = (constant - slope * float(weights @ free)) / (1.0 + slope * own)
        a = a - slope / (1.0 + slope * own) * np.outer(coupling, coupling)
        contact = lemke(a, b + coupling * alone)
        return contact, alone - slope / (1.0 + slope * own) * float(coupling @ contact)
    best: tuple[float, Array, float] | None = None
    for count in range(contacts + 1):
        for active in combinations(range(contacts), count):
            x, contact, pushed = _on_active(free, k, shapes, eta, residual, finger, list(active))
            gap = shapes @ x + residual @ contact - eta
            size = np.abs(eta).max(initial=0.0) + np.abs(shapes @ free).max(initial=0.0)
            reaction = contact * np.diag((shapes * k) @ shapes.T + residual)
            fault = max(-gap.min(initial=0.0), -reaction.min(initial=0.0))
            if best is None or fault < best[0]:
                best = (fault, contact, pushed)
            if fault <= 1e-13 * size:
                return contact, pushed
    assert best is not None
    return best[1], best[2]


def _on_active(
    free: Array,
    k: Array,
    shapes: Array,
    eta: Array,
    residual: Array,
    finger: tuple[Array, float, float] | None,
    active: list[int],
) -> tuple[Array, Array, float]:
    """The dense linear system in (x, λ of the active contacts, λ_f) with every active contact closed."""
    n, m = free.size, len(active)
    s = shapes[active]
    matrix = np.zeros((n + m + 1, n + m + 1))
    right = np.zeros(n + m + 1)
    matrix[:n, :n] = np.eye(n)
    matrix[:n, n : n + m] = -k[:, None] * s.T
    right[:n] = free
    matrix[n : n + m, :n] = s
    matrix[n : n + m, n : n + m] = residual[np.ix_(active, active)]
    right[n : n + m] = eta[active]
    matrix[-1, -1] = 1.0
    if finger is not None:
        weights, slope, constant = finger
        matrix[:n, -1] = -k * weights
        matrix[-1, :n] = slope * weights
        right[-1] = constant
    # rows and columns on one scale: forces are some 1e6 times the displacements that they make
    columns = np.ones(n + m + 1)
    if m:
        columns[n : n + m] = 1.0 / np.diag((s * k) @ s.T + residual[np.ix_(active, active)])
    if finger is not None:
        columns[-1] = max(finger[1], 1e-300)
    scaled = matrix * columns
    rows = np.abs(scaled).max(axis=1)
    unknown = np.linalg.lstsq(scaled / rows[:, None], right / rows, rcond=1e-15)[0] * columns
    contact = np.zeros(eta.size)
    contact[active] = unknown[n : n + m]
    return unknown[:n], contact, float(unknown[-1])


# --- Moreau–Jean ------------------------------------------------------------------------------------------------------


def moreau_jean_matrices(omega: Array, sigma: Array, dt: float) -> tuple[NDArray, NDArray, NDArray]:
    """Γ, Γ̄ (N,) of IA2018 eq. 25 and F = (1 − A + e)/(ωΔt)² of the filtered form, by eqs 20–23 as printed."""
    w, s, step = (np.asarray(x, dtype=np.longdouble) for x in (omega, sigma, dt))
    root = np.sqrt((s**2 - w**2).astype(np.clongdouble))
    a = (np.exp(-s * step) * (np.exp(root * step) + np.exp(-root * step))).real  # (22)
    e = np.exp(-2 * s * step)  # (23)
    c = 2 / (w**2 * step**2) - a / (1 + e - a)  # (20)
    star = (1 / step + w**2 * step / 2 - c * w**2 * step / 2) * (1 - e) / (1 + e)  # (21)
    below = 1 + (1 - c) * w**2 * step**2 / 2 + star * step
    return w**2 / below, 2 * star / below, (1 - a + e) / (w * step) ** 2


def moreau_jean_step(
    omega: Array,
    sigma: Array,
    mu: float,
    dt: float,
    shapes: Array,
    eta: Array,
    restitution: float,
    filtered: bool,
    q: Array,
    w: Array,
    finger: FingerRow | None = None,
    obstacle: tuple[float, float] = (0.0, 0.0),
) -> Step:
    """One step of IA2018 eqs 26–31, as printed or with the filter and the predicted gap of the authors' solver.

    obstacle : its velocity [m/s] over the step before and over this one; eta is where it is before this one. The law then
    is that of the velocities relative to it.
    """
    gamma, gamma_bar, filter_ = moreau_jean_matrices(omega, sigma, dt)
    w_free = (w - dt * gamma * q - dt * gamma_bar * w).astype(np.float64)  # (27)
    gain = (filter_ if filtered else np.ones(omega.size)).astype(np.float64) / mu
    v_c = shapes @ w - obstacle[0]
    gap = shapes @ q - eta
    if filtered:
        gap = gap + 0.5 * dt * v_c
    active = np.flatnonzero(gap <= 0.0)  # (30)
    spring = None
    if finger is not None:
        # the impulse Δt(k (path⁺ − u⁺) + r (Δpath/Δt − w⁺)), u⁺ = u + Δt w⁺
        slope = dt * (finger.stiffness * dt + finger.resistance)
        constant = dt * finger.stiffness * (finger.path[1] - float(finger.weights @ q))
        constant += finger.resistance * (finger.path[1] - finger.path[0])
        spring = (finger.weights, slope, constant)
    impulse = np.zeros(eta.size)
    part, pushed = _contact_forces(
        w_free, gain, shapes[active], obstacle[1] - restitution * v_c[active], np.zeros((active.size,) * 2), spring
    )  # (31)
    impulse[active] = part
    modal = impulse @ shapes + (pushed * finger.weights if finger is not None else 0.0)
    w_next = w_free + gain * modal  # (25)
    return Step(q + dt * w_next, w_next, impulse, pushed)  # (26)


# --- linear complementarity -------------------------------------------------------------------------------------------


def lemke(a: Array, b: Array) -> Array:
    """z ≥ 0 with w = A z + b ≥ 0, zᵀw = 0 by complementary pivoting (Lemke 1965), with the lexicographic ratio test.

    Raises ArithmeticError where the method ends on a ray: for a positive semidefinite A there is no solution then.
    """
    n = b.size
    if n == 0 or np.all(b >= 0.0):
        return np.zeros(n)
    # w − A z − 1 z0 = b; every column is divided by its own scale, which changes no pivot's sign
    scale = 1.0 / np.sqrt(np.maximum(np.diag(a), np.finfo(float).tiny))
    table = np.hstack([np.eye(n), -(a * scale) * scale[:, None], -np.ones((n, 1)), (b * scale)[:, None]])
    basis = list(range(n))
    entering = 2 * n
    row = int(np.argmin(b * scale))
    for _ in range(50 * n + 100):
        table[row] /= table[row, entering]
        for other in range(n):
            if other != row:
                table[other] -= table[other, entering] * table[row]
        leaving, basis[row] = basis[row], entering
        if leaving == 2 * n:
            z = np.zeros(n)
            for place, variable in enumerate(basis):
                if n <= variable < 2 * n:
                    z[variable - n] = max(0.0, table[place, -1])
            return z * scale
        entering = leaving + n if leaving < n else leaving - n
        column = table[:, entering]
        candidates = np.flatnonzero(column > 1e-11 * np.abs(column).max())
        if candidates.size == 0:
            raise ArithmeticError("the linear complementarity problem ends on a ray: it has no solution")
        # lexicographic: right side first, then the columns of the identity
        for key in [-1, *range(n)]:
            ratios = table[candidates, key] / column[candidates]
            least = float(ratios.min())
            candidates = candidates[ratios <= least + 1e-14 * max(1e-30, abs(least))]
            if candidates.size == 1:
                break
        with_z0 = [int(place) for place in candidates if basis[place] == 2 * n]
        row = with_z0[0] if with_z0 else int(candidates[0])
    raise ArithmeticError("Lemke's method did not end")
