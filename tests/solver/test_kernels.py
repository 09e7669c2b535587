"""The block kernels against their twins in `tests.oracles.steps`: one step from many states, then short runs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from synth.solver.laws import (
    EXACT_HOLD,
    MOREAU_JEAN,
    MOREAU_JEAN_FILTERED,
    NUMBERS,
    coefficients,
    contact_matrix,
)
from synth.solver.lcp import SOLVED
from synth.solver.stepwise import advance_free, finger_row, one_by_one
from synth.solver.stringmodel import StringContacts, StringModes, StringOutputs, Strung, make_string
from tests.oracles import steps as twin
from tests.oracles.plain import advance_one

LAWS = list(NUMBERS.values())


class Scene(NamedTuple):
    omega: np.ndarray
    sigma: np.ndarray
    mu: float
    dt: float
    positions: np.ndarray
    shapes: np.ndarray
    eta: np.ndarray
    residual: np.ndarray
    q: np.ndarray
    v: np.ndarray
    restitution: float


def random_scene(rng: np.random.Generator, modes: int, contacts: int, largest_step: float = 3.0) -> Scene:
    """A string of 1 m near its obstacle, states and heights of like size, some modes overdamped."""
    dt = 10 ** rng.uniform(-6.0, -4.3)
    j = np.arange(1, modes + 1)
    omega = largest_step / dt * rng.uniform(0.3, 1.0) * j / modes
    sigma = omega * 10 ** rng.uniform(-5.0, -0.5, modes)
    over = rng.random(modes) < 0.1
    sigma[over] = omega[over] * rng.uniform(1.05, 3.0, over.sum())
    positions = np.sort(rng.uniform(0.03, 0.97, contacts))
    shapes = np.sqrt(2.0) * np.sin(np.pi * np.outer(positions, j))
    q = rng.normal(size=modes) * 1e-3 / j
    v = rng.normal(size=modes) * omega * 1e-3 / j
    eta = shapes @ q + rng.normal(size=contacts) * 0.3e-3
    root = rng.normal(size=(contacts, contacts)) * 0.02 * dt / np.sqrt(1e-3 * max(1, contacts))
    mu = 10 ** rng.uniform(-3.5, -2.0)
    residual = (root @ root.T) / mu if contacts else np.zeros((0, 0))
    return Scene(omega, sigma, mu, dt, positions, shapes, eta, residual, q, v, rng.choice([0.0, 0.3, 1.0]))


def strung(scene: Scene, law: int, steps: int, path=None) -> Strung:
    """Two outputs of displacement, one of velocity."""
    modes = scene.omega.size
    coef = coefficients(law, scene.omega, scene.sigma, scene.mu, scene.dt)
    weights = np.array([np.ones(modes), 1.0 / np.arange(1, modes + 1), np.ones(modes)])
    model = make_string(
        law,
        scene.dt,
        StringModes(scene.mu, scene.omega, scene.sigma),
        coef,
        StringContacts(scene.shapes, scene.eta, scene.residual),
        StringOutputs(weights, on_q=2),
        restitution=scene.restitution,
    )
    return Strung(model, scene.q, scene.v, steps, watched=True, path=path)


def step_kernel(scene: Scene, law: int, steps: int, finger_path=None, watch=None, weights=None):
    """`one_by_one` from the scene's state; also what came out and where the contacts say they are."""
    string = strung(scene, law, steps, finger_path)
    state, modes = string.state, scene.omega.size
    finger = state.finger[0]
    if finger_path is not None:
        state.grip.weights[:modes] = weights
        rows = np.ascontiguousarray(string.model.rows[:6, :modes])
        finger["on"], finger["stiffness"], finger["resistance"], finger["here"] = 1, 2e4, 0.7, weights @ scene.q
        finger["own"] = finger_row(law, rows, scene.shapes, weights, state.grip.coupling)
    if watch is not None:
        string.scratch.watch[: watch.size] = watch
    assert one_by_one(*string.addresses, 0, 0, steps) == SOLVED
    if watch is not None:
        watch[:] = string.scratch.watch[: watch.size]
    out, forces, u = string.out(steps).T, string.forces(steps), string.contact_u(steps)
    held = np.array([finger["here"], finger["push"]])
    return string.q, string.v, state.force, held, out[:, :2], out[:, 2:], forces, u, state.u, state.v_contact


