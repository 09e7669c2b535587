"""The kernels of coupled strings, held to the readable twin and to their energy."""

import numpy as np
import pytest

from synth.physics.coupled import CoupledStrings
from synth.solver import coupling
from tests.coupledkit import Kernel, gains_nothing
from tests.oracles.contact_scenes import scene
from tests.oracles.ramp_frames import RampFrames
from tests.oracles.three_strings import body, lines, pluck

RATE_HZ = 48000.0


def size_of(system: CoupledStrings, x: np.ndarray) -> float:
    """√(2 energy) of a state, or of the difference of two."""
    return float(np.sqrt(2.0 * system.energy(x)))


def kernel_of(frames: RampFrames, **options) -> Kernel:
    return Kernel(
        frames.system, frames.frame_s, frames.steps, frames.places, list(frames.heights), frames.residual, **options
    )


def contact_scene(seed: int, steps: int, lightness: float = 1.0) -> tuple[RampFrames, np.ndarray]:
    """Of `contact_scenes`, with the kernels' own ρ."""
    frames, state = scene(np.random.default_rng(seed), steps, RATE_HZ, lightness)
    own = RampFrames(
        frames.system, frames.frame_s, steps, frames.places, frames.heights, frames.residual, coupling.KEPT_BY_THE_REST
    )
    return own, state.x


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize(("steps", "look_at_all"), [(1, False), (1, True), (4, True)])
def test_free_strings_are_the_twin_s(axes: int, steps: int, look_at_all: bool) -> None:
    system = CoupledStrings(tuple(lines(24, axes, (0.0, 90.0)[:axes])), body(axes))
    twin = RampFrames(system, 1.0 / RATE_HZ, steps, rho=coupling.KEPT_BY_THE_REST)
    x = np.zeros(system.size)
    for line, part in zip(system.lines, system.parts()[0], strict=True):
        x[part] = pluck(line, 0.1, 1e-3)
    x[system.parts()[3]] = 0.01
    state, kernel = twin.start(x), Kernel(system, 1.0 / RATE_HZ, steps, look_at_all=look_at_all)
    kernel.start(x)
    for _ in range(200):
        state, _ = twin.advance(state)
    kernel.advance(200)
    assert size_of(system, kernel.x - state.x) < 1e-11 * size_of(system, x)
    assert kernel.energy == pytest.approx(twin.energy(state), rel=1e-11)


@pytest.mark.parametrize("steps", [1, 2, 4, 8])
def test_touching_strings_are_the_twin_s(steps: int) -> None:
    touched = 0
    for seed in range(16):
        twin, x = contact_scene(seed, steps)
        state, kernel = twin.start(x), kernel_of(twin)
        kernel.start(x)
        for frame in range(40):
            state, happened = twin.advance(state)
            kernel.advance(1)
            touched += bool(happened.force.any())
            assert kernel.held_frames == 0
            assert size_of(twin.system, kernel.x - state.x) < 1e-9 * size_of(twin.system, x), (seed, frame)
            np.testing.assert_allclose(kernel.force, state.force, rtol=1e-6, atol=1e-8 * (1.0 + np.abs(state.force).max()))
    assert touched > 20


@pytest.mark.parametrize("steps", [1, 2, 4, 8])
def test_blocks_whole_and_cut_short_are_single_frames(steps: int) -> None:
    for seed in range(8):
        twin, x = contact_scene(100 + seed, steps)
        one, many = kernel_of(twin), kernel_of(twin)
        one.start(x)
        many.start(x)
        radiated = np.concatenate([one.advance(1) for _ in range(59)])
        at_once = np.concatenate([many.advance(frames) for frames in (24, 3, 5, 7, 14, 6)])
        assert size_of(twin.system, one.x - many.x) < 1e-9 * size_of(twin.system, x)
        np.testing.assert_allclose(at_once, radiated, atol=1e-8 * np.abs(radiated).max())


@pytest.mark.parametrize("steps", [1, 4])
def test_certificates_change_nothing(steps: int) -> None:
    """A string that is not looked at until it might touch moves as one that always is, as far as rounding does not tell
    them apart: what has touched often is chaotic."""
    spared = came_into_reach = compared = 0
    for seed in range(24):
        twin, x = contact_scene(200 + seed, steps)
        twin.heights -= 1e-3
        always, certified = kernel_of(twin), kernel_of(twin, engaged=False)
        always.start(x)
        certified.start(x)
        before = [int(end.counts[coupling.ENGAGED]) for end in certified.ends]
        for _ in range(30):
            always.advance(16)
            certified.advance(16)
            if always.coupling.counts[coupling.TOUCHED] <= 8:
                assert size_of(twin.system, always.x - certified.x) < 1e-8 * size_of(twin.system, x), seed
                compared += int(always.coupling.counts[coupling.TOUCHED] > 0)
        after = [int(end.counts[coupling.ENGAGED]) for end in certified.ends]
        spared += sum(1 for now, mine in zip(after, certified.mine, strict=True) if mine and not now)
        came_into_reach += sum(now > then for now, then in zip(after, before, strict=True))
    assert spared > 0
    assert compared > 20
    assert came_into_reach > 0


