"""A line that goes by frames, while something lies on it: the finger takes the line's steps, and no contact is missed."""

from __future__ import annotations

import numpy as np
import pytest

from synth.physics.coupled import CoupledStrings, Place
from synth.physics.modes import mode_shapes
from synth.solver import coupling
from synth.solver.line_tables import fill_apart, fill_finger, go_by_frames, look_at
from tests.coupledkit import Kernel
from tests.oracles.three_strings import body, lines, pluck

RATE_HZ = 48000.0
FRAMES = 64


def held(
    steps_of_first: int, heights_m: tuple[float, ...] = (), *, drop_m: float = 1e-3, seed: int = 0
) -> tuple[Kernel, list]:
    """Three strings in two directions, the first over points at these heights, plucked, with a palm on it; the points."""
    rng = np.random.default_rng(seed)
    system = CoupledStrings(tuple(lines(24, 2, (0.0, 90.0))), body(2))
    first = system.lines[0]
    places = [Place(0, first.length_m * share) for share in np.linspace(0.1, 0.6, len(heights_m))]
    each = [steps_of_first] + [8] * (len(system.lines) - 1)
    kernel = Kernel(
        system, 1.0 / RATE_HZ, 8, places, heights_m, 1e-7 * np.eye(len(places)), steps_of=each, path=FRAMES * 8 + 1
    )
    x = np.zeros(system.size)
    for line, part in zip(system.lines, system.parts()[0], strict=True):
        x[part] = pluck(line, rng.uniform(0.1, 0.4) * line.length_m, drop_m * rng.uniform(0.5, 1.0))
    kernel.start(x)
    for line, end in zip(system.lines, kernel.ends, strict=True):
        end.sigma[: line.sigma.size] = line.sigma
    where = 0.85 * first.length_m
    kernel.lines.hold(
        0, mode_shapes(first.length_m, np.array([where]), first.omega.size)[0], where / first.length_m, 50.0, 1.5
    )
    kernel.ends[0].path[:] = 0.0
    return kernel, places


def lie_down(kernel: Kernel) -> bool:
    """Whether the first line goes by frames from here on."""
    goes = go_by_frames(kernel.address, 0, kernel.lines.scratch)
    coupling.gather_lines(kernel.address)
    return goes


@pytest.mark.parametrize("frames", [64, 61, 8, 1])
def test_of_one_step_a_frame_it_is_the_same(frames: int) -> None:
    by_frames, one_step = held(1)[0], held(1)[0]
    assert lie_down(by_frames)
    for _ in range(5):
        for kernel in (by_frames, one_step):
            kernel.advance(frames)
        assert by_frames.ends[0].counts[coupling.BY_FRAMES]
        assert np.abs(by_frames.x - one_step.x).max() < 1e-10 * np.abs(one_step.x).max()


@pytest.mark.parametrize("seed", range(4))
def test_what_draws_it_takes_its_own_steps(seed: int) -> None:
    """By frames it is nearer to eight steps than a line of one step is, whose finger knows the ends of frames alone."""
    kernels, along = [held(steps, seed=seed)[0] for steps in (8, 1, 8)], np.arange(FRAMES * 8 + 1) / (FRAMES * 8)
    rough = 2.5e-6 * np.cumsum(np.random.default_rng(seed).standard_normal(along.size)) * along
    for kernel, every in zip(kernels, (1, 8, 1), strict=True):
        finger = kernel.states[0].finger[0]
        finger["stiffness"] = 2e4
        kernel.lines._fill_finger(0)
        path = finger["here"] + (1e-3 * along**2 + rough)[::every]
        kernel.ends[0].path[: path.size] = path
    assert lie_down(kernels[0])
    for kernel in kernels:
        kernel.advance(FRAMES)
    by_frames, one_step, eight = (kernel.x for kernel in kernels)
    assert kernels[0].ends[0].counts[coupling.BY_FRAMES]
    assert 1e-9 * np.abs(eight).max() < np.abs(by_frames - eight).max() < 0.9 * np.abs(one_step - eight).max()


def rest_above(kernel: Kernel, modes: int) -> None:
    """Only so many modes of the first line move while it is not looked at in its own steps."""
    kernel.ends[0].counts[coupling.APART_MODES] = modes
    size = kernel.ends[0].kick.size
    fill_apart(int(kernel.lines._tables[0][1].ctypes.data), np.zeros(size), np.zeros(size), np.zeros((3, 8)))