def step_twin(scene: Scene, law: int, q, v, row=None):
    basics = (scene.omega, scene.sigma, scene.mu, scene.dt, scene.shapes, scene.eta)
    if law == EXACT_HOLD:
        return twin.exact_hold_step(*basics, scene.residual, q, v, row)
    return twin.moreau_jean_step(*basics, scene.restitution, law == MOREAU_JEAN_FILTERED, q, v, row)


def close(got, expected, relative=1e-12):
    """Relative to the largest entry: a mode that happens to pass zero has no digits of its own."""
    got, expected = np.asarray(got), np.asarray(expected)
    size = np.abs(expected).max(initial=0.0)
    return np.abs(got - expected).max(initial=0.0) <= relative * size


def energy_norm(scene: Scene, q, v):
    """(ω q, v) in one row: the measure in which both parts of a state weigh alike."""
    return np.concatenate([scene.omega * q, v])


# --- coefficients -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS)
def test_coefficients_against_mpmath(law):
    """From ωΔt = 1e-5 to 100, from lossless to heavily overdamped, critical damping included."""
    import mpmath

    mpmath.mp.dps = 60
    dt, mu = 1e-5, 2e-3
    for x in (1e-5, 1e-3, 0.05, 0.2, 1.0, 3.0, 6.2, 31.0, 100.0):
        for damping in (0.0, 1e-6, 1e-2, 0.3, 0.99999, 1.0, 1.00001, 1.5, 20.0):
            w, s = x / dt, damping * x / dt
            got = coefficients(law, np.array([w]), np.array([s]), mu, dt)[:, 0]
            W, S, T, M = (mpmath.mpf(a) for a in (w, s, dt, mu))
            root = mpmath.sqrt(mpmath.mpc(W * W - S * S))
            cosine = (mpmath.exp(-S * T) * mpmath.cos(root * T)).real
            sine = (mpmath.exp(-S * T) * (mpmath.sin(root * T) / root if root != 0 else T)).real
            if law == EXACT_HOLD:
                p11 = cosine + S * sine
                expected = [p11, sine, -W * W * sine, cosine - S * sine, (1 - p11) / W**2 / M, sine / M]
            else:
                e = mpmath.exp(-2 * S * T)
                missing = 1 - 2 * cosine + e
                filtered = missing / (W * T) ** 2 if law == MOREAU_JEAN_FILTERED else mpmath.mpf(1)
                expected = [1 - missing, T * e, -missing / T, e, T * filtered / M, filtered / M]
            # p and k map states of size (1, ω): one mode's entries are compared in those units
            units = np.array([1.0, 1.0 / w, w, 1.0, 1.0 / (mu * w * w), 1.0 / (mu * w)])
            expected = np.array([float(value) for value in expected])
            assert np.all(np.abs(got - expected) <= 1e-13 * units + 1e-12 * np.abs(expected)), (x, damping)


@pytest.mark.parametrize("law", LAWS)
def test_small_steps_keep_their_digits(law):
    """1 − p11 and the impulse filter lose all digits in the printed forms; here they keep relative accuracy."""
    import mpmath

    mpmath.mp.dps = 60
    w, s, mu, dt = 2 * np.pi * 196.0, 0.8, 1.17e-3, 1e-8
    coef = coefficients(law, np.array([w]), np.array([s]), mu, dt)[:, 0]
    W, S, T = (mpmath.mpf(a) for a in (w, s, dt))
    root = mpmath.sqrt(W * W - S * S)
    cosine = mpmath.exp(-S * T) * mpmath.cos(root * T)
    sine = mpmath.exp(-S * T) * mpmath.sin(root * T) / root
    if law == EXACT_HOLD:
        assert coef[4] == pytest.approx(float((1 - cosine - S * sine) / W**2) / mu, rel=1e-14)
    else:
        missing = 1 - 2 * cosine + mpmath.exp(-2 * S * T)
        assert coef[2] == pytest.approx(float(-missing / T), rel=1e-14)


def test_rigid_mode():
    """ω = σ = 0: constant acceleration, K_q = Δt²/2, K_v = Δt."""
    coef = coefficients(EXACT_HOLD, np.zeros(1), np.zeros(1), 2.0, 0.1)[:, 0]
    np.testing.assert_allclose(coef, [1.0, 0.1, 0.0, 1.0, 0.0025, 0.05], rtol=1e-15, atol=0)


