"""`simulate` of strings on a body: cases, schemes against each other and against the readable twin, results, errors."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import synth
from synth.physics.coupled import Place
from synth.physics.modes import residual_compliance
from synth.research.case import CaseError
from synth.research.coupled.coupled_case import read_coupled
from synth.research.coupled.coupled_result import CoupledResult, load_coupled_result
from synth.research.coupled.coupled_run import CoupledPlayer
from synth.research.coupled.coupled_scene import CoupledScene
from synth.research.result import ResultError, load_result
from synth.solver.coupled_study import ENERGIES
from synth.solver.coupling import KEPT_BY_THE_REST
from tests.oracles.coupled_studies import ON_THE_BRIDGE, accuracy, judged, touching_case
from tests.oracles.ramp_frames import RampFrames
from tests.oracles.random_instruments import random_case

STRING = {
    "length_m": 0.65, "tension_n": 70.0, "linear_density_kg_m": 1e-3, "diameter_m": 4e-4, "inharmonicity": 2e-5,
    "viscoelastic_loss": 4.5e-3, "outputs_m": [0.1],
}  # fmt: skip
BODY = {
    "mode": [
        {"frequency_hz": 102.0, "q": 25.0, "mass_kg": 0.45, "shape": [1.0, 0.1, 2.0], "radiation": 2.0, "pan": -0.5},
        {"frequency_hz": 195.0, "q": 30.0, "mass_kg": 0.18},
    ]
}
RUN = {"internal_rate_hz": 48000.0, "output_rate_hz": 24000.0, "modes": 30, "duration_s": 0.02}


def case(*strings: dict[str, Any], scheme: dict[str, Any] | None = None, **run: Any) -> dict[str, Any]:
    return {"string": [STRING | more for more in strings], "body": BODY, "scheme": scheme or {}, "run": RUN | run}


def simulated(tables: dict[str, Any], **overrides: Any) -> CoupledResult:
    result = synth.simulate(tables, **overrides)
    assert isinstance(result, CoupledResult)
    return result


DRAWN = {
    "polarisation": {"detuning_cents": 0.5, "loss_ratio": 1.2},
    "initial": {"shape": "drawn", "position_m": 0.13, "force_n": 2.0, "direction_deg": 30.0},
}


@pytest.mark.parametrize("field", ["u", "bridge", "bridge_force", "radiated"])
def test_kernels_tend_to_the_complex_modes_as_the_square_of_the_step(field: str) -> None:
    tables = case(DRAWN, {"tension_n": 90.0, "place_mm": 10.0}, duration_s=0.1)
    errors = []
    for rate in (24000, 48000, 96000):
        exact, found = (
            getattr(simulated(tables, rate=rate, scheme=name), field)[1:] for name in ("complex-modes", "exact-hold")
        )
        errors.append(np.sqrt(((found - exact) ** 2).sum() / (exact**2).sum()))
    assert errors[1] < 3e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("substeps", [1, 2, 8])
def test_touching_strings_are_the_twin_s(substeps: int) -> None:
    """Two polarisations and two strings over points, one of which rides, against `ramp_frames`, which solves with Lemke."""
    drawn = {"shape": "drawn", "position_m": 0.13, "force_n": 2.0, "direction_deg": 30.0}
    first = {"polarisation": DRAWN["polarisation"], "initial": drawn}
    up = {"shape": "triangle", "position_m": 0.6, "displacement_m": 1e-3, "width_m": 0.02}
    second = {"tension_n": 90.0, "place_mm": 10.0, "initial": up}
    scheme = {"substeps": substeps}
    scene = CoupledScene(*read_coupled(case(first, second, scheme=scheme)))
    places = [Place(0, 0.1), Place(0, 0.16), Place(2, 0.64, True)]
    heights = scene.system.displacement_rows(places) @ scene.initial() - 2e-6
    under = {"positions_m": [0.1, 0.16], "heights_m": heights[:2]}
    rider = {"positions_m": [0.64], "heights_m": heights[2:], "rides": True}
    tables = case(first | {"obstacle": under}, second | {"obstacle": rider}, scheme=scheme, ledger=True)
    scene = CoupledScene(*read_coupled(tables))
    player = CoupledPlayer(scene)
    residual = np.zeros((3, 3))
    residual[:2, :2] = residual_compliance(scene.strings[0], [0.1, 0.16], 30)
    residual[2, 2] = residual_compliance(scene.strings[1], [0.64], 30)[0, 0]
    twin = RampFrames(scene.system, scene.frame_s, substeps, places, heights, residual, KEPT_BY_THE_REST)
    state, touched = twin.start(scene.initial()), 0
    size = np.sqrt(2.0 * scene.system.energy(scene.initial()))
    for _ in range(48):
        player.advance(1)
        state, frame = twin.advance(state)
        touched += bool(frame.force.any())
        assert np.sqrt(2.0 * scene.system.energy(player.x - state.x)) < 1e-9 * size
        assert player.t.now[:5].sum() == pytest.approx(twin.energy(state), rel=1e-9)
    assert touched > 20


@pytest.mark.slow
def test_contacts_err_by_their_own_step_alone() -> None:
    """At the reference's step the bridge moves eight times less often, and nothing shows of it."""
    [(_, _, errors)] = accuracy(ON_THE_BRIDGE, 0.05, (192_000,), (8,))
    assert max(errors) < 3e-4
    [(_, _, coarse)] = accuracy(ON_THE_BRIDGE, 0.05, (48_000,), (1,))
    assert coarse[0] < 0.006


