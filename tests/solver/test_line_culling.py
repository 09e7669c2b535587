"""Contacts that are passed over for a few passes: no sound depends on it."""

from __future__ import annotations

import numpy as np
import pytest

from synth.physics.coupled import CoupledStrings, Place
from synth.physics.modes import mode_shapes
from synth.solver import coupling
from synth.solver.line_culling import cull, spend_left
from tests.coupledkit import Kernel, gains_nothing
from tests.oracles.ramp_frames import RampFrames
from tests.oracles.three_strings import body, lines, pluck

RATE_HZ = 48000.0
#: contacts from which on none are passed over
ALL = 1000


def fretted(seed: int, steps: int, **options) -> tuple[RampFrames, np.ndarray, Kernel]:
    """Three strings in two directions, plucked, the first direction of each over six to eleven frets, some of which it
    touches; the twin, its x, the kernel on it."""
    rng = np.random.default_rng(seed)
    axes = int(rng.integers(2, 4))
    system = CoupledStrings(tuple(lines(int(rng.integers(20, 40)), axes, (0.0, 90.0))), body(axes))
    x = np.zeros(system.size)
    places, heights = [], []
    for number, (line, part) in enumerate(zip(system.lines, system.parts()[0], strict=True)):
        down = -1.0 if rng.integers(2) else 1.0
        x[part] = pluck(line, rng.uniform(0.1, 0.4) * line.length_m, down * rng.uniform(0.5e-3, 2e-3))
        if number % 2 == 0:
            count = int(rng.integers(6, 12))
            places += [Place(number, line.length_m * (1.0 - 2.0 ** (-k / 12.0))) for k in range(1, count + 1)]
            heights += list(-np.linspace(0.2e-3, rng.uniform(0.4e-3, 2e-3), count))
    heights = list(np.minimum(heights, system.displacement_rows(places) @ x))
    residual = np.diag(10 ** rng.uniform(-8.0, -6.5, len(places)))
    twin = RampFrames(system, 1.0 / RATE_HZ, steps, places, heights, residual, coupling.KEPT_BY_THE_REST)
    kernel = Kernel(system, twin.frame_s, steps, places, heights, residual, **options)
    kernel.start(x)
    return twin, x, kernel


def looked_at(kernel: Kernel) -> tuple[int, int]:
    """Contacts looked at in the last pass, of how many."""
    engaged = [end for end in kernel.ends if end.counts[coupling.KIND] >= coupling.SINGLE]
    return sum(int(end.counts[coupling.NEAR]) for end in engaged), sum(end.leverage.size for end in engaged)


def distance(twin: RampFrames, one: np.ndarray, other: np.ndarray, x: np.ndarray) -> float:
    """Of two states, √ of the share of the energy that x has."""
    return float(np.sqrt(twin.system.energy(one - other) / twin.system.energy(x)))


@pytest.mark.parametrize("steps", [1, 4, 8])
def test_fretted_strings_are_the_twin_s(steps: int) -> None:
    touched = near = there = 0
    for seed in range(6):
        twin, x, kernel = fretted(seed, steps)
        state = twin.start(x)
        for frame in range(32):
            state, happened = twin.advance(state)
            kernel.advance(1)
            touched += bool(happened.force.any())
            assert distance(twin, kernel.x, state.x, x) < 1e-9, (seed, frame)
            some, all_of_them = looked_at(kernel)
            near, there = near + some, there + all_of_them
    assert touched > 20
    assert near < 0.7 * there


@pytest.mark.parametrize("steps", [1, 2, 8])
@pytest.mark.parametrize("held", [False, True])
def test_what_is_passed_over_changes_nothing(steps: int, held: bool) -> None:
    """With a finger that draws a string and lets it go, too: to rounding, as long as few frames touch."""
    near = there = touched = compared = 0
    for seed in range(10):
        _, x, some = fretted(100 + seed, steps, path=1 + 64 * steps)
        every = fretted(100 + seed, steps, path=1 + 64 * steps, culled_from=ALL)[2]
        pair = (some, every)
        if held:
            x = 1e-2 * x
            for kernel in pair:
                kernel.start(x)
        for block in range(6):
            for kernel in pair:
                if held:
                    drawn(kernel, block, steps, seed)
                kernel.advance(61 if block % 2 else 64)
            if block < 2 if held else every.coupling.counts[coupling.TOUCHED] <= 24:  # a finger's frames count, too
                assert np.abs(some.x - every.x).max() < 1e-8 * np.abs(every.x).max(), (seed, block)
                compared += 1
            mine, all_of_them = looked_at(some)
            near, there = near + mine, there + all_of_them
        touched += int(some.coupling.counts[coupling.TOUCHED])
    assert compared > 10 and touched > 20
    assert near < 0.7 * there


