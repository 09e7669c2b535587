"""Contact forces that change K times a step: the plain scheme at K times the rate, its twin, and its energy."""

from operator import attrgetter

import numpy as np
import pytest

from synth.physics.modes import decay_rates, modal_frequencies, mode_shapes, residual_compliance
from synth.physics.string import String
from synth.solver import driver, study
from synth.solver.driver import Finger
from synth.solver.laws import EXACT_HOLD, MOREAU_JEAN
from synth.solver.stringmodel import StringContacts, StringModes
from tests.oracles.steps import substepped_step

OUT = [0.83, 0.4]


def scene(rng, contacts, substeps, rate_factor=1, compliant=True, points=2):
    """(model, q, v) of a random string a little above its contacts; rate_factor divides the step."""
    string = String.from_inharmonicity(
        1.0, rng.uniform(50, 200), 10 ** rng.uniform(-3, -2), 10 ** rng.uniform(-6, -4), 1e-3, viscoelastic_loss=0.005
    )
    modes = int(rng.integers(6, 60))
    omega = modal_frequencies(string, modes)
    dt = 10 ** rng.uniform(-0.3, 1.3) / omega[-1]
    positions = np.sort(rng.uniform(0.02, 0.98, contacts))
    j = np.arange(1, modes + 1)
    q = rng.normal(size=modes) * 1e-3 / j**1.5
    v = rng.normal(size=modes) * omega * 1e-3 / j**2
    eta = mode_shapes(1.0, positions, modes) @ q - np.abs(rng.normal(size=contacts)) * 0.5e-3
    residual = residual_compliance(string, positions, modes) if compliant else np.zeros((contacts, contacts))
    model = driver.make_model(
        EXACT_HOLD,
        StringModes(string.linear_density_kg_m, omega, decay_rates(string, modes)),
        dt / rate_factor,
        StringContacts(mode_shapes(1.0, positions, modes), eta, residual),
        mode_shapes(1.0, np.array(OUT[:points]), modes),
        1.0,
        substeps,
    )
    return model, q, v