def test_ledger_of_random_instruments() -> None:
    """Bends, frets, re-plucks, moving and riding obstacles, light bodies: no step gains, all is accounted for."""
    kinds = {"bend": 0, "fret": 0, "finger": 0, "rides": 0, "motion": 0}
    touched = 0
    for seed in range(30):
        tables = random_case(seed, most_strings=8)
        result = simulated(tables)
        assert judged(result).faults == (), seed
        touched += result.summary["contact_steps"]
        for string in tables["string"]:
            for key in ("bend", "fret", "finger"):
                kinds[key] += key in string
            kinds["rides"] += string.get("obstacle", {}).get("rides", False)
            kinds["motion"] += "motion" in string.get("obstacle", {})
    assert touched > 10_000
    assert min(kinds.values()) > 5, kinds


def test_body_takes_its_share() -> None:
    """All that a lossless string loses the body has, or has lost."""
    lossless = {"viscoelastic_loss": 0.0, "air_viscosity": 0.0, "initial": DRAWN["initial"] | {"direction_deg": 0.0}}
    result = simulated(case(lossless, ledger=True, duration_s=0.1))
    assert result.energy is not None
    energy = dict(zip(ENERGIES, result.energy.T, strict=True))
    assert abs(energy["lost_strings"][-1]) < 1e-12 * result.summary["initial_energy_j"]
    gone = energy["strings"][0] + energy["springs"][0] - energy["strings"] - energy["springs"]
    body = energy["body"] - energy["body"][0] + energy["left_out"] + energy["lost_left_out"] + energy["lost_body"]
    np.testing.assert_allclose(body, gone, atol=1e-12 * energy["strings"][0])
    assert energy["lost_body"][-1] > 0.01 * energy["strings"][0]
    assert result.summary["body_loss_j"] == energy["lost_body"][-1]


