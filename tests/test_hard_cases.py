"""Cases that break collision solvers, by file (presets/cases/hard), and what has to hold in each of them.

Tolerances. 1e-12 of the energy that the run has had, for a ledger that is a sum of some 1e5 roundings of 1e-16 each;
1e-12 m, or less, for a penetration: heights of 1e-3 m have an ulp of 2e-19 m, and forces a rounding of 1e-13 at the worst.
"""

from __future__ import annotations

import json
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from synth import EVENT, Engine, cli, load_preset
from synth.dsp.measures import relative_error
from synth.midi.events import NOTE_ON
from synth.physics.modes import residual_compliance, static_compliance
from synth.physics.tuning import tuned
from synth.research.case import case_names
from synth.research.simulation import Case, CaseError, Scene, case_folder, load_case, simulate
from synth.solver import driver, study
from synth.solver.schemes import PASSIVE_TO, energy_warning, safe_rate_hz
from tests.oracles.steps import exact_hold_step, moreau_jean_step

HARD = [name for name in case_names() if name.startswith("hard/")]
SMALLEST = np.finfo(float).tiny


def scene_of(case) -> Scene:
    return Scene(load_case(case) if isinstance(case, str) else Case.model_validate(case), case_folder())


@cache
def ran(name):
    """A case just as its file says; several tests look at the same run."""
    return simulate(name)


def with_tables(name, **tables):
    """A case's tables with some replaced, for `simulate`."""
    return with_tables_of(load_case(name).model_dump(exclude_none=True), **tables)


def with_tables_of(case, **tables):
    for key, table in tables.items():
        case[key] = {**case[key], **table} if isinstance(table, dict) else table
    return case


def had(result):
    """Energy at the start and brought in since [J], by row."""
    start = result.energy_stored[0] + result.energy_residual[0]
    return start + np.maximum.accumulate(np.maximum(result.energy_injected, 0.0))


def account(result):
    """Energy that the ledger cannot place [J], by row."""
    total = result.energy_stored + result.energy_residual + result.energy_viscous + result.energy_contact
    return total - total[0] - result.energy_injected


def must_hold(result):
    """What has to hold of exact-hold in any scene whatever."""
    scale = had(result)[-1]
    assert result.summary["finite"] and result.summary["unsolved_steps"] == 0
    for name in ("u", "u_contact", "contact_force", "energy_stored", "energy_viscous", "energy_contact"):
        values = getattr(result, name)
        assert np.all(np.isfinite(values))
        assert not np.any((values != 0.0) & (np.abs(values) < SMALLEST)), f"subnormal numbers in {name}"
    assert result.largest_penetration_m <= 1e-12
    assert np.all(result.contact_force >= 0.0)
    # passive: no step leaves more than it found and was given; damping and contact only ever take
    assert result.largest_energy_rise <= 1e-12
    assert np.diff(result.energy_viscous).min() >= -1e-12 * scale
    assert np.diff(result.energy_contact).min() >= -1e-12 * scale
    np.testing.assert_allclose(account(result), 0.0, rtol=0, atol=1e-12 * scale)


def pitch_hz(u, rate, least, most):
    """Frequency of the highest spectral peak between two bounds, by a parabola through its logarithm (Hann window)."""
    spectrum = np.abs(np.fft.rfft(u * np.hanning(u.size), 4 * u.size))
    hz = np.fft.rfftfreq(4 * u.size, 1.0 / rate)
    k = int(np.argmax(np.where((hz > least) & (hz < most), spectrum, 0.0)))
    a, b, c = np.log(spectrum[k - 1 : k + 2])
    return float(hz[k] + 0.5 * (a - c) / (a - 2.0 * b + c) * hz[1])


# --- every case ---------------------------------------------------------------------------------------------------------

#: steps with contact that a case must have at least, so that it is the case that it says it is
TOUCHES = {"critically-damped": 4000, "five-minutes": 10, "fretless": 3, "omega-dt": 50, "pressed-in": 5000}


@pytest.mark.parametrize("name", [name for name in HARD if name != "hard/restitution"])
def test_what_holds_in_every_case(name):
    result = ran(name)
    assert result.metadata["scheme"] == "exact-hold"
    must_hold(result)
    assert result.summary["contact_steps"] >= TOUCHES.get(name.removeprefix("hard/"), 90)


def test_cases_are_found_by_name(tmp_path, capsys):
    assert len(HARD) >= 20 and case_names()[:2] == ["bass", "cabannes"]
    assert load_case("hard/two-close").obstacle.positions_m == [0.006, 0.0061]
    with pytest.raises(CaseError, match=r"not one of bass, cabannes, .*hard/two-close"):
        load_case("hard/three-close")
    arguments = ["simulate", "hard/two-close", "-o", str(tmp_path / "out.npz"), "--duration", "0.01", "--json"]
    assert cli.main(arguments) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["contacts"] == 2 and said.err == ""
    assert (tmp_path / "out.npz").is_file()


# --- what one case promises beyond that ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["tanpura", "bass"])
def test_ten_times_the_pluck(name):
    """The scheme is homogeneous: ten times pluck and heights is ten times the motion. The tanpura's heights are zero."""
    strong = ran(f"hard/{name}-x10")
    case = with_tables(f"hard/{name}-x10")
    case["initial"]["displacement_m"] /= 10.0
    case["obstacle"]["heights_m"] = [height / 10.0 for height in case["obstacle"]["heights_m"]]
    weak = simulate(case)
    np.testing.assert_allclose(weak.u * 10.0, strong.u, rtol=0, atol=1e-9 * np.abs(strong.u).max())
    if name == "bass":
        assert (strong.contact_force > 0.0).sum(axis=1).max() >= 8


