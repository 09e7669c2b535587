import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synth.physics.excitation import pluck_weights, rounded_triangle, sharp_triangle, triangle_pluck
from synth.physics.modes import mode_shapes

LENGTH = 1.002
N = 20000  # the shape's remainder falls as 1/N (sharp corner), 1/N² (box), 1/N³ (triangular kernel)


def shape(q, x):
    return mode_shapes(LENGTH, x, q.size) @ q


def test_triangle_is_a_triangle():
    x = np.array([0.1, 0.2, 0.3, 0.6, 0.9])
    expected = 2e-3 * np.minimum(x / 0.3, (LENGTH - x) / (LENGTH - 0.3))
    # Remainder at the corner: slope jump × L/(π² N) = 5e-8 m
    assert np.allclose(shape(sharp_triangle(LENGTH, 0.3, 2e-3, N), x), expected, rtol=0, atol=6e-8)


def test_centred_triangle_by_hand():
    # q_j = √(2/L) · 4 p L/(jπ)² · sin(jπ/2)
    q = sharp_triangle(LENGTH, LENGTH / 2, 1.8e-3, 3)
    first = math.sqrt(2 / LENGTH) * 4 * 1.8e-3 * LENGTH / math.pi**2
    assert q == pytest.approx([first, 0.0, -first / 9], abs=1e-18)


def test_no_width_is_no_smoothing():
    sharp = sharp_triangle(LENGTH, 0.3, 2e-3, 50)
    assert np.array_equal(triangle_pluck(LENGTH, 0.3, 2e-3, 0.0, 50), sharp)
    assert np.array_equal(rounded_triangle(LENGTH, 0.3, 2e-3, 0.0, 50), sharp)


def test_rounded_corner_is_a_parabola_and_the_flanks_stay():
    h, slope = 7e-3, 1.8e-3 / (LENGTH / 2)
    off = np.array([0.0, 2e-3, 5e-3, 7e-3, 9e-3, 50e-3])
    expected = np.where(off < h, 1.8e-3 - slope * (h / 2 + off**2 / (2 * h)), 1.8e-3 - slope * off)
    q = rounded_triangle(LENGTH, LENGTH / 2, 1.8e-3, h, N)
    assert np.allclose(shape(q, LENGTH / 2 + off), expected, rtol=0, atol=1e-10)
    assert np.allclose(shape(q, LENGTH / 2 - off), expected, rtol=0, atol=1e-10)
    assert expected[0] == pytest.approx(1.78743e-3, abs=1e-8)  # not brought back to 1.8 mm


def test_smoothed_crest_is_lower_by_a_twelfth_of_width_times_corner():
    width, position = 12e-3, 0.2
    corner = 2e-3 / position + 2e-3 / (LENGTH - position)
    q = triangle_pluck(LENGTH, position, 2e-3, width, N)
    assert shape(q, position)[0] == pytest.approx(2e-3 - corner * width / 12, abs=1e-11)
    beyond = position + width / 2
    assert shape(q, beyond)[0] == pytest.approx(2e-3 * (LENGTH - beyond) / (LENGTH - position), abs=1e-11)


def test_a_triangular_kernel_is_two_boxes():
    box = rounded_triangle(LENGTH, 0.3, 2e-3, 5e-3, 300)
    sharp = sharp_triangle(LENGTH, 0.3, 2e-3, 300)
    pluck = triangle_pluck(LENGTH, 0.3, 2e-3, 20e-3, 300)  # boxes of ±5 mm: base 20 mm
    assert np.allclose(pluck * sharp, box**2, rtol=1e-12, atol=1e-25)


def test_pluck_weights_average_over_the_finger():
    # ∫ φ_j(y) tri(y − x) dy with a triangle of base w, on a fine midpoint grid
    position, width, n = 0.21, 15e-3, 200
    y = (np.arange(20000) + 0.5) / 20000 * width - width / 2
    kernel = (1 - np.abs(y) / (width / 2)) / (width / 2)
    mean = (kernel * width / 20000) @ mode_shapes(LENGTH, position + y, n)
    # Midpoint rule: (h k)²/24 per cell, h = w/20000, k = 200π/L: 1e-8
    assert np.allclose(pluck_weights(LENGTH, position, width, n), mean, rtol=0, atol=2e-8)


@given(st.floats(0.01, 0.99), st.floats(0.0, 0.3), st.floats(1e-7, 5e-3))
def test_linear_in_displacement_and_mirrored(share, width, displacement):
    x = share * LENGTH
    q = triangle_pluck(LENGTH, x, displacement, width, 40)
    assert np.allclose(triangle_pluck(LENGTH, x, -2 * displacement, width, 40), -2 * q, rtol=1e-14, atol=0)
    mirrored = triangle_pluck(LENGTH, LENGTH - x, displacement, width, 40)
    signs = (-1.0) ** np.arange(40)
    assert np.allclose(mirrored, signs * q, rtol=0, atol=1e-13 * displacement)


@pytest.mark.slow
def test_the_papers_start(reference):
    """The authors' string starts from the triangle rounded by a parabola, peak *not* renormalised."""
    q0 = reference("tanpura_q0.npz")["q0"]
    # Theirs is the sine transform of the shape at 1001 grid nodes; sample ours there and do the same
    n = 1001
    x = LENGTH * np.arange(1, n + 1) / (n + 1)
    sampled = shape(rounded_triangle(LENGTH, LENGTH / 2, 1.8e-3, 7e-3, 200 * n), x)
    on_grid = mode_shapes(LENGTH, x, n).T @ sampled * LENGTH / (n + 1)
    assert np.abs(on_grid - q0).max() < 1e-11
    # and without the grid the low modes, which carry the motion, agree but for what the grid folds in
    ours = rounded_triangle(LENGTH, LENGTH / 2, 1.8e-3, 7e-3, n)
    assert np.abs(ours - q0).max() < 1e-8


@pytest.mark.parametrize("position", [0.0, -0.1, LENGTH, math.nan])
def test_position_must_lie_on_the_string(position):
    for make in (triangle_pluck, rounded_triangle):
        with pytest.raises(ValueError, match=r"pluck position must lie between 0 and the string's 1\.002 m"):
            make(LENGTH, position, 1e-3, 1e-3, 5)
    with pytest.raises(ValueError, match="pluck position"):
        pluck_weights(LENGTH, position, 1e-3, 5)


def test_width_must_not_be_negative():
    with pytest.raises(ValueError, match=r"width_m must be >= 0 m, got -0\.001"):
        triangle_pluck(LENGTH, 0.3, 1e-3, -1e-3, 5)
    with pytest.raises(ValueError, match="half_width_m must be >= 0 m"):
        rounded_triangle(LENGTH, 0.3, 1e-3, math.inf, 5)
