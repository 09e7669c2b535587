"""The contact problems that a run meets, kept for comparing solvers on them."""

from __future__ import annotations

import numpy as np

from synth.solver.driver import Model, static_contact
from synth.solver.kernels import advance, make_work, no_finger
from synth.solver.laws import EXACT_HOLD


def contact_problems(model: Model, q, v, steps: int) -> np.ndarray:
    """b (n, C) of the problems 0 ≤ G λ + b ⊥ λ ≥ 0 of the steps in which the free string meets the obstacle.

    The run is exact-hold without a finger from q, v (N,), `steps` steps long; G is model.g. ValueError for another law.
    """
    if model.law != EXACT_HOLD:
        raise ValueError("contact problems on positions exist under exact-hold only; set scheme to exact-hold")
    n, contacts = model.omega.size, model.eta.size
    q, force, _ = static_contact(model, np.asarray(q, dtype=np.float64))
    v = np.array(v, dtype=np.float64)
    u, w = model.shapes @ q, model.shapes @ v
    work, finger, watch = make_work(contacts), no_finger(n, contacts), np.ones(contacts, np.uint8)
    none, no_out, nothing = np.zeros((0, n)), np.zeros((1, 0)), np.zeros((0, 0))
    met = []
    for _ in range(steps):
        b = model.shapes @ (model.coef[0] * q + model.coef[1] * v) - model.eta
        if np.any(b < 0.0):
            met.append(b)
        advance(
            model.law, 1, model.dt, model.restitution, model.coef, model.shapes, model.eta, model.g, q, v, u, w, force,
            finger, watch, none, none, no_out, no_out, nothing, nothing, work,
        )  # fmt: skip
    return np.array(met).reshape(-1, contacts)
