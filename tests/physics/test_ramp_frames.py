"""The step that the kernels are held to, held itself to the continuous system, to its closed form and to its energy."""

import math
from dataclasses import replace

import numpy as np
import pytest

from synth.physics.body_modes import Body
from synth.physics.coupled import CoupledStrings, Place
from synth.physics.modes import mode_shapes, residual_compliance
from synth.solver.laws import EXACT_HOLD, coefficients
from tests.oracles import three_strings
from tests.oracles.contact_scenes import scene
from tests.oracles.ramp_frames import RampFrames, enumerated, lemke
from tests.oracles.steps import exact_hold_step


def errors(system: CoupledStrings, rate_hz: float, exact: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """|cents| and relative error of the decay rate of each mode, by the eigenvalues of the frame's matrix."""
    found = np.log(np.linalg.eigvals(RampFrames(system, 1 / rate_hz).linear_step()).astype(complex)) * rate_hz
    near = np.array([found[np.argmin(np.abs(found - s))] for s in exact])
    return np.abs(1200 * np.log2(near.imag / exact.imag)), np.abs(near.real / exact.real - 1)


@pytest.mark.slow
@pytest.mark.parametrize("keeps_mass", [True, False])
@pytest.mark.parametrize(("axes", "angles"), [(1, (0.0,)), (3, (0.0, 90.0))])
def test_a_guitar_of_three_strings_sounds_as_its_complex_modes_have_it(axes, angles, keeps_mass):
    system = CoupledStrings(tuple(three_strings.lines(60, axes, angles, keeps_mass)), three_strings.body(axes))
    exact = system.modes().oscillations()
    cents, decay = errors(system, 48000.0, exact[:20])
    assert cents.max() < 0.02 and decay.max() < 1e-3
    high = exact[(exact.imag > 2 * math.pi * 2000) & (exact.imag < 2 * math.pi * 8000)]
    assert high.size > 60
    assert errors(system, 48000.0, high)[0].max() < 0.01
    # second order: a quarter at twice the rate
    coarse, fine = (np.array([e.max() for e in errors(system, rate, exact[:20])]) for rate in (24000.0, 96000.0))
    assert np.allclose(coarse / [cents.max(), decay.max()], 4.0, rtol=0.1)
    assert np.allclose([cents.max(), decay.max()] / fine, 4.0, rtol=0.1)


def test_steps_within_a_frame_change_nothing_where_nothing_touches():
    system = CoupledStrings(tuple(three_strings.lines(20, 2, (0.0, 90.0))), three_strings.body(2))
    one, five = (RampFrames(system, 1 / 48000, steps).linear_step() for steps in (1, 5))
    assert np.abs(one - five).max() < 1e-10 * np.abs(one).max()


def touching(axes: int = 2, modes: int = 30, body: Body | None = None, steps: int = 1) -> RampFrames:
    """Three strings over five points, two of which ride on the bridge, with the residual compliance of what is left out."""
    lines = tuple(three_strings.lines(modes, axes))
    system = CoupledStrings(lines, body or three_strings.body(axes))
    places = [Place(0, 0.30), Place(0, 0.645, True), Place(1, 0.640, True), Place(2, 0.20), Place(2, 0.21)]
    residual = np.zeros((5, 5))
    for number, (hz, diameter, _) in enumerate(three_strings.STRINGS):
        mine = [c for c, place in enumerate(places) if place.line == number]
        where = [places[c].position_m for c in mine]
        residual[np.ix_(mine, mine)] = residual_compliance(three_strings.steel(hz, diameter), where, modes)
    return RampFrames(system, 1 / 48000, steps, places, [-1e-4, -1e-6, -1e-6, -2e-4, -2e-4], residual)


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_one_step_a_frame_has_the_designs_closed_form(axes):
    """W = S κ_q Sᵀ/μ + R + G (I + ΓA/H)⁻¹ Γ Gᵀ/H², G_i = (ξ_i H − Σ_j S_ij p12_j c_j) B, by the kernels' coefficients."""
    frames = touching(axes)
    system, h = frames.system, frames.frame_s
    body = system.body
    kept = [coefficients(EXACT_HOLD, x.omega, x.sigma, x.linear_density_kg_m, h) for x in system.lines]
    held = np.hstack(
        [coefficients(EXACT_HOLD, body.omega[i : i + 1], body.sigma[i : i + 1], body.mass[i], h) for i in range(12)]
    )
    gamma = (body.shapes * held[4]) @ body.shapes.T
    a = np.zeros((axes, axes))
    for line, coef in zip(system.lines, kept, strict=True):
        mass = line.linear_density_kg_m
        push = mass * line.ramp**2 @ (1 - coef[3]) / h + line.stiffness * h / 2 + mass * line.ramp_left_out**2 * 1.9 / h
        a += push * np.outer(line.direction, line.direction)
    w = frames.residual.copy()
    g = np.zeros((5, axes))
    for i, place in enumerate(frames.places):
        line, coef = system.lines[place.line], kept[place.line]
        shape = mode_shapes(line.length_m, place.position_m, line.omega.size)[0]
        g[i] = ((place.position_m / line.length_m - place.rides) * h - shape @ (coef[1] * line.ramp)) * line.direction
        for k, other in enumerate(frames.places):
            if other.line == place.line:
                w[i, k] += (shape * coef[4]) @ mode_shapes(line.length_m, other.position_m, line.omega.size)[0]
    w += g @ np.linalg.solve(np.eye(axes) + gamma @ a / h, gamma) @ g.T / h**2
    scale = np.sqrt(np.outer(np.diag(w), np.diag(w)))
    assert np.abs((frames.matrix_of_forces - w) / scale).max() < 1e-11
    assert np.linalg.eigvalsh(w / scale).min() > 0.0


def start(frames: RampFrames, height_m: float = 2e-3):
    x = np.zeros(frames.system.size)
    for part, line in zip(frames.system.parts()[0], frames.system.lines, strict=True):
        x[part] = three_strings.pluck(line, 0.15, height_m)
    return frames.start(x)


@pytest.mark.parametrize("steps", [1, 3])
def test_under_a_body_too_heavy_to_move_it_is_the_uncoupled_step(steps):
    heavy = Body(tuple(replace(mode, mass_kg=1e8) for mode in three_strings.body(2).modes))
    frames = touching(2, 15, heavy, steps)
    state = start(frames)
    alone = [(state.x[w].copy(), state.x[v].copy()) for w, v in zip(*frames.system.parts()[:2], strict=True)]
    touched = 0
    for _ in range(150):
        state, frame = frames.advance(state)
        force = np.zeros_like(frame.force)
        for number, line in enumerate(frames.system.lines):
            mine = [c for c, place in enumerate(frames.places) if place.line == number]
            shapes = mode_shapes(line.length_m, [frames.places[c].position_m for c in mine], line.omega.size)
            for k in range(steps):
                step = exact_hold_step(
                    line.omega,
                    line.sigma,
                    line.linear_density_kg_m,
                    frames.frame_s / steps,
                    shapes,
                    frames.heights[mine],
                    frames.residual[np.ix_(mine, mine)],
                    *alone[number],
                )
                alone[number] = step.q, step.v
                force[k, mine] = step.contact
        touched += int(force.any())
        assert np.abs(frame.force - force).max() <= 1e-6 * max(1.0, np.abs(force).max())
    assert touched > 20
    for part, (q, _) in zip(frames.system.parts()[0], alone, strict=True):
        assert np.abs(state.x[part] - q).max() < 1e-6 * np.abs(q).max()


def test_nothing_is_lost_where_nothing_takes_it():
    body = Body(tuple(replace(mode, q=1e12) for mode in three_strings.body(3).modes))
    lines = tuple(replace(line, sigma=np.zeros_like(line.sigma)) for line in three_strings.lines(30, 3))
    for steps in (1, 3):
        frames = RampFrames(CoupledStrings(lines, body), 1 / 48000, steps, rho=1.0)
        state = start(frames)
        began = frames.energy(state)
        for _ in range(300):
            state, _ = frames.advance(state)
            assert frames.energy(state) == pytest.approx(began, rel=1e-12)


@pytest.mark.parametrize("lightness", [1.0, 1e4])
@pytest.mark.parametrize("hold", [False, True])
def test_random_scenes_never_gain_energy(lightness, hold):
    touched = 0
    for seed in range(24):
        rng = np.random.default_rng(seed)
        frames, state = scene(rng, int(rng.integers(1, 5)), lightness=lightness)
        began = before = frames.energy(state)
        for _ in range(150):
            state, frame = frames.advance(state, hold=hold)
            after = frames.energy(state)
            assert after - before <= 1e-12 * began, (seed, after, before)
            before = after
            touched += int(frame.force.any())
            assert frame.held == hold
            if not hold:  # the conditions that the forces are to meet, by the gaps that came of them
                gap = frame.gap + frame.force @ frames.residual
                assert frame.force.min() >= 0.0 and gap.min() > -1e-11
                assert np.all((frame.force == 0.0) | (np.abs(gap) < 1e-11))
    assert touched > 1000


@pytest.mark.slow
def test_every_root_of_a_frame_is_passive_also_where_there_are_several():
    """A body 10⁴ times too light gives a frame several sets of forces; none of them gains energy."""
    several, roots = 0, 0
    for seed in range(40):
        rng = np.random.default_rng(100 + seed)
        frames, state = scene(rng, 4, lightness=1e4)
        if len(frames.places) > 2:
            continue
        began = frames.energy(state)
        for _ in range(60):
            right, _ = frames.problem(state)
            before = frames.energy(state)
            found = enumerated(frames.matrix_of_forces, right) if right.min() < 0.0 else []
            several += len(found) > 1
            for force in found:
                after = frames.energy(frames.advance(state, force)[0])
                assert after - before <= 1e-12 * began, (seed, after, before)
                roots += 1
            state, _ = frames.advance(state)
    assert roots > 100
    assert several > 0


@pytest.mark.slow
def test_a_body_of_true_weight_leaves_a_frame_one_root():
    for steps in (2, 4):
        frames = touching(2, 30, None, steps)
        frames = RampFrames(frames.system, 1 / 48000, steps, frames.places[:2], frames.heights[:2], frames.residual[:2, :2])
        state, met = start(frames), 0
        for _ in range(240):
            right, _ = frames.problem(state)
            if right.min() < 0.0:
                found = enumerated(frames.matrix_of_forces, right)
                assert len(found) == 1
                assert np.allclose(found[0], lemke(frames.matrix_of_forces, right), rtol=1e-9, atol=1e-12)
                met += 1
            state, _ = frames.advance(state)
        assert met > 10


def test_with_contact_the_coupling_adds_no_error_to_that_of_the_contact():
    """6 ms of the bridge's motion: it matters at what rate the contacts run, but not whether the bridge turns at every step
    or once in four."""

    def bridge(contact_hz: int, steps: int) -> np.ndarray:
        frames = touching(1, 20)
        frames = RampFrames(frames.system, steps / contact_hz, steps, frames.places, frames.heights, frames.residual)
        state, kept = start(frames), []
        for number in range(contact_hz // steps * 6 // 1000):
            state, _ = frames.advance(state)
            if (number + 1) % (contact_hz // steps // 12000) == 0:
                kept.append((frames.system.bridge_rows() @ state.x)[0])
        return np.array(kept)

    reference = bridge(384000, 1)
    away = {
        (rate, steps): np.linalg.norm(bridge(rate, steps) - reference) / np.linalg.norm(reference)
        for rate, steps in ((48000, 1), (96000, 1), (96000, 2), (96000, 4), (192000, 1))
    }
    assert away[48000, 1] > 1.1 * away[96000, 1] > 1.2 * away[192000, 1]
    for steps in (2, 4):
        assert away[96000, steps] == pytest.approx(away[96000, 1], rel=0.02)


def test_lemke_and_the_enumeration_on_small_problems():
    a, b = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-1.0, -2.0])
    assert lemke(a, b) == pytest.approx([0.0, 1.0])
    assert lemke(a, -b) == pytest.approx([0.0, 0.0])
    assert lemke(np.array([[-1.0]]), np.array([-1.0])) is None
    # 0 ≤ −z + 1 ⊥ z ≥ 0 has two roots
    assert [list(z) for z in enumerated(np.array([[-1.0]]), np.array([1.0]))] == [[0.0], [1.0]]
    rng = np.random.default_rng(0)
    for _ in range(100):
        root = rng.normal(size=(6, 6))
        a, b = root @ root.T + np.triu(rng.normal(size=(6, 6)), 1) * 0.3, rng.normal(size=6)
        found = enumerated(a, b)
        z = lemke(a, b)
        assert z is None or any(np.allclose(z, other, atol=1e-9) for other in found)
    with pytest.raises(ValueError, match="at most 12 rows"):
        enumerated(np.eye(13), np.ones(13))


def test_the_ramps_modes_by_quadrature():
    line = three_strings.lines(12)[0]
    grid = np.linspace(0, 0.65, 20001)
    for j in (1, 2, 7):
        phi = math.sqrt(2 / 0.65) * np.sin(j * math.pi * grid / 0.65)
        assert line.ramp[j - 1] == pytest.approx((phi * grid / 0.65)[:-1].mean() * 0.65, rel=1e-3)
        assert abs(line.ramp[j - 1]) == pytest.approx(math.sqrt(2 * 0.65) / (j * math.pi), rel=1e-14)