def test_all_frets_at_once():
    result = simulate("hard/twenty-frets-at-once", output_rate_hz=88_200)
    assert np.all(result.contact_force[1] > 0.0) and result.contact_force.shape[1] == 20


def test_a_board_with_hundreds_of_contacts():
    result = ran("hard/fretless")
    assert np.all(result.contact_force[1] > 0.0) and result.contact_force.shape[1] == 299


def test_pressed_in_starts_where_it_is_held():
    """From rest on the three points: held by the static forces, it does not move at all."""
    case = with_tables("hard/pressed-in", initial={"shape": "rest"})
    for key in ("position_m", "displacement_m", "rounding_half_width_m"):
        case["initial"].pop(key)
    result = simulate(case)
    must_hold(result)
    np.testing.assert_allclose(result.u_contact[:, 1], 2e-3, rtol=0, atol=1e-15)
    assert result.summary["lifted_m"] == pytest.approx(2e-3, rel=1e-2)  # of the modes; R gives the rest
    assert np.ptp(result.u) <= 1e-12
    moving = ran("hard/pressed-in")
    assert moving.summary["started_from_static_contact"] and np.ptp(moving.u) > 1e-4


def test_two_contacts_that_are_one():
    """0.1 mm apart they act as one: within what a shift of one contact by as much does."""
    pair = ran("hard/two-close")
    alone = [
        simulate(with_tables("hard/two-close", obstacle={"positions_m": [x], "heights_m": [0.0]})) for x in (0.006, 0.0061)
    ]
    shift = relative_error(alone[0].u, alone[1].u)
    assert 0.0 < relative_error(pair.u, alone[1].u) < 2.0 * shift < 0.5
    assert np.all((pair.contact_force > 0.0).any(axis=0)), "both must be touched"


@pytest.mark.parametrize(("name", "every"), [("node-half", 2), ("node-third", 3)])
def test_modes_with_a_node_there_feel_nothing(name, every):
    """Every second or third mode goes on as if there were no obstacle: its state is that of free flight, to rounding."""
    scene = scene_of(f"hard/{name}")
    q, v = scene.initial()
    steps = 4000
    states = []
    for obstacle in (scene.model, scene.model.but(eta=np.full(scene.eta.size, -1.0))):
        state = driver.start_run(obstacle, q, v, np.zeros(scene.eta.size), 1, steps + 1, False, False)
        driver.run(obstacle, state, steps)
        states.append(state.q)
    assert np.abs(states[0] - states[1]).max() > 1e-5
    nodal = slice(every - 1, None, every)
    # sin(jπ/2) and sin(jπ/3) at their zeros are 1e-13, not 0
    np.testing.assert_allclose(states[0][nodal], states[1][nodal], rtol=0, atol=1e-13 * np.abs(q).max())


@pytest.mark.parametrize("product", [0.01, 0.1, 1.0, 10.0, 100.0, 1000.0])
def test_any_step_for_any_mode(product):
    """One mode that makes ωΔt = 0.01 … 1000, and 40 modes whose highest does."""
    for modes in (1, 40):
        case = with_tables("hard/omega-dt", obstacle={"positions_m": [0.3, 0.31], "heights_m": -0.3e-3})
        case["run"]["modes"] = modes
        rate = float(scene_of(case).omega[-1]) / product
        # two periods of the first mode, or 1000 steps
        case["run"] |= {"internal_rate_hz": rate, "duration_s": max(0.0102, 1000 / rate), "outputs_m": [0.3]}
        result = simulate(case)
        must_hold(result)
        assert result.summary["contact_steps"] > 0
    full = scene_of("hard/omega-dt")
    assert full.omega[0] * full.dt < 0.25 and full.omega[-1] * full.dt > 1000.0


def test_overdamped_and_critical_modes_are_what_they_say():
    damping = {name: scene_of(f"hard/{name}") for name in ("overdamped", "critically-damped")}
    ratio = damping["overdamped"].sigma / damping["overdamped"].omega
    assert ratio[0] < 0.01 and ratio[-1] > 10.0
    ratio = damping["critically-damped"].sigma / damping["critically-damped"].omega
    np.testing.assert_allclose(ratio, 1.0, rtol=0, atol=5e-16)
    # pressed in from below, it creeps up to the static shape and stays
    result = ran("hard/critically-damped")
    string = damping["critically-damped"].string
    expected = 0.4e-3 / float(static_compliance(string, 0.3, 0.3))
    assert result.contact_force[-1, 0] == pytest.approx(expected, rel=1e-6)


def test_a_minute_without_any_loss():
    """Only contact takes energy: between touches it stays what it is, but for an ulp in each of 331 000 steps at most.

    Lumped modes would take some: they are damped on any string.
    """
    result = simulate("hard/undamped-minute", tail="static")
    energy = result.energy_stored + result.energy_residual
    scale = energy[0]
    rounding = result.summary["steps"] * np.finfo(float).eps * scale
    np.testing.assert_allclose(result.energy_viscous, 0.0, rtol=0, atol=rounding)
    assert energy[-1] < 0.6 * scale and np.diff(energy).max() <= 50 * np.finfo(float).eps * scale
    # a row that ends in contact leaves R's spring to be let go after it
    untouched = ~np.any(result.contact_force[1:] > 0.0, axis=1) & (result.energy_residual[:-1] == 0.0)
    assert untouched.sum() > 100
    np.testing.assert_allclose(np.diff(energy)[untouched], 0.0, rtol=0, atol=50 * np.finfo(float).eps * scale)
    # and it still sounds at the end
    assert np.abs(result.u[-500:]).max() > 0.2 * np.abs(result.u[:500]).max()


