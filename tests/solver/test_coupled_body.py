"""The body over a block of frames, held to the same frames one by one and to its modes."""

from typing import NamedTuple

import numpy as np
import pytest

from synth.solver import coupling
from synth.solver.frames import advance_frames
from tests.coupledkit import Kernel
from tests.solver.test_coupled_frames import RATE_HZ, contact_scene, size_of

CALLS = (24, 11, 8, 5)


class Played(NamedTuple):
    """A kernel after some calls, and what it gave."""

    kernel: Kernel
    radiated: np.ndarray


def played(seed: int, steps: int, engaged: bool, calls: tuple[int, ...]) -> Played:
    """A scene of strings that touch, while a hand knocks on the body in every third frame or so; two channels."""
    twin, x = contact_scene(seed, steps)
    twin.heights -= 0.0 if engaged else 1e-4
    rng, modes = np.random.default_rng(seed), len(twin.system.body.modes)
    kernel = Kernel(
        twin.system, twin.frame_s, steps, twin.places, list(twin.heights), twin.residual, engaged=engaged, knocks=max(calls),
        radiation=rng.normal(size=(2, modes)), struck=rng.normal(size=modes) / (twin.system.body.mass * RATE_HZ),
    )  # fmt: skip
    blows = rng.normal(size=sum(calls)) * (rng.random(sum(calls)) < 0.3)
    kernel.start(x)
    c, radiated, at = kernel.coupling, [], 0
    for frames in calls:
        c.knocked[0], c.knock[:frames] = 1, blows[at : at + frames]
        before = c.p_speed.copy()
        out = np.zeros((2, frames))
        assert advance_frames(kernel.address, kernel.lines.scratch, frames, frames, out) == 0
        radiated.append(out)
        at += frames
        np.testing.assert_allclose(c.shape @ c.p, c.beta, atol=1e-12 * np.abs(c.beta).max())
        mean = c.radiation @ (c.p_speed - before) / (c.frame * frames)
        np.testing.assert_allclose(out.mean(axis=1), mean, atol=1e-11 * np.abs(out).max())
    return Played(kernel, np.hstack(radiated))


@pytest.mark.parametrize("engaged", [True, False], ids=["looked at", "certified"])
@pytest.mark.parametrize("steps", [1, 4])
def test_a_block_is_its_frames_one_by_one(steps: int, engaged: bool) -> None:
    touched = again = 0
    for seed in range(400, 416):
        many, one = (played(seed, steps, engaged, calls) for calls in (CALLS, (1,) * sum(CALLS)))
        system = many.kernel.system
        assert size_of(system, many.kernel.x - one.kernel.x) < 1e-9 * size_of(system, one.kernel.x), seed
        np.testing.assert_allclose(many.radiated, one.radiated, atol=1e-9 * np.abs(one.radiated).max())
        touched += int(many.kernel.coupling.counts[coupling.TOUCHED])
        again += int(many.kernel.coupling.counts[coupling.FRAMES]) - sum(CALLS)
    assert touched > 30
    assert engaged or again > 0


def test_what_a_response_says_is_what_the_modes_do() -> None:
    """Each force and the knock by itself, on the modes a frame at a time."""
    kernel = played(400, 1, True, (8,)).kernel
    c = kernel.coupling
    for source in range(coupling.COMPONENTS + 1):
        p, v = np.zeros((2, c.p.size))
        push = np.zeros(c.p.size) if source == coupling.HAND else c.shape[source]
        kicked = c.struck if source == coupling.HAND else 0.0 * c.struck
        for k in range(coupling.BLOCK, 2 * coupling.BLOCK):
            before, v = v, v + kicked
            p, v = c.body[0] * p + c.body[1] * v + c.body[4] * push, c.body[2] * p + c.body[3] * v + c.body[5] * push
            push, kicked = 0.0 * push, 0.0 * kicked
            np.testing.assert_allclose(c.moves[:, source, k], c.shape @ p, atol=1e-13 * np.abs(c.moves).max())
            np.testing.assert_allclose(
                c.sounds[:, source, k], c.radiation @ (v - before), atol=1e-13 * np.abs(c.sounds).max()
            )
    assert not c.moves[..., : coupling.BLOCK].any() and not c.sounds[..., : coupling.BLOCK].any()
