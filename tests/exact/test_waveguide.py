"""Travelling waves over points: against d'Alembert, against the first-order reflection law, and its own conservation."""

from __future__ import annotations

import numpy as np
import pytest

from synth.physics.excitation import rounded_triangle, sharp_triangle, triangle_pluck
from synth.physics.modes import mode_shapes
from synth.research.exact import shapes, triangle, waveguide

LENGTH, SPEED, TENSION = 1.0, 400.0, 160.0
EPS = np.finfo(float).eps


def run(u, points, eta, outputs, steps, every=1, moving=None):
    waves = waveguide.travelling(u, moving, SPEED)
    return waveguide.run(*waves, np.array(points, int), np.array(eta, float), outputs, steps, every, TENSION, LENGTH)


def pluck(n, position, height=1e-3):
    return shapes.triangle(LENGTH, position, height, np.arange(n + 1) * LENGTH / n)


@pytest.mark.parametrize(
    ("kernel", "modal"),
    [
        ({}, lambda n: sharp_triangle(0.8, 0.13, 2e-3, n)),
        ({"half_width_m": 0.05}, lambda n: rounded_triangle(0.8, 0.13, 2e-3, 0.05, n)),
        ({"half_width_m": 0.2}, lambda n: rounded_triangle(0.8, 0.13, 2e-3, 0.2, n)),
        ({"width_m": 0.1}, lambda n: triangle_pluck(0.8, 0.13, 2e-3, 0.1, n)),
        ({"width_m": 0.5}, lambda n: triangle_pluck(0.8, 0.13, 2e-3, 0.5, n)),
    ],
)
def test_plucked_shapes_are_the_modal_sums(kernel, modal):
    """A corner's series ends like 1/N: the tail bounds the difference (s φ²/k², s the slope jump)."""
    x, n = np.linspace(0.0, 0.8, 161), 20_000
    tail = 2e-3 * (1 / 0.13 + 1 / 0.67) * 2.0 * 0.8 / np.pi**2 / n
    np.testing.assert_allclose(shapes.triangle(0.8, 0.13, 2e-3, x, **kernel), mode_shapes(0.8, x, n) @ modal(n), atol=tail)


def test_free_string_is_dalemberts():
    """Plucked and thrown: u from both waves on the whole grid, to one rounding a row."""
    n, x = 120, np.arange(121) / 120
    q, v = np.array([1e-3, 0.0, -3e-4]), np.array([0.0, 0.7, 0.2])
    k = np.arange(1, 4) * np.pi
    thrown = np.sqrt(2.0) * (1 - np.cos(np.outer(x, k))) @ (v / k)
    got = run(mode_shapes(1.0, x, 3) @ q, [], [], np.arange(n + 1), 500, moving=thrown)
    t = np.arange(501)[:, None] / (n * SPEED)
    motion = np.cos(k * SPEED * t) * q + np.sin(k * SPEED * t) / (k * SPEED) * v
    np.testing.assert_allclose(got.u, motion @ mode_shapes(1.0, x, 3).T, rtol=0, atol=1e-14 * 2e-3)
    assert np.ptp(got.energy) <= 1e-12 * got.energy[0]


@pytest.mark.parametrize(("position", "height", "corner"), [(0.31, -3e-4, 0.3), (0.05, 0.0, 0.5), (0.7, 2e-4, 0.4)])
def test_one_point_is_the_first_order_reflection_law(position, height, corner):
    """Two algorithms without a line in common: to rounding where both stand on one time grid."""
    n, steps = 200, 3000
    got = run(pluck(n, corner), [round(position * n)], [height], [0], steps)

    def free(t):
        return triangle.free(np.array(position), t, LENGTH, SPEED, corner, 1e-3)

    u, push = waveguide.reflection(free, height, position, LENGTH, SPEED, LENGTH / (n * SPEED), steps)
    assert push[-1] > 1e-3
    # p only grows: a rounding of it a step
    np.testing.assert_allclose(got.contact_u[:, 0], u, rtol=0, atol=steps * EPS * push[-1])
    force = 2.0 * TENSION / SPEED * np.diff(push) * (n * SPEED / LENGTH)
    np.testing.assert_allclose(got.contact_force[1:, 0], force, rtol=0, atol=steps * EPS * push[-1] * 160e3)