def test_five_minutes_of_decay():
    """Through the whole range of numbers and out of it: no subnormals on the way (`must_hold`), every row no louder."""
    result = ran("hard/five-minutes")
    energy = result.energy_stored + result.energy_residual
    assert np.all(np.diff(energy) <= 0.0)
    at_a_minute, half = int(np.searchsorted(result.t, 60.0)), int(np.searchsorted(result.t, 150.0))
    assert 0.0 < energy[at_a_minute] < 1e-250 and energy[-1] == 0.0
    sigma = float(scene_of("hard/five-minutes").sigma[0])
    slope = np.polyfit(result.t[200:at_a_minute], np.log(energy[200:at_a_minute]), 1)[0]
    assert slope == pytest.approx(-2.0 * sigma, rel=1e-3)
    assert np.abs(result.u[half:]).max() < 1e-300


def test_a_note_that_fades_for_five_minutes_is_ever_less_work():
    """The engine's own count of work, mode-steps, in each ten seconds of a tanpura note: never more than in those before."""
    engine = Engine([load_preset("tanpura-light")], quality="draft")
    engine.prepare(44100.0, 4410)
    events = np.zeros(1, EVENT)
    events["kind"], events["a"], events["b"] = NOTE_ON, 36, 100
    out = np.zeros((4410, 2))
    work, loudest = [], []
    for _ in range(30):
        before, peak = engine.mode_steps, 0.0
        for _ in range(100):
            engine.process(events, out)
            events = np.zeros(0, EVENT)
            assert np.all(np.isfinite(out)) and not np.any((out != 0.0) & (np.abs(out) < SMALLEST))
            peak = max(peak, float(np.abs(out).max()))
        work.append(engine.mode_steps - before)
        loudest.append(peak)
    assert work[0] > 0 and np.all(np.diff(work) <= 0) and work[-1] < 0.05 * work[0]
    assert loudest[0] > 1e-3 and np.all(np.diff(loudest) <= 1e-6)  # where it falls asleep a resonance may move by -130 dB


def test_extreme_notes_sound_at_their_pitch():
    """Contact raises it by some cents: within a quarter tone above, five cents below."""
    for name, note_hz in (("lowest-bass", 30.87), ("highest-sitar", 698.5)):
        case = with_tables(f"hard/{name}")
        case["run"] |= {"duration_s": 1.0, "output_rate_hz": case["run"]["internal_rate_hz"] / 4, "ledger": False}
        result = simulate(case)
        rate = case["run"]["output_rate_hz"]
        cents = 1200.0 * np.log2(pitch_hz(result.u[round(0.2 * rate) :, 0], rate, 0.8 * note_hz, 1.25 * note_hz) / note_hz)
        assert -5.0 < cents < 50.0, (name, cents)


def test_four_megahertz_and_forty_four_kilohertz_agree():
    """1001 modes: at 44.1 kHz and at 4 MHz the same motion, to the first-order error of the step (0.013 over 0.1 s)."""
    fine = simulate(with_tables("hard/four-megahertz"), internal_rate_hz=44_100 * 90, output_rate_hz=44_100)
    coarse = simulate("hard/many-modes", duration_s=0.005)
    assert relative_error(coarse.u[: fine.u.shape[0]], fine.u[: coarse.u.shape[0]]) < 0.02


@pytest.mark.parametrize(
    ("name", "spans"), [("repluck", [(0.01, 0.03), (0.04, 0.055)]), ("bend", [(0.02, 0.12), (0.16, 0.19)])]
)
def test_fingers_and_bends_come_during_contact(name, spans):
    """There is contact while each of them lasts, and each brings or takes energy then; before the first none comes."""
    result = ran(f"hard/{name}")
    touched = np.any(result.contact_force > 0.0, axis=1)
    for begin, end in spans:
        during = (result.t > begin) & (result.t <= end)
        assert touched[during].sum() > 10
        assert np.ptp(result.energy_injected[during]) > 0.01 * result.energy_stored[0]
    assert not np.any(result.energy_injected[result.t < spans[0][0] - 1e-3])
    still = result.energy_injected[result.t > spans[-1][1] + 1e-3]
    assert np.ptp(still) == 0.0


# --- moving obstacles ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["moving-ramp", "moving-sine"])
def test_the_obstacles_work_is_force_times_way(name):
    """Injected = Σ λ·Δη over the steps, from the forces and displacements that come out; and it does work."""
    result = simulate(name := f"hard/{name}", output_rate_hz=load_case(name).run.internal_rate_hz)
    work = np.cumsum((result.contact_force[1:] * np.diff(result.obstacle_displacement)[:, None]).sum(axis=1))
    np.testing.assert_allclose(result.energy_injected[1:], work, rtol=0, atol=1e-12 * np.abs(work).max())
    assert np.abs(work).max() > 1e-5
    heights = result.contact_heights + result.obstacle_displacement[:, None]
    assert np.max(heights - result.u_contact) <= 1e-12
    # complementary: where there is a force, the gap is closed
    closed = result.contact_force > 0.0
    np.testing.assert_allclose(result.u_contact[closed], heights[closed], rtol=0, atol=1e-12)
    assert closed.any() and not closed.all()
    # without the ledger the same motion
    plain = simulate(name, output_rate_hz=load_case(name).run.internal_rate_hz, ledger=False)
    np.testing.assert_array_equal(plain.u, result.u)


