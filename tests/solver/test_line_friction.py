"""Coulomb friction at the contacts of strings that move in two directions and share a bridge."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from synth.physics.body_modes import Body, BodyMode, BridgePlace
from synth.physics.coupled import CoupledStrings, Line, Place
from synth.solver import coupling
from synth.solver.lcp import SOLVED
from synth.solver.line_friction import hold_back
from tests.coupledkit import Kernel, gains_nothing
from tests.oracles.ramp_frames import RampFrames
from tests.oracles.three_strings import pluck, steel

RATE_HZ = 48000.0
#: height of what a direction is not pressed by [m]
NEVER = -1.0


def rubbing_scene(seed: int, steps: int, lightness: float = 1.0) -> tuple[RampFrames, np.ndarray, Kernel, np.ndarray]:
    """One or two strings in two directions each over one to three points, plucked across and along: the twin, its x, the
    kernel on it and the friction of every line."""
    rng = np.random.default_rng(seed)
    axes = int(rng.integers(2, 4))
    modes = []
    for _ in range(int(rng.integers(1, 6))):
        shape = rng.normal(size=axes) * np.array([1.0, 0.5, 5.0])[:axes]
        mass = 10 ** rng.uniform(-1.5, 0.0) / lightness
        modes.append(BodyMode(10 ** rng.uniform(1.8, 3.3), 10 ** rng.uniform(0.7, 5.0), mass, tuple(shape)))
    lines, places, heights, starts, friction = [], [], [], [], []
    for number in range(0, 2 * int(rng.integers(1, 3)), 2):
        offset, angle = rng.uniform(-0.03, 0.03), rng.uniform(-20.0, 20.0)
        string = steel(10 ** rng.uniform(1.9, 2.6), rng.uniform(0.25e-3, 0.8e-3))
        size = int(rng.integers(10, 40))
        near_bridge = bool(rng.integers(2))
        span = (0.95, 0.995) if near_bridge else (0.2, 0.95)
        where = np.sort(rng.uniform(*span, int(rng.integers(1, 4)))) * string.length_m
        rides = near_bridge and bool(rng.integers(2))
        for second in (0, 1):
            line = Line.from_string(string, size, BridgePlace(offset, angle + 90.0 * second).direction(axes), True)
            if second:
                line = replace(line, omega=line.omega * 1.001)
            if number == 0:
                line = replace(line, sigma=np.zeros_like(line.sigma))
            lines.append(line)
            starts.append(pluck(line, rng.uniform(0.05, 0.5) * line.length_m, rng.uniform(0.5e-3, 3e-3)))
            places += [Place(number + second, float(x), rides) for x in where]
            heights += [NEVER if second else -(10 ** rng.uniform(-6.0, -3.5)) for _ in where]
            friction.append(10 ** rng.uniform(-1.5, 0.5) if second else 0.0)
    system = CoupledStrings(tuple(lines), Body(tuple(modes)))
    count = len(places)
    root = rng.normal(size=(count, count)) * np.array([[a.line == b.line for b in places] for a in places])
    residual = root @ root.T * 10 ** rng.uniform(-8.0, -5.5) if rng.integers(4) else np.zeros((count, count))
    twin = RampFrames(system, 1.0 / RATE_HZ, steps, places, heights, residual, coupling.KEPT_BY_THE_REST)
    x = np.zeros(system.size)
    w, _, _, v = system.parts()
    for part, shape in zip(w, starts, strict=True):
        x[part] = shape
    x[v] = rng.normal(size=len(modes)) * 0.05 * np.sqrt(lightness)
    twin.heights = np.minimum(twin.heights, system.displacement_rows(places) @ x)
    kernel = Kernel(system, twin.frame_s, steps, places, list(twin.heights), residual)
    kernel.coupling.lines.friction[:] = friction
    kernel.start(x)
    return twin, x, kernel, np.array(friction)


@pytest.mark.parametrize("steps", [1, 2, 8])
def test_the_law_holds_in_motion_that_the_twin_makes(steps: int) -> None:
    """What the twin's strings do under the kernel's forces is what the kernel's do, and there Coulomb's law holds."""
    stuck = slid = 0
    for seed in range(40):
        twin, x, kernel, friction = rubbing_scene(seed, steps)
        state = twin.start(x)
        line_of = np.array([place.line for place in twin.places])
        second = friction[line_of] > 0.0
        first_of = np.array([np.flatnonzero(line_of == line - 1)[0] if friction[line] > 0.0 else 0 for line in line_of])
        place_in = np.array([np.flatnonzero(np.flatnonzero(line_of == line) == c)[0] for c, line in enumerate(line_of)])
        there = twin.system.displacement_rows(twin.places) @ x - twin.heights
        for frame in range(48):
            kernel.advance(1)
            assert kernel.held_frames == 0
            force = kernel.frame_forces(steps)
            state, happened = twin.advance(state, force.ravel())
            scale = np.sqrt(2.0 * twin.system.energy(x))
            assert np.sqrt(2.0 * twin.system.energy(kernel.x - state.x)) < 1e-9 * scale, (seed, frame)
            for k in range(steps):
                before, there = there, happened.gap[k] + twin.residual @ force[k]
                bound = friction[line_of] * force[k, first_of + place_in]
                assert np.all(force[k, ~second] >= 0.0)
                assert np.all(np.abs(force[k, second]) <= bound[second] * (1.0 + 1e-12))
                way = there - before
                sticks = second & (np.abs(force[k]) < bound * (1.0 - 1e-9))
                assert np.abs(way[sticks]).max(initial=0.0) < 1e-12
                slides = second & ~sticks & (bound > 0.0)
                assert np.all(force[k, slides] * way[slides] <= 1e-12 * bound[slides])
                pressed = second & (bound > 0.0)
                stuck, slid = stuck + int((sticks & pressed).sum()), slid + int(slides.sum())
    assert stuck > 20 and slid > 20, (stuck, slid)


@pytest.mark.parametrize("lightness", [1.0, 30.0, 1000.0])
def test_no_frame_gains_energy(lightness: float) -> None:
    touched = held = 0
    for seed in range(40):
        _, _, kernel, _ = rubbing_scene(500 + seed, 2 ** (seed % 4), lightness)
        gains_nothing(kernel, seed)
        touched += int(kernel.coupling.counts[coupling.TOUCHED])
        held += kernel.held_frames
    assert touched > 1000
    assert held == 0 if lightness == 1.0 else held < 0.2 * touched


@pytest.mark.parametrize("steps", [1, 2, 8])
def test_blocks_are_single_frames(steps: int) -> None:
    for seed in range(8):
        twin, x, one, _ = rubbing_scene(100 + seed, steps)
        many = rubbing_scene(100 + seed, steps)[2]
        for _ in range(43):
            one.advance(1)
        for frames in (24, 5, 7, 1, 6):
            many.advance(frames)
        size = twin.system.energy(x)
        assert twin.system.energy(one.x - many.x) < 1e-16 * size


def test_without_it_nothing_changes() -> None:
    changed = 0
    for seed in range(6):
        twin, x, bare, _ = rubbing_scene(100 + seed, 2)
        rubbed = rubbing_scene(100 + seed, 2)[2]
        bare.coupling.lines.friction[:] = 0.0
        plain = Kernel(twin.system, twin.frame_s, 2, twin.places, list(twin.heights), twin.residual)
        plain.start(x)
        for kernel in (rubbed, bare, plain):
            kernel.advance(48)
        assert np.array_equal(bare.x, plain.x)
        changed += not np.array_equal(bare.x, rubbed.x)
    assert changed > 0


def test_the_forces_of_several_contacts_are_those_of_every_way_tried() -> None:
    """Contacts that stick, slide up and slide down, in all ways: the one that fits is the kernel's."""
    rng = np.random.default_rng(2)
    seen = set()
    for _ in range(300):
        n = int(rng.integers(1, 5))
        root = rng.normal(size=(n, n + 1))
        a, way = np.ascontiguousarray(root @ root.T), rng.normal(size=n)
        bound = np.where(rng.random(n) < 0.2, 0.0, 10 ** rng.uniform(-2.0, 1.0, n))
        side, active, order = np.zeros(n, np.uint8), np.zeros(n, np.uint8), np.zeros(n, np.int64)
        z, right, factor = np.zeros(n), np.zeros(n), np.zeros((n, n))
        status, rows = hold_back(a, way, bound, side, active, right, factor, order, z)
        assert status == SOLVED and rows == int(active.sum())
        for signs in product((0, 1, -1), repeat=n):
            sign = np.array(signs)
            loose = sign == 0
            wanted = sign * bound
            if loose.any():
                chosen = np.ix_(loose, loose)
                wanted[loose] = -np.linalg.solve(a[chosen], way[loose] + a[np.ix_(loose, ~loose)] @ wanted[~loose])
            moved = a @ wanted + way
            if np.all(np.abs(wanted) <= bound + 1e-12) and np.all((sign * moved)[~loose] <= 1e-12):
                np.testing.assert_allclose(z, wanted, atol=1e-9)
                break
        else:
            raise AssertionError("no way fits")
        seen |= set(side.tolist())
    assert seen == {0, 1, 2, 3}
