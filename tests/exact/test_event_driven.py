"""The event-driven string: closed forms of one and two modes, independence of its pieces, energy, time reversal, grazing."""

from __future__ import annotations

import numpy as np
import pytest

from synth.physics.modes import decay_rates, modal_frequencies, mode_shapes, residual_compliance
from synth.physics.string import String
from synth.research.exact import event_driven

MU = 1e-3


def stiff_string(loss=0.01):
    return String.from_inharmonicity(
        1.0, 160.0, MU, 1e-4, 1e-3, viscoelastic_loss=loss, air_viscosity=1.8e-5 if loss else 0.0
    )


def modes_at(position, n, loss=0.01):
    string = stiff_string(loss)
    return modal_frequencies(string, n), decay_rates(string, n), mode_shapes(1.0, position, n)[0]


def pluck(n):
    j = np.arange(1, n + 1)
    return 2e-3 * np.sin(0.4 * np.pi * j) / j**2 * np.exp(-((j / 12.0) ** 2)), np.zeros(n)


def run(modes, eta, q, v, row_s, rows, residual=0.0):
    omega, sigma, shape = modes
    return event_driven.run(omega, sigma, MU, shape, eta, q, v, row_s, rows, np.eye(omega.size), residual)


# --- closed forms -----------------------------------------------------------------------------------------------------


def test_one_mode_lands_and_stays():
    """q = cos ωt over −½: lands at 2π/(3ω), loses its speed, and its own spring lifts it off again, from rest. Over ½: lands
    at π/(3ω) and is pressed there by μω²/2 for ever."""
    omega, sigma, shape = np.array([100.0]), np.zeros(1), np.ones(1)
    got = event_driven.run(omega, sigma, MU, shape, -0.5, np.ones(1), np.zeros(1), 1e-3, 61, np.eye(1))
    lands = 2.0 * np.pi / 3.0 / 100.0
    t = np.arange(61) * 1e-3
    expected = np.where(t < lands, np.cos(100.0 * t), -0.5 * np.cos(100.0 * (t - lands)))
    assert got.landings == 1 and got.releases == 0
    np.testing.assert_allclose(got.u[:, 0], expected, atol=1e-14)
    assert got.contact_force.sum() * 1e-3 == pytest.approx(MU * 100.0 * np.sin(2.0 * np.pi / 3.0), rel=1e-12)
    assert got.contact_energy[-1] == pytest.approx(0.5 * MU * 100.0**2 * 0.75, rel=1e-12)
    got = event_driven.run(omega, sigma, MU, shape, 0.5, np.ones(1), np.zeros(1), 1e-3, 61, np.eye(1))
    lands = np.pi / 3.0 / 100.0
    np.testing.assert_allclose(got.u[:, 0], np.where(t < lands, np.cos(100.0 * t), 0.5), atol=1e-14)
    np.testing.assert_allclose(got.contact_force[t > lands + 1e-3], 0.5 * MU * 100.0**2, rtol=1e-12)
    assert got.contact_time[-1] == pytest.approx(0.06 - lands, rel=1e-12)


