"""A pluck of a run (`driver`): a finger draws the string aside and lets it slide off.

Both ways are half cosines. While the string slides off, the finger is a spring so soft that its path is a given force
(Chadefaux et al., JASA 133(4), 2013, 2444, on the harp).
"""

from __future__ import annotations

import numpy as np

from synth.solver import driver
from synth.solver.stepwise import LEAST_STIFFNESS


def pluck(
    model: driver.Model,
    run: driver.Run,
    weights: np.ndarray,
    stiffness: float,
    resistance: float,
    to_m: float,
    drawn: np.ndarray,
    slipped: np.ndarray,
) -> None:
    """The string of a run is drawn from where it is to `to_m` [m] and let go.

    weights (N,)           mode shapes averaged over the finger
    stiffness, resistance  of what is between finger and string [N/m], [N s/m]
    drawn, slipped         (n + 1,) parts of the time of drawing and of sliding off at the start and after each step; of one
                           number: at once
    """
    coupling, own = model.finger_row(weights)
    here = float(weights @ run.q)
    state = np.array([here, 0.0])

    def hold(spring: float, dashpot: float, path: np.ndarray) -> None:
        driver.run(model, run, path.size - 1, driver.Finger(weights, coupling, own, spring, dashpot, path, state))

    hold(stiffness, resistance, _way(drawn, here, to_m))
    if slipped.size > 1:
        hold(LEAST_STIFFNESS, 0.0, _way(slipped, float(state[1]) / LEAST_STIFFNESS, 0.0))


def _way(parts: np.ndarray, start: float, end: float) -> np.ndarray:
    return np.asarray(start + 0.5 * (end - start) * (1.0 - np.cos(np.pi * np.clip(parts, 0.0, 1.0))))
