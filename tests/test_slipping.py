"""A string that slides off a finger (`slip_s`): its motion in closed form, its ledger, resumed runs, the engine's stroke."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import synth
from synth.engine import layout
from synth.midi.events import NOTE_ON
from synth.research.case import Case, CaseError
from synth.research.coupled.coupled_case import read_coupled
from synth.research.coupled.coupled_result import CoupledResult
from synth.research.coupled.coupled_run import CoupledPlayer
from synth.research.coupled.coupled_scene import CoupledScene
from synth.research.result import Result
from synth.research.scene import Scene
from synth.solver.coupled_study import ENERGIES
from tests.engine.kit import FORCE, QUANTUM, bank_of, engine, model_of, play, preset, steel, string_of

STRING = {
    "length_m": 0.9, "tension_n": 60.0, "linear_density_kg_m": 1e-3, "diameter_m": 4e-4, "inharmonicity": 2e-5,
    "viscoelastic_loss": 4.5e-3,
}  # fmt: skip
FINGER = {"position_m": 0.63, "displacement_m": 1e-3, "draw_s": 0.005, "hold_s": 0.001, "slip_s": 0.002}
RUN = {"internal_rate_hz": 96e3, "output_rate_hz": 12e3, "modes": 20, "duration_s": 0.012, "outputs_m": [0.1]}
#: two points that the string is drawn on to and falls on to
POINTS = {"positions_m": [0.2, 0.7], "heights_m": [-1e-4, -2e-4]}
LAWS = ("exact-hold", "moreau-jean", "moreau-jean-filtered")


def case(slip_s: float | None = 0.002, **tables: Any) -> dict[str, Any]:
    finger = {key: value for key, value in (FINGER | {"slip_s": slip_s}).items() if value is not None}
    return {"string": STRING, "finger": [finger], "run": RUN} | tables


def simulated(tables: dict[str, Any], **more: Any) -> Result:
    result = synth.simulate(tables, **more)
    assert isinstance(result, Result)
    return result


def state_of_run(result: Result) -> dict[str, np.ndarray]:
    assert result.state is not None
    return result.state


def faded(scene: Scene, q: np.ndarray, v: np.ndarray, force_n: float, slip_s: float) -> np.ndarray:
    """q of the modes after slip_s [s] under ½ force_n (1 + cos(πt/slip_s)), in closed form."""
    push = scene.pluck_weights(scene.fingers[0]) * force_n / scene.string.linear_density_kg_m
    root = -scene.sigma + 1j * np.sqrt(scene.omega**2 - scene.sigma**2)
    turned = np.exp(root * slip_s)
    free = (turned * (v - np.conj(root) * q)).imag / root.imag
    forced = np.zeros(scene.omega.size, complex)
    for share, turn in ((0.5, 0.0), (0.25, np.pi / slip_s), (0.25, -np.pi / slip_s)):
        forced += share * (np.exp(1j * turn * slip_s) - turned) / (1j * turn - root)
    return free + push * forced.imag / root.imag


@pytest.mark.parametrize("scheme", LAWS)
def test_the_string_moves_as_under_a_force_that_fades(scheme: str) -> None:
    """Against the closed form from where the string was, at steps a half and a quarter as long: of the first order."""
    errors = []
    for rate in (96e3, 192e3, 384e3):
        drawn, gone = (simulated(case(), scheme=scheme, rate=rate, duration_s=seconds) for seconds in (0.006, 0.008))
        kept = state_of_run(drawn)
        wanted = faded(Scene(Case.model_validate(case()), Path()), drawn.final_q, drawn.final_v, kept["slip_force"], 0.002)
        assert 0.1 < float(kept["slip_force"]) < 1.0  # N
        assert "hold" not in state_of_run(gone)
        errors.append(np.abs(gone.final_q - wanted).max() / np.abs(wanted).max())
    assert errors[0] < 0.02
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.1)


@pytest.mark.parametrize("scheme", LAWS)
def test_the_force_begins_with_what_the_finger_does(scheme: str) -> None:
    """Drawn slowly, the string is pulled with displacement/compliance; the first step of the slip pulls as hard."""
    unit = 1.0 if scheme == "exact-hold" else 96e3
    pulls = []
    for steps in (576, 577, 672):  # the last of the draw, the first and the middle one of the slip
        run = RUN | {"output_rate_hz": 96e3}
        kept = state_of_run(simulated(case(run=run), scheme=scheme, duration_s=steps / 96e3))
        pulls.append(unit * float(kept["hold"][3]))
        assert float(kept["slip_force"]) == pytest.approx(pulls[0], rel=1e-15)
    assert pulls[1] == pytest.approx(pulls[0], rel=1e-4)
    assert pulls[2] == pytest.approx(0.5 * pulls[0], rel=1e-4)


def test_a_short_slip_is_a_plain_release() -> None:
    plain = simulated(case(None))
    assert np.array_equal(simulated(case(0.0)).u, plain.u)
    assert np.array_equal(simulated(case(0.4 / 96e3)).u, plain.u)  # less than half a step
    run = RUN | {"internal_rate_hz": 384e3}
    plain = simulated(case(None, run=run))
    errors = [np.abs(simulated(case(slip_s, run=run)).final_q - plain.final_q).max() for slip_s in (2e-4, 1e-4, 5e-5)]
    assert errors[0] < 0.2 * np.abs(plain.final_q).max()
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.1)


BEND = [{"start_s": 0.0055, "duration_s": 0.003, "cents": 30.0}]
CASES = {
    **{law: ({"obstacle": POINTS}, {"scheme": law}) for law in LAWS},
    "substeps": ({"obstacle": POINTS}, {"substeps": 2}),
    "one contact": ({"obstacle": {"positions_m": [0.2], "heights_m": [-1e-4]}}, {"substeps": 3}),
    "bent": ({"obstacle": POINTS, "bend": BEND}, {}),
    "over what moves": (
        {"obstacle": POINTS | {"motion": {"sine": [{"frequency_hz": 50.0, "amplitude_m": 1e-4}]}}},
        {},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_the_ledger_closes_and_runs_go_on_within_a_slip(name: str) -> None:
    tables, more = CASES[name]
    tables = case(**tables)
    whole = simulated(tables, ledger=True, **more)
    total = whole.energy_stored + whole.energy_residual + whole.energy_viscous + whole.energy_contact
    begun = total[0] - whole.energy_injected[0]
    np.testing.assert_allclose(total - begun, whole.energy_injected, rtol=0, atol=1e-11 * total.max())
    assert whole.contact_force.any()
    if not name.startswith("moreau"):
        assert whole.largest_energy_rise <= 1e-12
    # the finger works until it has left, and not from then on
    slips, gone = np.searchsorted(whole.t, (0.006 - 1e-9, 0.008 - 1e-9))
    worked = np.diff(whole.energy_injected[slips : gone + 1])
    assert np.abs(worked).min() > 0.0
    if name in LAWS:
        assert not np.diff(whole.energy_injected[gone:]).any()
    parts: list[Result] = []
    for rows in (36, 36, 12, 12, 48):  # to within the draw, its end, within the slip, its end, the end
        parts.append(
            simulated(tables, ledger=True, duration_s=rows / 12e3, resume_from=parts[-1] if parts else None, **more)
        )
    assert ["slip_force" in state_of_run(part) for part in parts] == [False, True, True, False, False]
    for column in ("u", "u_contact", "contact_force", "energy_stored", "energy_injected", "energy_viscous"):
        together = np.concatenate([getattr(parts[0], column), *(getattr(part, column)[1:] for part in parts[1:])])
        assert np.array_equal(together, getattr(whole, column)), column
    assert np.array_equal(parts[-1].final_q, whole.final_q) and np.array_equal(parts[-1].final_v, whole.final_v)


def test_a_run_of_before_there_were_slips_goes_on() -> None:
    first = simulated(case(0.0), duration_s=0.003)
    metadata = json.loads(json.dumps(first.metadata))
    for finger in metadata["case"]["finger"]:
        del finger["slip_s"]
    earlier = Result(**{f.name: getattr(first, f.name) for f in fields(Result)} | {"metadata": metadata})
    later, same = (simulated(case(0.0), resume_from=each, duration_s=0.006) for each in (earlier, first))
    assert np.array_equal(later.u, same.u)
    with pytest.raises(CaseError, match=r"resume_from: finger was .* there"):
        simulated(case(0.001), resume_from=earlier, duration_s=0.006)


def test_a_state_without_its_force_is_refused() -> None:
    first = simulated(case(), duration_s=0.007)
    state = {key: value for key, value in state_of_run(first).items() if key != "slip_force"}
    with pytest.raises(CaseError, match=r"state\.slip_force is missing"):
        simulated(case(), resume_from=replace(first, state=state))


@pytest.mark.parametrize("slip_s", [-1e-3, 1.5, float("nan"), "1"])
def test_slips_that_are_none(slip_s: Any) -> None:
    with pytest.raises(CaseError, match=r"finger\.0\.slip_s"):
        simulated(case(slip_s))


def test_the_next_finger_waits_for_the_slip() -> None:
    early = {"position_m": 0.6, "displacement_m": 1e-3, "draw_s": 0.002, "start_s": 0.007}
    tables = case()
    with pytest.raises(CaseError, match="finger: one must let go before the next takes hold"):
        simulated(tables | {"finger": [*tables["finger"], early]})
    assert simulated(tables | {"finger": [*tables["finger"], early | {"start_s": 0.008}]}).summary["finite"]


# --- on a body ---


def on_a_body(mass_kg: float, shape: float, *, finger: dict[str, Any] | None = None, **string: Any) -> dict[str, Any]:
    mode = {"frequency_hz": 150.0, "q": 25.0, "mass_kg": mass_kg, "shape": [shape]}
    table = STRING | {"outputs_m": [0.1], "finger": [FINGER if finger is None else finger]} | string
    run = {key: value for key, value in RUN.items() if key != "outputs_m"}
    return {"string": [table], "body": {"mode": [mode]}, "run": run}


def test_on_a_body_that_hardly_moves_it_is_the_slip_of_one_string() -> None:
    alone, coupled = simulated(case()), synth.simulate(on_a_body(1e3, 1e-3))
    assert np.abs(coupled.u - alone.u).max() < 1e-6 * np.abs(alone.u).max()


def test_on_a_body_both_directions_fade_and_the_ledger_closes() -> None:
    slanted = on_a_body(
        0.2, 1.0, finger=FINGER | {"direction_deg": 30.0}, obstacle=POINTS, polarisation={"detuning_cents": 0.5}
    )
    player = CoupledPlayer(CoupledScene(*read_coupled(slanted)))
    player._events()[0][1]()
    player.advance(576)
    fingers = [state.finger[0] for state in player.lines.states]
    before = [float(finger["push"]) for finger in fingers]
    assert before[1] == pytest.approx(before[0] * np.tan(np.pi / 6.0), rel=0.05)
    player.slide_off(0, 768)
    for frames, share in ((1, 1.0), (95, 0.5), (96, 0.0)):
        player.advance(frames)
        for finger, force in zip(fingers, before, strict=True):
            assert float(finger["push"]) == pytest.approx(share * force, abs=1e-4 * abs(force))
    slanted["run"]["ledger"] = True
    result = synth.simulate(slanted)
    assert isinstance(result, CoupledResult)
    assert result.energy is not None and result.contact_force.any()
    kinds = dict(zip(ENERGIES, result.energy.T, strict=True))
    work = sum(part for name, part in kinds.items() if name.startswith("work_"))
    rest = sum(part for name, part in kinds.items() if not name.startswith("work_"))
    assert isinstance(rest, np.ndarray)
    np.testing.assert_allclose(rest - rest[0], work, rtol=0, atol=1e-9 * np.abs(rest).max())
    assert result.largest_energy_rise <= 1e-12


def test_a_draw_of_less_than_a_frame_lets_go() -> None:
    short = {"position_m": 0.63, "displacement_m": 1e-3, "draw_s": 1e-6}
    coupled, alone = synth.simulate(on_a_body(1e3, 1e-3, finger=short)), simulated(case() | {"finger": [short]})
    assert np.abs(coupled.u - alone.u).max() < 1e-6 * np.abs(alone.u).max()


# --- the engine ---


def test_the_engine_s_stroke_is_that_of_a_case(tmp_path: Path) -> None:
    """One stroke, drawn and slid off, by the engine and as a case of the same modes."""
    made = engine(preset("one", steel("G2"), output=FORCE, pluck="draw_ms = 5\nslip_ms = 2"), internal_rate_hz=88200.0)
    play(made, [(0, NOTE_ON, 0, 43, 90)], QUANTUM, QUANTUM)
    while made._sounding.hands["phase"][0] == layout.NO_FINGER:
        play(made, [], QUANTUM, QUANTUM)
    sounding, model, string = made._sounding, model_of(made, 0), string_of(made, 0)
    hand, way = sounding.hands[0], sounding.strokes[0]
    fixed = bank_of(made).models[hand["model"]]
    assert hand["phase"] == layout.DRAW
    n, rate = int(model.modes), 88200.0
    p11, p12, p21, p22 = model.rows[:4, :n]
    sigma = -0.5 * np.log(p11 * p22 - p12 * p21) * rate
    np.savez(tmp_path / "modes.npz", f=model.omega[:n] / (2.0 * np.pi), sig=sigma)
    finger, steps = string.finger[0], int(way["finger_step"])
    table = {
        "length_m": float(fixed["length"]), "tension_n": float(fixed["tension"]), "linear_density_kg_m": model.mu,
        "diameter_m": 4e-4, "measured": {"file": str(tmp_path / "modes.npz")},
    }  # fmt: skip
    stroke = {
        "position_m": 0.7 * float(fixed["length"]), "width_m": 0.01, "displacement_m": float(way["finger_to"]),
        "draw_s": int(way["finger_steps"]) / rate, "slip_s": 2 * round(0.002 * 44100.0) / rate,
        "stiffness_n_m": float(finger["stiffness"]), "resistance_n_s_m": float(finger["resistance"]),
    }  # fmt: skip
    run = {"internal_rate_hz": rate, "modes": n, "outputs_m": [0.1]}
    weights, most = string.grip.weights[:n].copy(), int(way["finger_steps"]) + 600
    phases = set()
    while steps < most:
        play(made, [], QUANTUM, QUANTUM)
        steps += 2 * QUANTUM
        phases.add(int(hand["phase"]))
        found = simulated({"string": table, "finger": [stroke], "run": run | {"duration_s": steps / rate}})
        rounding = 1e-9 if hand["phase"] != layout.NO_FINGER else 1e-5  # the engine drops modes that nobody hears
        assert np.abs(found.final_q - string.q[:n]).max() < rounding * np.abs(string.q[:n]).max()
        assert np.abs(found.final_v - string.v[:n]).max() < rounding * np.abs(string.v[:n]).max()
    scene = Scene(Case.model_validate({"string": table, "finger": [stroke], "run": run | {"duration_s": 0.01}}), Path())
    np.testing.assert_allclose(scene.pluck_weights(scene.fingers[0]), weights, rtol=1e-9, atol=1e-12)
    assert {layout.DRAW, layout.SLIP, layout.NO_FINGER} <= phases