def test_two_modes_held_and_let_go():
    """Landing and release of two lossless modes against their closed forms, by root finding of another kind.

    Held, φ·q = η leaves one oscillator: Ω² = (φ₁²ω₂² + φ₂²ω₁²)/(φ₁² + φ₂²), about the static point.
    """
    from scipy.optimize import brentq

    omega, shape = np.array([100.0, 230.0]), np.array([1.0, 0.7])
    q, eta = np.array([1.6, -0.4]), 0.46
    norm = shape @ shape

    def gap(s):
        return shape @ (q * np.cos(omega * s)) - eta

    grid = np.linspace(0.0, 0.05, 2000)
    first = next(i for i in range(2000) if gap(grid[i]) < 0.0)
    lands = brentq(gap, grid[first - 1], grid[first], xtol=1e-16)
    at, speed = q * np.cos(omega * lands), -q * omega * np.sin(omega * lands)
    after = speed - shape * (shape @ speed) / norm
    held = np.sqrt((shape[0] ** 2 * omega[1] ** 2 + shape[1] ** 2 * omega[0] ** 2) / norm)
    assert event_driven.constrained_frequencies(omega, shape)[0] == pytest.approx(held, rel=1e-13)
    along = np.array([shape[1], -shape[0]]) / np.sqrt(norm)
    static = shape / omega**2 * eta / np.sum(shape**2 / omega**2)
    y, y_dot = along @ (at - static), along @ after

    def place(s):
        return static + along * (y * np.cos(held * s) + y_dot / held * np.sin(held * s))

    def force(s):
        return MU * shape @ (omega**2 * place(s)) / norm

    assert force(0.0) > 0.0
    grid = np.linspace(0.0, 0.2, 4000)
    last = next((i for i in range(4000) if force(grid[i]) < 0.0), None)
    assert last is not None
    lets_go = brentq(force, grid[last - 1], grid[last], xtol=1e-16)
    rows = int((lands + lets_go) / 1e-4)
    got = event_driven.run(omega, np.zeros(2), MU, shape, eta, q, np.zeros(2), 1e-4, rows + 2, np.eye(2))
    t = np.arange(rows + 2) * 1e-4
    expected = np.array([q * np.cos(omega * s) if s < lands else place(s - lands) for s in t[: rows + 1]])
    np.testing.assert_allclose(got.u[: rows + 1], expected, rtol=0, atol=1e-13)
    assert (got.landings, got.releases) == (1, 1)
    assert got.contact_time[-1] == pytest.approx(lets_go, rel=1e-11)
    assert got.last_contact_s == pytest.approx(lands + lets_go, rel=1e-12)
    assert got.contact_energy[-1] == pytest.approx(0.5 * MU * (shape @ speed) ** 2 / norm, rel=1e-12)


def test_constrained_frequencies_are_the_secular_roots():
    omega, _, shape = modes_at(0.37, 12, 0.0)
    held = event_driven.constrained_frequencies(omega, shape)
    assert np.all(held > omega[:-1]) and np.all(held < omega[1:])
    terms = shape**2 / (omega**2 - held[:, None] ** 2)
    np.testing.assert_allclose(terms.sum(axis=1), 0.0, atol=1e-9 * np.abs(terms).max())


@pytest.mark.parametrize("loss", [0.0, 0.05])
def test_contact_phase_against_a_dense_exponential(loss):
    """A string pressed on to a high point never leaves it: v̇ = −P(ω²q + 2σv) by scipy's expm, with one overdamped mode."""
    from scipy.linalg import expm

    n = 9
    omega, sigma, shape = modes_at(0.3, n, loss)
    if loss:
        sigma = sigma.copy()
        sigma[-1] = 1.3 * omega[-1]
    static = shape / omega**2 * 2e-3 / np.sum(shape**2 / omega**2)
    rng = np.random.default_rng(3)
    tangent = np.eye(n) - np.outer(shape, shape) / (shape @ shape)
    q, v = static + tangent @ rng.normal(size=n) * 1e-6, tangent @ rng.normal(size=n) * 1e-3
    got = run((omega, sigma, shape), 2e-3, q, v, 1e-3, 21)
    matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-tangent * omega**2, -tangent * 2.0 * sigma]])
    x = np.concatenate([q, v])
    step = expm(matrix * 1e-4)
    for row in range(1, 21):
        for _ in range(10):
            x = step @ x
        np.testing.assert_allclose(got.u[row], x[:n], rtol=0, atol=1e-9 * np.abs(q).max())
    assert got.landings <= 1 and got.releases == 0 and got.contact_time[-1] == pytest.approx(0.02)


def test_spring_contact_against_an_adaptive_integrator():
    """Thirty modes on R's spring through a dozen bounces: scipy's DOP853 at 1e-11 on v̇ = … + φ max(0, (η − φq)/R)/μ."""
    from scipy.integrate import solve_ivp

    n, eta = 30, -2e-4
    omega, sigma, shape = modes_at(0.05, n)
    residual = float(residual_compliance(stiff_string(), [0.05], n)[0, 0])
    q, v = pluck(n)
    rows = 61
    got = run((omega, sigma, shape), eta, q, v, 1e-4, rows, residual)

    def slope(_, x):
        push = max(0.0, eta - shape @ x[:n]) / (residual * MU)
        return np.concatenate([x[n:], push * shape - omega**2 * x[:n] - 2.0 * sigma * x[n:]])

    t = np.arange(rows) * 1e-4
    start = np.concatenate([q, v])
    other = solve_ivp(slope, (0.0, t[-1]), start, method="DOP853", rtol=1e-11, atol=1e-17, t_eval=t)
    assert got.landings >= 3
    # rtol a step on the velocities, some thousands of steps
    np.testing.assert_allclose(got.u, other.y[:n].T, rtol=0, atol=1e-8 * 2e-3)


