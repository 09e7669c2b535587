"""Compliant schemes through the research door: free flight, the rigid limit, the full grid, frets, starts and faults."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from synth.cli import main
from synth.dsp.measures import relative_error
from synth.research.simulation import Case, CaseError, Scene, simulate
from synth.solver.schemes import COMPLIANT

METHODS = tuple(COMPLIANT)


def table(result):
    return result.energy_stored + result.energy_residual + result.energy_viscous + result.energy_contact


def case(**tables):
    found = {
        "string": {
            "length_m": 1.0,
            "tension_n": 160.0,
            "linear_density_kg_m": 1e-3,
            "diameter_m": 4e-4,
            "inharmonicity": 2e-5,
            "viscoelastic_loss": 4e-3,
        },
        "obstacle": {"positions_m": [0.1], "heights_m": [0.0]},
        "initial": {"shape": "triangle", "position_m": 0.5, "displacement_m": 1e-3, "width_m": 0.05},
        "scheme": {"name": "compliant"},
        "run": {"internal_rate_hz": 96e3, "modes": 49, "duration_s": 0.02, "outputs_m": [0.3]},
    }
    for name, values in tables.items():
        found[name] = {**found.get(name, {}), **values} if isinstance(values, dict) else values
    return found


@pytest.mark.parametrize("scheme", METHODS)
@pytest.mark.parametrize("rate", [3_000.0, 96e3])
def test_free_flight_is_exact_at_any_rate(scheme, rate):
    clear = case(
        obstacle={"heights_m": [-0.1]}, scheme={"name": scheme}, run={"internal_rate_hz": rate, "output_rate_hz": 100.0}
    )
    result = simulate(clear, duration_s=0.1)
    scene = Scene(Case.model_validate(clear), Path())
    q, _ = scene.initial()
    w, s, t = scene.omega, scene.sigma, result.t[:, None]
    root = np.sqrt((w**2 - s**2).astype(complex))
    motion = (np.exp(-s * t) * (np.cos(root * t) + s * np.sin(root * t) / root)).real * q
    rounding = 1e-12 + 0.1 * rate * np.finfo(float).eps  # an ulp a step
    np.testing.assert_allclose(result.u[:, 0], motion @ scene.out_shapes[0], rtol=0, atol=rounding * 1e-3)
    assert np.isnan(result.last_contact_s) and result.largest_penetration_m < 0 and not np.any(result.contact_force)


@pytest.mark.parametrize("scheme", METHODS)
def test_stiffer_contacts_come_closer_to_the_rigid_one(scheme):
    """Against exact-hold at the same small step: the depth f/K of the contact is what is left."""
    small = case(run={"internal_rate_hz": 768e3, "output_rate_hz": 96e3, "duration_s": 0.01})
    rigid = simulate(small, scheme="exact-hold", residual_compliance=False)
    error, depth = [], []
    for stiffness in (1e5, 1e6, 1e7, 1e8):
        result = simulate(small, scheme=scheme, stiffness=stiffness)
        error.append(relative_error(result.u, rigid.u))
        depth.append(result.largest_penetration_m)
    assert np.all(np.diff(error) < 0) and error[-1] < 0.05, error
    assert np.all(np.diff(depth) < 0)


def test_full_grid_is_the_same_motion():
    """Node 5 of 50 cells is the obstacle's point: S over all nodes costs more and changes rounding only."""
    few, full = simulate(case(), ledger=True), simulate(case(), grid="full", ledger=True)
    assert full.summary["contacts_moved_m"] < 1e-15 and full.summary["contact_steps"] == few.summary["contact_steps"] > 100
    np.testing.assert_allclose(full.u, few.u, rtol=0, atol=1e-9 * np.abs(few.u).max())
    np.testing.assert_allclose(table(full), table(full)[0], rtol=1e-11)
    moved = simulate(case(obstacle={"positions_m": [0.107]}), grid="full")
    assert moved.summary["contacts_moved_m"] == pytest.approx(0.007)
    np.testing.assert_allclose(moved.u, full.u, rtol=0, atol=1e-9 * np.abs(few.u).max())


@pytest.mark.parametrize("scheme", METHODS)
@pytest.mark.parametrize("rate", [44_100, 705_600])
def test_bass_over_its_frets(scheme, rate):
    """Twenty frets, several at once: energy kept, every step solved."""
    result = simulate(
        "bass", scheme=scheme, rate=rate, output_rate=44_100, modes=60, duration=882 / 44_100, ledger=True, stiffness=1e8
    )
    assert np.count_nonzero(np.any(result.contact_force != 0, axis=0)) > 5
    assert result.summary["unsolved_steps"] == 0 and result.summary["finite"]
    # the ledger adds up to 1e-12 a thousand steps
    np.testing.assert_allclose(table(result), table(result)[0], rtol=1e-12 * (1 + rate * 0.02 / 1000))
    assert result.largest_energy_rise < 1e-12
    assert np.all(np.diff(result.energy_viscous) >= 0)


