"""Random scenes of strings that touch what stands under them while their body moves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from synth.physics.body_modes import Body, BodyMode, BridgePlace
from synth.physics.coupled import CoupledStrings, Line, Place
from tests.oracles.ramp_frames import RampFrames, State
from tests.oracles.three_strings import pluck, steel


def scene(
    rng: np.random.Generator, steps: int, rate_hz: float = 48000.0, lightness: float = 1.0
) -> tuple[RampFrames, State]:
    """One to three lines on a body of one to three axes over one to three points each, plucked down on them; `lightness`
    divides the body's masses."""
    axes = int(rng.integers(1, 4))
    modes = []
    for _ in range(int(rng.integers(1, 6))):
        shape = rng.normal(size=axes) * np.array([1.0, 0.5, 5.0])[:axes]
        mass = 10 ** rng.uniform(-1.5, 0.0) / lightness
        modes.append(BodyMode(10 ** rng.uniform(1.8, 3.3), 10 ** rng.uniform(0.7, 5.0), mass, tuple(shape)))
    lines, places, heights, states = [], [], [], []
    for number in range(int(rng.integers(1, 4))):
        place = BridgePlace(rng.uniform(-0.03, 0.03), rng.choice([0.0, 0.0, 20.0]))
        string = steel(10 ** rng.uniform(1.9, 2.6), rng.uniform(0.25e-3, 0.8e-3))
        line = Line.from_string(string, int(rng.integers(10, 40)), place.direction(axes), bool(rng.integers(2)))
        if rng.integers(2):  # nothing but contacts takes energy, and the body where its Q is low
            line = replace(line, sigma=np.zeros_like(line.sigma))
        lines.append(line)
        states.append(pluck(line, rng.uniform(0.05, 0.5) * line.length_m, rng.uniform(0.5e-3, 3e-3)))
        near_bridge = bool(rng.integers(2))
        where = np.sort(rng.uniform(0.95, 0.995, 3) if near_bridge else rng.uniform(0.2, 0.95, 3)) * line.length_m
        for x in where[: int(rng.integers(1, 4))]:
            places.append(Place(number, float(x), near_bridge and bool(rng.integers(2))))
            heights.append(-(10 ** rng.uniform(-6.0, -3.5)))
    system = CoupledStrings(tuple(lines), Body(tuple(modes)))
    # of contacts on one line: a positive semidefinite residual of the size of a stiff string's
    count = len(places)
    root = rng.normal(size=(count, count)) * np.array([[a.line == b.line for b in places] for a in places])
    residual = root @ root.T * 10 ** rng.uniform(-8.0, -5.5) if rng.integers(4) else np.zeros((count, count))
    frames = RampFrames(system, 1.0 / rate_hz, steps, places, heights, residual, float(rng.choice([0.9, 1.0, 0.5])))
    x = np.zeros(system.size)
    w, _, _, v = system.parts()
    for part, shape in zip(w, states, strict=True):
        x[part] = shape
    x[v] = rng.normal(size=len(modes)) * 0.05 * math.sqrt(lightness)
    gaps = system.displacement_rows(places) @ x
    frames.heights = np.minimum(frames.heights, gaps)  # nothing begins inside an obstacle
    return frames, frames.start(x)