@pytest.mark.parametrize("steps", [1, 2, 4, 8])
def test_blocks_cut_short_under_a_finger_are_single_frames(steps: int) -> None:
    """While a finger presses a string down on some of its frets: to rounding."""
    touched, by_pieces = 0, (13, 6, 20, 7, 5)
    for seed in range(10):
        pair = []
        for pieces in (by_pieces, (1,) * sum(by_pieces)):
            _, x, kernel = fretted(100 + seed, steps, path=1 + 64 * steps)
            kernel.start(1e-2 * x)
            drawn(kernel, 0, steps, seed)
            path, at = kernel.ends[0].path.copy(), 0
            for frames in pieces:
                kernel.ends[0].path[: frames * steps + 1] = path[at * steps : (at + frames) * steps + 1]
                kernel.advance(frames)
                at += frames
            pair.append(kernel)
        assert np.abs(pair[0].x - pair[1].x).max() < 1e-8 * np.abs(pair[1].x).max(), seed
        touched += int(pair[0].force.any())
    assert touched > 0


def drawn(kernel: Kernel, block: int, steps: int, seed: int) -> None:
    """A finger on the first string goes down fast over these frames, up again, and leaves after three times."""
    lines_of, end = kernel.lines, kernel.ends[0]
    if block == 0:
        line = kernel.system.lines[0]
        where = (0.15 + 0.05 * (seed % 5)) * line.length_m
        weights = mode_shapes(line.length_m, np.array([where]), line.omega.size)[0]
        lines_of.hold(0, weights, where / line.length_m, 2e4, 2.0)
    if block == 3:
        lines_of.let_go(0)
    if block < 3:
        deep = 1.5e-3 * np.sin(np.pi * (64 * block + np.arange(64 * steps + 1) / steps) / 150.0)
        end.path[:] = -deep


def test_no_frame_gains_energy() -> None:
    touched = 0
    for seed in range(12):
        kernel = fretted(300 + seed, 2 ** (seed % 4))[2]
        gains_nothing(kernel, seed, 100)
        touched += int(kernel.coupling.counts[coupling.TOUCHED])
    assert touched > 50


def culled(seed: int, steps: int, frames: int) -> tuple[Kernel, np.ndarray]:
    """A kernel whose first string has been asked how much is left for so many frames; the gaps of its contacts then."""
    kernel = fretted(500 + seed, steps)[2]
    kernel.advance(int(np.random.default_rng(seed).integers(1, 40)))
    kernel.ends[0].block.known[coupling.CULLING] = coupling.LONG
    kernel.ends[0].numbers[coupling.LATELY] = 0.0
    cull(kernel.address, 0, kernel.lines.scratch, steps * frames)
    return kernel, gaps(kernel)


def gaps(kernel: Kernel) -> np.ndarray:
    """Of the first string's contacts, as its modes have them."""
    model, end, n = kernel.models[0], kernel.ends[0], kernel.system.lines[0].omega.size
    height = float(kernel.coupling.lines.direction[0] @ kernel.coupling.bridge.beta)
    return model.contacts.shapes[:, :n] @ kernel.states[0].q[:n] + end.leverage * height - kernel.states[0].eta


@pytest.mark.parametrize("pushed", ["nothing", "contact", "bridge", "finger"])
def test_nothing_moves_further_than_is_spent(pushed: str) -> None:
    """A string that flies free from where it was asked, but for one push somewhere."""
    closest = 1.0
    for seed in range(20):
        rng, steps, frames = np.random.default_rng(seed), 4, 8
        kernel, before = culled(seed, steps, frames)
        end, state, model, n = kernel.ends[0], kernel.states[0], kernel.models[0], kernel.system.lines[0].omega.size
        first = before - end.block.left
        if pushed == "nothing" and seed % 2:  # one mode alone that is going through its middle: the bound is what it moves
            state.q[:n], state.v[:n] = 0.0, 0.0
            state.v[seed % 5] = 0.1
            cull(kernel.address, 0, kernel.lines.scratch, steps * frames)
            before = gaps(kernel)
            first = before - end.block.left
        there = end.block.left > 0.0
        turn, speed, end.counts[coupling.NEAR] = 0.0, 0.0, 0
        end.block.forces[:] = 0.0
        rows = model.rows
        if pushed == "contact":
            end.counts[coupling.NEAR], end.block.near[0] = 1, rng.integers(end.block.left.size)
            end.block.forces[0, 0] = rng.uniform(0.0, 1.0)
            shape, force = model.contacts.shapes[end.block.near[0], :n], end.block.forces[0, 0]
        elif pushed == "finger":
            line = kernel.system.lines[0]
            where = rng.uniform(0.1, 0.9) * line.length_m
            kernel.lines.hold(0, mode_shapes(line.length_m, np.array([where]), n)[0], where / line.length_m, 1e4, 0.0)
            state.finger[0]["push"] = rng.uniform(-1.0, 1.0)
            cull(kernel.address, 0, kernel.lines.scratch, steps * frames)
            there, first = end.block.left > 0.0, before - end.block.left
            more = rng.uniform(-1.0, 1.0)
            end.block.forces[-1, :steps] = state.finger[0]["push"]
            end.block.forces[-1, 0] += more
            shape, force = state.grip.weights[:n], state.finger[0]["push"] + more
        elif pushed == "bridge":
            turn, speed, shape, force = rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), model.contacts.shapes[0, :n], 0.0
        else:
            shape, force = model.contacts.shapes[0, :n], 0.0
        if not there.any():
            continue
        lasts = end.block.known[coupling.LASTS]
        spend_left(kernel.address, 0, 0, turn, speed)
        allowed = before - end.block.left  # what free flight may do, and what has been spent
        assert np.all(allowed[there] >= first[there])
        q, v = state.q[:n].copy(), state.v[:n] + end.kick[:n] * turn
        for step in range(lasts):
            q, v = rows[0, :n] * q + rows[1, :n] * v, rows[2, :n] * q + rows[3, :n] * v
            push = force if step == 0 else (state.finger[0]["push"] if pushed == "finger" else 0.0)
            q, v = q + rows[4, :n] * shape * push, v + rows[5, :n] * shape * push
            way = end.leverage * (speed * model.dt * min(step + 1, steps))
            now = model.contacts.shapes[:, :n] @ q - model.contacts.shapes[:, :n] @ state.q[:n] + way
            assert np.all(-now[there] <= allowed[there]), (pushed, seed, step)
            closest = min(closest, float((1.0 + now[there] / allowed[there]).min()))
    assert closest < 0.9
    if pushed == "nothing":
        assert closest < 0.15