def apart(twin, x, clearances: dict[int, float]) -> tuple[Kernel, dict[int, float]]:
    """A kernel after one block of 8 frames whose lines with contacts were apart at first, with these clearances [m]; what
    the bridge took off each line's in the last pass."""
    kernel = kernel_of(twin)
    kernel.start(x)
    for line, left in clearances.items():
        end = kernel.ends[line]
        end.counts[coupling.ENGAGED], end.counts[coupling.CERTIFIED] = 0, end.leverage.size
        end.certificate.clearance[:], end.numbers[coupling.LEAST] = left, left
    coupling.gather_lines(kernel.address)
    kernel.advance(8)
    return kernel, {line: float(kernel.ends[line].numbers[coupling.LATELY]) for line in clearances}


def test_a_block_may_be_gone_through_more_than_twice() -> None:
    """A certificate that runs out once another line, whose own has, is looked at: that line begins anew as well."""
    passes = []
    for seed in range(120):
        twin, x = contact_scene(700 + seed, 2)
        always = kernel_of(twin)
        always.start(x)
        lines = [line for line, mine in enumerate(always.mine) if mine]
        if len(lines) < 2:
            continue
        always.advance(8)
        far = 1.0
        _, alone = apart(twin, x, dict.fromkeys(lines, far))
        first, second = lines[:2]
        _, together = apart(twin, x, dict.fromkeys(lines, far) | {first: 0.5 * alone[first]})
        if not together[second] > alone[second]:
            continue
        between = 0.5 * (alone[second] + together[second])
        kernel, _ = apart(twin, x, dict.fromkeys(lines[2:], 0.0) | {first: 0.5 * alone[first], second: between})
        passes.append(int(kernel.coupling.counts[coupling.FRAMES]) // 8)
        if passes[-1] > 2:
            assert size_of(twin.system, always.x - kernel.x) < 1e-10 * size_of(twin.system, x), seed
    assert sum(count > 2 for count in passes) >= 5


@pytest.mark.parametrize("lightness", [1.0, 30.0, 1000.0])
def test_no_frame_gains_energy(lightness: float) -> None:
    """Not even where a body is too light for one root a frame, and forces have to be held."""
    touched = held = 0
    for seed in range(40):
        steps = 2 ** (seed % 4)
        twin, x = contact_scene(1000 + seed, steps, lightness)
        kernel = kernel_of(twin)
        kernel.start(x)
        gains_nothing(kernel, seed)
        touched += int(kernel.coupling.counts[coupling.TOUCHED])
        held += kernel.held_frames
    assert touched > 1000
    assert (held == 0) if lightness == 1.0 else (held > 0 or lightness < 1000.0)


def test_lines_of_different_steps_share_a_bridge() -> None:
    """That one line takes more steps than another changes nothing where nothing touches; where it does, no energy comes."""
    system = CoupledStrings(tuple(lines(24, 2, (0.0, 90.0))), body(2))
    x = np.zeros(system.size)
    for line, part in zip(system.lines, system.parts()[0], strict=True):
        x[part] = pluck(line, 0.1, 1e-3)
    mixed, even = (
        Kernel(system, 1.0 / RATE_HZ, look_at_all=True, steps_of=steps) for steps in ((1, 2, 4, 8, 2, 1), (1,) * 6)
    )
    for kernel in (mixed, even):
        kernel.start(x)
        for frames in (40, 3, 17, 100):
            kernel.advance(frames)
    assert size_of(system, mixed.x - even.x) < 1e-11 * size_of(system, x)
    touched = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        twin, start = contact_scene(5000 + seed, 1, float(rng.choice([1.0, 30.0])))
        steps = [int(2 ** rng.integers(4)) for _ in twin.system.lines]
        kernel, single = (kernel_of(twin, steps_of=steps) for _ in range(2))
        kernel.start(start)
        single.start(start)
        before = first = kernel.energy
        for block in range(20):
            kernel.advance(16)
            if block < 3:
                for _ in range(16):
                    single.advance(1)
                assert size_of(twin.system, kernel.x - single.x) < 1e-9 * size_of(twin.system, start), seed
            assert kernel.energy - before <= 1e-12 * first, seed
            before = kernel.energy
        touched += int(kernel.coupling.counts[coupling.TOUCHED])
    assert touched > 1000
