"""Where the energy of a run goes: stored in the modes, lost to damping, lost at the contacts, put in by a finger.

What is stored is a quadratic form of the state that the scheme's own undamped free motion keeps:

exact-hold      E = ½ μ Σ (v² + ω² q²), the string's energy; with residual compliance H = E + ½ λᵀRλ, R's spring energy,
                and with soft layers + Σ ½ k δ² (`layers`)
Moreau–Jean     H = ½ μ Σ (w²/F + ω² qⁿ qⁿ⁻¹),  F = (1 − a + e)/(ωΔt)², which tends to E as Δt → 0. F nearly vanishes
                where ωΔt is close to 2π, 4π, …: H then says little about such a mode's displacement,
                and a damped mode at rest under a finger can gain some 1e-11 of it in a step.

Work is exact, not estimated: exact propagation under a constant force gives ΔE = λ·Δu − losses, and an impulse changes
H by a product that is linear in each contact's share (`impulse_work`). Letters as in `laws`; energies in joules.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.laws import EXACT_HOLD


def filter_factor(law: int, omega: np.ndarray, coef: np.ndarray, dt: float) -> np.ndarray:
    """F (N,) of the Moreau–Jean energy, recovered from the step coefficients; ones for exact-hold."""
    factor = np.ones(omega.size)
    if law != EXACT_HOLD:
        moving = omega * dt > 1e-150
        lossy = ~moving & (coef[3, : omega.size] < 1.0)
        e = coef[3, : omega.size][lossy]
        factor[lossy] = (1.0 - e) / -np.log(e)
        factor[moving] = -coef[2, : omega.size][moving] / (omega[moving] ** 2 * dt)
    return factor


@njit(cache=True, nogil=True)
def stored(law: int, omega, factor, mu: float, dt: float, q, v) -> float:
    """The law's stored energy [J] of modes with ω (N,) [rad/s] and F (N,) in the state q, v (N,)."""
    total = 0.0
    if law == EXACT_HOLD:
        for j in range(q.size):
            total += v[j] * v[j] + (omega[j] * q[j]) ** 2
    else:
        for j in range(q.size):
            total += v[j] * v[j] / factor[j] + omega[j] ** 2 * q[j] * (q[j] - dt * v[j])
    return 0.5 * mu * total


@njit(cache=True, nogil=True)
def spring(residual, force) -> float:
    """½ λᵀRλ [J]: what the modes left out hold in R (C, C) [m/N] under the forces λ (C,) [N]."""
    total = 0.0
    for a in range(force.size):
        for b in range(force.size):
            total += force[a] * residual[a, b] * force[b]
    return 0.5 * total


@njit(cache=True, nogil=True)
def impulse_work(shape, gain, omega, factor, mu: float, dt: float, q, w_free, w, impulse: float) -> float:
    """Energy that one Moreau–Jean impulse [N s] at `shape` (N,) brings: ½ μ p Σ φ k ((w + w_free)/F + ω² Δt q).

    q (N,) before the step, w_free and w (N,) before and after *all* impulses of the step, k = gain (N,) [1/kg] the row
    kv of the coefficients. The shares of a step's impulses add up to the change of H.
    """
    if impulse == 0.0:
        return 0.0
    total = 0.0
    for j in range(q.size):
        total += shape[j] * gain[j] * ((w[j] + w_free[j]) / factor[j] + omega[j] ** 2 * dt * q[j])
    return 0.5 * mu * impulse * total