def test_modes_that_rest_are_held_by_the_finger() -> None:
    """To look again changes nothing; in steps again the string is under the finger where it was, and is looked at."""
    kernel = held(8, (-5e-4, -6e-4, -7e-4, -8e-4, -9e-4), drop_m=1e-5)[0]
    end, finger = kernel.ends[0], kernel.states[0].finger[0]
    finger["stiffness"] = 5e3
    kernel.lines._fill_finger(0)
    end.path[:] = finger["here"] + 1e-4
    rest_above(kernel, 8)
    assert lie_down(kernel)
    kernel.advance(40)
    assert end.counts[coupling.BY_FRAMES] and finger["push"] > 0.01
    before = finger["here"].copy(), kernel.states[0].q.copy()
    assert not before[1][8:].any()
    for _ in range(2):
        assert lie_down(kernel) and finger["here"] == pytest.approx(before[0], rel=1e-12)
    end.certificate.clearance[:] = 1.0
    look_at(kernel.address, 0, 1, kernel.lines.scratch)
    state, model = kernel.states[0], kernel.lines.models[0]
    n = model.modes
    assert state.q[8:n].any() and not end.certificate.clearance.any()
    np.testing.assert_allclose(
        state.q[8:n], finger["push"] * state.grip.weights[8:n] / (model.mu * model.omega[8:n] ** 2), rtol=1e-12
    )
    lever = end.numbers[coupling.FINGER_LEVERAGE] * coupling.along.py_func(
        kernel.lines.coupling, 0, kernel.lines.coupling.bridge.beta
    )
    assert state.grip.weights[:n] @ state.q[:n] + lever == pytest.approx(float(finger["here"]), rel=1e-9)


@pytest.mark.parametrize("moving", [24, 8])
def test_it_goes_in_steps_before_it_touches_anything(moving: int) -> None:
    """Of strings that swing towards points, some go by frames again and again: none passes through a point while it does."""
    rose = frames_by_frames = 0
    nearest = np.inf
    for seed in range(24):
        heights = tuple(-np.linspace(1e-4, 12e-4, 5) * (0.2 + 0.1 * (seed % 12)))
        kernel, places = held(8, heights, seed=seed)
        rest_above(kernel, moving)
        rows = kernel.system.displacement_rows(places)
        for _ in range(24):
            goes = lie_down(kernel)
            for _ in range(3):  # a block and frames one by one
                kernel.advance(9)
                gaps = rows @ kernel.x - np.array(heights)
                if kernel.ends[0].counts[coupling.BY_FRAMES]:
                    frames_by_frames += 1
                    nearest = min(nearest, float(gaps.min()))
                    assert not kernel.force.any() and gaps.min() > 0.0, seed
            rose += goes and not kernel.ends[0].counts[coupling.BY_FRAMES]
    assert rose > 10 and frames_by_frames > 200
    assert nearest < 1e-4  # some came near


def test_what_has_gone_by_frames_goes_in_steps_as_if_it_had_not() -> None:
    """From one state, with the tables of its steps filled anew: to rounding."""
    heights = (-5e-4, -6e-4, -7e-4, -8e-4, -9e-4)
    one, other = held(8, heights, drop_m=4e-5, seed=3)[0], held(8, heights, drop_m=4e-5, seed=3)[0]
    assert lie_down(one)
    one.ends[0].certificate.clearance[:] = 0.0
    one.ends[0].counts[coupling.BY_FRAMES] = 1
    look_at(one.address, 0, 1, one.lines.scratch)
    fill_finger(one.address, 0, one.lines.scratch)
    coupling.gather_lines(one.address)
    for kernel in (one, other):
        kernel.advance(61)
    assert np.abs(one.x - other.x).max() < 1e-9 * np.abs(other.x).max()


def test_no_frame_gains_energy() -> None:
    for seed in range(6):
        kernel, _ = held(8, (-6e-4, -8e-4, -1e-3, -12e-4, -14e-4), seed=seed)
        before = kernel.energy + 25.0 * float(kernel.states[0].finger[0]["here"]) ** 2
        for frame in range(200):
            lie_down(kernel)
            kernel.advance(1)
            now = kernel.energy + 25.0 * float(kernel.states[0].finger[0]["here"]) ** 2
            assert now <= before * (1.0 + 1e-12), (seed, frame)
            before = now
