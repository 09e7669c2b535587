"""The coupled linear system against other derivations: characteristic equations, Weinreich, energy, reciprocity."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from synth.physics.body_modes import Body, BodyMode
from synth.physics.coupled import CoupledStrings, Line, Place
from synth.physics.modes import residual_compliance
from synth.physics.string import String
from tests.oracles import three_strings


def ideal(length, tension, mu, modes, direction=(1.0,), sigma=0.0, keeps_mass=True):
    """An ideal string whose modes all decay at σ."""
    omega = np.arange(1, modes + 1) * math.pi / length * math.sqrt(tension / mu)
    return Line(length, tension, mu, omega, np.full(modes, sigma), np.array(direction), keeps_mass)


def newton(function, s, steps=60):
    """A root by the complex secant method."""
    before, value = s * (1 + 1e-7), function(s * (1 + 1e-7))
    for _ in range(steps):
        now = function(s)
        if now == value:
            break
        before, value, s = s, now, s - now * (s - before) / (now - value)
    return s


def nearest(values, s):
    return values[np.argmin(np.abs(values - s))]


BODY_2 = Body(
    (BodyMode(97.0, 20.0, 0.30, (1.0, 0.2)), BodyMode(211.0, 30.0, 0.20, (0.9, -0.5)), BodyMode(430, 15, 0.4, (0.3, 1)))
)


def exact_roots(strings, body, guesses):
    """Roots of det(1 + C(s) Σ B Bᵀ T(s/c) coth(sL/c)) = 0: ideal strings without losses, all their modes, on a body."""

    def characteristic(s):
        stiffness = np.zeros((body.axes, body.axes), complex)
        for length, tension, mu, direction in strings:
            k = s / math.sqrt(tension / mu)
            stiffness += tension * k / np.tanh(k * length) * np.outer(direction, direction)
        return np.linalg.det(np.eye(body.axes) + body.compliance(s) @ stiffness)

    return np.array([newton(characteristic, s) for s in guesses])


@pytest.mark.slow
@pytest.mark.slow
def test_modes_of_ideal_strings_are_the_roots_of_the_wave_equations_characteristic_equation():
    strings = [(0.65, 80.0, 1.2e-3, (1.0, 0.0)), (0.65, 78.0, 1.2e-3, (0.8, 0.6)), (0.9, 60.0, 3e-3, (1.0, 0.3))]
    errors = {}
    for modes in (40, 80, 160):
        for keeps in (True, False):
            lines = [ideal(*string[:3], modes, string[3], keeps_mass=keeps) for string in strings]
            found = CoupledStrings(tuple(lines), BODY_2).modes().oscillations()[:25]
            exact = exact_roots(strings, BODY_2, found)
            assert np.unique(np.round(exact, 6)).size == 25
            errors[modes, keeps] = np.abs(found / exact - 1).max()
    # third order with the mass of the modes left out, first without it
    assert errors[80, True] < 2e-5
    for keeps, order in ((True, 3), (False, 1)):
        rates = [math.log2(errors[n, keeps] / errors[2 * n, keeps]) for n in (40, 80)]
        assert np.allclose(rates, order, atol=0.25)


@pytest.mark.parametrize("keeps_mass", [True, False])
def test_modes_of_lossy_stiff_strings_are_the_roots_of_the_schur_complement(keeps_mass):
    """Every string mode eliminated by hand leaves a D × D problem: the bridge's dynamic stiffness."""
    body = three_strings.body(3)
    lines = three_strings.lines(30, 3, (0.0, 90.0), keeps_mass)

    def characteristic(s):
        stiffness = np.zeros((3, 3), complex)
        for line in lines:
            mass = line.linear_density_kg_m
            through = (line.omega**2 + 2 * line.sigma * s) / (s * s + 2 * line.sigma * s + line.omega**2)
            moved = mass * s * s * (line.ramp**2 @ through + line.ramp_left_out**2) + line.tension_n / line.length_m
            stiffness += moved * np.outer(line.direction, line.direction)
        return np.linalg.det(np.eye(3) + body.compliance(s) @ stiffness)

    modes = CoupledStrings(tuple(lines), body).modes()
    found = modes.oscillations()
    assert found.size >= 30 * 6 + 12
    for s in found[:60]:
        # roots by Newton, of the next ones none is as near
        root = newton(characteristic, s * (1 + 1e-9))
        assert abs(nearest(found, root) - root) < 1e-9 * abs(root)
        assert abs(root - s) < 1e-7 * abs(s)