def test_a_far_end_that_is_raised_leaves_a_straight_string() -> None:
    """Stopped where it is, and the stop raised slowly: the work is what the string drawn aslant holds, and its losses."""
    height, damped = 1e-3, {"air_viscosity": 1.0, "outputs_m": [0.2, 0.4, 0.6]}
    fret = {"start_s": 0.001, "position_m": 0.1, "height_m": height, "ramp_s": 0.1}
    heavy = {"mode": [{"frequency_hz": 102.0, "q": 25.0, "mass_kg": 1e3}]}
    result = simulated(case(damped | {"fret": [fret]}, duration_s=0.3, ledger=True) | {"body": heavy})
    np.testing.assert_allclose(result.u[-1], height * (1.0 - (np.array([0.2, 0.4, 0.6]) - 0.1) / 0.55), rtol=1e-3)
    assert result.energy is not None
    energy = dict(zip(ENERGIES, result.energy[-1], strict=True))
    assert energy["springs"] == pytest.approx(0.5 * 70.0 / 0.55 * height**2, rel=1e-4)
    assert energy["work_fret"] == pytest.approx(energy["springs"] + energy["lost_strings"] + energy["strings"], rel=1e-3)
    assert judged(result).faults == ()


def test_an_obstacle_that_stands_above_the_string_rises_slowly() -> None:
    """A string that begins inside is lifted by whoever raises the obstacle; no step gains more than that work."""
    result = simulated(case({"obstacle": {"positions_m": [0.3], "heights_m": [5e-4]}}, ledger=True, output_rate_hz=48000.0))
    assert result.summary["begun_inside_m"] == pytest.approx(5e-4)
    assert result.u_contact[10, 0] == pytest.approx(1e-4, rel=1e-6)  # 10 µm a step
    assert result.u_contact[60:, 0].min() > 5e-4 - 1e-9
    assert judged(result).faults == ()
    assert result.energy is not None and result.energy[-1, ENERGIES.index("work_obstacle")] > 0.0


def test_results_are_read_as_they_were_written(tmp_path: Path) -> None:
    result = simulated(case(DRAWN | {"obstacle": {"positions_m": [0.3], "heights_m": -1e-3}}, ledger=True))
    result.save(tmp_path / "run.npz")
    again = load_coupled_result(tmp_path / "run.npz")
    for name in ("t", "u", "u_contact", "contact_force", "bridge", "bridge_force", "radiated", "energy", "final"):
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    assert again.metadata == result.metadata and again.largest_energy_rise == result.largest_energy_rise
    result.save(tmp_path / "run.csv")
    header = (tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()[0]
    for name in ("u(1, 0.1 m) [m]", "bridge(normal) [m]", "bridge_force(rocking) [N m]", "energy(lost_body) [J]"):
        assert name in header
    with pytest.raises(ResultError, match="load_coupled_result"):
        load_result(tmp_path / "run.npz")
    synth.simulate("ideal-bridge", duration=0.001).save(tmp_path / "one.npz")
    with pytest.raises(ResultError, match="not a result of strings on a body"):
        load_coupled_result(tmp_path / "one.npz")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda c: c["string"][0].pop("length_m"), "string.0.length_m: "),
        (lambda c: c["string"][0].update(lenght=1.0), "string.0.lenght: no such key"),
        (lambda c: c.update(body={"mode": []}), "body.mode: must have at least one mode"),
        (lambda c: c["body"]["mode"][0].update(shape=[0.0]), "body.mode.0"),
        (lambda c: c["string"][0].update(initial={"shape": "drawn", "position_m": 0.1}), "needs force_n"),
        (lambda c: c["string"][0].update(initial={"shape": "drawn", "position_m": 1.0, "force_n": 1.0}), "got 1; count it"),
        (lambda c: c["string"][0].update(initial={"shape": "rest", "direction_deg": 5.0}), "needs a second direction"),
        (lambda c: c["string"][0].update(outputs_m=[0.7]), "outputs_m: must lie from 0 to the string's 0.65 m, got 0.7"),
        (lambda c: c["string"][0].update(fret=[{"start_s": 0.0, "position_m": 0.649}]), "must lie below 0.637 m"),
        (lambda c: c["string"][0].update(obstacle={"wall": {"from_m": 0.1, "to_m": 0.2, "height_m": 0.0}}), "one string"),
        (lambda c: c["string"][0].update(obstacle={"positions_m": [0.7], "heights_m": 0.0}), "string.0.obstacle: "),
        (lambda c: c["string"][0].update(bend=[{"duration_s": 0.01, "cents": -30000.0}]), "leave no tension"),
        (lambda c: c["scheme"].update(substeps=3), "scheme.substeps"),
        (lambda c: c["string"].append(c["string"][0] | {"name": "1"}), "'1' is the name of two strings"),
        (
            lambda c: c["string"][0].update(
                fret=[{"start_s": 0.001, "position_m": 0.2}],
                finger=[{"start_s": 0.01, "position_m": 0.1, "displacement_m": 1e-3, "draw_s": 0.01}],
            ),
            "string.0.finger: position_m must lie between 0.2 and 0.65 m",
        ),
        (
            lambda c: c["string"][0].update(
                fret=[{"start_s": 0.015, "position_m": 0.2}],
                finger=[{"start_s": 0.01, "position_m": 0.3, "displacement_m": 1e-3, "draw_s": 0.01}],
            ),
            "string.0.fret: the string changes its length at 0.015 s under a finger",
        ),
        (lambda c: c["scheme"].update(name="moreau-jean"), "scheme.name"),
        (lambda c: c["run"].update(output_rate_hz=44100.0), "whole multiple of output_rate_hz"),
        (lambda c: c["run"].update(duration_s=1e8), "the limit is"),
    ],
)
def test_what_is_wrong_is_named(change: Any, said: str) -> None:
    tables = json.loads(json.dumps(case({})))
    change(tables)
    with pytest.raises(CaseError) as caught:
        synth.simulate(tables)
    assert said in str(caught.value), str(caught.value)


