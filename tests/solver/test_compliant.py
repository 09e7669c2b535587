"""Compliant contacts: laws and Newton by themselves, kernels against twins, energy, differential equations."""

from __future__ import annotations

from functools import cache

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from synth.physics.modes import decay_rates, modal_frequencies, mode_shapes
from synth.physics.string import String
from synth.solver import two_step
from synth.solver.compliant import newton
from synth.solver.penalty import (
    discrete_gradient,
    discrete_gradient_slope,
    force,
    potential,
    root_potential_slope,
    solve_stiffened,
)
from synth.solver.problem import Problem
from synth.solver.schemes import COMPLIANT
from tests.oracles.penalty_steps import Twin

EPS = np.finfo(float).eps
METHODS = tuple(COMPLIANT)


def total(outcome):
    """Energy that is there or has been lost, per row."""
    return outcome.energy[:, :4].sum(axis=1)


def rounding(outcome, modes):
    """Of one step's energy [J]: sums over the modes, and depths that are such sums, times the largest force.

    In the auxiliary forms the law's force at the deepest point, which terms that cancel are made of, may be larger.
    """
    law = force(outcome.notes["stiffness"], outcome.notes["exponent"], outcome.largest_penetration_m)
    strongest = max(law, np.abs(outcome.contact_force).max())
    return 4 * modes * EPS * (total(outcome)[0] + strongest * np.abs(outcome.contact_u).max())


def random_problem(rng, contacts, modes=12, steps=40, every=1, lossless=False, pressed=0.0, span=(-1.0, 1.0)):
    """A string that moves against points a little below it, or pressed; ωΔt of the highest mode 10^span."""
    string = String.from_inharmonicity(
        length_m=rng.uniform(0.3, 1.2),
        tension_n=rng.uniform(40.0, 250.0),
        linear_density_kg_m=10 ** rng.uniform(-3.3, -2.0),
        inharmonicity=10 ** rng.uniform(-6.0, -3.5),
        diameter_m=rng.uniform(0.2e-3, 1.2e-3),
        viscoelastic_loss=rng.uniform(0.0, 0.01),
        thermoelastic_q_inverse=rng.uniform(0.0, 3e-4),
    )
    omega = modal_frequencies(string, modes)
    positions = np.sort(rng.uniform(0.05, 0.95, contacts)) * string.length_m
    shapes = mode_shapes(string.length_m, positions, modes)
    j = np.arange(1, modes + 1)
    q = rng.normal(size=modes) * 1e-3 / j**1.5
    return Problem(
        10 ** rng.uniform(*span) / omega[-1],
        steps,
        every,
        string.linear_density_kg_m,
        omega,
        np.zeros(modes) if lossless else decay_rates(string, modes),
        shapes,
        shapes @ q + pressed - np.abs(rng.normal(size=contacts)) * 1e-5,
        mode_shapes(string.length_m, np.array([0.37 * string.length_m]), modes),
        q,
        rng.normal(size=modes) * omega * 1e-3 / j**2,
    )


def solve(problem, method, ledger=False, **law):
    values = {"stiffness": 1e8, "exponent": 1.5, **law}
    return two_step.solve(problem, two_step.make_model(problem, method, two_step.Law(**values)), ledger)


# --- the law ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.3, 3.0])
@pytest.mark.parametrize(
    ("before", "after"),
    [
        (1e-6, 1e-6),
        (1e-6, 1.0000001e-6),
        (1e-6, 3e-9),
        (2e-9, 1e-6),
        (-1e-4, 1e-7),
        (1e-7, -1e-3),
        (0.0, 1e-8),
        (-1e-5, 0.0),
    ],
)
def test_discrete_gradient_does_not_cancel(exponent, before, after):
    with mpmath.workdps(60):
        x, y, a = mpmath.mpf(before), mpmath.mpf(after), mpmath.mpf(exponent)
        v = [mpmath.mpf(1e10) / (a + 1) * max(g, 0) ** (a + 1) for g in (x, y)]
        exact = (v[1] - v[0]) / (y - x) if x != y else mpmath.mpf(1e10) * x**a
        f = mpmath.mpf(1e10) * max(y, 0) ** a
        slope = (f - exact) / (y - x) if x != y else mpmath.mpf(1e10) * a * x ** (a - 1) / 2
    got = discrete_gradient(1e10, exponent, before, after)
    # a power is good to some ulps, and every other operation to half of one
    assert got == pytest.approx(float(exact), rel=20 * EPS, abs=0)
    assert got == discrete_gradient(1e10, exponent, after, before)
    # 1e-5 is where the difference and the middle value take turns: either is good to 1e-10 there
    assert discrete_gradient_slope(1e10, exponent, before, after, got) == pytest.approx(float(slope), rel=1e-9, abs=0)


