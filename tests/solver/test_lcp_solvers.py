"""All compiled solvers of the contact problem against each other, on random problems and on those that runs meet.

The judge is the natural residual over max|b|, `lcp.natural_residual`. What is compared between solvers is the motion
G λ, which is unique for every semidefinite G; forces only where G is well conditioned. Bounds: the active-set method
and Lemke's are direct, so rounding alone is left, ≤ 1e-12; projected relaxation stops by itself at `FEASIBILITY`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from synth.research.case import Case, load_case
from synth.research.scene import Scene
from synth.solver import lcp
from synth.solver.lcp import FEASIBILITY, NOT_SOLVED, SOLVED, natural_residual
from tests.oracles import gauss_seidel, lemke
from tests.oracles.record import contact_problems
from tests.oracles.steps import lemke as reference_lemke

DIRECT = 1e-12
SOLVERS = ("active set", "lemke", "gauss-seidel", "psor 1.3")


def run(solver, a, b, enabled=None, active=None, z=None):
    """(status, z, active) of one solver with fresh work space; active and z are the first guess."""
    n = b.size
    a, b = np.ascontiguousarray(a), np.ascontiguousarray(b)
    enabled = np.ones(n, np.uint8) if enabled is None else enabled
    active = np.zeros(n, np.uint8) if active is None else active.copy()
    z = np.full(n, np.nan) if z is None else z.copy()
    factor, index = np.zeros((n, n)), np.zeros(n, np.int64)
    if solver == "active set":
        status = lcp.solve(a, b, enabled, active, z, factor, index)
    elif solver == "lemke":
        status = lemke.solve(a, b, enabled, active, z, *lemke.make_work(n))
    elif solver == "gauss-seidel":
        status = gauss_seidel.solve(a, b, enabled, active, z, factor, index)
    else:
        status, _ = gauss_seidel.relax(a, b, enabled, active, z, factor[0], 1.3, FEASIBILITY, 5000)
    np.testing.assert_array_equal(active[z > 0.0], 1)
    assert np.all(z >= 0.0)
    return status, z, active


def relative_residual(a, b, z):
    return natural_residual(np.ascontiguousarray(a), b, z) / max(np.abs(b).max(), 1e-300)


def assert_agree(a, b, solvers=SOLVERS, motion=1e-10):
    """Every solver says SOLVED within its bound, and all find one motion; returns the forces by solver."""
    found = {}
    for solver in solvers:
        status, z, _ = run(solver, a, b)
        assert status == SOLVED, solver
        assert relative_residual(a, b, z) <= (DIRECT if solver in ("active set", "lemke") else 2.0 * FEASIBILITY), solver
        found[solver] = z
    first = found[solvers[0]]
    for solver, z in found.items():
        np.testing.assert_allclose(a @ z, a @ first, rtol=0, atol=motion * np.abs(b).max(), err_msg=solver)
    return found


def shapes_at(positions, modes):
    return np.sin(np.pi * np.outer(positions, np.arange(1, modes + 1)))


# --- made up ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_random_definite():
    """Wishart matrices of condition up to some hundreds: the force too is the same, and the NumPy Lemke's."""
    rng = np.random.default_rng(1)
    for _ in range(60):
        n = int(rng.integers(1, 21))
        root = rng.normal(size=(n, 3 * n))
        a, b = root @ root.T / n, rng.normal(size=n)
        found = assert_agree(a, b)
        expected = reference_lemke(a, b)
        for z in found.values():
            np.testing.assert_allclose(z, expected, rtol=0, atol=1e-9 * np.abs(expected).max(initial=1e-30))


@pytest.mark.slow
def test_scaled_rows():
    """Compliances over six decades, as of points near the end and in the middle: the residual is in w's units."""
    rng = np.random.default_rng(2)
    for _ in range(40):
        n = int(rng.integers(2, 15))
        root = rng.normal(size=(n, 3 * n)) * 10 ** rng.uniform(-3, 0, n)[:, None]
        assert_agree(root @ root.T * 1e-6, 1e-5 * rng.normal(size=n))


