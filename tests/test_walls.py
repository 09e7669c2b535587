"""Walls: the sine transform, the node law and its kernel, exact solutions, energy, convergence, and what a case may say."""

from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path

import numpy as np
import pytest
import scipy.fft
import scipy.integrate

import synth
from synth.dsp.measures import relative_error
from synth.instrument.plan import BRIDGE, WALL, plan_string, plan_wall, wanted_rate_hz
from synth.physics.obstacle import parabola_height, wall_positions
from synth.research.case import CaseError, load_case
from synth.research.exact.triangle import free
from synth.research.exact.triangle import wall as over_wall
from synth.research.scene import Scene
from synth.solver import wall
from synth.solver.clearance import attend, clear_for
from synth.solver.problem import Problem
from synth.solver.sine import make_sine, transform
from synth.solver.stepwise import fly
from tests.oracles.wall_steps import wall_steps


def case(name: str, **tables):
    """A case's tables with some replaced: wall={…}, run={…} and so on."""
    loaded = copy.deepcopy(load_case(name).model_dump())
    for table, values in tables.items():
        (loaded["obstacle"]["wall"] if table == "wall" else loaded[table]).update(values)
    return loaded


def scene(rng, modes: int, steps: int, stiffness: float, e: float, lossy: bool = True, every: int | None = None):
    """A random string, ωΔt of its highest mode from 0.3 to 100, thrown at a wall under a random stretch of it."""
    length, mu = rng.uniform(0.3, 1.2), 10 ** rng.uniform(-3.3, -2.0)
    j = np.arange(1, modes + 1)
    omega = rng.uniform(200.0, 2000.0) * j * np.sqrt(1.0 + 10 ** rng.uniform(-6.0, -3.0) * j**2)
    sigma = rng.uniform(0.1, 5.0) + 1e-3 * omega * rng.random() if lossy else np.zeros(modes)
    dt = 10 ** rng.uniform(-0.5, 2.0) / omega[-1]
    first = int(rng.integers(1, max(2, modes // 2)))
    numbers = np.arange(first, int(rng.integers(first, modes)) + 1)
    positions = numbers * length / (modes + 1)
    q = rng.normal(size=modes) * 1e-3 / j**1.5
    v = rng.normal(size=modes) * omega * 1e-3 / j**2.0
    shapes = math.sqrt(2.0 / length) * np.sin(np.pi * np.outer(positions, j) / length)
    eta = shapes @ q - np.abs(rng.normal(size=numbers.size)) * 0.3e-3
    if stiffness > 0.0 and math.isfinite(stiffness):
        stiffness = mu * (stiffness / dt) ** 2  # given as ΩΔt
    problem = Problem(dt, steps, every or steps, mu, omega, sigma, shapes, eta, shapes[:1], q, v)
    model = wall.make_wall(omega, sigma, mu, dt, length, positions, eta, shapes[:1], stiffness, e)
    return problem, model, numbers, length, stiffness


@pytest.mark.parametrize("n", [2, 4, 8, 12, 32, 64, 90, 128, 256, 512, 1024, 2048])
def test_sine_transform_is_scipys(n: int) -> None:
    rng = np.random.default_rng(n)
    a, b = rng.normal(size=(2, n - 1))
    out = np.empty((2, n - 1))
    transform(make_sine(n, dense=False), a, b, out[0], out[1])
    expected = 0.5 * scipy.fft.dst(np.array([a, b]), type=1)
    # the running sum of n/2 terms of size √n, each with a rounding
    assert np.abs(out - expected).max() < 1e-15 * n * math.sqrt(n)
    dense = np.empty((2, n - 1))
    transform(make_sine(n, dense=True), a, b, dense[0], dense[1])
    assert np.abs(dense - expected).max() < 1e-15 * n * math.sqrt(n)
    assert make_sine(n).matrix.size == (0 if n in (64, 128, 256, 512, 1024, 2048) else (n - 1) ** 2)


@pytest.mark.parametrize("stiffness", [0.3, 1.2, 5.0, math.inf])
@pytest.mark.parametrize("e", [0.0, 0.6, 1.0])
def test_kernel_is_its_twin(stiffness: float, e: float) -> None:
    touched = 0
    for seed in range(4):
        rng = np.random.default_rng([seed, int(10 * e)])
        modes = int(rng.choice([15, 20, 127]))
        problem, model, numbers, length, k = scene(rng, modes, 60, stiffness, e)
        run = wall.start_run(problem, model, ledger=False)
        wall.advance(model, run, problem.steps, problem.every)
        q, v, account = wall_steps(
            problem.omega,
            problem.sigma,
            problem.mu,
            problem.dt,
            length,
            numbers,
            problem.eta,
            k,
            e,
            problem.q,
            problem.v,
            60,
        )
        # 60 steps of rounding, in a problem whose impacts enlarge differences
        assert run.q == pytest.approx(q, abs=1e-9 * np.abs(q).max())
        assert run.v == pytest.approx(v, abs=1e-9 * np.abs(v).max())
        held = problem.mu * model.spacing * run.account
        assert held == pytest.approx(account, abs=1e-9 * run.results.sums[wall.START])
        touched += int(run.results.counts[wall.TOUCHED])
    assert touched > 10


@pytest.mark.parametrize("angle", [0.1, 0.7, 1.3, 2.0])
@pytest.mark.parametrize("e", [0.0, 0.35, 1.0])
def test_a_single_node_bounces_with_its_restitution(angle: float, e: float) -> None:
    dt, w, gap, touching, account, lost = 1.0, -1.0, 0.37, 0, 0.0, 0.0
    kappa = (2.0 * math.sin(0.5 * angle)) ** 2
    steps = 0
    while not (gap > 0.0 and steps > 2 and w >= 0.0) and steps < 1000:
        gap += dt * w
        w, touching, account, more = wall.after_contact(gap, w, touching, account, kappa, e, dt)
        lost += more
        steps += 1
        if e == 0.0 and w == 0.0:
            break
    assert w == pytest.approx(e, abs=1e-7)  # e = 0 stops by the square root of a rounding
    assert lost + account == pytest.approx(0.5 * (1.0 - e * e), abs=1e-14)
    if e == 1.0:
        assert steps * dt < math.pi / angle + 4.0


@pytest.mark.parametrize("e", [0.0, 0.6, 1.0])
def test_energy_never_grows_at_any_step(e: float) -> None:
    touched = 0
    for seed in range(12):
        rng = np.random.default_rng([seed, 7])
        stiffness = [10 ** rng.uniform(-1.5, 1.5), math.inf][seed % 3 == 0]
        problem, model, *_ = scene(rng, int(rng.choice([7, 40, 127])), 1500, stiffness, e, lossy=seed % 2 == 0, every=1)
        run = wall.start_run(problem, model, ledger=True)
        wall.advance(model, run, problem.steps, problem.every)
        stored, held, viscous, lost, _ = run.results.energy.T
        touched += int(run.results.counts[wall.TOUCHED])
        assert run.results.sums[wall.RISE] < 1e-13  # of the start's energy: rounding of one step
        assert np.diff(stored + held).max() < 1e-13 * stored[0]
        assert held.min() > -1e-13 * stored[0]
        assert np.abs(stored + held + viscous + lost - stored[0]).max() < 1e-11 * stored[0]  # 1500 roundings
        if e == 1.0 and seed % 2:
            assert stored[-1] + held[-1] > 0.999 * stored[0] - lost[-1]
    assert touched > 1000


def test_exact_flat_wall_below_a_centred_triangle() -> None:
    errors = []
    for modes in (63, 127, 255):
        result = synth.simulate(
            case("flat-wall", run={"modes": modes, "internal_rate_hz": 100.0 * (modes + 1), "duration_s": 0.0275})
        )
        exact = over_wall(result.positions, result.t[:, None], 1.0, 100.0, 0.5, 2e-3, -0.75e-3)
        errors.append(relative_error(result.u, exact))
        # at the end of the second period the triangle stands as at the start
        assert result.u[-1] == pytest.approx(exact[0], rel=0.02)
    # a wall at a node's height, impacts at instants of the grid: what is left is the corner that N modes round off
    assert errors[2] < 0.5 * errors[0] and errors[2] < 0.01


def test_exact_flat_wall_at_rest_height() -> None:
    tables = case("flat-wall", wall={"height_m": 0.0}, run={"duration_s": 0.1})
    result = synth.simulate(tables)
    exact = over_wall(result.positions, result.t[:, None], 1.0, 100.0, 0.5, 2e-3, 0.0)
    assert relative_error(result.u, exact) < 1e-3  # the corner's: N^−3/2 = 2.4e-4 of its height
    still = free(result.positions, result.t[:, None], 1.0, 100.0, 0.5, 2e-3)
    assert relative_error(still, exact) > 1.0


def test_elastic_wall_converges_where_contact_sweeps() -> None:
    """Off-centre pluck, u = |free|: halves with the duration of contact, where a rigid wall does not converge."""
    errors, rigid = [], []
    for modes in (63, 127, 255):
        changes = {"initial": {"position_m": 0.2}, "run": {"modes": modes, "duration_s": 0.02}}
        changes["run"]["internal_rate_hz"] = 800.0 * (modes + 1)
        stiffness = 5e-3 * (100.0 * (modes + 1)) ** 2  # Ω Δx/c = 1
        for found, k in ((errors, stiffness), (rigid, "rigid")):
            result = synth.simulate(case("flat-wall", wall={"height_m": 0.0, "stiffness_n_m2": k}, **changes))
            exact = over_wall(result.positions, result.t[:, None], 1.0, 100.0, 0.2, 2e-3, 0.0)
            found.append(relative_error(result.u, exact))
    assert errors[1] < 0.6 * errors[0] and errors[2] < 0.6 * errors[1]
    assert rigid[2] > 0.9 * rigid[0]


def test_springs_converge_to_their_differential_equation() -> None:
    """Another integrator of the same springs: second order in Δt, touch and release included."""
    modes, k, duration = 31, 5e-3 * 3200.0**2, 0.03
    j = np.arange(1, modes + 1)
    shapes = math.sqrt(2.0) * np.sin(np.pi * np.outer(j, j) / (modes + 1))
    omega, eta = 100.0 * np.pi * j, -0.5e-3
    q = shapes.T @ (2e-3 * np.minimum(j, modes + 1 - j) / 16.0) / (modes + 1)

    def rates(_, y):
        gap = shapes @ y[:modes] - eta
        force = k / 5e-3 * np.maximum(0.0, -gap) / (modes + 1)
        return np.concatenate([y[modes:], shapes.T @ force - omega**2 * y[:modes]])

    start = np.concatenate([q, np.zeros(modes)])
    exact = scipy.integrate.solve_ivp(rates, (0.0, duration), start, method="DOP853", rtol=1e-10, atol=1e-14).y[:modes, -1]
    errors = []
    for rate in (25_600, 51_200, 102_400, 204_800):
        steps = round(duration * rate)
        problem = Problem(
            1.0 / rate, steps, steps, 5e-3, omega, np.zeros(modes), shapes, np.full(modes, eta), shapes[:1], q, 0 * q
        )
        model = wall.make_wall(
            omega, np.zeros(modes), 5e-3, 1.0 / rate, 1.0, j / (modes + 1), problem.eta, shapes[:1], k, 1.0
        )  # fmt: skip
        run = wall.start_run(problem, model, ledger=False)
        wall.advance(model, run, steps, steps)
        assert run.results.counts[wall.TOUCHED] > 10
        errors.append(relative_error(run.q, exact))
    ratios = np.array(errors[:-1]) / errors[1:]
    assert ratios == pytest.approx(4.0, rel=0.15)  # second order


def test_a_wall_is_planned_as_it_was_measured() -> None:
    string = Scene(load_case("fretless"), Path()).string
    plans = [plan_wall(string, 1e8, quality=quality, rate_hz=44100.0) for quality in WALL]
    assert [(plan.modes, plan.factor, plan.scheme) for plan in plans] == [
        (127, 2, "wall"), (255, 4, "wall"), (511, 16, "wall"), (1023, 31, "wall")
    ]  # fmt: skip
    assert [plan_wall(string, 1e9, quality=quality, rate_hz=44100.0).modes for quality in WALL] == [255, 511, 1023, 2047]
    with pytest.raises(ValueError, match="rigid wall does not converge"):
        plan_wall(string, math.inf, quality="fine", rate_hz=44100.0)


def test_simulate_at_a_quality() -> None:
    result = synth.simulate("fretless", quality="standard", duration=0.01)
    assert (result.metadata["modes"], result.metadata["internal_rate_hz"]) == (255, 176400.0)
    said: list[str] = []
    synth.simulate("fretless", quality="draft", duration=0.01, restitution=1.0, warn=said.append)
    assert len(said) == 1 and "up to restitution 0.7, got 1" in said[0]
    bridge = synth.simulate("tanpura", quality="standard", duration=0.01)
    string = Scene(load_case("tanpura"), Path()).string
    plan = plan_string(string, string.fundamental_hz, 1, BRIDGE, quality="standard", rate_hz=44100.0)
    assert (bridge.metadata["modes"], bridge.metadata["internal_rate_hz"]) == (plan.modes, plan.rate_hz)
    assert synth.simulate("bass", quality="draft", duration=0.01, output_rate=48000).metadata["output_rate_hz"] == 48000.0
    # rows at a low rate are no reason to compute at a low one
    rare = synth.simulate("tanpura", quality="standard", duration=0.01, output_rate=1000)
    assert rare.metadata["internal_rate_hz"] >= wanted_rate_hz(string.fundamental_hz, BRIDGE, "standard") > 64_000
    for changes, message in (
        ({"modes": 12}, "leave out modes"),
        ({"scheme": "compliant"}, "known for exact-hold and wall"),
        ({"quality": "best"}, "quality must be one of"),
    ):
        with pytest.raises(ValueError, match=message):
            synth.simulate("tanpura", **{"quality": "standard", **changes})


def test_fretless_converges_in_nodes_and_rate() -> None:
    def run(modes: int, factor: int) -> np.ndarray:
        return synth.simulate("fretless", modes=modes, internal_rate_hz=44100 * factor, duration_s=0.02).u

    finest = run(511, 32)
    errors = [relative_error(run(modes, factor), finest) for modes, factor in ((127, 2), (255, 4), (511, 8))]
    assert errors[0] > 2.0 * errors[1] > 4.0 * errors[2]
    assert errors[1] < 0.01


def looked_at_everywhere(run: wall.WallRun) -> wall.WallRun:
    """The same run with bounds so large that no instant is passed over and no certificate given."""
    return run._replace(clearance=run.clearance._replace(margin=1e300))


def fretless(modes: int, factor: int, seconds: float) -> tuple[Problem, wall.Wall]:
    """The case with other modes and rate, as the scheme is given it."""
    run = {"modes": modes, "internal_rate_hz": 44100.0 * factor, "duration_s": seconds}
    loaded = load_case(case("fretless", run=run))
    problem, table = (found := Scene(loaded, Path())).problem(), loaded.obstacle.wall
    model = wall.make_wall(
        problem.omega, problem.sigma, problem.mu, problem.dt, found.string.length_m, found.positions, problem.eta,
        problem.out_shapes, table.stiffness_n_m2, loaded.scheme.restitution,
    )  # fmt: skip
    return problem, model


def test_how_often_there_are_rows_changes_nothing() -> None:
    problem, model = fretless(127, 8, 0.02)
    runs = []
    for every in (1, 7, 32, problem.steps):
        runs.append(wall.start_run(problem._replace(every=every), model, ledger=False))
        wall.advance(model, runs[-1], problem.steps, every)
    first = runs[0]
    assert first.results.counts[wall.TOUCHED] > 10 and first.results.counts[wall.LOOKED] < 0.2 * problem.steps
    for run, every in zip(runs, (1, 7, 32, problem.steps), strict=True):
        assert np.array_equal(run.q, first.q) and np.array_equal(run.v, first.v)
        assert run.results.counts[wall.LOOKED] == first.results.counts[wall.LOOKED]
        # rows are flown by other propagators: rounding
        assert run.results.u == pytest.approx(first.results.u[::every], abs=1e-12 * np.abs(first.results.u).max())
        u = first.results.contact_u
        assert run.results.contact_u == pytest.approx(u[::every], abs=1e-12 * np.abs(u).max())
        impulses = first.results.contact_force[1 : (problem.steps // every) * every + 1]
        mean = impulses.reshape(-1, every, impulses.shape[1]).mean(axis=1)
        assert run.results.contact_force[1:] == pytest.approx(mean, abs=1e-12 * impulses.max())


def test_a_whole_note_is_the_same_with_every_instant_looked_at() -> None:
    problem, model = fretless(127, 2, 3.0)
    run = wall.start_run(problem, model, ledger=False, contact_rows=False)
    wall.advance(model, run, problem.steps, problem.every)
    every = looked_at_everywhere(wall.start_run(problem, model, ledger=False, contact_rows=False))
    wall.advance(model, every, problem.steps, problem.every)
    assert every.results.counts[wall.LOOKED] == problem.steps > 20 * run.results.counts[wall.LOOKED]
    assert run.results.counts[wall.LAST] == every.results.counts[wall.LAST]
    assert run.results.counts[wall.TOUCHED] == every.results.counts[wall.TOUCHED]
    # the impacts enlarge what rounding differs by
    assert run.results.u == pytest.approx(every.results.u, abs=1e-10 * np.abs(every.results.u).max())


@pytest.mark.parametrize("rigid", [False, True])
def test_clear_steps_are_clear(rigid: bool) -> None:
    """Forwards, and backwards to when the bounds were taken, for the whole string and node by node."""
    found = {False: 0, True: 0}
    for seed in range(30):
        rng = np.random.default_rng([seed, 17])
        problem, model, *_ = scene(rng, int(rng.choice([20, 63])), 400, math.inf if rigid else 1.0, 1.0)
        q, v = problem.q.copy(), problem.v.copy()
        states = [(q.copy(), v.copy())]
        for _ in range(400):
            fly(model.flights.coef[0], q, v)
            states.append((q.copy(), v.copy()))
        u, w = (np.array([problem.shapes @ state[i] for state in states]) for i in (0, 1))
        eta = np.full(problem.eta.size, -rng.uniform(0.3, 1.5) * np.abs(u).max())
        clearance = wall.start_run(problem, model._replace(eta=np.minimum(eta, problem.eta)), ledger=False).clearance
        gaps = u - clearance.eta
        reached = (gaps + (0.5 * problem.dt * np.minimum(w, 0.0) if rigid else 0.0)).min(axis=1) <= 0.0
        for nodewise in (False, True):
            for _ in range(problem.omega.size if nodewise else 1):
                attend(clearance, *states[0])
                clear_for(clearance, gaps[0], gaps[0].min())
            for t in range(0, 401, 5):
                steps = min(400, clear_for(clearance, gaps[t], gaps[t].min()))
                if steps >= 0:
                    assert not reached[max(0, t - steps) : t + steps + 1].any()
                    found[nodewise] += steps
    assert found[True] > found[False] > 100


def test_rows_of_the_nodes_are_made_when_read() -> None:
    result = synth.simulate("fretless", modes=127, internal_rate_hz=88200, duration_s=0.02)
    again = pickle.loads(pickle.dumps(result))
    assert callable(result.__dict__["u_contact"]) and callable(again.__dict__["contact_force"])
    problem, model = fretless(127, 2, 0.02)
    run = wall.start_run(problem, model, ledger=False)
    wall.advance(model, run, problem.steps, problem.every)
    for one in (result, again):
        assert np.array_equal(one.u, run.results.u)
        assert np.array_equal(one.u_contact, run.results.contact_u)
        assert np.array_equal(one.contact_force, run.results.contact_force)
        assert one.u_contact is one.u_contact


@pytest.mark.parametrize("stiffness", [1.2, math.inf])
def test_a_string_that_is_free_for_ever_never_touches_again(stiffness: float) -> None:
    exits = 0
    for seed in range(40):
        rng = np.random.default_rng([seed, 13])
        problem, model, *_ = scene(rng, int(rng.choice([20, 63])), 30_000, stiffness, 0.5)
        # a wall that the losses leave behind
        eta = np.minimum(problem.eta, -rng.uniform(0.02, 0.5) * np.abs(problem.shapes @ problem.q).max())
        problem, model = problem._replace(eta=eta), model._replace(eta=eta)
        run = wall.start_run(problem, model, ledger=False)
        wall.advance(model, run, problem.steps, problem.every)
        every = looked_at_everywhere(wall.start_run(problem, model, ledger=False))
        wall.advance(model, every, problem.steps, problem.every)
        assert run.results.counts[wall.LAST] == every.results.counts[wall.LAST]
        if run.results.counts[wall.EXIT] >= 0 and run.results.counts[wall.LAST] > 0:
            exits += 1
            assert every.results.counts[wall.LAST] <= run.results.counts[wall.EXIT] < 0.9 * problem.steps
    assert exits >= 5, exits


@pytest.mark.parametrize("stiffness", [0.3, 1.2, 5.0, math.inf])
def test_instants_passed_over_change_nothing(stiffness: float) -> None:
    """Random strings and walls against the same with every instant looked at."""
    looked, passed, touched = 0, 0, 0
    for seed in range(24):
        rng = np.random.default_rng([seed, 11])
        problem, model, *_ = scene(rng, int(rng.choice([20, 63, 127])), 600, stiffness, rng.choice([0.0, 0.7, 1.0]), every=5)
        run = wall.start_run(problem, model, ledger=False)
        wall.advance(model, run, problem.steps, problem.every)
        every = looked_at_everywhere(wall.start_run(problem, model, ledger=False))
        wall.advance(model, every, problem.steps, problem.every)
        assert every.results.counts[wall.LOOKED] == problem.steps
        assert run.results.counts[wall.TOUCHED] == every.results.counts[wall.TOUCHED]
        assert run.results.counts[wall.LAST] == every.results.counts[wall.LAST]
        # 600 steps of rounding, in a problem whose impacts enlarge differences
        for name in ("u", "contact_u"):
            whole = getattr(every.results, name)
            assert getattr(run.results, name) == pytest.approx(whole, abs=1e-9 * np.abs(whole).max())
        looked += int(run.results.counts[wall.LOOKED])
        passed += problem.steps - int(run.results.counts[wall.LOOKED])
        touched += int(run.results.counts[wall.TOUCHED])
    assert touched > 100 and passed > 1000, (looked, passed, touched)


def test_fretless_keeps_its_energy_but_for_losses() -> None:
    result = synth.simulate(
        case(
            "fretless",
            scheme={"restitution": 0.5},
            run={"modes": 127, "internal_rate_hz": 88200, "duration_s": 0.05, "ledger": True},
        )
    )
    assert result.largest_energy_rise < 1e-13
    assert result.energy_contact[-1] > 0.05 * result.energy_stored[0]
    assert result.contact_force.max() > 1.0 and result.contact_force.min() >= 0.0


def test_curved_bridge_of_points_needs_no_high_rate() -> None:
    """Wrapping leaves no freedom: the rate hardly matters, the elastic wall agrees with the rigid points."""
    points = {
        factor: synth.simulate("sitar", internal_rate_hz=44100 * factor, modes=103, duration_s=0.05) for factor in (1, 4)
    }
    assert relative_error(points[1].u, points[4].u) < 0.05
    elastic = case("sitar", wall={"spacing_m": None, "stiffness_n_m2": 1e9}, scheme={"name": "wall"})
    elastic["run"].update(modes=511, internal_rate_hz=705600, duration_s=0.05)
    assert relative_error(points[4].u, synth.simulate(elastic).u) < 0.1


def test_where_a_wall_is_looked_at() -> None:
    assert wall_positions(1.0, 0.0, 0.5, intervals=8) == pytest.approx([0.125, 0.25, 0.375, 0.5])
    assert wall_positions(1.0, 0.0, 1.0, intervals=4) == pytest.approx([0.25, 0.5, 0.75])
    assert wall_positions(1.0, 0.2, 0.4, nodes=3) == pytest.approx([0.2, 0.3, 0.4])
    assert wall_positions(1.0, 0.0, 0.4, nodes=2) == pytest.approx([0.2, 0.4])
    assert wall_positions(1.0, 0.0, 0.03, spacing_m=0.01) == pytest.approx([0.01, 0.02, 0.03])
    assert parabola_height(np.array([0.0, 0.03]), 0.0, 0.0, 0.9) == pytest.approx([0.0, -0.5e-3])
    with pytest.raises(ValueError, match="no node lies on the wall"):
        wall_positions(1.0, 0.01, 0.02, intervals=8)
    with pytest.raises(ValueError, match="from_m < to_m"):
        wall_positions(1.0, 0.5, 0.2, nodes=3)


def test_the_wall_scheme_is_the_default_of_a_wall_without_points() -> None:
    tables = case("fretless")
    del tables["scheme"]["name"]
    assert load_case(tables).scheme.name == "wall"
    tables["obstacle"]["wall"]["spacing_m"] = 0.01
    assert load_case(tables).scheme.name == "exact-hold"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t["obstacle"]["wall"].update(height_m=0.0), "give one of height_m, neck and parabola"),
        (lambda t: t["obstacle"]["wall"].update(nodes=3, spacing_m=0.1), "either nodes or spacing_m"),
        (lambda t: t["obstacle"]["wall"].update(nodes=30), "modal grid"),
        (lambda t: t["obstacle"]["wall"].update(stiffness_n_m2=-1.0), "greater than 0"),
        (lambda t: t["obstacle"].update(positions_m=[0.1], heights_m=0.0), "give either wall"),
        (lambda t: t["obstacle"].update(wall=None), "needs a wall"),
        (lambda t: t["obstacle"].update(motion={"sine": [{"frequency_hz": 9.0, "amplitude_m": 1e-3}]}), "a wall stands"),
        (lambda t: t["initial"].update(displacement_m=-3e-3), "below it"),
        (lambda t: t.update(finger=[{"position_m": 0.5, "displacement_m": 1e-3, "draw_s": 0.1}]), "takes none"),
    ],
)
def test_a_wrong_wall_is_refused(change, message: str) -> None:
    tables = case("fretless", run={"duration_s": 0.001, "modes": 31})
    change(tables)
    with pytest.raises(CaseError, match=message):
        synth.simulate(tables)
