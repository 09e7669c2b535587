"""Exact solutions as schemes of `simulate`: on the program's own cases, what they answer, and what they refuse."""

from __future__ import annotations

import numpy as np
import pytest

from synth.dsp.measures import relative_error
from synth.research.exact import triangle
from synth.research.simulation import CaseError, load_case, simulate
from synth.solver.schemes import EXACT

POINTED = "flat-wall-points"


def changed(name, **tables):
    case = load_case(name).model_dump(exclude_none=True)
    for table, values in tables.items():
        case[table] = {**case.get(table, {}), **values}
    return case


@pytest.mark.parametrize(
    ("case", "scheme"),
    [("cabannes", "cabannes"), ("cabannes", "waveguide"), (POINTED, "flat-wall"), ("ideal-bridge", "waveguide")],
)
def test_lossless_cases(case, scheme):
    """Energy stays, nothing penetrates, the impulse of the obstacle over whole periods is what momentum balance asks."""
    result = simulate(case, scheme=scheme, ledger=True)
    assert result.metadata["scheme"] == scheme and scheme in EXACT
    assert result.largest_penetration_m <= 1e-16 and result.contact_force.min() >= 0.0 and result.contact_force.max() > 0.0
    stored = result.energy_stored
    np.testing.assert_allclose(stored, stored[0], rtol=1e-12)
    pluck = load_case(case).initial.displacement_m
    assert stored[0] == pytest.approx(0.5 * 160.0 * pluck**2 * 4.0, rel=1e-12)
    np.testing.assert_array_equal(result.energy_viscous, 0.0)
    assert not np.any(result.energy_injected) and not np.any(result.energy_residual)
    assert 0.0 <= result.largest_energy_rise <= 1e-12
    assert 0.0 < result.last_contact_s <= load_case(case).run.duration_s