# --- what must hold for any motion ------------------------------------------------------------------------------------


@pytest.mark.parametrize("compliant", [False, True])
@pytest.mark.parametrize("position", [0.03, 0.3, 0.71])
def test_pieces_leave_no_trace(position, compliant):
    """Rows 7 times as dense cut time elsewhere and give the same motion: 1e-9, roundings being stretched by each blow."""
    n = 15
    modes = modes_at(position, n)
    residual = float(residual_compliance(stiff_string(), [position], n)[0, 0]) if compliant else 0.0
    q, v = pluck(n)
    rare, dense = (run(modes, -2e-4, q, v, 1e-3 / k, 30 * k + 1, residual) for k in (1, 7))
    assert rare.landings == dense.landings >= 3 and rare.releases == dense.releases
    np.testing.assert_allclose(dense.u[::7], rare.u, rtol=0, atol=1e-9 * 2e-3)
    np.testing.assert_allclose(dense.contact_time[::7], rare.contact_time, rtol=0, atol=1e-9 * 0.03)
    means = dense.contact_force[1:].reshape(-1, 7).mean(axis=1)
    np.testing.assert_allclose(means, rare.contact_force[1:], rtol=0, atol=1e-8 * rare.contact_force.max())
    # no penetration, no pull, energy lost at landings only by the rigid point
    assert rare.contact_u.min() >= -2e-4 - 1e-17 and rare.contact_force.min() >= 0.0
    assert np.all(np.diff(rare.contact_energy) >= 0.0) and (rare.contact_energy[-1] > 0.0) == (not compliant)
    held = rare.energy + rare.spring_energy
    assert np.all(np.diff(held) <= 1e-13 * held[0])


@pytest.mark.parametrize("compliant", [False, True])
def test_lossless_energy(compliant):
    """Without damping all that goes is what landings take; over R's spring nothing goes."""
    n = 15
    modes = modes_at(0.3, n, 0.0)
    residual = float(residual_compliance(stiff_string(0.0), [0.3], n)[0, 0]) if compliant else 0.0
    got = run(modes, -2e-4, *pluck(n), 1e-3, 41, residual)
    held = got.energy + got.spring_energy + got.contact_energy
    np.testing.assert_allclose(held, held[0], rtol=1e-12)
    assert got.landings >= 5


def test_time_reversal_over_the_spring():
    """Lossless and elastic: from the end with velocities turned round back to the pluck. Each blow stretches roundings."""
    n = 12
    modes = modes_at(0.3, n, 0.0)
    residual = float(residual_compliance(stiff_string(0.0), [0.3], n)[0, 0])
    q, v = pluck(n)
    there = run(modes, -2e-4, q, v, 1e-3, 13, residual)
    back = run(modes, -2e-4, there.q, -there.v, 1e-3, 13, residual)
    assert there.landings >= 3 and (back.landings, back.releases) == (there.releases, there.landings)
    np.testing.assert_allclose(back.q, q, rtol=0, atol=1e-9 * np.abs(q).max())
    np.testing.assert_allclose(back.u[::-1], there.u, rtol=0, atol=1e-9 * np.abs(q).max())


def test_scale_mirror_and_shift():
    """u, η and pluck scale together; the mirrored string does the mirrored motion; a run goes on from where one ended."""
    n = 12
    q, v = pluck(n)
    omega, sigma, shape = modes_at(0.3, n)
    plain = run((omega, sigma, shape), -2e-4, q, v, 1e-3, 21)
    np.testing.assert_array_equal(run((omega, sigma, shape), -8e-4, 4.0 * q, v, 1e-3, 21).u, 4.0 * plain.u)
    odd = (-1.0) ** np.arange(n)
    mirrored = run((omega, sigma, modes_at(0.7, n)[2]), -2e-4, odd * q, v, 1e-3, 21)
    np.testing.assert_allclose(mirrored.u * odd, plain.u, rtol=0, atol=1e-9 * 2e-3)
    half = next(k for k in range(5, 15) if plain.contact_u[k] > -1e-4)  # clear of the point
    begin = run((omega, sigma, shape), -2e-4, q, v, 1e-3, half + 1)
    rest = run((omega, sigma, shape), -2e-4, begin.q, begin.v, 1e-3, 21 - half)
    np.testing.assert_allclose(rest.u, plain.u[half:], rtol=0, atol=1e-9 * 2e-3)


