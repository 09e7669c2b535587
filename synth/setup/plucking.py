"""A player's stroke at a note: where, how wide, how fast the finger draws the string and how it lets go.

The law is the engine's (`engine.stroke`): place, width and slip follow the velocity, a stopped note is plucked with the
force of the open string. What varies from stroke to stroke is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from synth.engine.articulated import pluck_of
from synth.engine.stroke import NEAREST, between, drawn_by, finger_distance, finger_width, pluck_force
from synth.engine.strokes import LONGEST_DRAW_S, LONGEST_SLIP_S
from synth.instrument.articulations import NORMAL, Articulation
from synth.instrument.compile import CompiledString, Position
from synth.instrument.preset import Preset

#: MIDI velocities of the strokes that have names
VELOCITIES = {"soft": 40, "medium": 80, "hard": 120}


@dataclass(frozen=True)
class Stroke:
    """A stroke at one note.

    distance_m        of the finger from the saddle
    width_m           base of the finger's triangular weighting
    draw_s, slip_s    times in which the finger draws the string aside and in which the string slides off
    stiffness_n_m, resistance_n_s_m    spring and dashpot between finger and string
    displacement_m    to which the finger draws the string at this velocity, normal to the board; along it, too, where the
                      preset's pluck has a direction
    """

    distance_m: float
    width_m: float
    draw_s: float
    slip_s: float
    stiffness_n_m: float
    resistance_n_s_m: float
    displacement_m: float

    @property
    def seconds(self) -> float:
        """Time from touching the string to its being free."""
        return self.draw_s + self.slip_s


def stroke_of(
    preset: Preset, string: CompiledString, position: Position, velocity: float, place_m: float | None = None
) -> Stroke:
    """The stroke of a velocity (0 … 127) at a note of a compiled string.

    place_m: distance from the saddle [m] in the place of the preset's. Raises ValueError for an excitation that is not a
    pluck, and for a place that is not on the speaking string.
    """
    way, strength = preset.articulations.get(NORMAL, Articulation()), velocity / 127.0
    if way.stroke == "throw":
        raise ValueError(
            f"articulations.{NORMAL} of {preset.name} must draw the string, got a throw; take a preset that is plucked"
        )
    pluck = pluck_of(preset.pluck, way)
    if preset.excitation is not None and preset.excitation.kind != "pluck":
        raise ValueError(
            f"excitation of {preset.name} must be a pluck, got {preset.excitation.kind}; take a preset that is plucked"
        )
    share = pluck.position + string.pluck_shift + strength * (pluck.hardest_position - pluck.position)
    distance = finger_distance(share, string.open_length_m, position.length_m)
    if place_m is not None:
        least = NEAREST * position.length_m
        if not least <= place_m <= position.length_m - least:
            raise ValueError(
                f"place must lie between {1e3 * least:.0f} and {1e3 * (position.length_m - least):.0f} mm from the saddle "
                f"on string {string.name} at fret {position.fret}, got {1e3 * place_m:g} mm; take another, or lower frets"
            )
        distance = place_m
    force = pluck_force(string.pluck_force_n * way.displacement_ratio, strength, pluck.velocity_exponent)
    drawn = drawn_by(force, distance, position.length_m, position.tension_n)
    across = 0.0 if preset.polarisation is None else math.radians(preset.polarisation.pluck_deg)
    slip_s, hard_slip_s = string.slip_s, string.hard_slip_s
    if way.slip_ms is not None:
        slip_s = hard_slip_s = 1e-3 * way.slip_ms
    if way.slip_hard_ms is not None:
        hard_slip_s = 1e-3 * way.slip_hard_ms
    return Stroke(
        distance,
        finger_width(
            1e-3 * pluck.width_mm,
            pluck.hardest_width_mm / pluck.width_mm,
            strength,
            distance,
            pluck.width_course == "ratios",
        ),
        min(string.draw_s if way.draw_ms is None else 1e-3 * way.draw_ms, LONGEST_DRAW_S),
        min(between(slip_s, hard_slip_s, strength), LONGEST_SLIP_S),
        1e3 * pluck.finger_stiffness_n_mm,
        pluck.finger_loss * string.impedance_kg_s,
        drawn * math.cos(across),
    )


def velocity_of(stroke: Stroke, velocity: float, exponent: float, displacement_m: float) -> float:
    """The MIDI velocity, also above 127, that draws the string so far, where `velocity` draws it by the stroke's
    displacement."""
    if exponent == 0.0 or stroke.displacement_m == 0.0:
        return math.inf
    return float(velocity * (displacement_m / stroke.displacement_m) ** (1.0 / exponent))


def moved(stroke: Stroke, by_m: float) -> Stroke:
    """The stroke moved away from the saddle by `by_m`."""
    return replace(stroke, distance_m=stroke.distance_m + by_m)