def lifted(**run):
    """A damped string at rest on a point that rises by 1 mm in 0.2 s and waits."""
    case = with_tables(
        "hard/moving-ramp",
        initial={"shape": "rest"},
        obstacle={
            "positions_m": [0.3],
            "heights_m": [0.0],
            "motion": {"ramp": [{"duration_s": 0.2, "displacement_m": 1e-3}]},
        },
    )
    for key in ("position_m", "displacement_m", "rounding_half_width_m"):
        case["initial"].pop(key)
    case["string"]["thermoelastic_q_inverse"] = 0.05
    case["run"] |= {"duration_s": 0.5, **run}
    return case


@pytest.mark.parametrize("modes", [3, 103])
def test_a_slow_lift_costs_the_elastic_energy(modes):
    """Force h/G(x, x) and work ½h²/G by the closed Green function, whatever the modes kept; the lift is 40 periods long."""
    case = lifted(modes=modes)
    result = simulate(case)
    must_hold(result)
    force = 1e-3 / float(static_compliance(scene_of(case).string, 0.3, 0.3))
    assert result.contact_force[-1, 0] == pytest.approx(force, rel=1e-6)
    assert result.energy_stored[-1] + result.energy_residual[-1] == pytest.approx(0.5 * force * 1e-3, rel=1e-6)
    assert result.energy_injected[-1] == pytest.approx(0.5 * force * 1e-3, rel=0.01)


def test_an_obstacle_that_does_not_move():
    """A motion of zero is no motion: bit for bit where both are taken step by step, to rounding against blocks."""
    still = {"motion": {"sine": [{"frequency_hz": 100.0, "amplitude_m": 0.0}]}}
    for ledger in (False, True):
        moved = simulate(with_tables("hard/two-close", obstacle=still), duration_s=0.02, ledger=ledger)
        fixed = simulate("hard/two-close", duration_s=0.02, ledger=ledger)
        for name in ("u", "contact_force"):
            expected = getattr(fixed, name)
            atol = 0.0 if ledger else 1e-10 * np.abs(expected).max()
            np.testing.assert_allclose(getattr(moved, name), expected, rtol=0, atol=atol)


@pytest.mark.parametrize("scheme", ["exact-hold", "moreau-jean", "moreau-jean-filtered"])
@pytest.mark.parametrize("restitution", [0.0, 0.7])
def test_the_driver_steps_as_the_twin_does(scheme, restitution):
    """Three points right under a drawn string of 15 modes, rising and falling at random: the same motion for 60 steps."""
    points = [0.3, 0.32, 0.5]
    case = with_tables("hard/moving-ramp", obstacle={"positions_m": points, "heights_m": 0.0})
    case["run"] |= {"modes": 15, "internal_rate_hz": 20e3, "output_rate_hz": 20e3}
    start = scene_of(with_tables_of(case, scheme={"tail": "static"}))
    case["obstacle"]["heights_m"] = list(start.shapes @ start.initial()[0] - 5e-5)
    scene = scene_of(with_tables_of(case, scheme={"name": scheme, "restitution": restitution}))
    model, string, dt = scene.model, scene.string, scene.dt
    rng = np.random.default_rng(7)
    path = np.cumsum(np.concatenate([[0.0], rng.normal(size=60) * 2e-5]))
    q, v = scene.initial()
    touched = 0
    state = driver.start_run(model, q, v, np.zeros(3), 1, 61, False, True)
    risen = 0.0
    for before, after in pairwise(path):
        common = (model.modes.omega, model.modes.sigma, string.linear_density_kg_m, dt, model.under.shapes)
        if scheme == "exact-hold":
            step = exact_hold_step(*common, model.under.eta + after, model.under.residual, q, v)
        else:
            moves = (risen / dt, (after - before) / dt)
            filtered = scheme == "moreau-jean-filtered"
            step = moreau_jean_step(*common, model.under.eta + before, restitution, filtered, q, v, obstacle=moves)
        driver.run(model, state, 1, heights=np.array([before, after]))
        np.testing.assert_allclose(state.q, step.q, rtol=0, atol=1e-11 * np.abs(q).max())
        np.testing.assert_allclose(state.v, step.v, rtol=0, atol=1e-11 * np.abs(v).max() + 1e-15)
        touched += np.count_nonzero(step.contact)
        q, v, risen = step.q, step.v, after - before
    assert touched > 10


RISING = {"motion": {"ramp": [{"duration_s": 0.01, "displacement_m": 1.5e-3}], "sine": []}}


