"""A string that is stopped elsewhere: its shape is kept, and no energy comes."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from synth.physics.modes import mode_shapes
from synth.solver.fret_change import drawn_behind, eased, overlap, release, stop

TENSION, MU = 70.0, 1e-3


def omega(length: float, n: int, stiffness: float) -> np.ndarray:
    """ω (n,) of a pinned string with bending stiffness EI [N m²]."""
    k = np.arange(1, n + 1) * math.pi / length
    return np.sqrt((TENSION * k**2 + stiffness * k**4) / MU)


def energy(w: np.ndarray, y: np.ndarray, length: float, far: float, bridge: float, stiffness: float) -> float:
    moving = 0.5 * MU * float(y @ y + np.sum((omega(length, w.size, stiffness) * w) ** 2))
    return moving + 0.5 * TENSION / length * (bridge - far) ** 2


@pytest.mark.parametrize(("long", "short"), [(0.65, 0.5), (0.6, 0.3), (1.0, 0.75)])
def test_overlap_is_the_integral(long: float, short: float) -> None:
    p = overlap(long, short, 6, 5)
    for i in range(5):
        for j in range(6):
            by_hand, _ = quad(
                lambda x, i=i, j=j: float(mode_shapes(short, x, 5)[0, i] * mode_shapes(long, x + long - short, 6)[0, j]),
                0,
                short,
            )
            assert p[i, j] == pytest.approx(by_hand, abs=1e-9)


def shape(w: np.ndarray, length: float, far: float, bridge: float, x: np.ndarray) -> np.ndarray:
    return mode_shapes(length, x, w.size) @ w + x / length * bridge + (1.0 - x / length) * far


def test_a_string_keeps_its_shape_on_what_is_left_and_on_what_is_added() -> None:
    rng = np.random.default_rng(1)
    w, y = rng.normal(size=12) * 1e-3 / np.arange(1, 13) ** 2, rng.normal(size=12)
    shorter, _, height = stop(w, y, 2e-4, -1e-4, 0.65, 0.5, 400)
    x = np.linspace(0.02, 0.48, 24)
    np.testing.assert_allclose(shape(shorter, 0.5, height, -1e-4, x), shape(w, 0.65, 2e-4, -1e-4, x + 0.15), atol=2e-6)
    longer, _ = release(w, y, 2e-4, -1e-4, 0.5, 0.65, -3e-4, 2000)
    np.testing.assert_allclose(shape(longer, 0.65, -3e-4, -1e-4, x + 0.15), shape(w, 0.5, 2e-4, -1e-4, x), atol=2e-6)
    behind = np.linspace(0.01, 0.14, 6)
    np.testing.assert_allclose(shape(longer, 0.65, -3e-4, -1e-4, behind), -3e-4 + 5e-4 * behind / 0.15, atol=2e-6)


@pytest.mark.parametrize("stiffness", [0.0, 2e-4, 0.05])
def test_no_energy_comes_but_the_hand_s(stiffness: float) -> None:
    rounded = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        long, n = float(rng.uniform(0.4, 1.0)), int(rng.integers(5, 60))
        short = long * float(rng.uniform(0.3, 0.95))
        w, y = rng.normal(size=n) * 1e-3 / np.arange(1, n + 1) ** 2, rng.normal(size=n) * 0.1
        far, bridge, after = rng.normal(size=3) * 1e-4
        kept = max(1, math.ceil(n * short / long))
        shorter, y_short, height = stop(w, y, far, bridge, long, short, kept)
        before = energy(w, y, long, far, bridge, stiffness)
        assert energy(shorter, y_short, short, height, bridge, stiffness) <= before * (1.0 + 1e-12)
        before = energy(shorter, y_short, short, height, bridge, stiffness)
        given = drawn_behind(height, after, TENSION, short, long)
        longer, y_long = release(shorter, y_short, height, bridge, short, long, after, n)
        most = before + given - energy(0.0 * longer, y_long, long, after, bridge, stiffness)
        lessened = eased(longer, omega(long, n, stiffness), MU, most)
        rounded += bool(np.any(lessened != longer))
        assert energy(lessened, y_long, long, after, bridge, stiffness) <= (before + given) * (1.0 + 1e-12)
        if stiffness == 0.0:  # Bessel's inequality is enough: at most rounding is taken off
            np.testing.assert_allclose(lessened, longer, rtol=1e-9, atol=1e-15)
    assert rounded > 0 or stiffness < 0.05
