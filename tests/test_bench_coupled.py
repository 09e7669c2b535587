"""The plain loop that coupled instruments are measured beside, and their scenes, without measurements."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from benchmarks import coupled_scenes, karplus_strong
from benchmarks.plain_coupled import PlainInstrument, exact_step

from synth.instrument.preset import load_preset
from synth.midi.events import BEND, NOTE_ON, make_events
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
        ours, theirs = kernel.advance(60), plain.advance(60)[0]
        touched += int(kernel.force.any())
        if plain.unsolved or kernel.held_frames:
            continue
        compared += 1
        np.testing.assert_allclose(theirs, ours, atol=1e-7 * np.abs(ours).max(), err_msg=str(seed))
        for k, line_state in enumerate(kernel.states):
            n = plain.modes[k]
            np.testing.assert_allclose(plain.q[k, :n], line_state.q[:n], atol=1e-8 * np.abs(line_state.q).max())
        speed = kernel.coupling.bridge.speed[: plain.speed.size]
        np.testing.assert_allclose(plain.speed, speed, atol=1e-7 * np.abs(speed).max())
    assert compared >= 10 and touched > 3


def test_the_plain_loop_is_the_engine_s_physics() -> None:
    """Open strings of a whole instrument, over frets and on its body, from a moment of the engine's on."""
    player = coupled_scenes.ringing("steel-guitar")
    plain = coupled_scenes.plain_of(player)
    assert plain.modes.size == 12 and plain.rows[-1] == 8 * plain.first[-1] > 500
    out = np.zeros((64, 2))
    for _ in range(4):
        player.engine.process(player.events[:0], out)
    assert coupled_scenes.difference(player, plain) > 0.1
    plain.advance(4 * 64)
    assert coupled_scenes.difference(player, plain) < 1e-3 and not plain.unsolved


def test_a_string_that_is_held_has_no_plain_loop() -> None:
    player = coupled_scenes.ringing("steel-guitar")
    player.engine.process(make_events([(0, NOTE_ON, 0, 40, 100)]), np.zeros((64, 2)))
    with pytest.raises(ValueError, match="held, damped or bent"):
        coupled_scenes.plain_of(player)


@pytest.mark.parametrize("frequency_hz", [82.4, 440.0])
def test_karplus_strong_is_in_tune(frequency_hz: float) -> None:
    out = np.zeros(1 << 17)
    karplus_strong.pluck(frequency_hz, out, 44100.0)
    spectrum = np.abs(np.fft.rfft(out * np.hanning(out.size), 1 << 20))
    expected = round(frequency_hz * (1 << 20) / 44100.0)
    near = slice(round(0.97 * expected), round(1.03 * expected))
    found = near.start + int(np.argmax(spectrum[near]))
    assert 1200.0 * abs(np.log2(found / expected)) < 2.0


def test_a_gesture_is_the_plain_note_and_a_wheel() -> None:
    preset = load_preset("banjo")
    plain, vibrato, bend = (coupled_scenes.rows_of_gesture(preset, each) for each in coupled_scenes.GESTURES)
    assert [row for row in vibrato if row[1] == NOTE_ON] == [row for row in bend if row[1] == NOTE_ON] == plain
    values = [row[3] for row in bend if row[1] == BEND]
    assert max(values) > 7990 and min(values) < -7990 and len(values) > 300


def test_sixty_strings_are_sixty() -> None:
    presets = [load_preset(name) for name in coupled_scenes.SIXTY]
    assert sum(len(preset.string) for preset in presets) == coupled_scenes.SIXTY_STRINGS
    assert all(preset.coupled for preset in presets)
    assert len(coupled_scenes.rows_of_sixty(presets)) == coupled_scenes.SIXTY_STRINGS - 13