def test_first_order_law_off_the_grid_converges_to_the_waves():
    """Steps that divide no delay: the error against waves falls in proportion to the step (0.8 to 1.2 over 4 halvings).

    Linear interpolation is exact between kinks, so that only the steps in which one falls err, by up to a step's motion.
    """
    n, corner, position = 800, 0.3, 0.31
    steps = 4 * n
    exact = run(pluck(n, corner), [round(position * n)], [-3e-4], [0], steps).contact_u[:, 0]
    finest = run(pluck(8 * n, corner), [round(position * 8 * n)], [-3e-4], [0], 8 * steps).contact_u[::8, 0]
    assert np.abs(exact - finest).max() < 1e-6
    t = np.arange(8 * steps + 1) * LENGTH / (8 * n * SPEED)
    fine = run(pluck(8 * n, corner), [round(position * 8 * n)], [-3e-4], [0], 8 * steps).contact_u[:, 0]
    errors = []
    for k in range(5):
        dt = 1.237e-5 / 2**k
        u, _ = waveguide.reflection(
            lambda s: triangle.free(np.array(position), s, LENGTH, SPEED, corner, 1e-3),
            -3e-4, position, LENGTH, SPEED, dt, int(t[-1] / dt),
        )  # fmt: skip
        errors.append(np.mean(np.abs(u - np.interp(np.arange(u.size) * dt, t, fine))))
    order = -np.polyfit(np.arange(5), np.log2(errors), 1)[0]
    assert 0.8 < order < 1.2, (order, errors)


def test_points_take_energy_only_where_a_touch_falls_between_nodes():
    """Passive at every step; what is lost, one step's share of each landing, halves with the grid."""
    losses = []
    for n in (200, 400, 800, 1600):
        got = run(pluck(n, 0.2971), [round(0.21 * n), round(0.62 * n)], [-3e-4, -1e-4], [n // 2], 6 * n)
        assert np.diff(got.energy).max() <= 1e-13 * got.energy[0]
        assert np.all(got.contact_u >= np.array([-3e-4, -1e-4]) - 1e-17) and got.contact_force.min() >= 0.0
        losses.append(1.0 - got.energy[-1] / got.energy[0])
    ratios = np.array(losses[:-1]) / losses[1:]
    assert losses[0] > 1e-4 and np.all(ratios > 1.4) and 1.7 < np.mean(ratios) < 2.4, losses


def test_mirror_scale_and_impulse():
    """The mirrored string does the mirrored motion, u, η and pluck scale together, and forces are rates of momentum."""
    n, points, eta = 240, [50, 130], [-2e-4, 1e-4]
    left = run(pluck(n, 0.3), points, eta, [60, 200], 2000)
    right = run(pluck(n, 0.7), [n - 130, n - 50], eta[::-1], [n - 60, n - 200], 2000)
    np.testing.assert_allclose(right.u, left.u, rtol=0, atol=1e-15 * 1e-3 * 100)
    np.testing.assert_allclose(right.contact_force[:, ::-1], left.contact_force, rtol=0, atol=1e-10)
    big = run(4.0 * pluck(n, 0.3), points, [4 * e for e in eta], [60, 200], 2000)
    np.testing.assert_array_equal(big.u, 4.0 * left.u)
    # rows only choose: every fourth, with the mean force over the four
    rows = run(pluck(n, 0.3), points, eta, [60, 200], 2000, every=4)
    np.testing.assert_array_equal(rows.u, left.u[::4])
    np.testing.assert_allclose(rows.contact_force[1:], left.contact_force[1:].reshape(-1, 4, 2).mean(axis=1), rtol=1e-13)
    assert rows.last_contact_step == left.last_contact_step and rows.contact_steps == left.contact_steps


def test_string_thrown_flat_against_a_point_pushes_with_twice_its_impedance():
    """v₀ everywhere, a point at rest height: 2√(Tμ) v₀ until the ends' waves arrive after L/2c, whatever the grid."""
    n, throw = 100, 0.5
    x = np.arange(n + 1) / n
    got = run(np.zeros(n + 1), [n // 2], [0.0], [n // 2], n // 2, moving=-throw * x)
    np.testing.assert_allclose(got.contact_force[1:, 0], 2.0 * TENSION / SPEED * throw, rtol=1e-12)
    np.testing.assert_allclose(got.u, 0.0, rtol=0, atol=1e-17)


def test_what_does_not_fit_the_grid_is_said():
    assert waveguide.cells(1.0, 400.0, 64e3) == 160
    with pytest.raises(ValueError, match=r"got 160\.25; the nearest rates are 64000 or 64400 Hz"):
        waveguide.cells(1.0, 400.0, 64.1e3)
    with pytest.raises(ValueError, match="nearest rates are 800 or 1200 Hz"):
        waveguide.cells(1.0, 400.0, 400.0)
    with pytest.raises(ValueError, match=r"got 0\.303 m; the nearest nodes are at 0\.3 and 0\.31 m"):
        waveguide.nodes("obstacle", np.array([0.303]), 1.0, 100)
    with pytest.raises(ValueError, match=r"clear of its obstacle, got 0\.0005 m under point 2"):
        run(pluck(100, 0.5), [20, 50], [0.0, 1.5e-3], [0], 10)
    with pytest.raises(ValueError, match="at most the shortest way back"):
        waveguide.reflection(np.sin, 0.0, 0.1, 1.0, 400.0, 1e-3, 10)
    with pytest.raises(ValueError, match="narrower than the string"):
        shapes.triangle(1.0, 0.5, 1e-3, np.zeros(1), half_width_m=1.2)
    with pytest.raises(ValueError, match="between 0 and 1 m"):
        shapes.triangle(1.0, 1.5, 1e-3, np.zeros(1))
