"""Strings whose mass is uneven along them."""

import random
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh

from synth.physics import modes
from synth.physics.mode_field import normal
from synth.physics.string import String
from synth.physics.uneven_mass import PIECE_M, frequency_factors, scatter_of

LENGTH_M = 0.65


def in_cents(factors: ArrayLike) -> NDArray[np.float64]:
    return 1200.0 * np.log2(factors)


def test_partials_are_as_far_off_as_asked() -> None:
    off = in_cents([frequency_factors(LENGTH_M, scatter_of(1.5, LENGTH_M), seed, 20) for seed in range(400)])
    assert np.all(off[:, 0] == 0.0)
    assert np.sqrt((off[:, 1:] ** 2).mean(axis=0)) == pytest.approx(1.5, rel=0.12)
    assert np.sqrt((off[:, 1:] ** 2).mean()) == pytest.approx(1.5, rel=0.03)
    # independent from partial to partial
    assert np.abs(np.corrcoef(off[:, 1:].T) - np.eye(19)).max() < 0.2


def test_the_same_string_is_the_same() -> None:
    one, again, other = (frequency_factors(LENGTH_M, 0.02, seed, 12) for seed in (3, 3, 4))
    assert np.array_equal(one, again) and not np.array_equal(one, other)
    for more in (40, 1023, 1024, 1025, 3000):
        assert np.array_equal(frequency_factors(LENGTH_M, 0.02, 3, more)[:12], one)
    assert np.array_equal(frequency_factors(LENGTH_M, 0.0, 3, 12), np.ones(12))


def test_factors_are_the_cosines_over_the_pieces() -> None:
    """Term by term, also of the part of a piece at the end, beyond a thousand modes, and of a string of one piece."""
    for length_m, scatter, n in ((0.6513, 0.02, 2100), (0.004, 0.1, 3), (0.01, 0.1, 5)):
        chance, places = random.Random(5), [*np.arange(0.0, length_m, PIECE_M), length_m]
        mode = np.arange(2, n + 1)
        shift = np.zeros(n - 1)
        for start, end in pairwise(places):
            between = np.sin(2.0 * np.pi * mode * end / length_m) - np.sin(2.0 * np.pi * mode * start / length_m)
            shift += 0.25 * scatter * normal(chance) * between / (np.pi * mode)
        assert frequency_factors(length_m, scatter, 5, n)[1:] == pytest.approx(1.0 + shift, rel=1e-15, abs=0.0)


def test_half_the_string_is_more_uneven_and_its_partials_go_on_being_off_alike() -> None:
    off = in_cents([frequency_factors(0.5 * LENGTH_M, scatter_of(1.0, LENGTH_M), seed, 12) for seed in range(400)])
    assert np.sqrt((off[:, 1:] ** 2).mean()) == pytest.approx(np.sqrt(2.0), rel=0.05)
    near = in_cents(frequency_factors(0.999 * LENGTH_M, scatter_of(1.0, LENGTH_M), 5, 6))
    assert near == pytest.approx(in_cents(frequency_factors(LENGTH_M, scatter_of(1.0, LENGTH_M), 5, 6)), abs=0.1)


def test_high_modes_do_not_feel_what_is_finer_than_a_piece() -> None:
    pieces = round(LENGTH_M / PIECE_M)
    off = in_cents([frequency_factors(LENGTH_M, scatter_of(10.0, LENGTH_M), seed, 2 * pieces) for seed in range(40)])
    assert np.abs(off[:, pieces - 1]).max() < 1e-6
    assert np.sqrt((off[:, pieces:] ** 2).mean()) < 3.0
    # of a string that is no worse than false, modes keep their order
    assert np.all(np.diff(np.arange(1, 2 * pieces + 1) * 2.0 ** (0.25 * off / 1200.0), axis=1) > 0.0)


def test_frequencies_are_those_of_a_string_with_that_mass() -> None:
    """Against the eigenvalues of an ideal string with point masses on it, less what the tuning takes."""
    scatter, seed, n, fine = 0.02, 7, 8, 20
    string = String(LENGTH_M, 70.0, 4e-3, 0.0, 1e-3, mass_scatter=scatter, seed=seed)
    shapes = modes.mode_shapes(LENGTH_M, (np.arange(130 * fine) + 0.5) * LENGTH_M / (130 * fine), 200)
    chance = random.Random(seed)
    uneven = np.repeat([scatter * normal(chance) for _ in range(130)], fine)
    mass = (shapes.T * (1.0 + uneven)) @ shapes * LENGTH_M / (130 * fine)
    squares = eigh(np.diag(np.arange(1.0, 201.0) ** 2), mass, eigvals_only=True)
    expected = in_cents(np.sqrt(squares[:n]) / np.arange(1, n + 1))
    found = in_cents(modes.model_frequencies(string, n) / modes.base_frequencies(string, n))
    # the mean mass and what is of second order move all alike or by little
    assert (found - found[1:].mean())[1:] == pytest.approx((expected - expected[1:].mean())[1:], abs=0.12)


def test_both_directions_losses_and_tuning() -> None:
    even = String(LENGTH_M, 70.0, 4e-3, 1e-4, 1e-3, viscoelastic_loss=0.01)
    uneven = replace(even, mass_scatter=0.03, seed=1)
    assert modes.model_frequencies(uneven, 9)[0] == modes.model_frequencies(even, 9)[0]
    moved = modes.model_frequencies(even, 9) * frequency_factors(LENGTH_M, 0.03, 1, 9)
    assert modes.model_frequencies(uneven, 9) == pytest.approx(moved, rel=1e-14)
    assert modes.model_decay_rates(uneven, 9) == pytest.approx(modes.model_decay_rates(even, 9), rel=0.01)
    assert np.array_equal(modes.base_frequencies(uneven, 9), modes.base_frequencies(even, 9))
    # what was measured is uneven already
    measured = replace(uneven, measured_frequencies_hz=(100.0, 201.0))
    assert modes.modal_frequencies(measured, 3)[:2] == pytest.approx(2.0 * np.pi * np.array([100.0, 201.0]))


def test_bounds() -> None:
    with pytest.raises(ValueError, match="mass_scatter must be a number"):
        String(LENGTH_M, 70.0, 4e-3, 1e-4, 1e-3, mass_scatter=-0.1)
