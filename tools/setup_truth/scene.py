"""A drawn note as a case of `synth.simulate`.

The string is the preset's; its frets and the stroke are worked out here from the preset's keys, once more, so that the map's
own are checked: a finger whose place, width and slip follow the velocity, and which draws a stopped string with the force
that it draws the open one with.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from setup_truth.draw import Drawn, frets_beyond
from synth.instrument.compile import open_string, speaking_string
from synth.instrument.preset import Preset, at_note
from synth.physics.modes import modal_frequencies
from synth.physics.string import String

#: rows per second: what lies so far above the bands that it could fold into them is far below the rest of a motion [Hz]
ROWS_HZ = 176400.0
#: seconds of a note after the string is free
SECONDS = 0.25
#: a force on the saddle follows from the displacements so near to it [m]
NEAR_SADDLE_M = (0.5e-3, 1.0e-3, 1.5e-3)
#: points at which a pickup's aperture is looked at, by Gauss's rule
APERTURE_POINTS = 12


@dataclass(frozen=True)
class Scene:
    """A note and what is heard of it.

    tables      of the case, whose one finger has no displacement yet
    weights     (P,) what is heard of each output's displacement
    speed       whether it is the velocity that is heard
    pitch_hz    of the first partial
    free_s      when the string is free
    limit_m     twice the displacement of velocity 127
    """

    tables: dict[str, Any]
    weights: np.ndarray
    speed: bool
    pitch_hz: float
    free_s: float
    limit_m: float

    def case(self, displacement_m: float, *, frets: bool = True) -> dict[str, Any]:
        """The tables of a stroke."""
        finger = {**self.tables["finger"][0], "displacement_m": displacement_m}
        tables = {**self.tables, "finger": [finger]}
        if not frets:
            del tables["obstacle"]
        return tables


def scene_of(note: Drawn) -> Scene:
    """The scene of a drawn note."""
    preset = note.loaded()
    alone = preset.on_rigid_ends
    table = alone.string[note.index]
    opened, below = open_string(alone, table, note.opened)
    string, _, _ = speaking_string(alone, table, note.opened, note.fret, opened, below)
    speaking, positions, heights = frets_beyond(preset, note.fret, opened.length_m)
    finger, limit = _finger(preset, note, opened, string)
    outputs, weights = _heard(alone, opened, string)
    free = finger["draw_s"] + finger["slip_s"]
    assert abs(speaking / string.length_m - 1.0) < 1e-12
    tables = {
        "string": _string_table(string),
        "obstacle": {"positions_m": positions.tolist(), "heights_m": heights.tolist()},
        "finger": [finger],
        "run": {"internal_rate_hz": ROWS_HZ, "output_rate_hz": ROWS_HZ, "modes": 10, "duration_s": free + SECONDS,
                "outputs_m": outputs},
    }  # fmt: skip
    speed = alone.output.kind in ("pickup", "velocity")
    return Scene(tables, weights, speed, float(modal_frequencies(string, 1)[0]) / (2.0 * math.pi), free, limit)


def _string_table(string: String) -> dict[str, Any]:
    assert not string.measured_frequencies_hz and not string.measured_decay_rates
    names = (
        "length_m", "tension_n", "linear_density_kg_m", "diameter_m", "bending_stiffness_n_m2", "core_diameter_m",
        "winding_diameter_m", "viscoelastic_loss", "thermoelastic_q_inverse", "air_viscosity", "air_density",
        "stiffness_law",
    )  # fmt: skip
    values = {name: getattr(string, name) for name in names}
    nut = [{"frequency_hz": each.frequency_hz, "q": each.q, "mass_kg": each.mass_kg} for each in string.nut]
    return {name: value for name, value in values.items() if value is not None} | {"nut": nut}


def _finger(preset: Preset, note: Drawn, opened: String, string: String) -> tuple[dict[str, float], float]:
    """A [[finger]] without its displacement, and the limit of that [m]."""
    pluck, table, key = preset.pluck, preset.string[note.index], note.opened
    length, speaking, strength = opened.length_m, string.length_m, note.velocity / 127.0
    soft = pluck.position if table.pluck_position is None else at_note(table.pluck_position, key)
    harder = 0.0 if pluck.position_hard is None else pluck.position_hard - pluck.position

    def distance_at(hard: float) -> float:
        wanted = (soft + hard * harder) * length if note.place_m is None else note.place_m
        return float(np.clip(wanted, 0.02 * speaking, 0.5 * speaking))

    distance = distance_at(strength)
    hard_width = pluck.width_mm if pluck.width_hard_mm is None else pluck.width_hard_mm
    width = 1e-3 * (pluck.width_mm + strength * (hard_width - pluck.width_mm))
    slips = [1e-3 * at_note(pluck.slip_ms, key)]
    slips.append(slips[0] if pluck.slip_hard_ms is None else 1e-3 * at_note(pluck.slip_hard_ms, key))
    if min(slips) > 0.0:
        slip = math.exp((1.0 - strength) * math.log(slips[0]) + strength * math.log(slips[1]))
    else:
        slip = (1.0 - strength) * slips[0] + strength * slips[1]
    finger = {
        "position_m": speaking - distance,
        "width_m": min(width, 1.5 * distance),
        "draw_s": 1e-3 * at_note(pluck.draw_ms, key),
        "slip_s": slip,
        "stiffness_n_m": 1e3 * pluck.finger_stiffness_n_mm,
        "resistance_n_s_m": pluck.finger_loss * math.sqrt(opened.tension_n * opened.linear_density_kg_m),
    }
    # the force that draws the open string by the preset's displacement, where its softest stroke is
    force = 1e-3 * at_note(pluck.displacement_mm, key) * opened.tension_n / (soft * (1.0 - soft) * length)
    hardest = distance_at(1.0)
    normal = 1.0 if preset.polarisation is None else math.cos(math.radians(preset.polarisation.pluck_deg))
    return finger, 2.0 * normal * force * hardest * (1.0 - hardest / speaking) / string.tension_n


def _heard(preset: Preset, opened: String, string: String) -> tuple[list[float], np.ndarray]:
    """Places of the outputs from the nut end [m] and their weights."""
    output = preset.output
    distance = min(output.position * opened.length_m, 0.98 * string.length_m)
    if output.kind == "force":
        assert distance == 0.0
        return [string.length_m - each for each in NEAR_SADDLE_M], _force_weights(string)
    if output.kind != "pickup":
        return [string.length_m - distance], np.ones(1)
    nodes, weights = np.polynomial.legendre.leggauss(APERTURE_POINTS)
    centre, half = string.length_m - distance, 0.5e-3 * output.aperture_mm
    return (centre + half * nodes).tolist(), 0.5 * weights


def _force_weights(string: String) -> np.ndarray:
    """(P,) weights of the displacements near the saddle that make T u′ − EI u‴ of them, where a stiff string is pinned:
    u = a s + b s³/6 + c s⁵/120 at s from the saddle."""
    s = np.array(NEAR_SADDLE_M)
    rows = np.array([s, s**3 / 6.0, s**5 / 120.0])
    return np.asarray(np.linalg.solve(rows, [string.tension_n, -string.bending_stiffness_n_m2, 0.0]))
