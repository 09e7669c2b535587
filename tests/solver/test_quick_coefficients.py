"""Step coefficients in vectors against those of the laws, mode by mode."""

import numpy as np
import pytest
from numba import njit

from synth.solver.laws import EXACT_HOLD, MOREAU_JEAN, MOREAU_JEAN_FILTERED, coefficients
from synth.solver.quick_coefficients import quick_coefficients

DT, MU = 1.0 / 44100.0, 0.01
ULP = np.finfo(float).eps


@njit
def quick(*arguments):
    quick_coefficients(*arguments)


def rows_of(law, omega, sigma):
    rows = np.full((6, omega.size + 3), 7.0)
    quick(law, omega, sigma, MU, DT, rows)
    assert (rows[:, omega.size :] == 7.0).all()
    return rows[:, : omega.size]


@pytest.mark.parametrize("seed", range(20))
def test_they_are_those_of_the_law(seed):
    """Within some units of the last place of each row's size; kq, which is a difference, of its own."""
    rng = np.random.default_rng(seed)
    turns = rng.uniform(0.0, 40.0, 500) if seed % 2 else 10.0 ** rng.uniform(-4, 3, 500)
    omega = np.ascontiguousarray(turns / DT)
    sigma = 10.0 ** rng.uniform(-9, 0.5, 500) / DT
    got, expected = rows_of(EXACT_HOLD, omega, sigma), coefficients(EXACT_HOLD, omega, sigma, MU, DT)
    sizes = np.array([np.ones(500), np.full(500, DT), omega**2 * DT, np.ones(500), expected[4], np.full(500, DT / MU)])
    worst = (np.abs(got - expected) / sizes).max(axis=1) / ULP
    assert (worst[[0, 1, 2, 3, 5]] < 8.0).all(), worst
    assert worst[4] < 32.0, worst


def test_what_the_series_are_not_for_is_left_to_the_law():
    turns = np.array([0.0, 1e-6, 1001.0, 4e4, 1.0, 1.0, 1.0, 0.01])
    losses = np.array([0.1, 1e-3, 1e-4, 1e-4, 0.9, 1.0, 1.5, 0.005])
    omega, sigma = turns / DT, losses / DT
    np.testing.assert_array_equal(rows_of(EXACT_HOLD, omega, sigma), coefficients(EXACT_HOLD, omega, sigma, MU, DT))


def test_no_loss_is_no_loss():
    """The determinant of a step, by which its energy goes, is 1."""
    omega = np.linspace(1e-3, 30.0, 1000) / DT
    rows = rows_of(EXACT_HOLD, omega, np.zeros(1000))
    assert np.abs(rows[0] * rows[3] - rows[1] * rows[2] - 1.0).max() < 16.0 * ULP


@pytest.mark.parametrize("law", [MOREAU_JEAN, MOREAU_JEAN_FILTERED])
def test_other_laws_are_themselves(law):
    omega, sigma = np.linspace(0.01, 1.9, 40) / DT, np.full(40, 3.0)
    np.testing.assert_array_equal(rows_of(law, omega, sigma), coefficients(law, omega, sigma, MU, DT))
