"""What no scheme may break: the mirrored, the scaled, the sped-up, the interrupted and the reversed motion."""

from __future__ import annotations

import numpy as np
import pytest

from synth.dsp.measures import relative_error
from synth.physics.modes import decay_rates, modal_frequencies, mode_shapes, residual_compliance
from synth.physics.string import String
from synth.research.simulation import simulate
from synth.solver import driver, study
from synth.solver.laws import EXACT_HOLD
from synth.solver.stringmodel import StringContacts, StringModes

SCHEMES = [
    pytest.param({"name": "exact-hold"}, id="exact-hold + R"),
    pytest.param({"name": "exact-hold", "residual_compliance": False}, id="exact-hold"),
    pytest.param({"name": "moreau-jean", "restitution": 0.0}, id="moreau-jean e=0"),
    pytest.param({"name": "moreau-jean", "restitution": 1.0}, id="moreau-jean e=1"),
    pytest.param({"name": "moreau-jean-filtered", "restitution": 0.0}, id="moreau-jean-filtered e=0"),
    pytest.param({"name": "moreau-jean-filtered", "restitution": 0.7}, id="moreau-jean-filtered e=0.7"),
]


def case(scheme, tension=160.0, mirrored=False, scale=1.0, faster=1.0):
    """A stiff, lossless string over three points; every length, height and time of it can be turned or stretched."""
    points, heights, plucked, outputs = [0.21, 0.46, 0.72], [-3e-4, -1e-4, -2e-4], 0.34, [0.1, 0.55]
    if mirrored:
        points, heights, plucked, outputs = (
            [1.0 - p for p in points[::-1]], heights[::-1], 1.0 - plucked, [1.0 - p for p in outputs]
        )  # fmt: skip
    return {
        "string": {
            "length_m": 1.0,
            "tension_n": tension,
            "linear_density_kg_m": 1e-3,
            "diameter_m": 1e-3,
            "inharmonicity": 1e-4,
            "air_viscosity": 0.0,
        },
        "obstacle": {"positions_m": points, "heights_m": [scale * h for h in heights]},
        "initial": {"shape": "triangle", "position_m": plucked, "displacement_m": scale * 1e-3, "width_m": 0.1},
        "scheme": scheme,
        "run": {
            "internal_rate_hz": 64e3 * faster,
            "output_rate_hz": 16e3 * faster,
            "modes": 24,
            "duration_s": 0.004 / faster,
            "outputs_m": outputs,
        },
    }


@pytest.mark.parametrize("scheme", SCHEMES)
def test_mirror_scale_and_speed(scheme):
    """Mirrored: to roundings, which 50 steps of contact stretch (without R exact-hold doubles them with every bounce).
    By powers of two, bit by bit: u, η and pluck ×4 with the forces; tension ×4, all rates ×2 and times ×½, which is the
    same motion sooner with forces ×4."""
    plain = simulate(case(scheme))
    assert np.count_nonzero(np.any(plain.contact_force[1:] > 0.0, axis=0)) == 3
    mirrored = simulate(case(scheme, mirrored=True))
    assert relative_error(mirrored.u, plain.u) < 1e-9
    assert relative_error(mirrored.contact_force[:, ::-1], plain.contact_force) < 1e-7
    scaled = simulate(case(scheme, scale=4.0))
    np.testing.assert_array_equal(scaled.u, 4.0 * plain.u)
    np.testing.assert_array_equal(scaled.contact_force, 4.0 * plain.contact_force)
    faster = simulate(case(scheme, tension=640.0, faster=2.0))
    np.testing.assert_array_equal(faster.u, plain.u)
    np.testing.assert_array_equal(faster.contact_force, 4.0 * plain.contact_force)


def model(dt, modes, residual=True):
    string = String.from_inharmonicity(1.0, 160.0, 1e-3, 1e-4, 1e-3, air_viscosity=0.0)
    points = np.array([0.3])
    r = residual_compliance(string, points, modes) if residual else np.zeros((1, 1))
    return driver.make_model(
        EXACT_HOLD,
        StringModes(1e-3, modal_frequencies(string, modes), decay_rates(string, modes)),
        dt,
        StringContacts(mode_shapes(1.0, points, modes), np.array([-2e-4]), r),
        np.eye(modes),
        0.0,
    )


def advanced(what, q, v, steps):
    run = driver.start_run(what, q, v, np.zeros(1), steps, 2, False, False)
    driver.run(what, run, steps)
    return run.q.copy(), run.v.copy(), int(run.results.counts[study.CONTACT_STEPS])


def test_exact_hold_goes_on_from_any_step():
    """(q, q̇) is all of the state: 1000 steps at once or in five parts, each from the last one's end.

    To rounding: blocks of steps then begin elsewhere."""
    what = model(1.0 / 64e3, 12)
    j = np.arange(1, 13)
    q, v = 1e-3 * np.sin(0.4 * np.pi * j) / j**2, np.zeros(12)
    once = advanced(what, q, v, 1000)
    touched = 0
    for part in (1, 199, 300, 37, 463):
        q, v, steps = advanced(what, q, v, part)
        touched += steps
    np.testing.assert_allclose(q, once[0], rtol=0, atol=1e-12 * np.abs(once[0]).max())
    np.testing.assert_allclose(v, once[1], rtol=0, atol=1e-12 * np.abs(once[1]).max())
    assert touched == once[2] > 10


def test_exact_hold_runs_back_to_first_order():
    """Lossless over R's spring the motion is reversible, the scheme loses Δt's share: 0.8 to 1.2 over four halvings."""
    j = np.arange(1, 9)
    q, v = 1e-3 * np.sin(0.4 * np.pi * j) / j**2, np.zeros(8)
    errors = []
    for k in range(5):
        steps = 6400 * 2**k
        what = model(0.01 / steps, 8)
        there_q, there_v, touched = advanced(what, q, v, steps)
        back_q, _, _ = advanced(what, there_q, -there_v, steps)
        assert touched > 100
        errors.append(np.abs(back_q - q).max() / np.abs(q).max())
    order = -np.polyfit(np.arange(5), np.log2(errors), 1)[0]
    assert 0.8 < order < 1.2 and errors[-1] < 0.01, (order, errors)
