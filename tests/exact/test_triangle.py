"""Closed forms of a plucked ideal string over a point at mid-string and over a flat wall, and the schemes on them."""

from __future__ import annotations

import numpy as np
import pytest

from synth.dsp.measures import relative_error
from synth.research.exact import shapes, triangle, waveguide
from synth.research.simulation import simulate

LENGTH, SPEED, TENSION, PLUCK = 1.0, 400.0, 160.0, 1e-3
X = np.linspace(0.0, LENGTH, 161)


def times(n, cells=160):
    return np.arange(n + 1)[:, None] * (LENGTH / (cells * SPEED))


# --- a point at mid-string ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("height", [-0.9, -0.5, 0.0, 0.25, 0.8])
def test_cabannes_is_what_the_waves_do(height):
    """Everywhere, over three periods: kinks and touches fall on the grid, so that both are exact."""
    steps = 480
    start = shapes.triangle(LENGTH, 0.5, PLUCK, X)
    waves = waveguide.run(
        *waveguide.travelling(start, None, SPEED),
        np.array([80]), np.array([height * PLUCK]), np.arange(161), steps, 1, TENSION, LENGTH,
    )  # fmt: skip
    expected = triangle.cabannes(X, times(steps), LENGTH, SPEED, PLUCK, height)
    np.testing.assert_allclose(waves.u, expected, rtol=0, atol=steps * 2.3e-16 * PLUCK)
    pushed = triangle.cabannes_impulse(times(steps)[:, 0], LENGTH, TENSION, SPEED, PLUCK, height)
    np.testing.assert_allclose(np.diff(pushed), waves.contact_force[1:, 0] / 64e3, rtol=0, atol=1e-12 * pushed[-1])
    assert np.ptp(waves.energy) <= 1e-12 * waves.energy[0]


@pytest.mark.parametrize("height", [-0.9, 0.0, 0.6])
def test_cabannes_repeats_and_reverses(height):
    """Back at the pluck, at rest, after (3 − h)/2 · L/c: so time runs back from there the way it came."""
    period = triangle.cabannes_period(LENGTH, SPEED, height)
    assert period == pytest.approx((3.0 - height) / 800.0, rel=1e-15)
    t = np.linspace(0.0, period, 301)[:, None]
    u = triangle.cabannes(X, t, LENGTH, SPEED, PLUCK, height)
    np.testing.assert_allclose(u[-1], shapes.triangle(LENGTH, 0.5, PLUCK, X), atol=1e-17)
    np.testing.assert_allclose(u[::-1], u, rtol=0, atol=1e-17)
    np.testing.assert_allclose(u[:, ::-1], u, rtol=0, atol=1e-17)
    assert u[:, 80].min() == pytest.approx(height * PLUCK, abs=1e-17)
    # the momentum that the point gives in a period is what the ends take: ∫ 2T u_x(0, t) dt
    pushed = triangle.cabannes_impulse(np.array([period]), LENGTH, TENSION, SPEED, PLUCK, height)[0]
    fine = (np.arange(20_000)[:, None] + 0.5) * period / 20_000
    slope = triangle.cabannes(np.array([1e-9]), fine, LENGTH, SPEED, PLUCK, height)[:, 0] / 1e-9
    taken = 2.0 * TENSION * np.mean(slope) * period
    # the slope jumps by 4A/L at most four times: each is placed to half a piece
    assert abs(pushed - taken) <= 4 * 0.5 * (2.0 * TENSION * 4.0 * PLUCK / LENGTH) * period / 20_000


