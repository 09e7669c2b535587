"""The body over a block of frames, held to the same frames one by one and to its modes."""

from typing import NamedTuple

import numpy as np
import pytest

from synth.solver import coupling
from synth.solver.coupled_body import COMPONENTS, HAND
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
    body = c.body
    for frames in calls:
        body.ahead.knocked[0], body.ahead.knock[:frames] = 1, blows[at : at + frames]
        before = body.motion.speed.copy()
        out = np.zeros((2, frames))
        assert advance_frames(kernel.address, kernel.lines.scratch, frames, frames, out) == 0
        radiated.append(out)
        at += frames
        np.testing.assert_allclose(body.shape @ body.motion.p, c.bridge.beta, atol=1e-12 * np.abs(c.bridge.beta).max())
        mean = body.radiation @ (body.motion.speed - before) / (c.frame * frames)
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
    body = kernel.coupling.body
    for source in range(COMPONENTS + 1):
        rows, (p, v) = body.rows, np.zeros((2, body.motion.p.size))
        push = np.zeros(body.motion.p.size) if source == HAND else body.shape[source]
        kicked = body.struck if source == HAND else 0.0 * body.struck
        for k in range(coupling.BLOCK, 2 * coupling.BLOCK):
            before, v = v, v + kicked
            p, v = rows[0] * p + rows[1] * v + rows[4] * push, rows[2] * p + rows[3] * v + rows[5] * push
            push, kicked = 0.0 * push, 0.0 * kicked
            np.testing.assert_allclose(body.moves[:, source, k], body.shape @ p, atol=1e-13 * np.abs(body.moves).max())
            np.testing.assert_allclose(
                body.sounds[:, source, k], body.radiation @ (v - before), atol=1e-13 * np.abs(body.sounds).max()
            )
    assert not body.moves[..., : coupling.BLOCK].any() and not body.sounds[..., : coupling.BLOCK].any()
