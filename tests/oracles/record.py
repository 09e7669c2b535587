"""The contact problems that a run meets, kept for comparing solvers on them."""

from __future__ import annotations

import numpy as np

from synth.solver.driver import Model, static_contact
from synth.solver.laws import EXACT_HOLD
from synth.solver.stepwise import one_by_one
from synth.solver.stringmodel import Strung


def contact_problems(model: Model, q, v, steps: int) -> np.ndarray:
    """b (n, C) of the problems 0 ≤ G λ + b ⊥ λ ≥ 0 of the steps in which the free string meets the obstacle.

    The run is exact-hold without a finger from q, v (N,), `steps` steps long; G is model.string.matrix.
    ValueError for another law.
    """
    if model.string.law != EXACT_HOLD:
        raise ValueError("contact problems on positions exist under exact-hold only; set scheme to exact-hold")
    start, _, _ = static_contact(model, np.asarray(q, dtype=np.float64))
    string = Strung(model.string, start, np.asarray(v, dtype=np.float64), 1)
    met, coef = [], model.string.rows[:, : model.string.modes]
    for _ in range(steps):
        b = model.under.shapes @ (coef[0] * string.q + coef[1] * string.v) - model.under.eta
        if np.any(b < 0.0):
            met.append(b)
        one_by_one(*string.addresses, 0, 0, 1)
    return np.array(met).reshape(-1, model.under.eta.size)
