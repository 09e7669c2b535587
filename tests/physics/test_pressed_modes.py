"""Modes of a string that presses on one point: against the string that ends there, and against all energies of the first."""

from __future__ import annotations

import math

import numpy as np
import pytest

from synth.physics.modes import mode_shapes, ramp_moments, residual_compliance
from synth.physics.pressed_modes import PressedModes, pressed_modes
from synth.physics.string import String

LENGTH_M, TENSION_N, MU = 0.62, 38.5, 3.3e-4
IDEAL = String(LENGTH_M, TENSION_N, MU, 0.0, 2.3e-4)


def made(n: int, from_bridge_m: float, force_n: float = 0.2) -> tuple[PressedModes, dict]:
    """The pressed modes of an ideal string of n modes over a point that rides on its bridge, and what they are made of."""
    omega = np.arange(1, n + 1) * math.pi / LENGTH_M * math.sqrt(TENSION_N / MU)
    place = np.array([LENGTH_M - from_bridge_m])
    of = {
        "omega": omega,
        "sigma": 0.3 + 1e-9 * omega**2,
        "shape": mode_shapes(LENGTH_M, place, n)[0],
        "residual": float(residual_compliance(IDEAL, place, n)[0, 0]),
        "ramp": ramp_moments(LENGTH_M, n),
        "leverage": -from_bridge_m / LENGTH_M,
    }
    end = (LENGTH_M, TENSION_N / LENGTH_M, of["leverage"])
    found = pressed_modes(omega, of["sigma"], MU, of["shape"], of["residual"], of["ramp"], end, force_n)
    return found, of


@pytest.mark.parametrize("from_bridge_m", [0.002, 0.02, 0.11])
def test_it_swings_as_the_two_strings_on_either_side_of_the_point(from_bridge_m: float) -> None:
    found, _ = made(300, from_bridge_m)
    speed = math.sqrt(TENSION_N / MU)
    sides = [np.arange(1, 31) * math.pi * speed / side for side in (LENGTH_M - from_bridge_m, from_bridge_m)]
    expected = np.sort(np.concatenate(sides))[:20]
    assert found.omega[:20] == pytest.approx(expected, rel=2e-5)
    assert abs(found.omega[0] / (math.pi * speed / LENGTH_M) - 1.0) > 1e-3  # and not as the string that does not press


def test_its_energies_are_those_of_the_string_over_its_point() -> None:
    """Of any motion of string and bridge; and its force is what keeps the string on the point."""
    found, of = made(90, 0.004)
    rng = np.random.default_rng(3)
    eta = float(of["shape"] @ found.rest) + of["residual"] * found.force_n
    mass = MU * (LENGTH_M / 3.0 - float(of["ramp"] @ of["ramp"]))
    own_mass = MU * (found.mass_length_m / 3.0 - float(found.ramp @ found.ramp))

    def potential(q: np.ndarray, b: float) -> float:
        sunk = float(of["shape"] @ q) + of["leverage"] * b - eta
        return 0.5 * (MU * float(np.sum((of["omega"] * q) ** 2)) + sunk**2 / of["residual"] + TENSION_N / LENGTH_M * b**2)

    for _ in range(20):
        z, moves = rng.normal(size=(2, 90)) * 1e-4 / np.arange(1, 91)
        b, speed = rng.normal(size=2) * 1e-4
        q, v = found.rest + found.follows * b + z @ found.modes, found.follows * speed + moves @ found.modes
        held = -of["leverage"] * found.force_n * b  # the pull at rest, which is counted from
        own = 0.5 * (MU * float(np.sum((found.omega * z) ** 2)) + found.stiffness * b**2)
        assert potential(q, b) - potential(found.rest, 0.0) - held == pytest.approx(own, rel=1e-9)
        kinetic = 0.5 * (MU * float(np.sum((v + of["ramp"] * speed) ** 2)) + mass * speed**2)
        own = 0.5 * (MU * float(np.sum((moves + found.ramp * speed) ** 2)) + own_mass * speed**2)
        assert kinetic == pytest.approx(own, rel=1e-9)
        sunk = float(of["shape"] @ q) + of["leverage"] * b - eta
        force = found.force_n + float(found.force_of_modes @ z) + found.force_of_end * b
        assert force == pytest.approx(-sunk / of["residual"], rel=1e-6)


def test_it_loses_what_its_modes_lose() -> None:
    found, of = made(60, 0.01)
    assert np.sum(found.sigma) == pytest.approx(np.sum(of["sigma"]))
    assert np.allclose(found.modes @ found.modes.T, np.eye(60), atol=1e-12)
    slow = float(np.sum(of["sigma"] * found.modes[4] ** 2))
    assert found.sigma[4] == pytest.approx(slow)


def test_modes_that_are_left_out_move_with_the_bridge_as_a_mass() -> None:
    found, _ = made(60, 0.01)
    few = found.first(12)
    assert few.omega.size == few.sigma.size == few.ramp.size == few.force_of_modes.size == 12
    assert few.modes.shape == (12, 60) and few.rest.size == few.follows.size == 60
    assert few.mass_length_m == found.mass_length_m and np.array_equal(few.ramp, found.ramp[:12])


@pytest.mark.parametrize(("residual", "force_n"), [(0.0, 0.2), (1e-6, 0.0), (1e-6, -1.0)])
def test_a_point_that_does_not_press_is_refused(residual: float, force_n: float) -> None:
    n = 4
    ones = np.ones(n)
    with pytest.raises(ValueError, match="residual and force_n must be positive"):
        pressed_modes(ones, ones, MU, ones, residual, ones, (1.0, 1.0, 0.0), force_n)
