"""The body that strings share, as its bridge moves under a force: modes as peaks of the mobility, with what dragging
changes.

describe_body(preset) -> dict

    coupled      whether the preset has such a body; what follows is there only where it has
    axes         ["normal", "lateral", "rocking"], as many as the shapes have
    hz           [`ROWS` frequencies, evenly in octaves]
    mobility_db  [[of each axis, per frequency] |Y_ii| at the bridge's reference point, without strings, in dB of 1 m/(N s),
                 rocking of 1 rad/(N m s)]
    modes        of a field what a single one of its modes does in the mean, at its lowest frequency:
                 [{index, frequency_hz, q, mass_kg, rings_s (time to −60 dB), peak_db: [of each axis, what the mode alone
                 reaches at its frequency, null where it does not move that way],
                 drag: {frequency: D, q: [D per axis], mass: [D per axis]}}]
    new          a mode to begin with, in the widest gap between two: an edit of body.mode.N appends it, N how many there are
    strings      [{string, table, opened, place_mm, angle_deg, impedance_kg_s}] by place on the bridge

D is as in `instrument`, with `exponential`: value = exp(offset + factor · coordinate), the coordinates ln(frequency in Hz)
along and dB upwards; None where the mode does not move that way.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from synth.author.views.parameters import NEW_ITEMS, ranges
from synth.instrument.compile import make_string, string_frequency, string_notes
from synth.instrument.preset import MovingMode, Preset, at_note
from synth.instrument.soundboard import body_of
from synth.physics.body_modes import AXES
from synth.units import LN_1000, midi_to_note

#: frequencies of the curve, and its ends in octaves beyond the lowest and highest mode, at least from LOWEST to HIGHEST
ROWS, BEYOND = 480, 0.5
LOWEST_HZ, HIGHEST_HZ = 50.0, 4000.0
#: of a level in dB, the factor's logarithm
PER_DB = math.log(10.0) / 20.0


def describe_body(preset: Preset) -> dict[str, Any]:
    """The body of a preset; see the module's docstring."""
    if not preset.coupled:
        return {"coupled": False}
    modes = preset.body.mode
    body = body_of(preset.body.mode)
    frequencies = [mode.frequency_hz for mode in body.modes]
    low, high = min(LOWEST_HZ, min(frequencies) / 2.0**BEYOND), max(HIGHEST_HZ, max(frequencies) * 2.0**BEYOND)
    # the very top of each peak as well, which may lie between two of the even ones
    hz = np.unique(np.concatenate([np.geomspace(low, high, ROWS), frequencies]))
    mobility = np.abs(body.mobility(2.0 * math.pi * hz))
    own = np.einsum("nii->in", mobility)
    limits = ranges(preset)
    return {
        "coupled": True,
        "axes": list(AXES[: body.axes]),
        "hz": np.round(hz, 4).tolist(),
        "mobility_db": np.round(20.0 * np.log10(np.maximum(own, 1e-15)), 3).tolist(),
        "modes": [_mode(index, mode, body.axes, limits) for index, mode in enumerate(modes)],
        "new": _new(frequencies, low, high),
        "strings": _strings(preset),
    }


def _mode(index: int, mode: MovingMode, axes: int, limits: dict[str, Any]) -> dict[str, Any]:
    shape = (*mode.shape, *(0.0,) * (axes - len(mode.shape)))
    omega = 2.0 * math.pi * mode.frequency_hz
    # |Y| of a mode at its own frequency: ψ² Q/(m Ω)
    gains = [math.log(psi**2 / omega) if psi else None for psi in shape]

    def drag(key: str, offset: float, factor: float) -> dict[str, Any]:
        path = f"body.mode.{index}.{key}"
        minimum, maximum = limits[path]
        return {
            "path": path,
            "offset": offset,
            "factor": factor,
            "minimum": minimum,
            "maximum": maximum,
            "anchor": None,
            "edits": [],
            "exponential": True,
        }

    return {
        "index": index,
        "frequency_hz": mode.frequency_hz,
        "q": mode.q,
        "mass_kg": mode.mass_kg,
        "shape": list(shape),
        "rings_s": round(LN_1000 * 2.0 * mode.q / omega, 4),
        "peak_db": [None if g is None else round((g + math.log(mode.q / mode.mass_kg)) / PER_DB, 3) for g in gains],
        "drag": {
            "frequency": drag("frequency_hz", 0.0, 1.0),
            "q": [None if g is None else drag("q", math.log(mode.mass_kg) - g, PER_DB) for g in gains],
            "mass": [None if g is None else drag("mass_kg", g + math.log(mode.q), -PER_DB) for g in gains],
        },
    }


def _new(frequencies: list[float], low: float, high: float) -> dict[str, Any]:
    """A mode in the middle of the widest gap, in octaves."""
    places = sorted([low, *frequencies, high])
    a, b = max(pairwise(places), key=lambda pair: pair[1] / pair[0])
    return {**NEW_ITEMS[MovingMode], "frequency_hz": float(f"{math.sqrt(a * b):.3g}")}


def _strings(preset: Preset) -> list[dict[str, Any]]:
    found = []
    for number, table in enumerate(preset.string):
        for note in string_notes(table):
            string = make_string(preset, table, note, string_frequency(preset, table, note))
            found.append(
                {
                    "string": table.name or midi_to_note(note),
                    "table": number,
                    "opened": note,
                    "place_mm": round(at_note(table.place_mm, note), 4),
                    "angle_deg": round(at_note(table.angle_deg, note), 4),
                    "impedance_kg_s": float(f"{string.impedance_kg_s:.4g}"),
                }
            )
    return sorted(found, key=lambda string: string["place_mm"])
