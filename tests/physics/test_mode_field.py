"""A field of modes: its density, its spacings, what its modes do at a point, and that a seed decides it."""

from __future__ import annotations

import numpy as np
import pytest

from synth.instrument.nut_modes import nut_resonances
from synth.instrument.preset import MovingMode, NutMode
from synth.instrument.soundboard import body_of, single_modes
from synth.physics.mode_field import LEAST_SHAPE, Q_SPREAD, field_modes


def many(count: int = 40) -> list:
    return [field_modes(300.0, 8000.0, 40.0, 30.0, seed) for seed in range(count)]


def test_density_and_spacings_follow_wigners_law() -> None:
    spacings = np.concatenate([np.diff([mode.frequency_hz for mode in field]) for field in many()]) / 40.0
    assert spacings.mean() == pytest.approx(1.0, abs=0.02)
    # standard deviation of Wigner's law √(4/π − 1); of independent modes it would be 1, of a comb 0
    assert spacings.std() == pytest.approx(np.sqrt(4.0 / np.pi - 1.0), abs=0.02)
    assert np.mean(spacings < 0.1) == pytest.approx(1.0 - np.exp(-np.pi * 0.01 / 4.0), abs=0.005)


def test_shapes_are_normally_distributed_and_independent() -> None:
    shapes = np.array([mode.shape for field in many() for mode in field])
    assert np.mean(shapes**2, axis=0) == pytest.approx([1.0] * 3, abs=0.05)
    assert np.mean(shapes**4, axis=0) == pytest.approx([3.0] * 3, abs=0.4)
    assert np.abs(np.corrcoef(shapes.T) - np.eye(3)).max() < 0.04
    assert np.abs(shapes).min() >= LEAST_SHAPE


def test_losses_scatter_about_q() -> None:
    logs = np.log([mode.q for field in many() for mode in field])
    assert logs.mean() == pytest.approx(np.log(30.0), abs=0.02)
    assert logs.std() == pytest.approx(Q_SPREAD, abs=0.02)


def test_a_seed_decides_the_field() -> None:
    assert field_modes(300.0, 8000.0, 40.0, 30.0, 7) == field_modes(300.0, 8000.0, 40.0, 30.0, 7)
    assert field_modes(300.0, 8000.0, 40.0, 30.0, 7) != field_modes(300.0, 8000.0, 40.0, 30.0, 8)
    # the numbers of one field, so that a sound is the same in another version of Python
    first = field_modes(300.0, 8000.0, 40.0, 30.0, 7)[1]
    assert (first.frequency_hz, first.q) == pytest.approx((311.0326508217698, 30.140123967671432), rel=1e-12)


def test_mean_mobility_is_that_of_the_density() -> None:
    """⟨Re Y⟩ = π/(2 M Δω) of modes of mass M every Δω: Skudrzyk's mean."""
    mode = MovingMode(frequency_hz=50.0, to_hz=12000.0, spacing_hz=50.0, q=40.0, mass_kg=2.0, shape=(1.0,))
    hz = np.linspace(2000.0, 6000.0, 4000)
    real = [
        body_of([mode.model_copy(update={"seed": seed})]).mobility(2.0 * np.pi * hz)[:, 0, 0].real.mean()
        for seed in range(12)
    ]
    assert np.mean(real) == pytest.approx(np.pi / 2.0 / (2.0 * 2.0 * np.pi * 50.0), rel=0.1)


def test_a_single_mode_is_as_it_is_written() -> None:
    (nut,) = nut_resonances((NutMode(frequency_hz=188.0, q=25.0, mass_kg=2.5),))
    assert (nut.frequency_hz, nut.q, nut.mass_kg, nut.across_mass_kg) == (188.0, 25.0, 2.5, None)
    (mode,) = single_modes(MovingMode(frequency_hz=101.0, q=20.0, mass_kg=1.5, shape=(1.0, 0.1)), 3)
    assert (mode.shape, mode.radiation) == ((1.0, 0.1, 0.0), 1.0)


def test_directions_of_a_nut_are_independent() -> None:
    field = nut_resonances((NutMode(frequency_hz=200.0, to_hz=4000.0, spacing_hz=100.0, q=30.0, mass_kg=2.0, seed=3),))
    along, across = np.array([mode.mass_kg for mode in field]), np.array([mode.across_mass_kg for mode in field])
    assert np.abs(np.corrcoef(np.log(along), np.log(across))[0, 1]) < 0.4
    assert not np.any(along == across)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"to_hz": 1000.0}, "to_hz and spacing_hz make a field of modes together"),
        ({"spacing_hz": 10.0}, "to_hz and spacing_hz make a field of modes together"),
        ({"seed": 4}, "seed chooses the modes of a field, got 4"),
        (
            {"to_hz": 100.0, "spacing_hz": 10.0},
            "must have 2 to 320 modes from frequency_hz to to_hz in the mean, got -10",
        ),
        ({"to_hz": 10000.0, "spacing_hz": 1.0}, "must have 2 to 320 modes .* got 9800"),
        ({"to_hz": 300.0, "spacing_hz": 90.0}, "must have 2 to 320 modes .* got 1.111"),
    ],
)
def test_half_a_field_is_refused(change: dict, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        NutMode(frequency_hz=200.0, q=30.0, mass_kg=2.0, **change)
