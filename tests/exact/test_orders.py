"""Order of convergence of each scheme in Δt, the number of modes fixed, against the event-driven solution.

One stiff, lossy string of 10 modes over one point, nine places drawn at random, 12 ms with three to seven landings, six
rates 200 kHz … 6.4 MHz (five halvings). Order 1 for all: exact-hold holds the force that stands at a step's end, an implicit
Euler rule for R's spring; Moreau–Jean acts a fraction of a step after the landing. That fraction is as good as random: one
error scatters by a factor of 2^±0.8 about its line, the slope through six of a mean over nine by 0.8/3/√17.5 = 0.06, and
the band is four of these. Exact-hold + R does not scatter; its band is what is left of the second order, e = 2 % at 200 kHz.
"""

from __future__ import annotations

import numpy as np
import pytest

from synth.dsp.measures import relative_error
from synth.research.simulation import simulate

MODES, ROWS = 10, 25e3
BAND = 0.25
PLACES = np.random.default_rng(1).uniform(0.1, 0.9, 9)
RATES = [200e3 * 2**k for k in range(6)]


def case(position):
    return {
        "string": {
            "length_m": 1.0,
            "tension_n": 160.0,
            "linear_density_kg_m": 1e-3,
            "diameter_m": 1e-3,
            "inharmonicity": 1e-4,
            "viscoelastic_loss": 0.01,
        },
        "obstacle": {"positions_m": [position], "heights_m": [-0.4e-3]},
        "initial": {"shape": "triangle", "position_m": 0.4, "displacement_m": 2e-3, "width_m": 0.3},
        "run": {
            "internal_rate_hz": ROWS,
            "modes": MODES,
            "duration_s": 0.012,
            # as many points as modes: all of q
            "outputs_m": np.arange(1, MODES + 1) / (MODES + 1),
        },
    }


def errors(scheme, residual):
    found = []
    for position in PLACES:
        what = case(position)
        exact = simulate(what, scheme="event-driven", residual_compliance=residual)
        assert exact.summary["landings"] >= 2 and exact.summary["unsolved_steps"] == 0
        runs = (
            simulate(
                what, scheme=scheme, restitution=0.0, tail="static" if residual else "none",
                internal_rate_hz=rate, output_rate_hz=ROWS,
            )
            for rate in RATES
        )  # fmt: skip
        found.append([relative_error(run.u, exact.u) for run in runs])
    return np.log2(found).mean(axis=0)


@pytest.mark.parametrize(
    ("scheme", "residual", "band"),
    [("exact-hold", True, 0.1), ("moreau-jean", False, BAND), ("moreau-jean-filtered", False, BAND)],
)
def test_first_order_to_the_exact_motion(scheme, residual, band):
    mean = errors(scheme, residual)
    order = -np.polyfit(np.arange(6), mean, 1)[0]
    assert abs(order - 1.0) < band, (order, 2.0**mean)
    assert 2.0 ** mean[-1] < 2e-3


def test_exact_hold_of_few_rigid_modes_does_not_converge():
    """Without R a landing at the fraction θ of a step leaves with |1 − 2θ| of its speed: no limit, whatever the step.

    One mode, a free mass, shows it; ten modes keep an error of some per cent at every rate. What rebounds is the mass
    μ/Σφ² of N modes at the point, so that with N growing this matters less and less (`test_simulation`, 4000 modes).
    """
    from synth.solver import driver
    from synth.solver.laws import EXACT_HOLD
    from synth.solver.stringmodel import StringContacts, StringModes

    for fraction in (0.05, 0.3, 0.5, 0.8, 0.95):
        one, zero = np.ones((1, 1)), np.zeros(1)
        model = driver.make_model(
            EXACT_HOLD, StringModes(1.0, zero, zero), 0.1, StringContacts(one, zero, 0.0 * one), one, 0.0
        )
        run = driver.start_run(model, np.array([0.1 * fraction]), np.array([-1.0]), np.zeros(1), 1, 11, False, False)
        driver.run(model, run, 10)
        assert run.v[0] == pytest.approx(abs(1.0 - 2.0 * fraction), abs=1e-12)

    mean = errors("exact-hold", False)
    order = -np.polyfit(np.arange(6), mean, 1)[0]
    assert abs(order) < BAND and 2.0 ** mean[-1] > 1e-2, (order, 2.0**mean)


def test_free_flight_has_no_error():
    """Clear of the point every scheme is the closed form: at 200 kHz and 6.4 MHz, to a rounding a step."""
    what = case(0.3)
    what["obstacle"]["heights_m"] = [-10e-3]
    exact = simulate(what, scheme="event-driven").u
    for scheme in ("exact-hold", "moreau-jean", "moreau-jean-filtered"):
        for rate in (RATES[0], RATES[-1]):
            got = simulate(what, scheme=scheme, tail="static", internal_rate_hz=rate, output_rate_hz=ROWS).u
            assert relative_error(got, exact) < rate * 0.012 * 2.3e-16


@pytest.mark.parametrize("residual", [True, False])
def test_ideal_string_over_three_points(residual):
    """The coupled contacts of exact-hold, 2000 modes at 16 … 256 kHz, against travelling waves: order 1 over six draws.

    Modes beyond the rate are what makes a rigid point of the string's own inertia, so that here R changes nothing. Slopes
    of single draws scatter by 0.2, their mean by 0.08; the band is three of these.
    """
    rng = np.random.default_rng(4)
    found = []
    for _ in range(6):
        what = case(0.0)
        what["string"] |= {"inharmonicity": 0.0, "viscoelastic_loss": 0.0, "air_viscosity": 0.0}
        what["obstacle"] = {
            "positions_m": np.sort(rng.choice(np.arange(160, 1441), 3, replace=False)) / 1600,
            "heights_m": -rng.uniform(1e-4, 4e-4, 3),
        }
        what["initial"] = {"shape": "triangle", "position_m": 0.34, "displacement_m": 1e-3, "width_m": 0.2}
        what["run"] = {
            "internal_rate_hz": 16e3,
            "output_rate_hz": 16e3,
            "modes": 2000,
            "duration_s": 0.01,
            "outputs_m": [0.1, 0.3, 0.5, 0.9],
        }
        exact = simulate(what, scheme="waveguide", internal_rate_hz=400.0 * 3200).u
        runs = (simulate(what, internal_rate_hz=16e3 * 2**k, residual_compliance=residual).u for k in range(5))
        found.append([relative_error(u, exact) for u in runs])
    mean = np.log2(found).mean(axis=0)
    order = -np.polyfit(np.arange(5), mean, 1)[0]
    assert abs(order - 1.0) < BAND and 2.0 ** mean[-1] < 4e-3, (order, 2.0**mean)