def test_the_cases_are_periodic():
    """Cabannes' string after (3 − h)/2 · L/c = 4.375 ms, the wall's after (1 + h)L/c = 3.75 ms: 280 and 240 rows."""
    for case, scheme, rows in (("cabannes", "cabannes", 280), (POINTED, "flat-wall", 240)):
        u = simulate(case, scheme=scheme).u
        np.testing.assert_allclose(u[rows:], u[:-rows], rtol=0, atol=1e-16)
        assert np.abs(u[rows // 2 :] - u[: -(rows // 2)]).max() > 1e-4
    assert simulate("cabannes", scheme="cabannes").summary["period_s"] == pytest.approx(4.375e-3, rel=1e-12)


def test_schemes_agree_on_ideal_strings():
    """Over one point: waves, closed form; 1500 modes by exact-hold, e < 0.002; 60 modes without a step, e < 0.1."""
    exact = simulate("cabannes", scheme="cabannes", duration=0.01)
    waves = simulate("cabannes", scheme="waveguide", duration=0.01)
    np.testing.assert_allclose(waves.u, exact.u, rtol=0, atol=1e-15)
    np.testing.assert_allclose(waves.contact_force, exact.contact_force, rtol=0, atol=1e-8)
    assert relative_error(simulate("cabannes", residual_compliance=False, duration=0.01).u, exact.u) < 0.002
    few = [
        relative_error(
            simulate("cabannes", scheme="event-driven", modes=n, duration=0.01, residual_compliance=False).u, exact.u
        )
        for n in (15, 60)
    ]
    assert few[1] < 0.1 and few[1] < 0.6 * few[0], few


def test_event_driven_on_the_tanpura():
    """A stiff, lossy string of 40 modes: ledger closed, the rows it is asked for, exact-hold + R nearer at every rate."""
    exact = simulate("tanpura", scheme="event-driven", modes=20, duration=0.02, internal_rate=44_100, ledger=True)
    assert exact.metadata["residual_compliance"] and exact.summary["landings"] > 0 and exact.u.shape == (883, 1)
    total = exact.energy_stored + exact.energy_residual + exact.energy_viscous + exact.energy_contact
    np.testing.assert_allclose(total, total[0], rtol=1e-12)
    assert np.diff(exact.energy_viscous).min() >= -1e-13 * total[0] and not np.any(exact.energy_contact)
    errors = [
        relative_error(simulate("tanpura", modes=20, duration=0.02, internal_rate=44_100 * 4**k, tail="static").u, exact.u)
        for k in range(4)
    ]
    assert errors[0] > 3.0 * errors[2] > 9.0 * errors[3], errors


def test_pressed_start_is_lifted_as_for_exact_hold():
    case = changed("tanpura", obstacle={"positions_m": [0.3], "heights_m": [2e-3]}, run={"modes": 20, "duration_s": 0.005})
    for residual in (True, False):
        exact = simulate(case, scheme="event-driven", internal_rate=88_200, residual_compliance=residual)
        held = simulate(case, internal_rate=88_200, tail="static" if residual else "none")
        assert exact.summary["lifted_m"] == held.summary["lifted_m"] > 0.0
        np.testing.assert_allclose(exact.contact_force[0], held.contact_force[0], rtol=1e-9)
        np.testing.assert_allclose(exact.u_contact[0], 2e-3, rtol=1e-12)


FINGER = [{"position_m": 0.3, "displacement_m": 1e-3, "draw_s": 0.01}]
POINTS = list(np.arange(1, 40) / 40)


@pytest.mark.parametrize(
    ("case", "scheme", "message"),
    [
        (changed("cabannes", string={"inharmonicity": 1e-5}), "waveguide", r"needs an ideal string .*stiffness 0\.000162"),
        (changed("cabannes", string={"viscoelastic_loss": 0.1, "inharmonicity": 1e-5}), "cabannes", "decay rates up to"),
        (changed("cabannes", string={"air_viscosity": 1e-5, "air_density": 1.2}), "flat-wall", "set air_viscosity"),
        ("tanpura", "waveguide", "leave out inharmonicity"),
        (changed("cabannes", run={"internal_rate_hz": 64100.0}), "waveguide", "the nearest rates are 64000 or 64400 Hz"),
        (
            changed("cabannes", run={"internal_rate_hz": 4e8, "output_rate_hz": 4e4, "duration_s": 1.0, "modes": 9}),
            "waveguide",
            "would take days",
        ),
        (changed("cabannes", obstacle={"positions_m": [0.501]}), "waveguide", r"positions_m must lie on a node .*0\.5 and"),
        (changed("cabannes", run={"outputs_m": [0.3001]}), "waveguide", r"outputs_m must lie on a node .*got 0\.3001 m"),
        (changed("cabannes", obstacle={"heights_m": [2e-3]}), "waveguide", "must start clear of its obstacle"),
        (changed("cabannes", obstacle={"heights_m": [2e-3]}), "cabannes", "between −1 and 1 times the pluck's, got 2"),
        (changed("cabannes", initial={"position_m": 0.4}), "cabannes", r"mid-string, 0\.5 m, got 0\.4 m"),
        (changed("cabannes", initial={"width_m": 0.1}), "cabannes", "must be a sharp triangle"),
        (changed("cabannes"), "flat-wall", "needs at least 20 points of one height.*got 1 points"),
        (
            changed(POINTED, obstacle={"heights_m": list(np.linspace(-1e-3, 0, 39))}),
            "flat-wall",
            "differ by 0.001 m",
        ),
        (changed(POINTED, obstacle={"positions_m": [0.5 * x for x in POINTS]}), "flat-wall", r"0\.512 m apart"),
        (changed(POINTED, scheme={"restitution": 0.5}), "flat-wall", r"is elastic, got restitution 0\.5"),
        (changed(POINTED, initial={"position_m": 0.4}), "flat-wall", r"at mid-string, 0\.5 m, got 0\.4 m"),
        ("bass", "event-driven", "needs one contact point, got 20"),
        (changed("tanpura", obstacle={"positions_m": [], "heights_m": []}), "event-driven", "one contact point, got 0"),
        ({**changed("tanpura"), "finger": FINGER}, "event-driven", r"takes no \[\[finger\]\]"),
        ({**changed("cabannes"), "finger": FINGER}, "waveguide", r"takes no \[\[finger\]\]"),
    ],
)
def test_what_does_not_apply_is_said(case, scheme, message):
    with pytest.raises(CaseError, match=message) as fault:
        simulate(case, scheme=scheme)
    assert str(fault.value).startswith(f"{scheme}: ")


def test_off_centre_pluck_over_a_wall_at_rest_height():
    case = changed(POINTED, obstacle={"heights_m": 0.0}, initial={"position_m": 0.2})
    result = simulate(case, scheme="flat-wall")
    free = triangle.free(np.array([0.25, 0.5]), result.t[:, None], 1.0, 400.0, 0.2, 1e-3)
    np.testing.assert_allclose(result.u, np.abs(free), rtol=0, atol=1e-16)


def test_thrown_and_modal_starts_run_on_the_waveguide():
    """A start in modes, moving: over a low point that is not reached, the closed form; the same over a high one bounces."""
    start = {"shape": "modes", "q": [2e-4, 1e-4], "v": [0.3, -0.2]}
    case = changed("cabannes", run={"modes": 2, "duration_s": 0.01})
    case["initial"] = start
    case["obstacle"]["heights_m"] = [-5e-3]
    waves, modal = simulate(case, scheme="waveguide"), simulate(case)
    np.testing.assert_allclose(waves.u, modal.u, rtol=0, atol=1e-15)
    assert np.isnan(waves.last_contact_s)
    case["obstacle"]["heights_m"] = [-1e-4]
    case["run"]["modes"] = 1500
    bounced = simulate(case, scheme="waveguide")
    assert bounced.last_contact_s > 0.0
    assert relative_error(simulate(case, residual_compliance=False).u, bounced.u) < 0.01