# --- one step ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("with_finger", [False, True])
def test_one_step_from_random_states(law, with_finger):
    """Hundreds of states: every law, 0 to 20 contacts, with and without finger, restitution 0, 0.3 and 1."""
    rng = np.random.default_rng([law, with_finger])
    touched = 0
    for number in range(150):
        contacts = number % 5 if number % 6 else int(rng.integers(5, 21))
        scene = random_scene(rng, int(rng.integers(max(6, contacts), 31)), contacts)
        row, path, weights = None, None, None
        if with_finger:
            weights = np.sqrt(2.0) * np.sin(np.pi * rng.uniform(0.1, 0.9) * np.arange(1, scene.omega.size + 1))
            here = float(weights @ scene.q)
            path = here + rng.normal(size=2) * 1e-4
            row = twin.FingerRow(weights, 2e4, 0.7, (path[0], path[1]))
        q, v, force, finger, out_q, out_v, rec_force, rec_u, u_c, v_c = step_kernel(scene, law, 1, path, weights=weights)
        expected = step_twin(scene, law, scene.q, scene.v, row)
        touched += int(np.any(force > 0.0))
        size = np.abs(energy_norm(scene, scene.q, scene.v)).max()
        wrong = energy_norm(scene, q, v) - energy_norm(scene, expected.q, expected.v)
        assert np.abs(wrong).max() <= 1e-12 * max(size, np.abs(energy_norm(scene, q, v)).max()), number
        # what is reported is what was done
        np.testing.assert_array_equal(rec_force[0], force)
        np.testing.assert_allclose(rec_u[0], scene.shapes @ q, rtol=0, atol=1e-14)
        np.testing.assert_allclose(out_q[0], [q.sum(), (q / np.arange(1, q.size + 1)).sum()], atol=1e-14, rtol=0)
        np.testing.assert_allclose(out_v[0, 0], v.sum(), atol=1e-12 * np.abs(v).sum(), rtol=0)
        if law != EXACT_HOLD:
            np.testing.assert_allclose(u_c, scene.shapes @ q, rtol=0, atol=1e-13)
            np.testing.assert_allclose(v_c, scene.shapes @ v, rtol=0, atol=1e-11 * np.abs(v).max())
        if with_finger:
            assert finger[0] == pytest.approx(weights @ q, rel=0, abs=1e-14)
            assert close(finger[1], expected.finger, 1e-10)
    assert touched > 60, "the states must be such that contact matters"


