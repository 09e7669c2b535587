"""A guitar of three steel strings on twelve body modes, of plausible numbers, for tests and tools of the coupled strings."""

from __future__ import annotations

import math

import numpy as np

from synth.physics.body_modes import Body, BodyMode, BridgePlace
from synth.physics.coupled import Line
from synth.physics.string import String
from synth.physics.tuning import tuned

#: frequency [Hz], Q, mass [kg] and the direction of the motion from the normal [°]: the low modes as published for guitars
#: (Woodhouse 2004 gives their order of size), then a spread tail
MODES = (
    (102, 25, 0.45, 2), (195, 30, 0.18, 5), (220, 35, 0.35, -10), (260, 40, 0.9, 25), (305, 40, 0.7, -20),
    (375, 45, 0.35, 15), (420, 45, 0.4, -25), (480, 45, 0.5, 10), (550, 45, 0.5, 28), (620, 45, 0.5, -15),
    (700, 50, 0.45, 5), (790, 50, 0.6, -5),
)  # fmt: skip
#: pitch [Hz], diameter [m] and place across the bridge [m]
STRINGS = ((110.0, 0.9e-3, -0.016), (196.0, 0.55e-3, 0.005), (329.6, 0.33e-3, 0.027))


def body(axes: int = 1) -> Body:
    """The twelve modes; with 3 axes some rock the bridge."""
    modes = []
    for number, (hz, q, mass, angle) in enumerate(MODES):
        shape = (math.cos(math.radians(angle)), math.sin(math.radians(angle)), 3.0 * math.sin(1.0 + 2.0 * number))
        modes.append(BodyMode(hz, q, mass, (1.0,) if axes == 1 else shape[:axes]))
    return Body(tuple(modes))


def steel(frequency_hz: float, diameter_m: float, length_m: float = 0.65) -> String:
    """A plain steel string at its pitch."""
    area, inertia = math.pi * diameter_m**2 / 4, math.pi * diameter_m**4 / 64
    string = String(
        length_m, 50.0, 7850.0 * area, 2e11 * inertia, diameter_m, viscoelastic_loss=4.5e-3, thermoelastic_q_inverse=2.03e-4
    )
    return tuned(string, frequency_hz)


def lines(modes: int, axes: int = 1, angles: tuple[float, ...] = (0.0,), keeps_mass: bool = True) -> list[Line]:
    """Every string in each of the polarisations, with so many modes a line."""
    return [
        Line.from_string(steel(hz, diameter), modes, BridgePlace(offset, angle).direction(axes), keeps_mass)
        for hz, diameter, offset in STRINGS
        for angle in angles
    ]


def pluck(line: Line, position_m: float, height_m: float) -> np.ndarray:
    """w (N,) of a triangle that is rounded over 12 mm."""
    from synth.physics.excitation import triangle_pluck

    return triangle_pluck(line.length_m, position_m, height_m, 0.012, line.omega.size)