def two_unisons(weight):
    """Two strings of 220 Hz, the second 0.4 cents sharp or not, on a body of so many times its mass; ζ = (T/L) Y; s."""
    body = Body((BodyMode(235.0, 8.0, 0.6 * weight), BodyMode(900.0, 10.0, 0.2 * weight)))
    length, mu, f0, sigma = 0.65, 1.2e-3, 220.0, 0.05

    def lines(cents):
        return tuple(
            ideal(length, mu * (2 * length * f0 * ratio) ** 2, mu, 60, sigma=sigma) for ratio in (1.0, 2 ** (cents / 1200))
        )

    s = -sigma + 1j * math.sqrt((2 * math.pi * f0) ** 2 - sigma**2)  # of either string with rigid ends
    return body, lines, lines(0.0)[0].stiffness * s * body.compliance(s)[0, 0], s


@pytest.mark.parametrize("cents", [0.0, 0.4, 3.0])
def test_two_unison_strings_decay_as_weinreich_has_it(cents):
    """Weinreich, JASA 62 (1977) 1474: the slow amplitudes a obey ȧ = (i diag(0, δ) − σ − ζ [[1, 1], [1, 1]]) a, with the
    admittance at the strings' frequency taken as constant. What it leaves out is smaller the heavier the body is."""
    errors = []
    for weight in (1.0, 10.0):
        body, lines, zeta, s = two_unisons(weight)
        delta = s.imag * (2 ** (cents / 1200) - 1)
        # the mistuning is small in proportion to the coupling, as in his figures; σ/ω, 4e-5, is left out too
        delta /= weight
        shift = 1200 * math.log2(1 + delta / s.imag)
        found = CoupledStrings(lines(shift), body).modes().oscillations()
        theory = s + 1j * delta / 2 - zeta + np.array([1, -1]) * np.sqrt(zeta**2 - delta**2 / 4)
        pair = np.sort_complex(found[np.argsort(np.abs(found - theory.mean()))[:2]])
        errors.append(np.abs(pair - np.sort_complex(theory)).max() / abs(zeta))
    assert errors[0] < 0.05
    assert 7.0 < errors[0] / errors[1] < 14.0


def test_two_stage_decay_of_one_string_plucked():
    """The bridge's motion falls at first at the rate of both strings in phase, and at last at that of the slow mode."""
    body, lines, zeta, s = two_unisons(3.0)
    sigma = -s.real
    delta = 0.2 * zeta.real
    system = CoupledStrings(lines(1200 * math.log2(1 + delta / s.imag)), body)
    modes = system.modes()
    state = np.zeros(system.size)
    state[0] = 1e-3  # the first mode of the first string
    # amplitudes of the two coupled modes near 220 Hz, without the rest
    near = np.argsort(np.abs(modes.eigenvalues - s))[:2]
    weights = (system.bridge_rows() @ modes.right[:, near])[0] * (modes.left[near] @ state)
    matrix = np.diag([-sigma, -sigma + 1j * delta]) - zeta * np.ones((2, 2))

    def rate(t):
        terms = weights * np.exp(modes.eigenvalues[near] * t)
        return -((modes.eigenvalues[near] * terms).sum() / terms.sum()).real

    def theory(t):
        values, vectors = np.linalg.eig(matrix)
        terms = np.ones(2) @ vectors * np.linalg.solve(vectors, [1, 0]) * np.exp(values * t)
        return -((values * terms).sum() / terms.sum()).real

    late = 12 / zeta.real
    for t in (0.0, 0.5 / zeta.real, 1.5 / zeta.real, 4 / zeta.real, late):
        assert rate(t) == pytest.approx(theory(t), rel=0.02), t
    assert rate(0.0) == pytest.approx(sigma + 2 * zeta.real, rel=0.02)
    assert rate(late) < sigma + 0.02 * zeta.real


def guitar(axes=3, modes=25, angles=(0.0, 90.0), **how):
    return CoupledStrings(tuple(three_strings.lines(modes, axes, angles, **how)), three_strings.body(axes))


@pytest.mark.parametrize("keeps_mass", [True, False])
def test_energy_is_lost_to_the_losses_and_to_nothing_else(keeps_mass):
    system = guitar(keeps_mass=keeps_mass)
    h, a = system.energy_matrix, system.matrix
    w, rates, _, v = system.parts()
    lost = np.zeros_like(h)
    for number, (line, end) in enumerate(zip(system.lines, system.ends, strict=True)):
        bent = np.zeros((line.omega.size, system.size))  # ẇ
        bent[:, rates[number]] = np.eye(line.omega.size)
        bent[:, v] = -np.outer(line.ramp, end)
        lost += bent.T @ np.diag(2 * line.linear_density_kg_m * line.sigma) @ bent
    lost[v, v] += np.diag(2 * system.body.mass * system.body.sigma)
    balance = h @ a + (h @ a).T + 2 * lost
    assert np.abs(balance).max() < 1e-12 * np.abs(h @ a).max()
    assert np.linalg.eigvalsh(h).min() > 0.0
    # a pluck: kinetic and potential energy by quadrature of the string's shape, and it falls
    state = np.zeros(system.size)
    state[w[0]] = three_strings.pluck(system.lines[0], 0.13, 1e-3)
    energies = system.energy(system.modes().free_response(state, np.linspace(0, 0.5, 400), np.eye(system.size)))
    assert np.all(np.diff(energies) < 0.0)
    assert energies[0] == pytest.approx(system.energy(state), rel=1e-10)