# --- nothing is missed ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-9, 1e-12])
def test_grazing_touches_are_found(depth):
    """A crest that dips under the point by `depth` of its height, for √(8·depth)/ω of time, at an odd place in its piece."""
    omega, shape = np.array([100.0, 1.0]), np.array([1.0, 0.0])
    phase = 0.7331
    q, v = np.array([np.cos(phase), 0.0]), np.array([-100.0 * np.sin(phase), 0.0])
    for eta, landings in ((-1.0 + depth, True), (-1.0 - depth, False)):
        got = event_driven.run(omega, np.zeros(2), MU, shape, eta, q, v, 5e-3, 31, np.eye(2))
        assert (got.landings > 0) == landings
        if landings:
            # what is lost is the speed at the point, ω√(2·depth)
            assert got.contact_energy[-1] == pytest.approx(0.5 * MU * 1e4 * (2.0 * depth - depth**2), rel=1e-3)


def test_first_of_several_touches_in_one_piece():
    """Polynomials with roots placed at will: the first crossing is found, touches from above are none."""
    pascal = event_driven._pascal()
    stack, ends = np.empty((60, 25)), np.empty((60, 3))

    def first(polynomial, lead=0):
        series = np.zeros(25)
        coefficients = polynomial.convert(kind=np.polynomial.Polynomial).coef
        series[: coefficients.size] = coefficients
        return event_driven._first_root(series, lead, 24, pascal, stack, ends)

    roots = np.polynomial.Polynomial.fromroots
    assert first(-roots([0.3, 0.300001, 0.9])) == pytest.approx(0.3, abs=1e-9)
    assert first(roots([0.2, 0.25, 0.7, 0.71])) == pytest.approx(0.2, abs=1e-12)
    assert first(roots([0.6, 0.6]) + 1e-13) == -1.0
    assert first(roots([0.6, 0.6]) - 1e-13) == pytest.approx(0.6 - np.sqrt(1e-13), abs=1e-9)
    assert first(roots([-0.5, 1.5]) * -1.0) == -1.0
    assert first(roots([0.0, 0.0, 0.4]) * -1.0, lead=2) == pytest.approx(0.4, abs=1e-14)
    assert first(roots([0.0, 0.0, 1.4]) * -1.0, lead=2) == -1.0
    assert first(roots([0.5, 0.5, 0.5]) * -1.0) == pytest.approx(0.5, abs=1e-5)


def test_starts():
    """Under a rigid point: refused; under R's spring: held by it; pressed on the point at rest: in contact at once."""
    omega, sigma, shape = modes_at(0.3, 8)
    q = shape / omega**2 * 1e-3 / np.sum(shape**2 / omega**2)
    pressed = run((omega, sigma, shape), 1e-3, q, np.zeros(8), 1e-3, 5)
    static = MU * 1e-3 / np.sum(shape**2 / omega**2)
    np.testing.assert_allclose(pressed.contact_force, static, rtol=1e-11)
    np.testing.assert_allclose(pressed.u, np.tile(q, (5, 1)), rtol=0, atol=1e-15)
    with pytest.raises(ValueError, match=r"on or over the point, got 0\.0001 m under it"):
        run((omega, sigma, shape), 1.1e-3, q, np.zeros(8), 1e-3, 5)
    stiffness = 1.0 / (np.sum(shape**2 / omega**2) / MU + 1e-5)
    softly = q * (1e-3 - 1e-5 * stiffness * 1e-3) / 1e-3
    held = run((omega, sigma, shape), 1e-3, softly, np.zeros(8), 1e-3, 5, 1e-5)
    np.testing.assert_allclose(held.contact_force, stiffness * 1e-3, rtol=1e-11)
    np.testing.assert_allclose(held.contact_u, 1e-3, rtol=1e-13)
    with pytest.raises(ValueError, match="must be moved by some mode"):
        run((omega[:1], sigma[:1], np.zeros(1)), 0.0, np.zeros(1), np.zeros(1), 1e-3, 5)
    with pytest.raises(ValueError, match="residual must be ≥ 0"):
        run((omega, sigma, shape), 0.0, np.zeros(8), np.zeros(8), 1e-3, 5, -1.0)