@pytest.mark.parametrize("distance_m", [1e-3, 1e-4])
def test_neighbouring_frets(distance_m):
    """Six pairs of frets 1 and 0.1 mm apart, condition some 1e6 and 1e8, from known forces on three of four contacts.

    The direct methods find the known motion to rounding; relaxation says that it did not get there, where it did not.
    """
    rng = np.random.default_rng(3)
    gave_up = 0
    for _ in range(20):
        places = np.sort(rng.uniform(0.05, 0.7, 6))
        shapes = shapes_at(np.concatenate([places, places + distance_m]) / 0.863, 150) / np.arange(1, 151) ** 1.5
        a = shapes @ shapes.T
        assert np.linalg.cond(a) > 0.5 / distance_m**2
        loaded = rng.random(12) < 0.75
        force, gap = rng.uniform(0.5, 1.0, 12) * loaded, rng.uniform(0.1, 1.0, 12) * ~loaded
        b = gap - a @ force
        found = assert_agree(a, b, ("active set", "lemke"))
        np.testing.assert_allclose(a @ found["lemke"], a @ force, rtol=0, atol=1e-10 * np.abs(b).max())
        status, z, _ = run("gauss-seidel", a, b)
        gave_up += status == NOT_SOLVED
        assert (status == SOLVED) == (relative_residual(a, b, z) <= 2.0 * FEASIBILITY)
    assert gave_up > 0