def test_energy_is_that_of_the_strings_shape():
    """By quadrature of ½μu̇² + ½Tu'² over a string that moves with its end."""
    line = ideal(0.7, 60.0, 2e-3, 6, keeps_mass=False)
    system = CoupledStrings((line,), Body((BodyMode(100.0, 20.0, 0.3),)))
    rng = np.random.default_rng(3)
    w, dw, p, dp = rng.normal(size=6) * 1e-3, rng.normal(size=6), 2e-3, 0.7
    state = np.concatenate([w, dw + line.ramp * dp, [p, dp]])
    x, weight = np.polynomial.legendre.leggauss(60)
    x, weight = 0.35 * (x + 1), 0.35 * weight
    k = np.arange(1, 7) * math.pi / 0.7
    phi, slope = math.sqrt(2 / 0.7) * np.sin(np.outer(x, k)), math.sqrt(2 / 0.7) * np.cos(np.outer(x, k)) * k
    rate, bend = phi @ dw + x / 0.7 * dp, slope @ w + p / 0.7
    strung = weight @ (1e-3 * rate**2 + 30.0 * bend**2)
    # the six modes hold of the ramp's mass Σ c², not L/3
    missing = 1e-3 * (0.7 / 3 - line.ramp @ line.ramp) * dp**2
    alone = 0.15 * (dp**2 + (2 * math.pi * 100 * p) ** 2)
    assert system.energy(state) == pytest.approx(strung - missing + alone, rel=1e-13)
    whole = ideal(0.7, 60.0, 2e-3, 6)
    assert CoupledStrings((whole,), system.body).energy(state) == pytest.approx(strung + alone, rel=1e-13)


def test_forces_and_displacements_are_reciprocal():
    system = guitar()
    places = [Place(0, 0.1), Place(0, 0.64, True), Place(3, 0.5), Place(5, 0.2, True)]
    rows = np.vstack([system.displacement_rows(places), system.bridge_rows()])
    columns = np.hstack([system.force_columns(places), system.bridge_columns()])
    # power: H g is the row of the velocity
    assert np.allclose(system.energy_matrix @ columns, (rows @ system.matrix).T, rtol=0, atol=1e-12)
    assert np.allclose(system.velocity_rows(places), (rows @ system.matrix)[:4])
    modes = system.modes()
    s = 2j * math.pi * np.array([50.0, 110.3, 441.0, 2000.0])
    transfer = modes.transfer(rows, columns, s)
    assert transfer.shape == (4, 7, 7)
    scale = np.sqrt(np.abs(np.einsum("kii->ki", transfer)))
    assert np.abs((transfer - transfer.transpose(0, 2, 1)) / scale[:, :, None] / scale[:, None, :]).max() < 1e-10
    for number, value in enumerate(s):
        direct = rows @ np.linalg.solve(value * np.eye(system.size) - system.matrix, columns)
        assert np.abs((transfer[number] - direct) / np.outer(scale[number], scale[number])).max() < 1e-10


def test_a_body_too_heavy_to_move_leaves_the_strings_alone():
    heavy = Body(tuple(BodyMode(m.frequency_hz, m.q, 1e9 * m.mass_kg / 1e3, m.shape) for m in three_strings.body(1).modes))
    lines = three_strings.lines(20)
    found = CoupledStrings(tuple(lines), heavy).modes().oscillations()
    for line in lines:
        alone = -line.sigma + 1j * np.sqrt(line.omega**2 - line.sigma**2)
        assert max(abs(nearest(found, s) - s) / abs(s) for s in alone) < 2e-6
    for omega, sigma in zip(heavy.omega, heavy.sigma, strict=True):
        s = -sigma + 1j * math.sqrt(omega**2 - sigma**2)
        assert abs(nearest(found, s) - s) < 2e-6 * abs(s)
    # and a direction that no mode moves is a rigid end exactly
    across = tuple(Line(x.length_m, x.tension_n, x.linear_density_kg_m, x.omega, x.sigma, np.array([0.0])) for x in lines)
    found = CoupledStrings(across, three_strings.body(1)).modes().oscillations()
    alone = np.concatenate([-x.sigma + 1j * np.sqrt(x.omega**2 - x.sigma**2) for x in lines])
    assert max(abs(nearest(found, s) - s) / abs(s) for s in alone) < 1e-13