@pytest.mark.parametrize("scheme", ["moreau-jean", "moreau-jean-filtered"])
def test_moreau_jean_over_a_moving_obstacle(scheme):
    """Restitution 0 and 400 modes, most of them: the motion of exact-hold at 6 MHz within 1 %, and no deeper than a step."""
    common = {"modes": 400, "duration_s": 0.012, "output_rate_hz": 48_000.0, "residual_compliance": False}
    case = with_tables("hard/moving-ramp", obstacle=RISING)
    exact = simulate(case, internal_rate_hz=6.144e6, ledger=False, **common)
    fixed = simulate(with_tables("hard/moving-ramp", obstacle={"motion": {}}), internal_rate_hz=768e3, **common)
    assert relative_error(fixed.u, exact.u) > 0.3
    every = {**common, "output_rate_hz": 1.536e6}
    result = simulate(case, scheme=scheme, restitution=0.0, internal_rate_hz=1.536e6, **every)
    assert relative_error(result.u[::32], exact.u) < 0.01
    gap = result.u_contact - result.contact_heights - result.obstacle_displacement[:, None]
    assert result.largest_penetration_m == pytest.approx(-gap.min(), rel=1e-6)
    assert -gap.min() <= np.abs(np.diff(gap, axis=0)).max()
    np.testing.assert_allclose(account(result), 0.0, rtol=0, atol=1e-11 * had(result)[-1])
    assert result.energy_injected[-1] == pytest.approx(exact_work(case, common), rel=0.02)


def exact_work(case, common):
    return simulate(case, internal_rate_hz=1.536e6, **common).energy_injected[-1]


@pytest.mark.parametrize("scheme", ["moreau-jean", "moreau-jean-filtered"])
def test_elastic_impacts_on_a_moving_obstacle(scheme):
    """Restitution 1: all that contact brings is the obstacle's work, to first order in the step."""
    common = {"modes": 100, "duration_s": 0.012, "output_rate_hz": 48_000.0, "restitution": 1.0}
    case = with_tables("hard/moving-ramp", obstacle=RISING)
    amiss = []
    for rate in (768e3, 3.072e6):
        result = simulate(case, scheme=scheme, internal_rate_hz=rate, **common)
        amiss.append(np.abs(result.energy_contact).max() / had(result)[-1])
        assert result.energy_injected[-1] > 0.1 * result.energy_stored[0]
    assert amiss[1] < 0.5 * amiss[0] < 1e-3, amiss


# --- bends --------------------------------------------------------------------------------------------------------------


def test_a_bend_keeps_the_action():
    """One mode, no loss, no contact: E/ω is an adiabatic invariant, and the pitch ends up where it was asked to.

    The staircase of 1 ms has treads of at most 0.8 %, whose phases average out; a raised cosine over 60 periods adds less.
    """
    case = with_tables("hard/one-mode", bend=[{"start_s": 0.1, "duration_s": 0.3, "cents": 500.0}])
    case["obstacle"] = {"positions_m": [0.3], "heights_m": [-1.0]}
    case["string"] |= {"air_viscosity": 0.0, "viscoelastic_loss": 0.0, "thermoelastic_q_inverse": 0.0}
    case["run"] |= {"duration_s": 1.0, "ledger": True}
    result = simulate(case)
    ratio = 2.0 ** (500.0 / 1200.0)
    assert result.energy_stored[-1] / result.energy_stored[0] == pytest.approx(ratio, rel=0.008)
    np.testing.assert_allclose(account(result), 0.0, rtol=0, atol=1e-12 * result.energy_stored[-1])
    before = float(scene_of(case).omega[0]) / (2.0 * np.pi)
    after = pitch_hz(result.u[round(0.45 * 44100) :, 0], 44_100.0, 200.0, 400.0)
    assert after == pytest.approx(before * ratio, rel=1e-5)


@pytest.mark.parametrize("modes", [3, 60])
def test_a_bend_under_a_standing_contact(modes):
    """The obstacle holds the string up; bent, it presses with h/G(x, x) of the new tension: R follows, and so does λ."""
    case = lifted(modes=modes)
    case["obstacle"] = {"positions_m": [0.3, 0.31], "heights_m": [1e-3, 1e-3]}
    case["bend"] = [{"start_s": 0.05, "duration_s": 0.1, "cents": 700.0}]
    result = simulate(case)
    must_hold(result)
    bent = scene_of(case).bent_model(700.0)
    # the two-point static problem on all modes
    compliance = (bent.under.shapes / (bent.modes.mu * bent.modes.omega**2)) @ bent.under.shapes.T + bent.under.residual
    np.testing.assert_allclose(result.contact_force[-1], np.linalg.solve(compliance, [1e-3, 1e-3]), rtol=1e-6)
    np.testing.assert_allclose(result.u_contact, 1e-3, rtol=0, atol=1e-12)
    assert result.contact_force[-1].sum() / result.contact_force[0].sum() == pytest.approx(2.0 ** (700 / 600), rel=1e-3)
    # slowly bent, the shape stands and its energy ½ λ·η grows
    work = 0.5e-3 * (result.contact_force[-1] - result.contact_force[0]).sum()
    assert result.energy_injected[-1] == pytest.approx(work, rel=1e-4)


def test_a_bend_that_goes_back_ends_where_it_began():
    """500 cents up and 500 down while the bridge buzzes: the model is the old one again, and the pitch is."""
    scene = scene_of("hard/bend")
    changes = scene.tension_changes
    assert 100 < len(changes) < 140 and changes[-1][1] == pytest.approx(0.0, abs=1e-9)
    assert max(cents for _, cents in changes) == pytest.approx(500.0)
    again = scene.bent_model(0.0)
    np.testing.assert_allclose(again.modes.omega, scene.omega, rtol=1e-14)
    np.testing.assert_allclose(again.under.residual, scene.residual, rtol=1e-12)
    up = scene.bent_model(500.0)
    assert up.modes.omega[0] / scene.omega[0] == pytest.approx(2.0 ** (500 / 1200), rel=1e-12)
    assert up.modes.omega[-1] / scene.omega[-1] < 2.0 ** (500 / 1200) - 1e-3  # stiffness does not bend


