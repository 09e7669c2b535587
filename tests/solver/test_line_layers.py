"""Soft contacts of strings that share a bridge."""

from __future__ import annotations

import numpy as np
import pytest

from synth.solver import coupling
from synth.solver.stringmodel import DEPTH, RESISTANCE, STIFFNESS
from tests.coupledkit import Kernel, gains_nothing
from tests.oracles.ramp_frames import RampFrames

from .test_coupled_frames import RATE_HZ, contact_scene, kernel_of


def soft_scene(
    seed: int, steps: int, lightness: float = 1.0, **options
) -> tuple[RampFrames, np.ndarray, Kernel, np.ndarray]:
    """A random scene with layers far softer to far stiffer than its strings, with and without loss, some contacts bare."""
    twin, x = contact_scene(seed, steps, lightness)
    rng = np.random.default_rng(7000 + seed)
    count = len(twin.places)
    step = 1.0 / (RATE_HZ * steps)
    stiffness = 10 ** rng.uniform(3.0, 6.5, count)
    resistance = 10 ** rng.uniform(-1.0, 1.0, count) * stiffness * step * (rng.random(count) < 0.8)
    layers = np.array([stiffness, resistance, 10 ** rng.uniform(-5.5, -3.5, count) * (rng.random(count) < 0.85)])
    kernel = kernel_of(twin, layers=layers, **options)
    kernel.start(x)
    return twin, x, kernel, layers


@pytest.mark.parametrize("steps", [1, 2, 8])
def test_the_law_holds_in_motion_that_the_twin_makes(steps: int) -> None:
    """What the twin's strings do under the kernel's forces is what the kernel's do, and there every layer's law holds."""
    inside = stopped = 0
    for seed in range(30):
        twin, x, kernel, layers = soft_scene(seed, steps)
        state, step = twin.start(x), 1.0 / (RATE_HZ * steps)
        slope = 0.5 * layers[STIFFNESS] + layers[RESISTANCE] / step
        kept = 0.5 * layers[STIFFNESS] - layers[RESISTANCE] / step
        depth = layers[DEPTH]
        sunk = twin.heights - twin.system.displacement_rows(twin.places) @ x
        for frame in range(40):
            kernel.advance(1)
            assert kernel.held_frames == 0
            force = kernel.frame_forces(steps)
            state, happened = twin.advance(state, force.ravel())
            size = twin.system.energy(x)
            assert twin.system.energy(kernel.x - state.x) < 1e-18 * size, (seed, frame)
            for k in range(steps):
                before, sunk = np.clip(sunk, 0.0, depth), -(happened.gap[k] + twin.residual @ force[k])
                soft = np.where(depth > 0.0, np.maximum(0.0, slope * sunk + kept * before), 0.0)
                clear = sunk < depth - 1e-12
                error = 1e-12 * slope + 1e-9 * (1.0 + force[k])
                assert np.all(sunk <= depth + 1e-12)
                assert np.all(np.abs(force[k] - soft)[clear] <= error[clear])
                assert np.all(force[k] >= soft - error)
                inside += int((clear & (force[k] > 0.0)).sum())
                stopped += int((~clear & (force[k] > 0.0)).sum())
    assert inside > 40 and stopped > 40, (inside, stopped)


@pytest.mark.parametrize("lightness", [1.0, 30.0, 1000.0])
def test_no_frame_gains_energy(lightness: float) -> None:
    """With what the layers hold among it; not even where forces are held over a frame."""
    touched = held = 0
    for seed in range(40):
        kernel = soft_scene(1000 + seed, 2 ** (seed % 4), lightness)[2]
        gains_nothing(kernel, seed)
        touched += int(kernel.coupling.counts[coupling.TOUCHED])
        held += kernel.held_frames
    assert touched > 1000
    assert (held == 0) if lightness == 1.0 else (held > 0 or lightness < 1000.0)


@pytest.mark.parametrize("steps", [1, 2, 8])
def test_blocks_are_single_frames_and_certificates_change_nothing(steps: int) -> None:
    for seed in range(8):
        twin, x, one, _ = soft_scene(100 + seed, steps)
        many, certified = (soft_scene(100 + seed, steps, engaged=engaged)[2] for engaged in (True, False))
        for _ in range(43):
            one.advance(1)
        for kernel in (many, certified):
            for frames in (24, 5, 7, 1, 6):
                kernel.advance(frames)
            assert twin.system.energy(one.x - kernel.x) < 1e-16 * twin.system.energy(x), seed


def test_bare_contacts_are_the_rigid_ones() -> None:
    for seed in range(6):
        twin, x = contact_scene(seed, 2)
        bare = kernel_of(twin, layers=np.zeros((3, len(twin.places))))
        rigid = kernel_of(twin)
        for kernel in (bare, rigid):
            kernel.start(x)
            kernel.advance(40)
        assert twin.system.energy(bare.x - rigid.x) < 1e-18 * twin.system.energy(x)