def test_root_of_the_potential():
    g = 3e-7
    root = 2 * g * root_potential_slope(1e9, 1.7, g) / 2.7
    assert 0.5 * root**2 == pytest.approx(potential(1e9, 1.7, g), rel=10 * EPS)
    assert root * root_potential_slope(1e9, 1.7, g) == pytest.approx(force(1e9, 1.7, g), rel=10 * EPS)
    assert root_potential_slope(1e9, 1.7, -g) == potential(1e9, 1.7, -g) == force(1e9, 1.7, -g) == 0.0


@pytest.mark.parametrize("contacts", [1, 2, 7, 20])
def test_stiffened_system(contacts):
    rng = np.random.default_rng(contacts)
    root = rng.normal(size=(contacts, contacts + 3))
    a, k = root @ root.T, 10 ** rng.uniform(-3, 3, contacts) * (rng.random(contacts) < 0.7)
    right, x = rng.normal(size=contacts), np.zeros(contacts)
    solve_stiffened(a, k, right, x, np.zeros((contacts, contacts)))
    matrix = np.eye(contacts) + a * k
    np.testing.assert_allclose(x, np.linalg.solve(matrix, right), rtol=0, atol=EPS * 10 * np.linalg.cond(matrix))


@pytest.mark.parametrize("contacts", [1, 3, 12])
@pytest.mark.parametrize("stiffness", [1e3, 1e8, 1e13, 1e17])
def test_newton_from_any_start(contacts, stiffness):
    """r + A f = b with f the discrete gradient, for depths from 1 nm to 1 mm on either side and poor guesses."""
    rng = np.random.default_rng(int(np.log10(stiffness)) + contacts)
    for _ in range(200):
        root = rng.normal(size=(contacts, contacts + 2))
        a = 10 ** rng.uniform(-9, -4) * root @ root.T
        before, b = (rng.choice([-1, 1], contacts) * 10 ** rng.uniform(-9, -3, contacts) for _ in range(2))
        f, r = rng.uniform(0, 10, contacts) * (rng.random() < 0.5), np.zeros(contacts)
        drag = rng.uniform(0, 1e3, contacts) * (rng.random() < 0.5)
        work, matrix = np.zeros((5, contacts)), np.zeros((contacts, contacts))
        done = newton(stiffness, 1.5, a, drag, before, b, f, r, 1e-12, 100, work, matrix)
        assert 0 <= done <= 100
        law = drag * r + [discrete_gradient(stiffness, 1.5, x, x + y) for x, y in zip(before, r, strict=True)]
        # f is the law of r as well as the tolerance on r lets it be, and r + A f = b to rounding
        slope = [discrete_gradient_slope(stiffness, 1.5, x, x + y, z) for x, y, z in zip(before, r, law, strict=True)]
        scale = (np.abs(before) + np.abs(r)).max()
        assert np.all(np.abs(f - law) <= 2e-12 * (slope + drag) * scale + 1e-12 * np.abs(law))
        terms = np.abs(r) + np.abs(b) + np.abs(a) @ np.abs(f)
        assert np.abs(r + a @ f - b).max() <= 100 * EPS * terms.max()


# --- kernels against twins ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("contacts", [1, 3])
@pytest.mark.parametrize("ledger", [False, True])
def test_kernel_is_its_twin(method, contacts, ledger):
    """40 steps from random states in and out of contact: to rounding, which stiff contacts let grow to some 1e-10."""
    pushed = 0
    for seed in range(3):
        rng = np.random.default_rng(100 * contacts + seed)
        p = random_problem(rng, contacts, pressed=3e-4, span=(-1.0, 0.0))
        law = {"exponent": [1.5, 2.0, 1.3][seed]}
        if method == "scalar-auxiliary-variable":
            law["correction"] = [0.0, 0.5, 1.0][seed]
        else:
            law["loss"] = [0.0, 0.1, 3.0][seed]
        outcome = solve(p, method, ledger, stiffness=1e6, **law)
        twin = Twin(method, p.omega, p.sigma, p.mu, p.dt, p.shapes, p.eta, p.q, p.v, 1e6, **law)
        forces, u = [twin.first], [p.out_shapes @ p.q, p.out_shapes @ twin.q]
        for _ in range(p.steps - 1):
            forces.append(twin.step())
            u.append(p.out_shapes @ twin.q)
        forces = np.array(forces, dtype=float)
        pushed += np.count_nonzero(forces)
        np.testing.assert_allclose(outcome.contact_force[1:], forces, rtol=0, atol=1e-9 * np.abs(forces).max())
        np.testing.assert_allclose(outcome.u, np.array(u, dtype=float), rtol=0, atol=1e-9 * np.abs(outcome.u).max())
        assert outcome.unsolved_steps == 0
    assert pushed > 30