@pytest.mark.slow
def test_a_block_in_which_it_is_used_up_is_gone_through_once_more() -> None:
    """A finger that pushes a string suddenly onto frets which were passed over."""
    taken_back = 0
    for seed in range(6):
        some, every = (fretted(700 + seed, 8, path=1 + 64 * 8, culled_from=count)[2] for count in (5, ALL))
        line = some.system.lines[0]
        where = 0.3 * line.length_m
        weights = mode_shapes(line.length_m, np.array([where]), line.omega.size)[0]
        for kernel in (some, every):
            kernel.start(np.zeros(kernel.system.size))
            kernel.lines.hold(0, weights, 0.3, 3e4, 1.0)
            kernel.ends[0].path[:] = np.where(np.arange(64 * 8 + 1) < 8 * 11 + seed, 0.0, -3e-3)
            kernel.advance(16)
        assert every.coupling.counts[coupling.FRAMES] == 16
        taken_back += int(some.coupling.counts[coupling.FRAMES]) - 16
        assert np.abs(some.x - every.x).max() < 1e-9 * np.abs(every.x).max()
    assert taken_back > 0


def test_a_contact_whose_gap_is_used_up_is_followed_until_the_call_ends() -> None:
    """A finger that pushes a string further and further down: the block is left off in the frame that uses a gap up, not at
    its end, and what is followed is looked at in every pass of the call, but not in that of the next one."""
    followed = 0
    for seed in range(6):
        kernel = fretted(700 + seed, 8, path=1 + 64 * 8, culled_from=5)[2]
        end, line = kernel.ends[0], kernel.system.lines[0]
        where = 0.3 * line.length_m
        kernel.start(np.zeros(kernel.system.size))
        kernel.lines.hold(0, mode_shapes(line.length_m, np.array([where]), line.omega.size)[0], 0.3, 3e4, 1.0)
        end.path[:] = np.where(np.arange(64 * 8 + 1) < 8 * 10, 0.0, -3e-3)
        kernel.advance(16)
        more = int(kernel.coupling.counts[coupling.FRAMES]) - 16
        assert more < coupling.BLOCK  # a block gone through to its end would count whole
        marked = np.flatnonzero(end.block.left == coupling.FOLLOWED)
        assert (marked.size > 0) == (more > 0)
        followed += marked.size
        state = kernel.states[0]
        state.q[:], state.v[:] = 0.0, 0.0  # far from all of them
        state.finger[0]["push"] = 0.0
        end.block.known[coupling.CULLING] = coupling.LONG
        near = cull(kernel.address, 0, kernel.lines.scratch, 8)
        assert near >= marked.size and np.all(end.block.left[marked] == coupling.FOLLOWED)
        kernel.start(np.zeros(kernel.system.size))
        kernel.lines.let_go(0)
        kernel.advance(1)
        assert not np.any(end.block.left == coupling.FOLLOWED)
    assert followed > 0


@pytest.mark.parametrize("height", [1e-3, 3e-3])
def test_sets_of_contacts_that_depend_on_each_other(height: float) -> None:
    """Two contacts at one place: sets with both have no table, and forces are found all the same."""
    system = CoupledStrings(tuple(lines(2, 1)[:1]), body(1))
    line = system.lines[0]
    places = [Place(0, share * line.length_m) for share in (0.3, 0.3, 0.6)]
    kernel = Kernel(system, 1.0 / RATE_HZ, 4, places, [-1e-4, -1e-4, -1e-4])
    x = np.zeros(system.size)
    x[system.parts()[0][0]] = pluck(line, 0.2, height)
    kernel.start(x)
    gains_nothing(kernel, height)
    assert kernel.coupling.counts[coupling.TOUCHED] > 0
    known = kernel.ends[0].block.known
    assert known[coupling.OF_SETS] == 3 and known[coupling.SETS] > 0
    assert known[coupling.SETS] & (1 << 0b011 | 1 << 0b111) == 0
