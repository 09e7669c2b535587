"""The plain loop that coupled instruments are measured beside, and their scenes, without measurements."""

from __future__ import annotations

import numpy as np
import pytest

from bench.plain_coupled import PlainInstrument, exact_step
from synth.physics.coupled import CoupledStrings, Place
from synth.physics.modes import mode_shapes
from synth.solver import coupling
from synth.solver.coupled_lines import LineArrays
from tests.coupledkit import Kernel
from tests.oracles.contact_scenes import scene
from tests.oracles.ramp_frames import RampFrames

RATE_HZ = 48000.0


def line_arrays(system: CoupledStrings, places: list[Place], heights: np.ndarray, residual: np.ndarray) -> list[LineArrays]:
    """The lines of a system over contacts, as `tests.coupledkit` gives them to the kernels."""
    made = []
    for k, line in enumerate(system.lines):
        mine, n = [c for c, place in enumerate(places) if place.line == k], line.omega.size
        where = np.array([places[i].position_m for i in mine])
        made.append(
            LineArrays(
                line.length_m, line.stiffness, line.linear_density_kg_m, line.omega, line.sigma, line.ramp, line.direction,
                mode_shapes(line.length_m, where, n).reshape(len(mine), n),
                np.array([places[i].position_m / line.length_m - places[i].rides for i in mine]),
                np.array([heights[i] for i in mine], dtype=float), residual[np.ix_(mine, mine)], line.keeps_mass,
            )
        )  # fmt: skip
    return made


def plain_of(frames: RampFrames, x: np.ndarray) -> PlainInstrument:
    system = frames.system
    body = system.body
    lines = line_arrays(system, frames.places, frames.heights, frames.residual)
    body_step = exact_step(body.omega, body.sigma, body.mass, frames.frame_s)
    radiation = np.ones((1, body.omega.size))
    plain = PlainInstrument(lines, body_step, body.shapes, radiation, frames.frame_s, [frames.steps] * len(lines))
    w, rates, p, v = system.parts()
    for k, (of_w, of_rates) in enumerate(zip(w, rates, strict=True)):
        plain.q[k, : plain.modes[k]], plain.v[k, : plain.modes[k]] = x[of_w], x[of_rates]
    plain.p[:], plain.p_speed[:] = x[p], x[v]
    plain.rest[:] = body.shapes @ x[v]
    return plain


@pytest.mark.parametrize("steps", [1, 4, 8])
def test_the_plain_loop_is_the_physics_of_the_kernels(steps: int) -> None:
    """Strings that touch, over 60 frames: sound, displacements and speed of the bridge within rounding of the kernels'."""
    compared = touched = 0
    for seed in range(12):
        frames, state = scene(np.random.default_rng(seed), steps, RATE_HZ)
        own = RampFrames(
            frames.system, frames.frame_s, steps, frames.places, frames.heights, frames.residual, coupling.KEPT_BY_THE_REST
        )
        kernel = Kernel(own.system, own.frame_s, steps, own.places, list(own.heights), own.residual)
        kernel.start(state.x)
        plain = plain_of(own, state.x)
        ours, theirs = kernel.advance(60)[0:60], plain.advance(60)[0]
        touched += int(kernel.force.any())
        if plain.unsolved or kernel.held_frames:
            continue
        compared += 1
        np.testing.assert_allclose(theirs, ours, atol=1e-7 * np.abs(ours).max(), err_msg=str(seed))
        for k, line_state in enumerate(kernel.states):
            n = plain.modes[k]
            np.testing.assert_allclose(plain.q[k, :n], line_state.q[:n], atol=1e-8 * np.abs(line_state.q).max())
        np.testing.assert_allclose(plain.speed, kernel.coupling.speed, atol=1e-7 * np.abs(kernel.coupling.speed).max())
    assert compared >= 10