def run(model, q, v, steps, every=1, ledger=False, finger=None):
    state = driver.start_run(model, q, v, np.zeros(model.under.eta.size), every, steps // every + 1, ledger, False)
    driver.run(model, state, steps, finger)
    return state


@pytest.mark.parametrize("count", [2, 3, 4, 5])
@pytest.mark.parametrize("points", [1, 2])
@pytest.mark.parametrize("ledger", [False, True])
def test_one_contact_is_the_plain_scheme_at_k_times_the_rate(count, points, ledger):
    """Outputs, contact positions and mean forces, from random states."""
    touched = 0
    for seed in range(8):
        model, q, v = scene(np.random.default_rng(seed), 1, count, points=points)
        fine, _, _ = scene(np.random.default_rng(seed), 1, 1, rate_factor=count, points=points)
        divided = run(model, q, v, 60, ledger=ledger)
        plain = run(fine, q, v, 60 * count, every=count)
        for name in ("results.u", "results.contact_u", "results.contact_force", "q", "v"):
            expected = attrgetter(name)(plain)
            atol = 1e-10 * np.abs(expected).max()
            np.testing.assert_allclose(attrgetter(name)(divided), expected, rtol=0, atol=atol, err_msg=name)
        touched += int(divided.results.counts[study.CONTACT_STEPS])
    assert touched > 30


@pytest.mark.parametrize("every", [1, 3])
def test_blocks_of_any_length_are_the_same_run(every):
    model, q, v = scene(np.random.default_rng(3), 1, 2, points=1)
    whole = run(model, q, v, 600, every=every)
    pieces = driver.start_run(model, q, v, np.zeros(1), every, 600 // every + 1, False, False)
    for n in (1, 2, 7, 90, 200, 300):
        driver.run(model, pieces, n)
    np.testing.assert_allclose(pieces.results.u, whole.results.u, rtol=0, atol=1e-10 * np.abs(whole.results.u).max())
    force = whole.results.contact_force
    np.testing.assert_allclose(pieces.results.contact_force, force, rtol=0, atol=1e-9 * np.abs(force).max())


@pytest.mark.parametrize("ledger", [False, True])
def test_several_contacts_against_the_twin(ledger):
    """Whole steps in the open, parts where it touches: state and mean forces of every step."""
    touched = whole = 0
    for seed in range(6):
        count = 2 + seed % 4
        model, q, v = scene(np.random.default_rng(100 + seed), 2 + seed % 3, count)
        state, (mu, omega, sigma) = run(model, q, v, 40, ledger=ledger), model.modes
        divide = False
        u, forces = [model.out_shapes @ q], [np.zeros(model.under.eta.size)]
        for _ in range(40):
            step, divide, means = substepped_step(omega, sigma, mu, model.string.dt, count, *model.under[:3], q, v, divide)
            q, v = step.q, step.v
            u.append(model.out_shapes @ q)
            forces.append(means)
            whole += not divide
            touched += bool(np.any(means > 0.0))
        np.testing.assert_allclose(state.results.u, u, rtol=0, atol=1e-9 * np.abs(u).max())
        np.testing.assert_allclose(state.results.contact_force, forces, rtol=0, atol=1e-8 * np.abs(forces).max())
    assert touched > 20 and whole > 20, (touched, whole)


def test_several_contacts_of_which_one_is_pressed_are_the_plain_scheme():
    """A contact that is always pressed divides every step."""
    rng = np.random.default_rng(5)
    model, q, _ = scene(rng, 3, 4)
    fine, _, _ = scene(np.random.default_rng(5), 3, 1, rate_factor=4)
    eta = np.array([model.under.eta[0], 2e-3, model.under.eta[2]])
    model, fine = model.but(eta=eta), fine.but(eta=eta)
    q, force, _ = driver.static_contact(fine, np.zeros(q.size))
    v = 1e-3 * model.modes.omega[0] * np.eye(q.size)[2]
    runs = []
    for m, count in ((model, 1), (fine, 4)):
        state = driver.start_run(m, q, v, force, count, 41, False, False)
        driver.run(m, state, 40 * count)
        runs.append(state.results)
    assert np.all(runs[0].contact_force[1:, 1] > 0.0)
    np.testing.assert_allclose(runs[0].u[1:], runs[1].u[1:], rtol=0, atol=1e-10 * np.abs(runs[1].u).max())


@pytest.mark.parametrize("compliant", [False, True])
def test_no_penetration_and_no_energy_from_nowhere(compliant):
    """200 random scenes: at every end of a part or whole step u + Rλ ≥ η and H = E + ½λᵀRλ has not grown."""
    rng = np.random.default_rng(40 + compliant)
    touched = several = divided = 0
    for number in range(200):
        count = 2 + number % 5
        contacts = 1 if number % 3 == 0 else int(rng.integers(2, 13))
        model, q, v = scene(rng, contacts, count, compliant=compliant)
        state = run(model, q, v, 150, ledger=True)
        assert state.results.counts[study.BAD_STEPS] == 0
        assert state.results.sums[study.PENETRATION] <= 1e-12
        assert state.results.sums[study.RISE] <= 1e-12
        assert state.results.sums[study.LEAST_VISCOUS] >= -1e-12
        assert state.results.sums[study.LEAST_CONTACT] >= -1e-12
        stored, spring, viscous, contact, _ = state.results.energy.T
        np.testing.assert_allclose(stored + spring + viscous + contact, stored[0], rtol=1e-12)
        touched += state.results.counts[study.CONTACT_STEPS] > 0
        several += bool(np.any((state.results.contact_force > 0).sum(axis=1) > 1))
        divided += contacts > 1 and 0 < state.results.counts[study.CONTACT_STEPS] < 150
    assert touched > 150 and several > 60 and divided > 80, (touched, several, divided)


@pytest.mark.parametrize("contacts", [1, 3])
def test_a_finger_is_the_plain_scheme_at_k_times_the_rate(contacts):
    """Drawn aside and let go, path given at every part; one contact also in what follows."""
    count, steps = 3, 80
    model, q, v = scene(np.random.default_rng(9), contacts, count)
    fine, _, _ = scene(np.random.default_rng(9), contacts, 1, rate_factor=count)
    weights = mode_shapes(1.0, 0.37, q.size)[0]
    path = float(weights @ q) + 1e-3 * np.linspace(0.0, 1.0, steps * count + 1)
    runs = []
    for m, every, ledger in ((model, 1, False), (model, 1, True), (fine, count, False)):
        finger = Finger(weights, *fine.finger_row(weights), 1e5, 1.0, path, np.array([path[0], 0.0]))
        runs.append(run(m, q, v, steps * every, every=every, ledger=ledger, finger=finger))
    for state in runs[:2]:
        np.testing.assert_allclose(state.results.u, runs[2].results.u, rtol=0, atol=1e-10 * np.abs(runs[2].results.u).max())
        np.testing.assert_allclose(state.q, runs[2].q, rtol=0, atol=1e-10 * np.abs(runs[2].q).max())


def test_what_cannot_be_divided_is_refused():
    model, _, _ = scene(np.random.default_rng(0), 1, 1)
    given = (
        model.modes,
        model.string.dt,
        model.under,
        model.out_shapes,
        0.0,
    )
    for count in (0, -1, 1.5):
        with pytest.raises(ValueError, match="substeps must be a whole number >= 1"):
            driver.make_model(EXACT_HOLD, *given, count)
    with pytest.raises(ValueError, match="substeps need exact-hold"):
        driver.make_model(MOREAU_JEAN, *given, 2)