def test_bass_schemes_agree_at_small_steps():
    """Three schemes of one contact law, soft enough to be resolved, over the first contacts."""
    runs = [
        simulate("bass", scheme=s, rate=2_116_800, output_rate=44_100, modes=30, duration=0.01, stiffness=1e6).u
        for s in METHODS
    ]
    assert relative_error(runs[1], runs[0]) < 0.02 and relative_error(runs[2], runs[0]) < 0.02


@pytest.mark.parametrize("scheme", METHODS)
def test_a_start_pressed_in_begins_as_given(scheme):
    pressed = case(
        obstacle={"positions_m": [0.1, 0.5], "heights_m": [5e-4, 1.1e-3]},
        scheme={"name": scheme, "stiffness": 1e7},
        run={"internal_rate_hz": 768e3},
    )
    result = simulate(pressed, ledger=True)
    scene = Scene(Case.model_validate(pressed), Path())
    q, _ = scene.initial()
    np.testing.assert_allclose(result.u_contact[0], scene.shapes @ q, rtol=1e-12)
    depth = np.maximum(scene.eta - result.u_contact[0], 0)
    np.testing.assert_allclose(result.contact_force[0], 1e7 * depth**1.5, rtol=1e-9)
    # the ledger begins half a step later, by when the string has hardly moved; the first step keeps the energy
    start = 0.5 * 1e-3 * np.sum((scene.omega * q) ** 2) + 1e7 / 2.5 * np.sum(depth**2.5)
    np.testing.assert_allclose(table(result), table(result)[0], rtol=1e-11)
    assert table(result)[0] == pytest.approx(start, rel=0.02)
    assert result.metadata["start"] == "as given"


def test_loss_takes_energy_at_the_contact():
    result = simulate(case(scheme={"loss": 1.0, "stiffness": 1e7}), ledger=True)
    assert result.energy_contact[-1] > 1e-4 * table(result)[0]
    assert np.all(np.diff(result.energy_contact) >= 0) and result.largest_energy_rise < 1e-12


def test_no_obstacle_is_no_contact():
    for scheme in METHODS:
        free = {key: value for key, value in case(scheme={"name": scheme}).items() if key != "obstacle"}
        assert simulate(free, ledger=True).summary["contact_steps"] == 0


@pytest.mark.parametrize(
    ("scheme", "message"),
    [
        ({"name": "exact-hold", "stiffness": 1e9}, "'exact-hold' does not take stiffness; it belongs to compliant"),
        ({"name": "scalar-auxiliary-variable", "loss": 1.0}, "does not take loss; it belongs to compliant, energy"),
        ({"name": "energy-quadratisation", "grid": "full"}, "does not take grid"),
        ({"name": "compliant", "drift_correction": 0.5}, "does not take drift_correction"),
        ({"name": "compliant", "stiffness": 0.0}, r"scheme\.stiffness: .*greater than 0, got 0"),
        ({"name": "compliant", "exponent": 0.5}, r"scheme\.exponent: .*got 0\.5"),
        ({"name": "compliant", "grid": "half"}, r"scheme\.grid"),
        ({"name": "compliant", "iterations": 0}, r"scheme\.iterations"),
    ],
)
def test_faults_are_named(scheme, message):
    with pytest.raises(CaseError, match=message):
        simulate(case(scheme=scheme))


def test_newton_keeps_to_its_limit_and_says_so():
    hard = simulate(case(), stiffness=1e12, iterations=2)
    assert hard.summary["unsolved_steps"] > 0 and hard.summary["most_newton_iterations"] == 2
    rough, fine = (simulate(case(), stiffness=1e12, tolerance=t).summary for t in (1e-2, 1e-12))
    assert rough["newton_iterations"] < fine["newton_iterations"] and fine["unsolved_steps"] == 0


def test_options_of_the_command_line(tmp_path, capsys):
    out = tmp_path / "out.npz"
    run = ["simulate", "tanpura", "-o", str(out), "--modes", "20", "--rate", "44100", "--duration", "0.01", "--json"]
    assert main([*run, "--scheme", "energy-quadratisation", "--stiffness", "1e9", "--exponent", "2"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["scheme"], summary["stiffness"], summary["exponent"]) == ("energy-quadratisation", 1e9, 2.0)
    assert summary["contact_steps"] > 0 and summary["auxiliary_drift"] > 0
    assert main([*run, "--stiffness", "1e9"]) != 0
    assert "'exact-hold' does not take stiffness" in capsys.readouterr().err


def test_work_of_the_full_grid_counts():
    absurd = case(scheme={"grid": "full"}, run={"modes": 20_000, "internal_rate_hz": 2e6, "output_rate_hz": 1e3})
    with pytest.raises(CaseError, match="mode-steps"):
        simulate(absurd, duration_s=1.0)


def test_fingers_and_crowded_grids_are_refused():
    with pytest.raises(CaseError, match="finger: scheme 'compliant' has none"):
        simulate(case(finger=[{"position_m": 0.3, "displacement_m": 1e-3, "draw_s": 0.01}]))
    with pytest.raises(CaseError, match="take more modes"):
        simulate(case(obstacle={"positions_m": [0.1, 0.105], "heights_m": 0.0}, scheme={"grid": "full"}))
    with pytest.raises(CaseError, match="on an end"):
        simulate(case(obstacle={"positions_m": [0.001], "heights_m": 0.0}, scheme={"grid": "full"}))