def test_one_contact_makes_both_auxiliary_forms_one():
    """With one contact that lasts, G and ψ of both are the same."""
    rng = np.random.default_rng(5)
    p = random_problem(rng, 1)._replace(steps=30)
    p = p._replace(eta=p.shapes @ p.q + 1e-3, v=np.zeros(12), dt=0.01 / p.omega[-1])
    one, other = (solve(p, method, stiffness=1e5) for method in METHODS[1:])
    assert one.contact_steps == other.contact_steps == 30
    np.testing.assert_allclose(one.u, other.u, rtol=1e-10)


# --- energy -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("contacts", [1, 5])
@pytest.mark.parametrize("lossless", [True, False])
def test_energy_is_kept_to_rounding(method, contacts, lossless):
    """The ledger's terms come each from a formula of its own, so that their sum is a test."""
    for seed in range(4):
        p = random_problem(np.random.default_rng(seed), contacts, modes=30, steps=600, lossless=lossless)
        outcome = solve(p, method, True, stiffness=10.0 ** (6 + 3 * (seed % 3)))
        books, step = total(outcome), rounding(outcome, 30)
        assert outcome.contact_steps > 10 and outcome.unsolved_steps == 0
        assert np.all(outcome.energy[:, 0] >= 0) and np.all(outcome.energy[:, 1] >= 0)
        assert np.abs(books - books[0]).max() < 600 * step
        assert outcome.largest_energy_rise * books[0] < step
        assert np.all(outcome.energy[:, 3] == 0.0)
        if lossless:
            assert np.all(outcome.energy[:, 2] == 0.0)


@pytest.mark.parametrize("method", METHODS[:2])
def test_hunt_crossley_only_takes_energy(method):
    for seed in range(3):
        p = random_problem(np.random.default_rng(seed), 3, modes=30, steps=600, lossless=True)
        outcome = solve(p, method, True, loss=1.0)
        books, step = total(outcome), rounding(outcome, 30)
        assert np.all(np.diff(outcome.energy[:, 3]) >= 0) and outcome.energy[-1, 3] > 1e-4 * books[0]
        assert np.abs(books - books[0]).max() < 600 * step
        assert outcome.largest_energy_rise * books[0] < step


def test_ledger_changes_nothing():
    for contacts in (1, 3):
        p = random_problem(np.random.default_rng(contacts), contacts)
        for method in METHODS:
            plain, weighed = solve(p, method), solve(p, method, True)
            np.testing.assert_allclose(plain.u, weighed.u, rtol=0, atol=1e-11 * np.abs(plain.u).max())
            assert plain.energy is None and np.isnan(plain.largest_energy_rise)
            seldom = solve(p._replace(every=8), method)
            np.testing.assert_allclose(seldom.u, plain.u[::8], rtol=0, atol=1e-11 * np.abs(plain.u).max())
            mean = plain.contact_force[1:].reshape(5, 8, contacts).mean(axis=1)
            np.testing.assert_allclose(seldom.contact_force[1:], mean, rtol=1e-8, atol=1e-9 * np.abs(mean).max())


# --- differential equations ---------------------------------------------------------------------------------------------


def oscillator(steps, dt, sigma=5.0):
    """One mode, 100 Hz, 1 mm, over a compliant stop 0.2 mm below."""
    w, one = 2 * np.pi * 100.0, np.ones((1, 1))
    return Problem(
        dt, steps, 1, 1e-3, np.array([w]), np.array([sigma]), one, np.array([-2e-4]), one, np.array([1e-3]), np.zeros(1)
    )