@pytest.mark.parametrize("law", LAWS)
def test_short_runs(law):
    """200 steps with contacts that open and close: rounding grows, but no further than to 1e-9."""
    rng = np.random.default_rng(7 + law)
    for contacts in (1, 4):
        scene = random_scene(rng, 12, contacts, 1.5)
        scene = scene._replace(sigma=1e-3 * scene.omega)
        q, v, *_, rec_force, _, _, _ = step_kernel(scene, law, 200)
        tq, tv = scene.q, scene.v
        forces = []
        for _ in range(200):
            step = step_twin(scene, law, tq, tv)
            tq, tv = step.q, step.v
            forces.append(step.contact)
        assert 5 < np.any(rec_force > 0.0, axis=1).sum() < 195
        np.testing.assert_array_equal(rec_force > 0.0, np.array(forces) > 0.0)
        assert close(energy_norm(scene, q, v), energy_norm(scene, tq, tv), 1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_blocks_do_not_matter(law):
    """One call of n steps is bitwise n calls of one step."""
    rng = np.random.default_rng(3)
    scene = random_scene(rng, 20, 6, 2.0)
    whole = step_kernel(scene, law, 60)
    string = strung(scene, law, 1)
    for t in range(60):
        assert one_by_one(*string.addresses, 0, 0, 1) == SOLVED
        np.testing.assert_array_equal(string.forces(1)[0], whole[6][t])
    np.testing.assert_array_equal(string.q, whole[0])
    np.testing.assert_array_equal(string.v, whole[1])


# --- the fast kernels -------------------------------------------------------------------------------------------------


def test_one_contact_kernel_is_the_general_one():
    rng = np.random.default_rng(11)
    for _ in range(40):
        scene = random_scene(rng, 25, 1, 2.0)
        coef = coefficients(EXACT_HOLD, scene.omega, scene.sigma, scene.mu, scene.dt)
        g = np.zeros((1, 1))
        contact_matrix(EXACT_HOLD, coef, scene.shapes, scene.residual, g)
        q, v = scene.q.copy(), scene.v.copy()
        out_q, out_v = np.zeros(50), np.zeros(50)
        weights = np.ones(25)
        touched = advance_one(50, coef, scene.shapes[0], scene.eta[0], g[0, 0], q, v, weights, weights, 1, 1, out_q, out_v)
        general = step_kernel(scene, EXACT_HOLD, 50)
        assert touched == np.count_nonzero(general[6])
        assert close(energy_norm(scene, q, v), energy_norm(scene, general[0], general[1]), 1e-10)
        assert close(out_q, general[4][:, 0], 1e-10)
        assert close(out_v, general[5][:, 0], 1e-10)


def test_free_kernel_is_the_exact_motion():
    """1000 steps of the kernel against the closed form at t = 1000 Δt."""
    rng = np.random.default_rng(5)
    scene = random_scene(rng, 30, 0, 3.0)
    coef = coefficients(EXACT_HOLD, scene.omega, scene.sigma, scene.mu, scene.dt)
    q, v = scene.q.copy(), scene.v.copy()
    out_q, out_v = np.zeros(1000), np.zeros(1000)
    ones = np.ones(30)
    advance_free(1000, coef, q, v, ones, ones, 1, 1, out_q, out_v)
    jump = [twin.held_force_propagator(w, s, 1.0, 1000 * scene.dt) for w, s in zip(scene.omega, scene.sigma, strict=True)]
    expected_q = np.array([m[0, 0] * a + m[0, 1] * b for m, a, b in zip(jump, scene.q, scene.v, strict=True)], float)
    expected_v = np.array([m[1, 0] * a + m[1, 1] * b for m, a, b in zip(jump, scene.q, scene.v, strict=True)], float)
    start = energy_norm(scene, scene.q, scene.v)
    wrong = energy_norm(scene, q, v) - energy_norm(scene, expected_q, expected_v)
    assert np.abs(wrong).max() <= 1e-12 * np.abs(start).max()
    assert out_q[-1] == pytest.approx(q.sum(), abs=1e-15)
    assert out_v[-1] == pytest.approx(v.sum(), abs=1e-12 * np.abs(scene.v).sum())


# --- contacts that are not watched ------------------------------------------------------------------------------------


def test_culled_contacts_change_nothing():
    """Contacts that free motion does not reach need no look until something touches: bitwise the same run."""
    rng = np.random.default_rng(23)
    late = 0
    for _ in range(60):
        scene = random_scene(rng, 15, 8, 2.0)
        eta = scene.shapes @ scene.q - rng.uniform(0.1e-3, 6e-3, 8)
        scene = scene._replace(eta=eta, residual=np.zeros((8, 8)))
        watched = step_kernel(scene, EXACT_HOLD, 40)
        touched = np.any(watched[6] > 0.0, axis=1)
        first = int(np.argmax(touched)) if touched.any() else 40
        late += 2 < first < 40
        # only those that are touched first have to be watched
        watch = (watched[6][first] > 0.0).astype(np.uint8) if first < 40 else np.zeros(8, np.uint8)
        culled = step_kernel(scene, EXACT_HOLD, 40, watch=watch)
        np.testing.assert_array_equal(culled[0], watched[0])
        np.testing.assert_array_equal(culled[1], watched[1])
        np.testing.assert_array_equal(culled[6], watched[6])
    assert late > 5


@pytest.mark.parametrize("law", [MOREAU_JEAN, MOREAU_JEAN_FILTERED])
def test_published_matrices_make_the_two_step_form(law):
    """q⁺ = a q − e q⁻ is what both forms do without contact, whatever the coefficients are called."""
    rng = np.random.default_rng(2)
    scene = random_scene(rng, 20, 0, 2.5)
    coef = coefficients(law, scene.omega, scene.sigma, scene.mu, scene.dt)
    before = scene.q - scene.dt * scene.v
    after = coef[0] * scene.q + coef[1] * scene.v
    root = np.sqrt((scene.omega**2 - scene.sigma**2).astype(complex))
    a = 2 * (np.exp(-scene.sigma * scene.dt) * np.cos(root * scene.dt)).real
    e = np.exp(-2 * scene.sigma * scene.dt)
    np.testing.assert_allclose(after, a * scene.q - e * before, rtol=0, atol=1e-14 * np.abs(before).max())