@pytest.mark.parametrize("name", ["tanpura", "bass", "hard/highest-sitar"])
@pytest.mark.parametrize("cents", [-312.5, 12.5, 137.0, 700.0])
def test_residual_compliance_of_a_bent_string(name, cents):
    """From a grid of bends 25 cents apart, against that of the string tuned there.

    Linear in x = 1/T over a relative step δ = 0.029 errs by δ²/8 · x²R''/R at most, and that factor is ≤ 2 for either law.
    """
    scene = scene_of(name)
    got = scene.bent_model(cents).under.residual
    exact = residual_compliance(
        tuned(scene.string, float(scene.omega[0]) * 2.0 ** (cents / 1200) / (2.0 * np.pi)), scene.positions, scene.omega.size
    )
    np.testing.assert_allclose(got, exact, rtol=0, atol=2.0 * 0.0293**2 / 8.0 * np.diag(exact).max())
    assert np.abs(np.diag(got) / np.diag(scene.residual) - 1.0).max() > 3e-4


def test_measured_modes_are_bent_as_the_models(tmp_path):
    np.savez(tmp_path / "modes.npz", f=[100.0, 205.0], sig=[1.0])
    case = with_tables("hard/bend")
    plain = scene_of(case).bent_model(300.0)
    case["string"]["measured"] = {"file": str(tmp_path / "modes.npz")}
    scene = scene_of(case)
    bent = scene.bent_model(300.0)
    share = plain.modes.omega / scene_of("hard/bend").omega
    np.testing.assert_allclose(bent.modes.omega[:2], 2.0 * np.pi * np.array([100.0, 205.0]) * share[:2], rtol=1e-12)
    np.testing.assert_array_equal(bent.modes.omega[2:], plain.modes.omega[2:])
    assert bent.modes.sigma[0] == pytest.approx(plain.modes.sigma[0] / scene_of("hard/bend").sigma[0], rel=1e-12)


@pytest.mark.parametrize("scheme", ["exact-hold", "moreau-jean", "moreau-jean-filtered"])
def test_finger_bend_and_moving_obstacle_at_once(scheme):
    """Everything in one run: the ledger balances in all schemes, exact-hold is passive."""
    case = with_tables(
        "hard/repluck",
        obstacle={"motion": {"sine": [{"frequency_hz": 60.0, "amplitude_m": 0.5e-3}], "ramp": []}},
        bend=[{"start_s": 0.005, "duration_s": 0.05, "cents": -200.0}],
        scheme={"name": scheme, "restitution": 0.0},
    )
    case["run"] |= {"modes": 60, "duration_s": 0.06}
    result = simulate(case)
    np.testing.assert_allclose(account(result), 0.0, rtol=0, atol=1e-11 * had(result)[-1])
    assert result.summary["finite"] and result.summary["contact_steps"] > 100
    if scheme == "exact-hold":
        must_hold(result)


@pytest.mark.parametrize("compliant", [False, True])
def test_random_motion_is_passive(compliant):
    """H⁺ − H − λ·Δη ≤ 0 over paths without any smoothness: 60 scenes, up to 8 contacts, ωΔt of the last mode 0.3 to 100."""
    rng = np.random.default_rng(20)
    touched = 0
    for _ in range(60):
        points = np.sort(rng.uniform(0.05, 0.95, int(rng.integers(1, 9))))
        case = with_tables("hard/moving-ramp", obstacle={"positions_m": list(points), "heights_m": -1e-4})
        case["scheme"]["residual_compliance"] = compliant
        case["run"]["modes"] = int(rng.integers(4, 40))
        case["run"]["internal_rate_hz"] = float(scene_of(case).omega[-1]) / 10 ** rng.uniform(-0.5, 2.0)
        case["run"].pop("output_rate_hz", None)
        scene = scene_of(case)
        q, v = scene.initial()
        model = scene.model
        q, force, _ = driver.static_contact(model, q)
        state = driver.start_run(model, q, v, force, 1, 301, True, False)
        path = np.cumsum(np.concatenate([[0.0], rng.normal(size=300) * 10 ** rng.uniform(-6.0, -4.0)]))
        driver.run(model, state, 300, heights=path)
        touched += state.results.counts[study.CONTACT_STEPS] > 10
        assert state.results.counts[study.STEPS] == 300 and state.results.counts[study.BAD_STEPS] == 0
        assert state.results.sums[study.RISE] <= 1e-12 and state.results.sums[study.PENETRATION] <= 1e-12
        assert state.results.sums[study.LEAST_VISCOUS] >= -1e-12 and state.results.sums[study.LEAST_CONTACT] >= -1e-12
    assert touched > 40


# --- passivity in floating point ----------------------------------------------------------------------------------------

EPS = float(np.finfo(float).eps)

#: one mode under two holds: the finger's 2700 N bear on the point, and nothing in the model bends between them
CLAMPED = {
    "string": {"length_m": 1.9, "tension_n": 2.22, "linear_density_kg_m": 5.3e-8, "diameter_m": 1e-4},
    "obstacle": {"positions_m": [0.6333], "heights_m": [-1e-7]},
    "finger": [{"position_m": 1.36, "displacement_m": -3e-3, "draw_s": 0.02, "hold_s": 0.05, "stiffness_n_m": 1e6}],
    "run": {"internal_rate_hz": 3383.0, "modes": 1, "duration_s": 0.2, "outputs_m": [1.0], "ledger": True},
}


