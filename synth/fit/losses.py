"""The loss law of `physics.string` through measured decay rates: air, viscoelastic and thermoelastic losses.

A recording tells the length and weight of a string only through its losses, so the air's two terms (drag, and the
boundary layer that grows with √ν) are kept as what they depend on: 1/μ and d/μ. A drag greater than any string's weight
explains stands for what the ends take from all partials alike. All four terms are ≥ 0 and enter linearly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.fit.partials import MeasuredPartial, Stretch
from synth.physics.modes import model_decay_rates
from synth.physics.string import String


@dataclass(frozen=True)
class Losses:
    """Decay parameters.

    air_drag_m_kg           1/μ of the air's drag [m/kg]
    air_boundary_m2_kg      d/μ of the air's boundary layer [m²/kg]
    viscoelastic_loss       δ_ve
    thermoelastic_q_inverse Q_te⁻¹
    spread                  rms of the measured rates beside the law, relative
    """

    air_drag_m_kg: float
    air_boundary_m2_kg: float
    viscoelastic_loss: float
    thermoelastic_q_inverse: float
    spread: float

    @property
    def terms(self) -> NDArray[np.float64]:
        return np.array([self.air_drag_m_kg, self.air_boundary_m2_kg, self.viscoelastic_loss, self.thermoelastic_q_inverse])

    def decay_rates(self, stretch: Stretch, n: int) -> NDArray[np.float64]:
        """σ of partials 1 … n [1/s]."""
        return loss_terms(stretch, n) @ self.terms


def loss_terms(stretch: Stretch, n: int) -> NDArray[np.float64]:
    """(n, 4): what each of the terms, at 1, adds to σ of partials 1 … n [1/s]; from the model itself, linear in them."""

    def rates(diameter_m: float, viscoelastic: float, thermoelastic: float) -> NDArray[np.float64]:
        # Of 1 kg/m and 1 m: only f0, B and d/μ matter.
        string = String.from_inharmonicity(
            1.0,
            (2.0 * stretch.f0_hz) ** 2,
            1.0,
            stretch.inharmonicity,
            diameter_m,
            viscoelastic_loss=viscoelastic,
            thermoelastic_q_inverse=thermoelastic,
        )
        return model_decay_rates(string, n)

    tiny = 1e-12
    drag = rates(tiny, 0.0, 0.0)
    return np.stack([drag, rates(1.0, 0.0, 0.0) - drag, rates(tiny, 1.0, 0.0) - drag, rates(tiny, 0.0, 1.0) - drag], axis=1)


def fit_losses(found: list[MeasuredPartial], stretch: Stretch) -> Losses:
    """Bounded least squares of the relative errors of σ, those of partials far beside the law counting less."""
    use = [p for p in found if p.decay > 0.0 and p.steady]
    if len(use) < 3:
        use = [p for p in found if p.decay > 0.0]
    if not use:
        return Losses(0.0, 0.0, 0.0, 0.0, math.inf)
    numbers = np.array([p.number for p in use])
    sigma = np.array([p.decay for p in use])
    error = np.maximum(np.array([p.decay_error for p in use]) / sigma, 1e-4)
    terms = loss_terms(stretch, int(numbers.max()))[numbers - 1]
    coefficients, spread = fit_terms(terms, sigma, error)
    drag, boundary, viscoelastic, thermoelastic = (float(c) for c in coefficients)
    return Losses(drag, boundary, viscoelastic, thermoelastic, spread)


def fit_terms(
    terms: NDArray[np.float64], sigma: NDArray[np.float64], error: NDArray[np.float64], rounds: int = 15
) -> tuple[NDArray[np.float64], float]:
    """(coefficients ≥ 0, relative spread) of sigma ≈ terms @ coefficients. error: relative standard errors (n,)."""
    from scipy.optimize import nnls

    spread, robust = 0.05, np.ones(sigma.size)
    coefficients = np.zeros(terms.shape[1])
    model = sigma.copy()
    for _ in range(rounds):
        # Relative to the model as it grows good: an error of the measurement must not choose its own weight.
        weight = np.sqrt(robust / (error**2 + spread**2)) / np.maximum(model, 0.2 * sigma)
        scaled = weight[:, None] * terms
        norms = np.maximum(np.linalg.norm(scaled, axis=0), 1e-300)
        coefficients = nnls(scaled / norms, weight * sigma)[0] / norms
        model = terms @ coefficients
        left = sigma / np.maximum(model, 0.2 * sigma) - 1.0
        size = 1.4826 * float(np.median(np.abs(left)))
        spread = max(1e-4, math.sqrt(max(0.0, size**2 - float(np.median(error)) ** 2)))
        robust = np.minimum(1.0, 2.0 * np.sqrt(error**2 + spread**2) / np.maximum(np.abs(left), 1e-12))
    return coefficients, spread