@pytest.mark.parametrize(
    ("more", "run", "said"),
    [
        ({"obstacle": {"positions_m": [0.5], "heights_m": [-1e-5]}}, {}, "reaches its obstacle at 0.5 m after 0.00"),
        ({"finger": [{"position_m": 0.1, "displacement_m": 1e-3, "draw_s": 0.01}]}, {}, "string.0.finger: no hand may act"),
        ({"bend": [{"duration_s": 0.01, "cents": 10.0}]}, {}, "string.0.bend: no hand may act"),
        ({"fret": [{"start_s": 0.01, "position_m": 0.1}]}, {}, "string.0.fret: no hand may act"),
        ({}, {"ledger": True}, "run.ledger: complex modes"),
        ({}, {"modes": 4000}, "unknowns would take many minutes"),
    ],
)
def test_complex_modes_refuse_what_they_cannot(more: dict[str, Any], run: dict[str, Any], said: str) -> None:
    with pytest.raises(CaseError, match=said):
        simulated(case(DRAWN | more, scheme={"name": "complex-modes"}, **run))


def test_what_is_of_one_string_is_refused() -> None:
    with pytest.raises(CaseError, match="quality: "):
        synth.simulate(case({}), quality="fine")
    with pytest.raises(CaseError, match="resume_from: "):
        synth.simulate(case({}), resume_from="run.npz")
    with pytest.raises(CaseError, match="read_coupled"):
        synth.load_case(case({}))
    with pytest.raises(CaseError, match="unknown contact scheme 'complex-modes'"):
        synth.simulate("ideal-bridge", scheme="complex-modes", duration=0.001)


def test_the_case_that_comes_with_the_program_runs() -> None:
    result = simulated(read_coupled("guitar-pair")[0].model_dump(exclude_unset=True), duration=0.05, ledger=True)
    assert judged(result).faults == ()
    assert result.summary["contact_steps"] > 0 and result.summary["held_frames"] == 0
    assert repr(result).startswith("<CoupledResult: exact-hold, 0 to 0.05 s")


def test_studies_use_what_they_say() -> None:
    tables = touching_case(ON_THE_BRIDGE, 48_000, 2, 0.01)
    assert [string.get("obstacle", {}).get("rides") for string in tables["string"]] == [True, True, None]
