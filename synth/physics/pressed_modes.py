"""Modes of a string that presses on one point of its bridge without a break: persistent contact, a linear string.

With λ = −(S q + ξ b − η)/R, R the compliance of the modes left out, the string μ(q̈_j + 2σ_j q̇_j + ω_j² q_j) = S_j λ is

    q = q₀ + a b + Vᵀz,    (Ω² + SᵀS/(μR)) v = λ² v of each row v of V,    a = −ξ Ω⁻²Sᵀ/(μ(R + C)),    C = S Ω⁻²Sᵀ/μ,

q₀ the state at rest and a what follows the bridge's motion b without inertia. In z it is a string that touches nothing: with
moments c′ = V(c + a) in the place of c (`solver.coupling`), stiffness T/L + ξ²/(R + C) towards the bridge, and the same sum
of all masses. The damping matrix V diag(σ) Vᵀ is taken for its diagonal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class PressedModes:
    """M modes z of a string of N modes q that presses on one point."""

    omega: np.ndarray  # (M,) [rad/s]
    sigma: np.ndarray  # (M,) [1/s]
    ramp: np.ndarray  # (M,) c′ [√m]
    stiffness: float  # of its end [N/m]
    mass_length_m: float  # L′ with μL′/3 the mass of the whole ramp: L/3 + Σ c′² − Σ c² of all modes
    modes: np.ndarray  # (M, N) V, orthonormal rows
    rest: np.ndarray  # (N,) q₀
    follows: np.ndarray  # (N,) a
    force_n: float  # λ at rest
    force_of_modes: np.ndarray  # (M,) what z adds to λ [N/(m·√m)]
    force_of_end: float  # what b adds to it [N/m]

    def first(self, count: int) -> PressedModes:
        """The first `count` modes alone."""
        fewer = {name: getattr(self, name)[:count] for name in ("omega", "sigma", "ramp", "modes", "force_of_modes")}
        return replace(self, **fewer)


def pressed_modes(
    omega: np.ndarray,
    sigma: np.ndarray,
    mu: float,
    shape: np.ndarray,
    residual: float,
    ramp: np.ndarray,
    end: tuple[float, float, float],
    force_n: float,
) -> PressedModes:
    """The modes of a string ω, σ, S, c (N,), μ [kg/m], over a point with R = residual [m/N] that presses by force_n [N].

    end: L [m], T/L [N/m] and ξ of the point. Raises ValueError unless residual and force_n are positive.
    """
    if not (residual > 0.0 and force_n > 0.0):
        raise ValueError(f"residual and force_n must be positive, got {residual!r} m/N and {force_n!r} N")
    length_m, stiffness, leverage = end
    soft = shape / (mu * omega**2)
    compliance = residual + float(shape @ soft)
    squares, columns = np.linalg.eigh(np.diag(omega**2) + np.outer(shape, shape) / (mu * residual))
    follows = -leverage / compliance * soft
    whole = ramp + follows
    return PressedModes(
        omega=np.sqrt(squares),
        sigma=sigma @ columns**2,
        ramp=whole @ columns,
        stiffness=stiffness + leverage**2 / compliance,
        mass_length_m=length_m + 3.0 * float(whole @ whole - ramp @ ramp),
        modes=np.ascontiguousarray(columns.T),
        rest=soft * force_n,
        follows=follows,
        force_n=force_n,
        force_of_modes=-(shape @ columns) / residual,
        force_of_end=-leverage / compliance,
    )
