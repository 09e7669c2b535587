"""Contacts with a soft, lossy layer in front of what is rigid: passive, exact, and a spring and a dashpot in the limit."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from synth.physics.string import String
from synth.solver import driver, study
from synth.solver.driver import Model
from synth.solver.laws import EXACT_HOLD
from synth.solver.lcp import SOLVED
from synth.solver.stringmodel import DEPTH, RESISTANCE, STIFFNESS

from .test_energy import build, random_scene, run


def random_layers(rng, model: Model) -> np.ndarray:
    """Springs from far softer to far stiffer than the string at the contact, with and without loss, some contacts bare."""
    contacts = model.under.eta.size
    stiffness = 10 ** rng.uniform(-2.0, 2.0, contacts) / np.diag(model.string.contacts.matrix)
    resistance = 10 ** rng.uniform(-2.0, 1.0, contacts) * stiffness * model.string.dt * (rng.random(contacts) < 0.8)
    return np.array([stiffness, resistance, 10 ** rng.uniform(-6.0, -3.0, contacts) * (rng.random(contacts) < 0.8)])


@pytest.mark.parametrize("compliant", [False, True])
def test_layers_gain_nothing_and_have_an_end(compliant: bool) -> None:
    """200 random scenes of 1 to 20 contacts: no step gains energy, nothing goes beyond a layer, nothing pulls."""
    rng = np.random.default_rng(311 + compliant)
    touched = sunk = through = lost = 0
    for _ in range(200):
        model, q, v = random_scene(rng, compliant)
        model = model.but(layers=random_layers(rng, model))
        state = run(model, q, v, 200)
        assert state.results.counts[study.BAD_STEPS] == 0
        assert state.results.sums[study.PENETRATION] <= 1e-12
        assert state.results.sums[study.RISE] <= 1e-12
        assert state.results.sums[study.LEAST_VISCOUS] >= -1e-12
        assert state.results.sums[study.LEAST_CONTACT] >= -1e-12
        assert state.results.contact_force.min() >= 0.0
        stored, held, viscous, contact, injected = state.results.energy.T
        np.testing.assert_allclose(stored + held + viscous + contact, stored[0] + held[0], rtol=1e-12)
        assert not injected.any()
        depth, layers = model.under.eta - state.results.contact_u, model.string.contacts.layers
        touched += state.results.counts[study.CONTACT_STEPS] > 0
        sunk += bool(np.any((depth > 1e-9) & (depth < 0.99 * layers[DEPTH])))
        through += bool(np.any((depth > layers[DEPTH] - 1e-12) & (layers[DEPTH] > 0.0)))
        lost += bool(contact[-1] > 1e-6 * stored[0])
    assert min(touched, sunk, through, lost) > 80, (touched, sunk, through, lost)


def answer(a: np.ndarray, free: np.ndarray, before: np.ndarray, layers: np.ndarray, dt: float) -> np.ndarray:
    """Forces by trying every way in which contacts are out of reach, in their layer, or on the stop behind it."""
    contacts = free.size
    slope = 0.5 * layers[STIFFNESS] + layers[RESISTANCE] / dt
    kept = (0.5 * layers[STIFFNESS] - layers[RESISTANCE] / dt) * np.clip(before, 0.0, layers[DEPTH])
    for ways in product(("out", "soft", "stop"), repeat=contacts):
        rows, right = np.zeros((contacts, contacts)), np.zeros(contacts)
        for c, way in enumerate(ways):  # p = free − A λ
            if way == "out":
                rows[c, c] = 1.0
            elif way == "soft":
                rows[c] = slope[c] * a[c]
                rows[c, c] += 1.0
                right[c] = slope[c] * free[c] + kept[c]
            else:
                rows[c], right[c] = a[c], free[c] - layers[DEPTH, c]
        force = np.linalg.solve(rows, right)
        depth = free - a @ force
        soft = np.where(layers[DEPTH] > 0.0, slope * depth + kept, 0.0)
        tiny, weak = 1e-13 * np.abs(free).max(), 1e-10 * np.abs(force).max()
        fits = [
            {
                "out": soft[c] <= weak and depth[c] <= layers[DEPTH, c] + tiny,
                "soft": layers[DEPTH, c] > 0.0 and force[c] >= -weak and depth[c] <= layers[DEPTH, c] + tiny,
                "stop": force[c] >= max(soft[c], 0.0) - weak,
            }[way]
            for c, way in enumerate(ways)
        ]
        if all(fits):
            return np.maximum(force, 0.0)
    raise AssertionError("no way fits")


@pytest.mark.parametrize("contacts", [1, 2, 3])
def test_the_kernel_is_what_trying_every_way_gives(contacts: int) -> None:
    rng = np.random.default_rng(40 + contacts)
    ways = set()
    for _ in range(25):
        model, q, v = random_scene(rng, True)
        while model.under.eta.size < contacts:
            model, q, v = random_scene(rng, True)
        some = np.sort(rng.choice(model.under.eta.size, contacts, replace=False))
        chosen = np.ix_(some, some)
        model = model.but(shapes=model.under.shapes[some], eta=model.under.eta[some], residual=model.under.residual[chosen])
        model = model.but(layers=random_layers(rng, model))
        state = driver.start_run(model, q, v, np.zeros(contacts), 1, 50, False, False)
        coef = model.string.rows[:, : q.size]
        for _ in range(25):
            u = model.under.shapes @ state.q + model.under.residual @ state.force
            free = model.under.eta - model.under.shapes @ (coef[0] * state.q + coef[1] * state.v)
            matrix, layers = model.string.contacts.matrix, model.string.contacts.layers
            wanted = answer(matrix, free, model.under.eta - u, layers, model.string.dt)
            driver.run(model, state, 1)
            scale = max(wanted.max(), np.abs(free).max() / np.diag(matrix).max())
            assert state.force == pytest.approx(wanted, abs=1e-8 * scale)
            depth = model.under.eta - model.under.shapes @ state.q - model.under.residual @ state.force
            ways |= set(zip((wanted > 0.0).tolist(), (depth < layers[DEPTH] - 1e-13).tolist(), strict=True))
    assert ways >= {(False, True), (True, True), (True, False)}


def test_a_bare_contact_is_the_rigid_one() -> None:
    """Layers that are no metre deep beside those of exact-hold, over as many steps as rounding takes to be heard of."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        model, q, v = random_scene(rng, True)
        bare = run(model.but(layers=np.zeros((3, model.under.eta.size))), q, v, 40)
        rigid = run(model, q, v, 40)
        assert rigid.results.counts[study.CONTACT_STEPS] == bare.results.counts[study.CONTACT_STEPS]
        np.testing.assert_allclose(bare.q, rigid.q, rtol=0.0, atol=1e-9 * np.abs(rigid.q).max())


