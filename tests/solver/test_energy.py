"""The energy ledger, no penetration, passivity: the exact-hold scheme's proof, tried on scenes of every kind."""

from __future__ import annotations

import numpy as np
import pytest

from synth.physics.modes import decay_rates, modal_frequencies, mode_shapes, residual_compliance
from synth.physics.string import String
from synth.solver import driver, study
from synth.solver.driver import Finger
from synth.solver.laws import EXACT_HOLD, MOREAU_JEAN, MOREAU_JEAN_FILTERED
from synth.solver.lcp import SOLVED
from synth.solver.stringmodel import StringContacts, StringModes


def random_string(rng) -> String:
    return String.from_inharmonicity(
        length_m=rng.uniform(0.3, 1.2),
        tension_n=rng.uniform(40.0, 250.0),
        linear_density_kg_m=10 ** rng.uniform(-3.3, -2.0),
        inharmonicity=10 ** rng.uniform(-6.0, -3.5) if rng.random() < 0.8 else 0.0,
        diameter_m=rng.uniform(0.2e-3, 1.2e-3),
        viscoelastic_loss=rng.uniform(0.0, 0.01),
        thermoelastic_q_inverse=rng.uniform(0.0, 3e-4),
        air_viscosity=1.8e-5 if rng.random() < 0.8 else 0.0,
        stiffness_law=str(rng.choice(["sqrt", "linear"])),  # type: ignore[arg-type]
    )


def build(string, modes, dt, positions, eta, law=EXACT_HOLD, compliant=False, restitution=0.0, outputs=()):
    contacts = len(positions)
    return driver.make_model(
        law,
        StringModes(string.linear_density_kg_m, modal_frequencies(string, modes), decay_rates(string, modes)),
        dt,
        StringContacts(
            mode_shapes(string.length_m, np.array(positions), modes),
            np.array(eta),
            residual_compliance(string, positions, modes) if compliant else np.zeros((contacts, contacts)),
        ),
        mode_shapes(string.length_m, np.array(outputs), modes),
        restitution,
    )


def random_scene(rng, compliant):
    """ωΔt of the highest mode from 0.3 to 100, 1 to 20 contacts, all a little below a moving string's start."""
    string = random_string(rng)
    modes = int(rng.integers(4, 80))
    omega = modal_frequencies(string, modes)
    dt = 10 ** rng.uniform(-0.5, 2.0) / omega[-1]
    positions = np.sort(rng.uniform(0.02, 0.98, int(rng.integers(1, 21)))) * string.length_m
    j = np.arange(1, modes + 1)
    q = rng.normal(size=modes) * 1e-3 / j ** rng.uniform(1.0, 2.0)
    v = rng.normal(size=modes) * omega * 1e-3 / j ** rng.uniform(1.5, 2.5)
    eta = mode_shapes(string.length_m, positions, modes) @ q - np.abs(rng.normal(size=positions.size)) * 0.5e-3
    return build(string, modes, dt, positions, eta, compliant=compliant), q, v