@pytest.mark.parametrize("height", [-0.5, 0.0, 0.5])
def test_exact_hold_on_cabannes(height):
    """1500 modes at 64 kHz over eight L/c: e below that of a motion late by one step in 160, (2cA/L)Δt in every row.

    The period from the middle's displacement, by the lag of best agreement, is right to a step.
    """
    case = cabannes_case(height)
    exact, got = simulate(case, scheme="cabannes"), simulate(case, scheme="exact-hold", residual_compliance=False)
    late = 2.0 * SPEED * PLUCK / LENGTH / 64e3
    assert relative_error(got.u, exact.u) < late / np.sqrt(np.mean(exact.u**2))
    assert got.contact_force.sum() == pytest.approx(exact.contact_force.sum(), rel=0.01)
    expected = triangle.cabannes_period(LENGTH, SPEED, height) * 64e3
    lags = np.arange(int(0.7 * expected), int(1.3 * expected))
    first = got.u[: got.u.shape[0] // 2, 1]
    agreement = [relative_error(got.u[lag : lag + first.size, 1], first) for lag in lags]
    assert abs(lags[np.argmin(agreement)] - expected) <= 1.0


def cabannes_case(height):
    from synth.research.simulation import load_case

    case = load_case("cabannes").model_dump(exclude_none=True)
    case["obstacle"]["heights_m"] = [height * PLUCK]
    case["run"]["duration_s"] = 0.02
    return case


def test_cabannes_asks_for_its_case():
    for height in (-1.0, 1.0, 3.0):
        with pytest.raises(ValueError, match="between −1 and 1"):
            triangle.cabannes(X, 0.0, LENGTH, SPEED, PLUCK, height)
    with pytest.raises(ValueError, match=r"> 0 m, got -0\.001 m"):
        triangle.cabannes(X, 0.0, LENGTH, SPEED, -PLUCK, 0.0)


# --- a flat wall --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("position", "height"), [(0.5, -0.5), (0.5, 0.0), (0.3, 0.0), (0.5, -0.9)])
def test_wall_pushes_only_where_it_is_touched(position, height):
    """u ≥ wall; the wave equation off the wall; impulses ≥ 0 that are what the momentum of the string changes by."""
    cells = 160
    t = times(4 * cells)
    what = (LENGTH, SPEED, position, PLUCK, height * PLUCK)
    u = triangle.wall(X, t, *what)
    assert u.min() >= height * PLUCK - 1e-18 and u.min() == pytest.approx(height * PLUCK, abs=1e-4 * PLUCK)
    # u(x, t + Δt) + u(x, t − Δt) = u(x + Δx, t) + u(x − Δx, t) + what the wall pushed into the diamond
    pushed = u[2:, 1:-1] + u[:-2, 1:-1] - u[1:-1, 2:] - u[1:-1, :-2]
    assert pushed.min() >= -1e-14 * PLUCK
    clear = u[1:-1, 1:-1] - height * PLUCK > 0.05 * PLUCK
    assert clear.mean() > 0.5 and np.abs(pushed[clear]).max() <= 1e-14 * PLUCK
    # a kick of the velocity by p/μ at one node and instant shows as pushed = (p/μ)Δt
    mu, start, end = TENSION / SPEED**2, t[0, 0], t[-1, 0]
    cut = slice(1, -1)
    impulses = triangle.wall_impulses(X[cut], start, end, LENGTH, TENSION, SPEED, position, PLUCK, height * PLUCK)
    expected = mu * pushed.sum(axis=0) / (LENGTH / (cells * SPEED))
    assert impulses.min() >= 0.0 and impulses.max() > 0.0
    # each edge of the part that lands falls on a node, which then gets half of what its neighbour does or none
    assert abs(impulses.sum() - expected.sum()) <= (1.0 + 1e-9) * impulses.max()


def test_wall_periods():
    """(1 + h)L/c, L/c at rest height (half the free period), 2L/c where the wall is out of reach; and time reversal."""
    for height, period in ((-0.5, 1.5), (0.0, 1.0), (-1.0, 2.0), (-3.0, 2.0)):
        t = np.linspace(0.0, period, 101)[:, None] * LENGTH / SPEED
        u = triangle.wall(X, t, LENGTH, SPEED, 0.5, PLUCK, height * PLUCK)
        np.testing.assert_allclose(u[-1], u[0], atol=1e-17)
        np.testing.assert_allclose(u[::-1], u, rtol=0, atol=1e-17)
        assert np.abs(u[50] - u[0]).max() > 0.9 * PLUCK
    off_centre = triangle.wall(X, times(320), LENGTH, SPEED, 0.2, PLUCK, 0.0)
    np.testing.assert_allclose(off_centre[160], off_centre[0][::-1], atol=1e-17)
    np.testing.assert_array_equal(off_centre, np.abs(triangle.free(X, times(320), LENGTH, SPEED, 0.2, PLUCK)))


@pytest.mark.parametrize("height", [-0.5, 0.0])
def test_filtered_moreau_jean_on_the_modal_grid_is_the_elastic_wall(height):
    """e = 1, a point on every node, Δt = Δx/c: e ∝ Δx^1.5, from the corner's series alone; it falls 2.8 times a halving."""
    errors = []
    for cells in (40, 80, 160):
        case = wall_case(cells, height)
        exact = simulate(case, scheme="flat-wall")
        got = simulate(case, scheme="moreau-jean-filtered")
        errors.append(relative_error(got.u, exact.u))
    assert errors[2] < 1e-3 and 2.0 < errors[0] / errors[1] < 4.0 and 2.0 < errors[1] / errors[2] < 4.0, errors


def test_points_are_no_wall():
    """What is known of other schemes there: neither exact-hold nor restitution 0 is the elastic wall, on any grid."""
    case = wall_case(160, -0.5)
    exact = simulate(case, scheme="flat-wall").u
    for scheme, restitution in (("exact-hold", 1.0), ("moreau-jean-filtered", 0.0)):
        assert relative_error(simulate({**case, "scheme": {"name": scheme, "restitution": restitution}}).u, exact) > 0.3


def wall_case(cells, height):
    return {
        "string": {
            "length_m": LENGTH,
            "tension_n": TENSION,
            "linear_density_kg_m": 1e-3,
            "diameter_m": 4e-4,
            "air_viscosity": 0.0,
        },
        "obstacle": {"positions_m": np.arange(1, cells) / cells, "heights_m": height * PLUCK},
        "initial": {"shape": "triangle", "position_m": 0.5, "displacement_m": PLUCK},
        "run": {
            "internal_rate_hz": SPEED * cells,
            "modes": cells - 1,
            "duration_s": 0.03,
            "outputs_m": [0.25, 0.5],
        },
    }


def test_wall_asks_for_its_case():
    for what, message in (
        ((0.3, PLUCK, -1e-4), "at mid-string, 0.5 m, got 0.3 m"),
        ((0.5, PLUCK, 1e-4), "at or below the string's ends, got a height of 0.0001 m"),
        ((0.5, -PLUCK, -1e-4), "displacement_m must be > 0"),
        ((1.5, PLUCK, 0.0), "between 0 and 1 m"),
    ):
        with pytest.raises(ValueError, match=message):
            triangle.wall(X, 0.0, LENGTH, SPEED, *what)
