"""Strings that share a bridge in slow motion: the string that is played, the bridge, the body, and the other strings.

film_together(…) -> what `motion.film` gives, its heights those of the string's first direction, u = Σ w φ + (x/L) b with the
bridge's motion b along it, a frame of the film after whole frames of the output rate, and

    lift       [mm per frame] b, by which the string's end, and what rides on the bridge, is raised
    rides      whether what the string touches rides on the bridge
    bridge     {axes: its components, motion: [[normal µm, lateral µm, rocking µrad …] per frame], largest: [of each]}
    body       {motion: [[of each mode, µm, of the bridge where it moves most by that mode] per frame], largest}: modes above
               the band, which the engine leaves out, are 0
    strings    [{string (its name), table, opened, played, place_mm, angle_deg, level_db: [per frame, re the loudest string
               of the film, −`FLOOR_DB` or above], motion: [[along, across; mm] per frame] at `SEEN_AT` from the bridge}]
    swing_mm   largest of all strings' motion

force and impulse are of the last step of each frame. Strings other than the one that is played are open.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from synth.author.views.film_shapes import line_at_finger, mostly_zero, places_along, rounded
from synth.author.views.instrument import draw
from synth.host.frames_tape import Frames, Shots, joined
from synth.instrument.compile import string_notes
from synth.instrument.place import find, speaking
from synth.instrument.preset import BridgeObstacle, Preset, at_note
from synth.instrument.soundboard import single_modes
from synth.physics.body_modes import AXES
from synth.physics.modes import mode_shapes
from synth.units import midi_to_note

#: of a string's level
FLOOR_DB = 90.0
#: where strings are seen from their ends, from the bridge, as a share of their length
SEEN_AT = 0.3


def film_together(
    preset: Preset,
    note: int,
    velocity: int,
    seconds: float,
    frames: int,
    start_s: float,
    longest_s: float,
    quality: str,
    rate_hz: float,
) -> dict[str, Any]:
    """See the module's docstring; arguments as `motion.film` has checked them."""
    place = find(preset, note)
    drawing = draw(preset, note, velocity)
    made = Frames(preset, place, quality, rate_hz)
    position, direction = made.position(made.line), made.body.direction[made.line]
    stride = max(1, round(seconds * rate_hz / (frames - 1)))
    first = max(1, round(start_s * rate_hz))
    shots = joined(list(made.play(velocity, first, stride, frames)))
    scene = speaking(place)
    x = places_along(scene)
    b = shots.bridge @ direction
    share = x / position.length_m
    heights = made.displacement(shots, x)
    nut = drawing["open_length_m"] - position.length_m
    rest = position.rest_height_m * (1.0 - share) + 1e-3 * drawing["saddle"]["height"] * share
    in_play = [point for point in drawing["points"] if point["in_play"]]
    points = [
        {**{name: point[name] for name in ("index", "label", "x", "height")}, "at": int(np.argmin(np.abs(x - contact)))}
        for point, contact in zip(in_play, scene.reached.positions_m, strict=True)
    ]
    contacts = len(points)
    all_mm = 1e3 * (heights + rest)
    sound = shots.out.mean(axis=1)[np.minimum(shots.ends + made.latency_samples, len(shots.out)) - 1]
    strings = _strings(preset, made, shots)
    return {
        "rate_hz": position.plan.rate_hz,
        "step_s": 1.0 / position.plan.rate_hz,
        "start_s": round(first / rate_hz, 9),
        "dt_s": stride / rate_hz,
        "release_s": round(made.strings[made.number].draw_s * rate_hz) / rate_hz,
        "length_s": longest_s,
        "slow_motion": round(rate_hz / (25.0 * stride), 1),
        "x": [round(float(place_m), 6) for place_m in nut + x],
        "rest": rounded(1e3 * rest, 5),
        "frames": rounded(all_mm, 4),
        "points": points,
        "force": mostly_zero(shots.force[:, :contacts], 4),
        "impulse": mostly_zero(shots.impulse[:, :contacts], 8),
        "finger": [
            None if math.isnan(h) else round(1e3 * h + line_at_finger(rest, x, drawing, nut), 4) for h in shots.finger
        ],
        "finger_x": drawing["pluck"]["x"],
        "output": rounded(sound, 6),
        "height_mm": [round(float(all_mm.min()), 4), round(float(all_mm.max()), 4)],
        "largest_n": round(float(shots.force.max(initial=0.0)), 4),
        "lift": rounded(1e3 * b, 5),
        "rides": isinstance(preset.obstacle, BridgeObstacle),
        "bridge": _bridge(made, shots),
        "body": _body(preset, made, shots),
        "strings": strings,
        "swing_mm": max(abs(value) for string in strings for pair in string["motion"] for value in pair),
    }


def _bridge(made: Frames, shots: Shots) -> dict[str, Any]:
    motion = 1e6 * shots.p @ made.body.moves.T
    return {
        "axes": list(AXES[: motion.shape[1]]),
        "motion": rounded(motion, 4),
        "largest": rounded(np.abs(motion).max(axis=0), 4),
    }


def _body(preset: Preset, made: Frames, shots: Shots) -> dict[str, Any]:
    """Of every mode of the preset, of a field the sum; those that the engine leaves out rest."""
    motion = np.zeros((len(shots.p), len(preset.body.mode)))
    left = list(enumerate(made.body.omega))  # modes of one frequency one after the other
    for number, table in enumerate(preset.body.mode):
        for mode in single_modes(table, len(table.shape)):
            place = next((k for k, (_, w) in enumerate(left) if math.isclose(w, 2.0 * math.pi * mode.frequency_hz)), None)
            if place is not None:
                index, _ = left.pop(place)
                motion[:, number] += 1e6 * shots.p[:, index] * max(mode.shape[:2], key=abs, default=1.0)
    return {"motion": rounded(motion, 4), "largest": round(float(np.abs(motion).max()), 4)}


def _strings(preset: Preset, made: Frames, shots: Shots) -> list[dict[str, Any]]:
    directions = made.directions
    ends = [(number, note) for number, table in enumerate(preset.string) for note in string_notes(table)]
    energy = np.zeros((len(ends), len(shots.q)))
    found = []
    for string, (number, note) in enumerate(ends):
        motion = np.zeros((len(shots.q), 2))
        for turn in range(directions):
            line = directions * string + turn
            position = made.position(line)
            shape = mode_shapes(position.length_m, np.array([(1.0 - SEEN_AT) * position.length_m]), position.own)[0]
            w = made.modes_of(line, shots.q)[:, : position.own]
            motion[:, turn] = 1e3 * (w @ shape + (1.0 - SEEN_AT) * (shots.bridge @ made.body.direction[line]))
            energy[string] += made.energy_j(line, shots)
        table = preset.string[number]
        found.append(
            {
                "string": made.strings[string].name,
                "note_name": midi_to_note(note),
                "table": number,
                "opened": note,
                "played": string == made.number,
                "place_mm": round(at_note(table.place_mm, note), 4),
                "angle_deg": round(at_note(table.angle_deg, note), 4),
                "motion": rounded(motion, 4),
            }
        )
    loudest = max(float(energy.max()), 1e-300)
    level = np.maximum(10.0 * np.log10(np.maximum(energy / loudest, 1e-300)), -FLOOR_DB)
    for each, db in zip(found, level, strict=True):
        each["level_db"] = rounded(db, 1)
    return found