@pytest.mark.slow
def test_it_tends_to_a_spring_and_a_dashpot() -> None:
    """Eight modes over one deep layer against their differential equation: the error is of second order."""
    string = String.from_inharmonicity(0.6, 80.0, 2e-3, 1e-5, 0.4e-3)
    stiffness, resistance, height = 4e4, 3.0, -2e-4
    base = build(string, 8, 1e-5, [0.45], [height])
    q0, v0 = 1.5e-3 * np.array([1.0, 0.3, -0.2, 0.1, 0.05, -0.05, 0.02, 0.01]), np.zeros(8)
    shape, (mu, omega, sigma) = base.under.shapes[0], base.modes

    def rates(_: float, y: np.ndarray) -> np.ndarray:
        q, v = y[:8], y[8:]
        depth = height - shape @ q
        force = max(0.0, stiffness * depth - resistance * (shape @ v)) if depth > 0.0 else 0.0
        return np.concatenate([v, -(omega**2) * q - 2.0 * sigma * v + shape * force / mu])

    seconds = 4e-3
    start = np.concatenate([q0, v0])
    exact = solve_ivp(rates, (0.0, seconds), start, rtol=1e-10, atol=1e-13, max_step=2e-7, method="DOP853").y[:8, -1]
    errors = []
    for steps in (400, 800, 1600, 3200):
        model = build(string, 8, seconds / steps, [0.45], [height]).but(layers=np.array([[stiffness], [resistance], [1e-2]]))
        state = run(model, q0, v0, steps)
        assert state.results.counts[study.CONTACT_STEPS] > 0.1 * steps
        errors.append(float(np.linalg.norm(state.q - exact) / np.linalg.norm(exact)))
    assert all(error < 1e-4 * (400 / steps) ** 2 for error, steps in zip(errors, (400, 800, 1600, 3200), strict=True))


def test_at_rest_it_gives_way_as_far_as_it_must() -> None:
    """A string lifted on to layers begins in equilibrium, within them or on the stop; nothing moves from there."""
    rng = np.random.default_rng(8)
    soft = stopped = 0
    for _ in range(60):
        model, _, _ = random_scene(rng, True)
        if model.under.eta.size > model.modes.omega.size / 2:
            continue
        model = model.but(eta=np.abs(rng.normal(size=model.under.eta.size)) * 1e-3, layers=random_layers(rng, model))
        q, force, status = driver.static_contact(model, np.zeros(model.modes.omega.size))
        assert status == SOLVED and force.min() >= 0.0
        depth = model.under.eta - model.under.shapes @ q - model.under.residual @ force
        layers = model.string.contacts.layers
        assert np.all(depth <= layers[DEPTH] + 1e-12)
        inside = (depth > 1e-9) & (depth < layers[DEPTH] - 1e-9)
        np.testing.assert_allclose(force[inside], (layers[STIFFNESS] * depth)[inside], rtol=1e-6)
        soft, stopped = soft + inside.any(), stopped + bool(np.any(force > 1.01 * layers[STIFFNESS] * depth))
        state = run(model, q, np.zeros(q.size), 50, force=force)
        assert state.results.sums[study.RISE] <= 1e-12
        assert np.abs(state.q - q).max() <= 1e-8 * np.abs(q).max()
    assert soft > 20 and stopped > 20, (soft, stopped)


def test_divided_steps_and_other_laws_are_refused() -> None:
    string = String.from_inharmonicity(0.6, 80.0, 2e-3, 1e-5, 0.4e-3)
    model = build(string, 8, 1e-5, [0.45], [-1e-4])
    layers = np.array([[1e4], [0.0], [1e-4]])
    for changed in ({"substeps": 2}, {"law": EXACT_HOLD + 1}):
        with pytest.raises(ValueError, match="soft layer need exact-hold with substeps 1"):
            model.but(layers=layers, **changed)