def rounded_forces(case, result):
    """ε G λ² over the energy: what a step makes of forces' rounding, 1e-16 of each (`schemes.clamping_warning`)."""
    g = scene_of(case).model.string.contacts.matrix.diagonal()
    return EPS * float((g * result.contact_force.max(axis=0) ** 2).max()) / max(had(result).max(), SMALLEST)


@pytest.mark.parametrize("tail", ["none", "static", "lumped", None])
def test_a_string_clamped_between_finger_and_point(tail):
    """Where no mode leaves it a way round, rounding of the forces shows, is bounded by them, and is told with its remedy."""
    case, told = {**CLAMPED, "scheme": {} if tail is None else {"tail": tail}}, []
    result = simulate(case, warn=told.append)
    if tail == "none":
        assert result.contact_force.max() > 2500.0
        assert PASSIVE_TO < result.largest_energy_rise < 10.0 * rounded_forces(case, result)
        assert len(told) == 1 and ": a finger clamps the string on a point" in told[0] and 'set tail = "static"' in told[0]
        assert "forces of 2.7e+03 N" in told[0] and "\n" not in told[0]
    else:
        assert result.contact_force.max() < 1.0
        must_hold(result)
        assert told == []


def random_holds(rng, finger):
    """A case of up to 20 modes and 10 points, some all but coincident, often more than modes; a finger of up to 1e8 N/m."""
    length, modes, points = rng.uniform(0.3, 2.0), int(rng.choice([1, 2, 3, 5, 8, 20])), int(rng.choice([1, 2, 3, 6, 10]))
    tension, mu = 10 ** rng.uniform(0.0, 2.5), 10 ** rng.uniform(-7.5, -2.0)
    dt = 10 ** rng.uniform(-1.5, 1.5) * length / (np.pi * modes * np.sqrt(tension / mu))
    x = rng.uniform(0.02, 0.98, points) * length
    if points > 1 and rng.random() < 0.3:
        x[1] = x[0] * (1.0 + 10 ** rng.uniform(-9.0, -3.0))
    x = np.unique(x)
    case = {
        "string": {"length_m": length, "tension_n": tension, "linear_density_kg_m": mu, "diameter_m": 1e-4},
        "obstacle": {"positions_m": x, "heights_m": -(10 ** rng.uniform(-8.0, -3.0, x.size))},
        "scheme": {"tail": str(rng.choice(["none", "none", "static", "lumped"]))},
        "run": {"internal_rate_hz": 1.0 / dt, "modes": modes, "duration_s": 300 * dt, "outputs_m": [0.0], "ledger": True},
    }
    place = rng.uniform(0.1, 0.9) * length
    if not finger or rng.random() < 0.5:
        case["initial"] = {"shape": "triangle", "position_m": place, "displacement_m": 10 ** rng.uniform(-4.0, -2.0)}
    if finger:
        hold = rng.uniform(50.0, 250.0) * dt
        case["finger"] = [
            {
                "position_m": float(rng.choice(x)) if rng.random() < 0.3 else place,
                "displacement_m": float(rng.choice([-1.0, -1.0, 1.0])) * 10 ** rng.uniform(-4.0, -2.0),
                "draw_s": 0.4 * hold,
                "hold_s": 0.6 * hold,
                "stiffness_n_m": 10 ** rng.uniform(2.0, 8.0),
                "width_m": float(rng.choice([0.0, 0.01])),
            }
        ]
    return load_case(case)


def test_any_number_of_points_over_any_number_of_modes():
    """Points push one way, and so no harder than the string does: passive to rounding of the energy, whatever the tail."""
    rng = np.random.default_rng(21)
    more = touched = 0
    for _ in range(100):
        case = random_holds(rng, finger=False)
        result = simulate(case, warn=pytest.fail)
        assert result.largest_energy_rise <= PASSIVE_TO and result.largest_penetration_m <= 1e-12
        more += len(case.obstacle.positions_m) > case.run.modes and case.scheme.tail == "none"
        touched += result.summary["contact_steps"] > 10
    assert more > 10 and touched > 60, (more, touched)


def test_a_finger_over_any_number_of_points_gains_no_more_than_rounding_of_its_forces():
    """… and is told of exactly where that is more than rounding of the energy; static compliance leaves a way round."""
    rng = np.random.default_rng(22)
    loud = {"none": 0, "static": 0, "lumped": 0}
    for _ in range(150):
        case, told = random_holds(rng, finger=True), []
        result = simulate(case, warn=told.append)
        rise = result.largest_energy_rise
        assert rise <= PASSIVE_TO + 10.0 * rounded_forces(case, result)
        assert (rise > PASSIVE_TO) == any("a finger clamps" in text for text in told)
        loud[case.scheme.tail] += rise > PASSIVE_TO
    assert loud["static"] == 0 and loud["none"] >= 3, loud