def test_free_response_is_the_systems_own():
    system = guitar(axes=2, modes=10)
    rng = np.random.default_rng(5)
    state = rng.normal(size=system.size) / np.sqrt(np.diag(system.energy_matrix))
    modes = system.modes()
    assert modes.condition < 100.0
    rows = np.vstack([system.displacement_rows([Place(1, 0.2), Place(2, 0.6, True)]), system.bridge_rows()])
    times = np.array([0.0, 1e-4, 0.013, 0.4])
    found = modes.free_response(state, times, rows)
    # in coordinates whose squares are the energy, where the exponential of the matrix loses little to rounding
    to_energy = np.linalg.cholesky(system.energy_matrix).T
    back = np.linalg.inv(to_energy)
    even = to_energy @ system.matrix @ back
    direct = np.array([rows @ back @ expm(even * t) @ to_energy @ state for t in times])
    assert np.abs(found - direct).max() < 1e-10 * np.abs(direct).max()
    many = modes.free_response(state, np.linspace(0, 0.4, 3000), rows)
    assert many.shape == (3000, 4) and many[-1] == pytest.approx(found[-1], rel=1e-8)


def test_static_deflection_is_at_rest_and_that_of_the_whole_string():
    system = guitar(axes=2, modes=40, angles=(0.0,))
    places, forces = [Place(0, 0.13), Place(2, 0.6, True)], np.array([2.0, -0.5])
    state = system.static_deflection(places, forces)
    rest = system.matrix @ state + system.force_columns(places) @ forces
    assert np.abs(rest).max() < 1e-9 * np.abs(system.force_columns(places) @ forces).max()
    # the static limit of the transfer
    transfer = system.modes().transfer(system.displacement_rows(places), system.force_columns(places), 0.0).real
    assert system.displacement_rows(places) @ state == pytest.approx(transfer @ forces, rel=1e-9)
    # an ideal string on one spring: x(L − x)/(TL) and what the end gives way, (x/L)²/(k + T/L)
    length, tension, x = 0.7, 60.0, 0.2
    body = Body((BodyMode(50.0, 20.0, 0.1),))
    one = CoupledStrings((ideal(length, tension, 2e-3, 100),), body)
    spring = 0.1 * (2 * math.pi * 50) ** 2
    found = (one.displacement_rows([Place(0, x)]) @ one.static_deflection([Place(0, x)], [1.0]))[0]
    left_out = residual_compliance(String(length, tension, 2e-3, 0.0, 1e-3), x, 100)[0, 0]
    expected = x * (length - x) / (tension * length) + (x / length) ** 2 / (spring + tension / length)
    assert found + left_out == pytest.approx(expected, rel=1e-12)


def test_the_pages_example_runs():
    """A string on two modes, drawn aside and let go: what the page of the coupled strings shows."""
    page = (Path(__file__).parents[2] / "docs" / "coupled-strings.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    told: dict = {}
    exec(example, told)
    assert np.all(told["partials"].real < 0.0)
    assert told["bridge"].shape == (48000, 2)
    assert told["bridge"][0] == pytest.approx(told["system"].bridge_rows() @ told["state"], rel=1e-6)
    assert np.abs(told["bridge"][-4800:]).max() < 0.2 * np.abs(told["bridge"][:4800]).max()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sigma": [1.0]}, "omega and sigma must be equally long, got 2 and 1"),
        ({"omega": [1.0, -2.0]}, "omega of a line must be > 0, got -2"),
        ({"omega": [1.0, math.nan]}, "omega of a line must be a list of finite numbers"),
        ({"sigma": [1.0, -1.0]}, "sigma of a line must be >= 0 1/s, got -1"),
        ({"tension_n": 0.0}, "length_m, tension_n and linear_density_kg_m of a line must be > 0, got 0"),
    ],
)
def test_what_is_no_line_is_refused(change, message):
    good = {"length_m": 1.0, "tension_n": 1.0, "linear_density_kg_m": 1.0, "omega": [1.0, 2.0], "sigma": [0.0, 0.0]}
    with pytest.raises(ValueError, match=message):
        Line(**{**good, "direction": [1.0], **change})


def test_what_does_not_fit_together_is_refused():
    line = ideal(1.0, 1.0, 1.0, 3, direction=(1.0, 0.0))
    with pytest.raises(ValueError, match="direction of line 0 must have 1 components as the body's shapes, got 2"):
        CoupledStrings((line,), three_strings.body(1))
    system = CoupledStrings((line,), three_strings.body(2))
    with pytest.raises(ValueError, match="one force for each of 1 places"):
        system.static_deflection([Place(0, 0.5)], [1.0, 2.0])
    with pytest.raises(ValueError, match="positions must lie between 0 and 1 m"):
        system.displacement_rows([Place(0, 1.5)])