def test_semidefinite():
    """Coincident contacts, and more contacts than modes: forces are not unique, the motion is."""
    rng = np.random.default_rng(4)
    for _ in range(100):
        modes = int(rng.integers(2, 8))
        n = int(rng.integers(2, 19))
        shapes = rng.normal(size=(n, modes))
        shapes[n // 2 :] = shapes[: n - n // 2]  # the second half coincides with the first
        gap = np.maximum(0.0, rng.normal(size=n))
        gap[n // 2 :] = gap[: n - n // 2]
        a, b = shapes @ shapes.T, -shapes @ rng.normal(size=modes) + gap  # some motion opens all: feasible
        for solver in ("active set", "lemke"):
            status, z, _ = run(solver, a, b)
            assert status == SOLVED
            assert relative_residual(a, b, z) <= 1e-9, solver  # forces on dependent contacts are large
        _, first, _ = run("active set", a, b)
        np.testing.assert_allclose(a @ z, a @ first, rtol=0, atol=1e-8 * np.abs(b).max())


@pytest.mark.parametrize("solver", SOLVERS)
def test_no_solution_is_said(solver):
    """A contact in the obstacle that its neighbour's push only presses further in: finite, ended, NOT_SOLVED."""
    a, b = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([-1.0, -1.0])
    status, z, _ = run(solver, a, b)
    assert status == NOT_SOLVED
    assert np.all(np.isfinite(z))


@pytest.mark.parametrize("solver", SOLVERS)
def test_disabled_contacts_stay_out(solver):
    """The enabled ones are the smaller problem; the rest has no force, whatever its gap and first guess."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        root = rng.normal(size=(8, 24))
        a, b = root @ root.T / 8, rng.normal(size=8)
        enabled = rng.integers(0, 2, 8).astype(np.uint8)
        status, z, active = run(solver, a, b, enabled, np.ones(8, np.uint8), np.ones(8))
        on = np.flatnonzero(enabled)
        assert status == SOLVED
        assert not np.any(z[enabled == 0]) and not np.any(active[enabled == 0])
        if on.size:
            assert relative_residual(a[np.ix_(on, on)], b[on], z[on]) <= DIRECT


@pytest.mark.parametrize("solver", SOLVERS)
def test_one_contact_is_the_closed_form(solver):
    for b in (-3.0, -1e-9, 0.0, 2.0):
        status, z, _ = run(solver, np.array([[2.5e-7]]), np.array([b]))
        assert status == SOLVED
        assert z[0] == pytest.approx(lcp.single(2.5e-7, b), rel=1e-12, abs=0.0)


def test_arrays_may_be_longer():
    """Space made for more contacts, with what others left there, changes no bit and is not read."""
    rng = np.random.default_rng(8)
    for _ in range(20):
        n, more = 7, 12
        root = rng.normal(size=(n, 20))
        a, b = root @ root.T / 20, rng.normal(size=n)
        wide, factor = rng.normal(size=(more, more)), rng.normal(size=(more, more))
        wide[:n, :n] = a
        ones, index = np.ones(more, np.uint8), np.full(more, 99)
        for solver, solve in (("active set", lcp.solve), ("gauss-seidel", gauss_seidel.solve), ("lemke", lemke.solve)):
            active, z = ones.copy(), np.zeros(more)
            space = (factor, index) if solver != "lemke" else lemke.make_work(more)
            assert solve(wide, b, ones, active, z, *space) == SOLVED
            guess = np.ones(n, np.uint8)
            np.testing.assert_array_equal(z[:n], run(solver, a, b, active=guess, z=np.zeros(n))[1], err_msg=solver)
            assert not np.any(z[n:])


def test_lemke_does_not_cycle():
    """Ties everywhere: integer matrices of low rank with equal right sides, where a plain ratio test has no rule."""
    rng = np.random.default_rng(6)
    for _ in range(200):
        n, rank = int(rng.integers(2, 10)), int(rng.integers(1, 5))
        shapes = rng.integers(-1, 2, size=(n, rank)).astype(float)
        a = shapes @ shapes.T
        b = -shapes @ np.ones(rank)
        status, z, _ = run("lemke", a, b)
        assert status == SOLVED
        assert relative_residual(a, b, z) <= DIRECT if np.any(b) else not np.any(z)


def test_relaxation_starts_from_the_forces_given():
    """At the solution no sweep is needed; from nearby fewer than from nothing."""
    rng = np.random.default_rng(7)
    root = rng.normal(size=(10, 30))
    a, b = root @ root.T / 10, rng.normal(size=10)
    _, z, active = run("active set", a, b)
    sweeps = []
    for guess in (z, z * (1.0 + 1e-6), 0.0 * z):
        start, w = guess.copy(), np.zeros(10)
        status, count = gauss_seidel.relax(a, b, np.ones(10, np.uint8), active.copy(), start, w, 1.0, FEASIBILITY, 1000)
        assert status == SOLVED
        np.testing.assert_allclose(w, a @ start + b, rtol=0, atol=1e-14 * np.abs(b).max())
        sweeps.append(count)
    assert sweeps[0] == 0 < sweeps[1] < sweeps[2]


def test_judge_sees_what_is_not_a_number():
    """A NaN anywhere is the worst residual of all, not none."""
    a, b = np.eye(3), -np.ones(3)
    for place in range(3):
        z = np.ones(3)
        z[place] = np.nan
        assert np.isnan(natural_residual(a, b, z))


# --- as a run meets them ------------------------------------------------------------------------------------------------


def scene(obstacle: dict | None, rate_hz: float, modes: int) -> Scene:
    case = load_case("bass", internal_rate_hz=rate_hz, output_rate_hz=rate_hz, modes=modes)
    if obstacle is not None:
        case = Case.model_validate({**case.model_dump(), "obstacle": obstacle})
    return Scene(case, Path())


def sequence(which: str) -> tuple[np.ndarray, np.ndarray]:
    """(G, b (n, C)) of 25 ms of the bass string over its frets, over a flat wall, and wound on to a curved bridge."""
    obstacle = None
    if which == "wall":
        obstacle = {"positions_m": list(np.arange(1, 101) * 0.863 / 101), "heights_m": -5e-4}
    elif which == "bridge":
        x = np.arange(1, 41) * 1.5e-3
        obstacle = {"positions_m": list(x), "heights_m": list(-0.07 * x * x)}
    here = scene(obstacle, 88_200.0, 231)
    return here.model.string.contacts.matrix, contact_problems(here.model, *here.initial(), 2205)


@pytest.fixture(scope="module", params=["frets", "wall", "bridge"])
def met(request):
    g, problems = sequence(request.param)
    assert len(problems) > 50
    return g, problems


def test_real_problems(met):
    """All solvers find the motion of the recorded steps, to a hundred times what relaxation stops at."""
    g, problems = met
    for b in problems[:: len(problems) // 30]:
        assert_agree(g, b, motion=1e-11)


def test_sequence_with_warm_start(met):
    """In turn, each from the set and the forces of the one before: what a run does."""
    g, problems = met
    n = g.shape[0]
    on = np.ones(n, np.uint8)
    set_, forces, w, z = np.zeros(n, np.uint8), np.zeros(n), np.zeros(n), np.zeros(n)
    loaded = np.zeros(n, np.uint8)
    factor, index = np.zeros((n, n)), np.zeros(n, np.int64)
    for b in problems:
        assert lcp.solve(g, b, on, set_, z, factor, index) == SOLVED
        assert gauss_seidel.relax(g, b, on, loaded, forces, w, 1.0, FEASIBILITY, 5000)[0] == SOLVED
        assert relative_residual(g, b, z) <= 1e-14
        np.testing.assert_allclose(g @ forces, g @ z, rtol=0, atol=1e-11 * np.abs(b).max())


def test_kept_factor_changes_no_bit(met):
    """A factor kept from step to step as far as the set agrees, and one made anew: bitwise the same forces."""
    g, problems = met
    n = g.shape[0]
    on = np.ones(n, np.uint8)
    made = [(np.zeros(n, np.uint8), np.zeros(n), np.zeros((n, n)), np.zeros(n, np.int64)) for _ in range(2)]
    held, most = 0, 0
    for b in problems:
        active, z, factor, index = made[0]
        status, _, held = lcp.pivot(g, b, on, active, z, factor, index, held)
        assert status == SOLVED
        active, plain, factor, index = made[1]
        assert lcp.solve(g, b, on, active, plain, factor, index) == SOLVED
        np.testing.assert_array_equal(z, plain)
        most = max(most, held)
    assert most > 1, "nothing was ever kept: the test shows nothing"