def run(model, q, v, steps, ledger=True, every=1, force=None, published=False):
    force = np.zeros(model.under.eta.size) if force is None else force
    state = driver.start_run(model, q, v, force, every, steps // every + 1, ledger, published)
    driver.run(model, state, steps)
    return state


@pytest.mark.parametrize("compliant", [False, True])
def test_no_penetration_and_no_energy_from_nowhere(compliant):
    """200 random scenes. Without R: u ≥ η, E never grows. With R: u + Rλ ≥ η, H = E + ½λᵀRλ never grows."""
    rng = np.random.default_rng(2018 + compliant)
    touched = several = fast = 0
    for _ in range(200):
        model, q, v = random_scene(rng, compliant)
        state = run(model, q, v, 300)
        assert state.results.counts[study.BAD_STEPS] == 0
        assert state.results.sums[study.PENETRATION] <= 1e-12
        assert state.results.sums[study.RISE] <= 1e-12
        # damping and contact each only ever take
        assert state.results.sums[study.LEAST_VISCOUS] >= -1e-12
        assert state.results.sums[study.LEAST_CONTACT] >= -1e-12
        touched += state.results.counts[study.CONTACT_STEPS] > 0
        several += bool(np.any((state.results.contact_force > 0).sum(axis=1) > 1))
        fast += model.modes.omega[-1] * model.string.dt > 10.0
        # nothing is missing from the account
        stored, spring, viscous, contact, injected = state.results.energy.T
        np.testing.assert_allclose(stored + spring + viscous + contact, stored[0], rtol=1e-12)
        assert np.all(injected == 0.0) and np.any(np.diff(state.results.energy[:, 2]) > 0)
    assert touched > 150 and several > 80 and fast > 60, (touched, several, fast)


def test_viscous_column_is_the_loss_integral():
    """2μΣσ∫v² dt over each step by Gauss–Legendre quadrature of the exact motion under the held force."""
    from synth.solver.laws import coefficients

    rng = np.random.default_rng(1)
    nodes, weights = np.polynomial.legendre.leggauss(30)
    model, q, v = random_scene(rng, False)
    while not 1.0 < model.modes.omega[-1] * model.string.dt < 4.0:
        model, q, v = random_scene(rng, False)
    total, states = 0.0, []
    state = run(model, q, v, 0)
    state = driver.start_run(model, q, v, np.zeros(model.under.eta.size), 1, 200, True, False)
    contacts = 0
    for step in range(150):
        states = (state.q.copy(), state.v.copy())
        driver.run(model, state, 1)
        contacts += bool(np.any(state.force > 0.0))
        f = state.force @ model.under.shapes
        for x, w in zip(nodes, weights, strict=True):
            part = 0.5 * (x + 1.0) * model.string.dt
            c = coefficients(EXACT_HOLD, model.modes.omega, model.modes.sigma, model.modes.mu, part)
            speed = c[2] * states[0] + c[3] * states[1] + c[5] * f
            total += 0.5 * w * model.string.dt * 2.0 * model.modes.mu * float(model.modes.sigma @ speed**2)
        assert state.results.energy[step + 1, 2] == pytest.approx(total, rel=1e-9)
    assert contacts > 3


def test_stored_energy_is_the_strings():
    """½∫(μu_t² + T u_x² + EI u_xx²) of a shape sampled finely, against the modal sum (the sqrt law is that string's)."""
    string = String.from_inharmonicity(1.0, 100.0, 5e-3, 1e-3, 1e-3)
    rng = np.random.default_rng(0)
    j = np.arange(1, 9)
    q, v = rng.normal(size=8) * 1e-3 / j, rng.normal(size=8)
    x = (np.arange(4000) + 0.5) / 4000
    k = j * np.pi
    slope = np.sqrt(2) * (np.cos(np.outer(x, k)) * k) @ q
    bend = np.sqrt(2) * (np.sin(np.outer(x, k)) * k**2) @ q
    speed = np.sqrt(2) * np.sin(np.outer(x, k)) @ v
    expected = 0.5 * np.mean(
        string.linear_density_kg_m * speed**2 + string.tension_n * slope**2 + string.bending_stiffness_n_m2 * bend**2
    )
    model = build(string, 8, 1e-4, [0.5], [-1.0])
    assert run(model, q, v, 1).results.energy[0, 0] == pytest.approx(expected, rel=1e-12)


def test_pressed_start_begins_from_the_static_contact():
    """The string lies on the points, forces only push, and nothing moves but the undisturbed remainder."""
    rng = np.random.default_rng(6)
    for compliant in (False, True):
        for _ in range(40):
            model, _, _ = random_scene(rng, compliant)
            modes = model.modes.omega.size
            raised = np.abs(rng.normal(size=model.under.eta.size)) * 1e-3 if model.under.eta.size < modes / 2 else None
            if raised is None:
                continue
            model = model.but(eta=raised)
            q, force, status = driver.static_contact(model, np.zeros(modes))
            assert status == SOLVED
            gap = model.under.shapes @ q + model.under.residual @ force - model.under.eta
            assert gap.min() >= -1e-12 and force.min() >= 0.0
            assert np.all(np.minimum(gap, force / max(force.max(), 1e-30)) <= 1e-9)
            # at equilibrium: the ledger sees no loss, no rise, and the forces stay
            state = run(model, q, np.zeros(modes), 100, force=force)
            assert state.results.sums[study.PENETRATION] <= 1e-12
            assert state.results.sums[study.RISE] <= 1e-12
            assert np.abs(state.q - q).max() <= 1e-9 * np.abs(q).max()


def test_a_start_clear_of_the_obstacle_is_left_alone():
    rng = np.random.default_rng(8)
    model, q, _ = random_scene(rng, True)
    lifted, force, status = driver.static_contact(model, q)
    assert status == SOLVED
    np.testing.assert_array_equal(lifted, q)
    np.testing.assert_array_equal(force, 0.0)


# --- Moreau–Jean ------------------------------------------------------------------------------------------------------


def string_over_point(law, restitution, rate, modes):
    string = String.from_inharmonicity(
        1.002, 180.5, 1.17e-3, 1.78e-5, 0.43e-3, viscoelastic_loss=4.5e-3, thermoelastic_q_inverse=2.03e-4
    )
    model = build(string, modes, 1.0 / rate, [0.006], [0.0], law, restitution=restitution)
    j = np.arange(1, modes + 1)
    q = 1e-3 * np.sin(0.5 * j * np.pi) / j**2
    return model, q


@pytest.mark.parametrize("rate", [44100.0, 176400.0])
def test_filtered_form_keeps_its_energy_at_full_restitution(rate):
    model, q = string_over_point(MOREAU_JEAN_FILTERED, 1.0, rate, 60)
    state = run(model, q, np.zeros(60), 4000)
    assert state.results.counts[study.CONTACT_STEPS] > 50
    assert state.results.sums[study.RISE] <= 1e-12


def test_published_form_gains_energy_below_twice_its_modes():
    """The ledger can see it: modes above half the rate, and a step multiplies the energy."""
    model, q = string_over_point(MOREAU_JEAN, 0.0, 44100.0, 400)
    state = run(model, q, np.zeros(400), 2000)
    assert state.results.sums[study.RISE] > 0.01


@pytest.mark.parametrize("law", [MOREAU_JEAN, MOREAU_JEAN_FILTERED])
def test_moreau_jean_account_closes_and_tends_to_the_strings_energy(law):
    model, q = string_over_point(law, 0.0, 1e6, 20)
    state = run(model, q, np.zeros(20), 3000)
    stored, _, viscous, contact, _ = state.results.energy.T
    np.testing.assert_allclose(stored + viscous + contact, stored[0], rtol=1e-11)
    energy = 0.5 * model.modes.mu * float(np.sum((model.modes.omega * q) ** 2))
    assert stored[0] == pytest.approx(energy, rel=1e-2)
    assert state.results.counts[study.CONTACT_STEPS] > 5


# --- fingers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", [EXACT_HOLD, MOREAU_JEAN_FILTERED])
def test_what_a_finger_gives_is_what_the_string_has(law):
    """Drawn slowly from rest and let go: the injected work is the static energy d²/2G_w and every joule is accounted."""
    string = String.from_inharmonicity(0.863, 191.6, 6.69e-3, 3.5e-5, 1.1e-3, viscoelastic_loss=0.01)
    modes, dt, distance = 60, 1.0 / 200_000, 2e-3
    model = build(string, modes, dt, [0.3], [-1.5e-3], law, restitution=1.0)
    j = np.arange(1, modes + 1)
    weights = mode_shapes(0.863, 0.6, modes)[0] * np.sinc(j * 0.01 / (4 * 0.863)) ** 2
    steps = 20_000
    path = distance * 0.5 * (1 - np.cos(np.pi * np.arange(steps + 1) / steps))
    finger = Finger(weights, *model.finger_row(weights), 1e6, 1.0, path, np.zeros(2))
    state = driver.start_run(model, np.zeros(modes), np.zeros(modes), np.zeros(1), 1, 2 * steps + 1, True, False)
    driver.run(model, state, steps - int(state.results.counts[study.STEPS]), finger)
    # an ideal string's shape: the modes' own static compliance under these weights
    static = 0.5 * distance**2 / float(weights @ (weights / (model.modes.mu * model.modes.omega**2)))
    stored = state.results.energy[steps - 1, 0]
    assert stored == pytest.approx(static, rel=0.02)
    assert state.results.energy[steps - 1, 4] >= stored
    driver.run(model, state, steps)
    stored, spring, viscous, contact, injected = state.results.energy.T
    np.testing.assert_allclose(stored + spring + viscous + contact, injected, atol=1e-11 * injected.max())
    assert state.results.counts[study.CONTACT_STEPS] > 10, "the freed string must reach the obstacle"
    if law == EXACT_HOLD:
        assert state.results.sums[study.RISE] <= 1e-12


# --- the driver's own business ----------------------------------------------------------------------------------------


def test_ledger_and_blocks_do_not_change_the_motion():
    """Block kernels with certificates, or one weighed step at a time: the same run to rounding, step for step in contact."""
    rng = np.random.default_rng(44)
    for _ in range(20):
        model, q, v = random_scene(rng, bool(rng.integers(2)))
        model = model.but(out_shapes=rng.normal(size=(2, model.modes.omega.size)))
        weighed = run(model, q, v, 480, ledger=True, every=24).results
        plain = run(model, q, v, 480, ledger=False, every=24).results
        for name in ("u", "contact_u", "contact_force"):
            expected = getattr(weighed, name)
            atol = 1e-10 * np.abs(expected).max()
            np.testing.assert_allclose(getattr(plain, name), expected, rtol=0, atol=atol, err_msg=name)
        assert weighed.counts[study.CONTACT_STEPS] == plain.counts[study.CONTACT_STEPS]
        assert weighed.counts[study.LAST_CONTACT] == plain.counts[study.LAST_CONTACT]


def test_contact_force_is_the_mean_between_rows():
    rng = np.random.default_rng(4)
    model, q, v = random_scene(rng, False)
    fine = run(model, q, v, 400, every=1)
    coarse = run(model, q, v, 400, every=8)
    assert np.any(fine.results.contact_force > 0)
    means = fine.results.contact_force[1:].reshape(50, 8, -1).mean(axis=1)
    np.testing.assert_allclose(coarse.results.contact_force[1:], means, rtol=1e-12)
