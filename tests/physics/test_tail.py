"""Lumped modes of the tail: what they keep exactly, what they may never do, and where contacts degenerate."""

import mpmath
import numpy as np
import pytest

from synth.physics.modes import base_frequencies, force_weights, mode_shapes, residual_compliance, static_compliance
from synth.physics.string import String
from synth.physics.tail import DAMPING_RATIO, RESOLVED, lumped_tail

FAST = 1e9  # a contact rate at which nothing is brought down


def compliance(tail, mu):
    return (tail.shapes / (mu * tail.omega**2)) @ tail.shapes.T


@pytest.mark.parametrize("rate", [20e3, 88.2e3, FAST])
@pytest.mark.parametrize("positions", [[0.006], [0.3], [0.048, 0.094, 0.5, 0.86]])
def test_static_compliance_is_that_of_all_modes_left_out(guitar, positions, rate):
    for modes in (0, 20, 103):
        tail = lumped_tail(guitar, positions, modes, rate)
        total = compliance(tail, guitar.linear_density_kg_m) + tail.residual
        expected = residual_compliance(guitar, positions, modes)
        np.testing.assert_allclose(total, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def test_four_moments_of_one_contact_are_matched_against_mpmath(guitar):
    """Σ φ²/ω^2m, m = 1…4, over the modes summed: two lumped modes are their Gauss quadrature."""
    x, modes = 0.006, 103
    tail = lumped_tail(guitar, [x], modes, FAST)
    assert tail.omega.size == 2
    with mpmath.workdps(40):
        length, b = mpmath.mpf(guitar.length_m), mpmath.mpf(guitar.inharmonicity)
        base = 2 * mpmath.pi * mpmath.mpf(guitar.fundamental_hz)
        for m in range(1, 5):
            total = mpmath.mpf(0)
            for j in range(modes + 1, tail.modes + 1):
                phi2 = 2 / length * mpmath.sin(j * mpmath.pi * mpmath.mpf(x) / length) ** 2
                total += phi2 / (base * j * mpmath.sqrt(1 + b * j * j)) ** (2 * m)
            lumped = float(np.sum(tail.shapes[0] ** 2 / tail.omega ** (2 * m)))
            assert lumped == pytest.approx(float(total), rel=1e-10), m


def test_several_contacts_keep_static_compliance_and_inertia(bass):
    """Σ φφᵀ/ω⁴ as a matrix, and the second pair of moments too: block Krylov."""
    positions = np.array([0.048, 0.094, 0.137, 0.5])
    modes = 60
    tail = lumped_tail(bass, positions, modes, FAST)
    assert tail.omega.size == 8
    omega = base_frequencies(bass, tail.modes)[modes:]
    shapes = mode_shapes(bass.length_m, positions, tail.modes)[:, modes:]
    for m in (1, 2, 3, 4):
        expected = (shapes / omega ** (2 * m)) @ shapes.T
        lumped = (tail.shapes / tail.omega ** (2 * m)) @ tail.shapes.T
        np.testing.assert_allclose(lumped, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_they_are_oscillators_and_nothing_else():
    """Passive by form: ω > ω_N, σ > 0 and R ⪰ 0, for random strings, contacts and rates; each Ritz value within the tail."""
    rng = np.random.default_rng(7)
    for _ in range(25):
        string = String.from_inharmonicity(
            rng.uniform(0.1, 1.2),
            rng.uniform(50, 200),
            1e-3 * 10 ** rng.uniform(-0.5, 1),
            10 ** rng.uniform(-6, -3),
            1e-3,
            viscoelastic_loss=rng.uniform(0, 0.01),
            stiffness_law=str(rng.choice(["sqrt", "linear"])),
        )
        modes, contacts = int(rng.integers(1, 200)), int(rng.integers(1, 21))
        positions = np.sort(rng.uniform(0, string.length_m, contacts))
        rate = 10 ** rng.uniform(4, 6)
        tail = lumped_tail(string, positions, modes, rate)
        assert tail.omega.size <= 2 * contacts
        assert np.all(tail.sigma > 0.0) and np.all(np.isfinite(tail.shapes))
        assert np.linalg.eigvalsh(tail.residual)[0] >= -1e-13 * max(np.trace(tail.residual), 1e-300)
        base = base_frequencies(string, tail.modes)
        free = tail.omega < RESOLVED * rate * (1 - 1e-12)
        assert np.all(tail.omega[free] >= base[modes] * (1 - 1e-9))
        assert np.all(tail.omega <= max(base[-1], RESOLVED * rate) * (1 + 1e-9))
        np.testing.assert_allclose(tail.sigma[~free], DAMPING_RATIO * RESOLVED * rate)


def test_what_a_step_cannot_follow_is_one_mode_per_contact(bass):
    """At 44.1 kHz both pairs of Ritz values of 157 modes are too fast: as many modes as contacts, at one frequency."""
    positions = [0.048, 0.094, 0.137]
    tail = lumped_tail(bass, positions, 157, 44_100.0)
    np.testing.assert_allclose(tail.omega, np.full(3, RESOLVED * 44_100.0))


@pytest.mark.parametrize(
    "positions, most",
    [([0.3, 0.3], 2), ([0.3, 0.3 + 1e-10], 4), ([0.0, 0.3, 1.002], 2), ([0.0], 0), ([], 0), ([0.006, 0.00601, 0.00602], 6)],
)
@pytest.mark.parametrize("rate", [44_100.0, FAST])
def test_contacts_that_coincide_or_lie_on_an_end(guitar, positions, most, rate):
    tail = lumped_tail(guitar, positions, 50, rate)
    assert tail.omega.size <= most
    assert np.all(np.isfinite(tail.shapes)) and np.all(tail.omega > 0.0) and np.all(tail.sigma > 0.0)
    total = compliance(tail, guitar.linear_density_kg_m) + tail.residual
    expected = residual_compliance(guitar, positions, 50)
    np.testing.assert_allclose(total, expected, rtol=0, atol=1e-11 * np.abs(expected).max(initial=0.0))


@pytest.mark.parametrize("rate", [44_100.0, FAST])
def test_a_static_force_bends_the_string_as_all_modes_would(guitar, rate):
    """Displacement elsewhere under a force at the contact: kept modes, lumped modes and Green's function."""
    contact, modes = 0.3, 30
    points = np.array([0.1, 0.29, 0.31, 0.7])
    tail = lumped_tail(guitar, [contact], modes, rate)
    mu = guitar.linear_density_kg_m
    omega = base_frequencies(guitar, modes)
    seen = mode_shapes(guitar.length_m, points, tail.modes)
    kept = (seen[:, :modes] / (mu * omega**2)) @ mode_shapes(guitar.length_m, contact, modes)[0]
    lumped = tail.weights(seen) @ (tail.shapes[0] / (mu * tail.omega**2))
    expected = static_compliance(guitar, points, contact)
    # what is behind the modes summed is missing here: its compliance at the contact bounds it
    assert np.abs(kept + lumped - expected).max() <= 1.01 * tail.residual[0, 0] + 1e-12 * expected.max()
    assert np.abs(kept - expected).max() > 10 * tail.residual[0, 0]


@pytest.mark.parametrize("rate", [44_100.0, FAST])
@pytest.mark.parametrize("contact", [0.3, 0.996])
def test_a_static_force_reaches_the_bridge_by_the_law_of_the_lever(guitar, contact, rate):
    """Force on the end x = L per force at the contact: −x_c/L, which 30 modes miss by far where the contact is near.

    Of the series −(2/π) Σ (−1)^(j+1) sin(jπx_c/L)/j what is behind the modes summed, T, is missing here: by Abel's
    summation no more than (2/π)/((T + 1) |cos(πx_c/2L)|).
    """
    modes = 30
    tail = lumped_tail(guitar, [contact], modes, rate)
    mu, length = guitar.linear_density_kg_m, guitar.length_m
    seen = force_weights(guitar, length, tail.modes)
    kept = (seen[:modes] / (mu * base_frequencies(guitar, modes) ** 2)) @ mode_shapes(length, contact, modes)[0]
    lumped = tail.weights(seen) @ (tail.shapes[0] / (mu * tail.omega**2))
    behind = 2.0 / np.pi / ((tail.modes + 1) * abs(np.cos(0.5 * np.pi * contact / length)))
    assert abs(kept + lumped + contact / length) <= behind
    assert abs(kept + contact / length) > 5.0 * behind


@pytest.mark.parametrize("rate", [44_100.0, FAST])
def test_the_shape_that_a_force_gives_is_one_they_can_take(guitar, rate):
    """state() of the modes' answer to a static force is the lumped modes' own answer to it."""
    tail = lumped_tail(guitar, [0.3], 30, rate)
    mu = guitar.linear_density_kg_m
    q = mode_shapes(guitar.length_m, 0.3, tail.modes)[0] / (mu * base_frequencies(guitar, tail.modes) ** 2)
    np.testing.assert_allclose(tail.state(q), tail.shapes[0] / (mu * tail.omega**2), rtol=1e-9)


@pytest.mark.parametrize("rate", [0.0, -1.0, np.inf, np.nan])
def test_a_rate_must_be_one(guitar, rate):
    with pytest.raises(ValueError, match="contact_rate_hz must be > 0"):
        lumped_tail(guitar, [0.3], 30, rate)