def motion(p, exponent, stiffness, loss, times):
    """The same by an integrator with error control, N modes."""

    def right(t, y):
        q, v = np.split(y, 2)
        depth, rate = p.eta - p.shapes @ q, -p.shapes @ v
        push = stiffness * np.maximum(depth, 0) ** exponent * (1 + loss * rate)
        return np.concatenate([v, -(p.omega**2) * q - 2 * p.sigma * v + push @ p.shapes / p.mu])

    solution = solve_ivp(
        right, (0, times[-1]), np.concatenate([p.q, p.v]), method="DOP853", t_eval=times, rtol=1e-11, atol=1e-13
    )
    return solution.y[: p.q.size].T @ p.out_shapes.T


@cache
def bounces(exponent, stiffness, loss):
    """(41, 1) of the oscillator over 40 ms: the equation has no step."""
    return motion(oscillator(1, 1e-4), exponent, stiffness, loss, np.linspace(0, 0.04, 41))


@pytest.mark.parametrize(
    ("method", "exponent", "stiffness", "loss", "least_order"),
    [
        ("compliant", 1.5, 1e6, 0.0, 1.8),
        ("compliant", 1.5, 1e6, 2.0, 1.8),
        ("energy-quadratisation", 1.5, 1e6, 0.0, 0.5),
        ("energy-quadratisation", 1.5, 1e6, 2.0, 0.5),
        ("scalar-auxiliary-variable", 1.5, 1e6, 0.0, 0.5),
        ("compliant", 3.0, 1e13, 0.0, 1.8),
        ("energy-quadratisation", 3.0, 1e13, 0.0, 1.8),
        ("scalar-auxiliary-variable", 3.0, 1e13, 0.0, 1.8),
    ],
)
def test_single_mode_bounces_as_its_equation_says(method, exponent, stiffness, loss, least_order):
    """Four bounces, five halvings of the step. Order 2 with a discrete gradient and where ψ' is smooth (α = 3).

    Hertz's ψ' ~ g^(1/4) is steep where the string lands: what ψ misses of the step in which it does, some (vΔt)^(5/4),
    depends on where in the step that is, so that the error falls slowly and by fits and starts.
    """
    errors = []
    for k in range(6):
        dt = 1e-4 / 2**k
        steps = round(0.04 / dt)
        p = oscillator(steps, dt)
        exact = bounces(exponent, stiffness, loss)
        got = solve(p, method, stiffness=stiffness, exponent=exponent, loss=loss)
        errors.append(np.abs(got.u[:: steps // 40] - exact).max() / 1e-3)
    assert -np.polyfit(np.arange(6), np.log2(errors), 1)[0] > least_order, errors
    assert errors[-1] < 2e-3


@pytest.mark.parametrize("method", METHODS)
def test_second_order_in_a_smooth_contact(method):
    """A string that stays pressed on two points is a smooth system, where all three have order 2 ± 0.1."""
    rng = np.random.default_rng(1)
    base = random_problem(rng, 2, modes=4)
    base = base._replace(q=0.1 * base.q, v=np.zeros(4), eta=np.array([4e-3, 3e-3]), dt=0.0)
    end = 20.0 / base.omega[-1]
    exact = motion(base, 1.5, 1e4, 0.0, np.linspace(0, end, 51))
    errors = []
    for k in range(6):
        steps = 50 * 2**k
        p = base._replace(dt=end / steps, steps=steps)
        outcome = solve(p, method, stiffness=1e4)
        assert outcome.largest_penetration_m > 0 and np.all(outcome.contact_force > 0)
        errors.append(np.abs(outcome.u[:: 2**k] - exact).max() / np.abs(exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(np.abs(orders[1:] - 2.0) < 0.1)


# --- the auxiliary variable ---------------------------------------------------------------------------------------------


def test_drift_of_the_auxiliary_variable():
    """ψ leaves √(2V) at large steps and comes back to it as they shrink; the correction holds it closer at the large."""
    drift = {}
    for correction, dt in ((0.0, 1e-4), (0.0, 1e-5), (1.0, 1e-4)):
        p = oscillator(round(0.04 / dt), dt, sigma=0.0)
        outcome = solve(p, METHODS[2], True, stiffness=1e6, correction=correction)
        drift[correction, dt] = outcome.notes["auxiliary_drift_relative"]
        books = total(outcome)
        assert np.abs(books / books[0] - 1).max() < p.steps * 100 * EPS
    assert 0 < drift[0.0, 1e-5] < 0.1 * drift[0.0, 1e-4]
    assert drift[1.0, 1e-4] < drift[0.0, 1e-4]