# --- Moreau–Jean --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["moreau-jean", "moreau-jean-filtered"])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.9, 1.0])
def test_every_restitution_at_a_safe_rate(scheme, restitution):
    """At 4.2 MHz, bass frets, all modes: never more energy than at the start, and no deeper than a point moves in a step.

    A law of velocities lets a point through until the step after its gap has closed.
    """
    rate = load_case("hard/restitution").run.internal_rate_hz
    common = {"duration_s": 0.006, "output_rate_hz": rate}
    result = simulate("hard/restitution", scheme=scheme, restitution=restitution, **common)
    energy = result.energy_stored
    assert result.metadata["restitution"] == restitution and result.summary["contact_steps"] > 1000
    assert energy.max() <= energy[0] * (1.0 + 1e-12)
    np.testing.assert_allclose(account(result), 0.0, rtol=0, atol=1e-11 * energy[0])
    assert result.largest_penetration_m <= np.abs(np.diff(result.u_contact, axis=0)).max()
    # what contacts take falls with restitution: measured 0.02 of all energy at 0, and at 1 a gain of 0.005 at most
    lost = result.energy_contact[-1] / energy[0]
    assert lost > 0.01 if restitution <= 0.5 else abs(lost) < 0.01
    highest = float(scene_of("hard/restitution").omega.max()) / (2.0 * np.pi)
    assert rate >= safe_rate_hz(scheme, restitution, highest)


@pytest.mark.parametrize(
    ("name", "scheme", "modes", "restitution", "least"),
    [  # `least` is half of what was measured: 8.9, 2340, 10.6 and 2.5 times
        ("tanpura", "moreau-jean", 1001, 0.0, 4.0),
        ("bass", "moreau-jean", 863, 0.0, 1000.0),
        ("tanpura", "moreau-jean-filtered", 103, 1.0, 5.0),
        ("bass", "moreau-jean-filtered", 863, 1.0, 1.2),
    ],
)
def test_moreau_jean_gains_energy_where_it_warns(name, scheme, modes, restitution, least):
    """44.1 kHz: what happens below the safe rate is on record, and exact-hold on the same grid holds."""
    common = {"internal_rate_hz": 44_100, "modes": modes, "duration_s": 0.05, "ledger": True}
    told = []
    result = simulate(name, scheme=scheme, restitution=restitution, warn=told.append, **common)
    assert result.energy_stored.max() > least * result.energy_stored[0]
    assert len(told) == 1 and "can gain energy below" in told[0] and "--rate" in told[0]
    quiet = []
    must_hold(simulate(name, warn=quiet.append, **common))
    assert quiet == []


@pytest.mark.parametrize(("restitution", "gains"), [(1.0, True), (0.5, False)])
def test_a_step_of_moreau_jean_that_gains_at_a_safe_rate_is_told(restitution, gains):
    """With restitution 1 a blow gives back more than it took within the step, and takes it in the next ones."""
    told = []
    result = simulate(
        "hard/restitution", scheme="moreau-jean", restitution=restitution, ledger=True, duration_s=0.004, warn=told.append
    )
    assert (result.largest_energy_rise > PASSIVE_TO) == gains
    assert len(told) == gains
    assert all(f"raised the energy by {result.largest_energy_rise:.1e} of" in text and "\n" not in text for text in told)


def test_the_rule_for_safe_rates():
    assert safe_rate_hz("exact-hold", 0.0, 1e9) == 0.0
    assert safe_rate_hz("moreau-jean", 0.0) == 1e6
    assert safe_rate_hz("moreau-jean-filtered", 0.0, 0.7e6) == 1.4e6
    assert safe_rate_hz("moreau-jean", 0.5, 0.7e6) == 4e6
    assert energy_warning("moreau-jean", 0.0, 1e6, "--rate", 1.0) is None
    text = energy_warning("moreau-jean", 0.0, 44_100.0, "--rate", 44_100.0, 1.2e6)
    assert text is not None and "2.4 MHz" in text and "--rate 2425500 " in text and "\n" not in text


def test_simulate_warns_on_standard_error(tmp_path, capsys):
    arguments = ["simulate", "tanpura", "-o", str(tmp_path / "out.npz"), "--duration", "0.005", "--modes", "50"]
    low = ["--scheme", "moreau-jean", "--restitution", "0", "--rate", "44100"]
    assert cli.main([*arguments, *low]) == 0
    said = capsys.readouterr()
    assert said.err.startswith("synth: moreau-jean with restitution 0 can gain energy") and said.err.count("\n") == 1
    for quiet in ([*low, "--quiet"], ["--rate", "44100"], [*low[:-1], "1058400"]):
        assert cli.main([*arguments, *quiet]) == 0
        assert capsys.readouterr().err == ""


# --- faults -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"bend": [{"duration_s": 0.0, "cents": 100}]}, r"bend\.0\.duration_s: .*greater than 0, got 0"),
        ({"bend": [{"duration_s": 0.1, "cents": -30_000}]}, r"-30000 cents at 0\.1 s leave no tension"),
        ({"obstacle": {"motion": {"ramp": [{"duration_s": 0.1}]}}}, r"motion\.ramp\.0\.displacement_m: missing"),
        ({"obstacle": {"motion": {"sine": [{"frequency_hz": -1.0, "amplitude_m": 1e-3}]}}}, "frequency_hz"),
        ({"obstacle": {"positions_m": [], "heights_m": []}}, "motion needs something that moves"),
    ],
)
def test_faults_are_named(tables, message):
    case = with_tables("hard/moving-ramp", **tables)
    with pytest.raises(ValueError, match=message):
        simulate(case)


def test_an_override_of_what_is_no_table_is_a_fault_of_the_table():
    case = {**with_tables("hard/moving-ramp"), "scheme": "exact-hold"}
    with pytest.raises(CaseError, match=r"scheme: must be a table, got 'exact-hold'"):
        simulate(case, tail="static")
