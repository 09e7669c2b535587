"""Random instruments whose strings share a bridge and a body: what each number of steps a frame makes of a note of theirs.

The measure is that of strings on rigid ends (`runs.distances`): the displacement of the string that is played, near the
bridge, from the moment that the finger lets go. The engine plays the note; the reference is the same coupled scheme with
many times as many frames (REFERENCE) and eight steps in each, which stands as far as it differs from four steps in each.
Where nothing touches, the reference are the complex modes of the same strings and body, exact from the first frame after
the finger on.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from promise.runs import RATE_HZ, distances
from promise.scenes import BRIDGE_STIFFNESS, lowest
from synth.dsp.measures import relative_error
from synth.host.frames_tape import Frames, joined, line_of
from synth.instrument.compile import string_kind
from synth.instrument.place import find, speaking
from synth.instrument.plan import FREE
from synth.instrument.preset import Preset, validate_preset
from synth.instrument.soundboard import body_of, directions_of
from synth.physics.coupled import CoupledStrings, Line, Place
from synth.units import midi_to_hz

KINDS = ("free", "bridge", "points", "frets")
#: frames of 44.1 kHz that the finger draws, and seconds of a note from then on
DRAWN = 220
DURATION_S = {"free": 3.0, "bridge": 3.0, "points": 0.3, "frets": 0.3}
#: frames of the reference in one of 44.1 kHz, and its steps in each; it is held against half as many steps in each
REFERENCE = {"bridge": (4, 8), "points": (8, 8), "frets": (8, 8)}
STEPS = (1, 2, 4, 8)
#: where the string is looked at, from the saddle, as a part of its length
SEEN_AT = {"free": 0.05, "bridge": 0.009, "points": 0.05, "frets": 0.05}
#: a coupled system is solved exactly up to so many modes of all strings
MOST_EXACT = 700


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def seed(kind: str, index: int, verify: bool) -> list[int]:
    """What the random instrument of this number is drawn from: those that verify are others than those that calibrate."""
    return [1977, int(verify), KINDS.index(kind), index]


def instrument(rng: np.random.Generator, kind: str) -> tuple[Preset, int]:
    """A preset and the note that is played on it.

    free    two or three strings over nothing, of pitches at which all their modes together can be solved
    bridge  two to four strings that rest on points which ride on the bridge, or lie a little above them
    points  one to three points under two to four strings, that do not ride
    frets   two to four strings over a neck, played hard near the bridge
    """
    count = int(rng.integers(2, 4 if kind == "free" else 5))
    low, high = (55, 76) if kind == "free" else (40, 64)
    notes = sorted(int(note) for note in rng.choice(np.arange(low, high), count, replace=False))
    if rng.uniform() < 0.3:
        notes[1] = notes[0]  # two in unison
    length = float(rng.uniform(0.6, 0.9))
    tables = []
    for number, note in enumerate(notes):
        tension = _log_uniform(rng, 40.0, 150.0)
        density = tension / (2.0 * length * midi_to_hz(note)) ** 2
        tables.append(
            {
                "notes": (note, note),
                "length_m": length,
                "linear_density_g_m": 1e3 * density,
                "diameter_mm": 1e3 * math.sqrt(4.0 * density / (math.pi * 7850.0)),
                "inharmonicity": _log_uniform(rng, 1e-5, 3e-4),
                "viscoelastic_loss": _log_uniform(rng, 2e-3, 1e-2),
                "thermoelastic_q_inverse": _log_uniform(rng, 2e-5, 5e-4),
                "cents": float(rng.uniform(-4.0, 4.0)),
                "place_mm": float(10.0 * (number - 0.5 * (count - 1))),
                "angle_deg": float(rng.uniform(-10.0, 10.0)),
            }
        )
    axes = int(rng.integers(1, 4))
    modes = [
        {
            "frequency_hz": _log_uniform(rng, 80.0, 3000.0),
            "q": float(rng.uniform(15.0, 50.0)),
            "mass_kg": _log_uniform(rng, 0.3, 2.0),
            "shape": [float(rng.uniform(0.5, 1.0)), float(rng.uniform(-0.3, 0.3)), float(rng.uniform(-10.0, 10.0))][:axes],
        }
        for _ in range(int(rng.integers(3, 13)))
    ]
    pluck = float(rng.uniform(0.08, 0.3 if kind in ("points", "frets") else 0.5))
    displacement = 3e-3 * length
    played = int(rng.integers(count))
    data: dict[str, Any] = {
        "format": 2,
        "name": f"random-{kind}",
        "string": tables,
        "pluck": {
            "position": pluck,
            "displacement_mm": 1e3 * displacement,
            "width_mm": 1e3 * _log_uniform(rng, 0.005, 0.03) * length,
            "draw_ms": 1e3 * DRAWN / RATE_HZ,
        },
        "damping": {"ring_on": True},
        "output": {"kind": "body", "gain_db": -40.0},
        "body": {"mode": modes},
    }
    if axes > 1 and rng.uniform() < 0.5:
        data["polarisation"] = {
            "detuning_cents": float(rng.uniform(0.0, 2.0)),
            "loss_ratio": float(rng.uniform(0.8, 1.6)),
            "pluck_deg": float(rng.uniform(0.0, 40.0)),
        }
    fret = 0
    if kind == "bridge":
        most = min(math.sqrt(table["inharmonicity"]) / math.pi for table in tables) / BRIDGE_STIFFNESS
        ratio = _log_uniform(rng, 0.003, min(0.03, 0.9 * most))
        depth = float(rng.choice([0.0, 0.5])) * float(rng.uniform())
        jiva = depth * lowest(length, (1.0 - pluck) * length, displacement, (1.0 - ratio) * length)
        data["obstacle"] = {"kind": "bridge", "distance_ratio": ratio, "jiva_um": 1e6 * jiva}
    elif kind == "points":
        places = sorted(float(x) * length for x in rng.uniform(0.03, 0.97, int(rng.integers(1, 4))))
        heights = [-float(rng.uniform(0.3, 0.9)) * lowest(length, (1.0 - pluck) * length, displacement, x) for x in places]
        data["obstacle"] = {
            "kind": "points",
            "positions_mm": [1e3 * x for x in places],
            "heights_mm": [1e3 * height for height in heights],
        }
    elif kind == "frets":
        action = float(rng.uniform(0.6, 1.1)) * lowest(length, (1.0 - pluck) * length, displacement, 0.5 * length)
        data["obstacle"] = {
            "kind": "frets",
            "count": 20,
            "action_12th_mm": 1e3 * action,
            "relief_mm": 1e3 * float(rng.uniform(0.0, 0.15)) * action,
            "nut_height_mm": 1e3 * float(rng.uniform(0.15, 0.3)) * action,
        }
        fret = int(rng.integers(0, 13))
    preset = validate_preset(data, data["name"])
    while fret and not _sounds(preset, notes[played] + fret):
        fret -= 1
    return preset, notes[played] + fret


def _sounds(preset: Preset, note: int) -> bool:
    try:
        speaking(find(preset, note))
    except ValueError:
        return False
    return True


def displacement(preset: Preset, note: int, seconds: float, frames: int, steps: int, seen_at: float) -> np.ndarray:
    """(n,) at 44.1 kHz from the finger's release on, of the string that is played: `frames` frames in one of 44.1 kHz,
    each of `steps` steps."""
    rate_hz = float(frames * RATE_HZ)
    place = find(preset, note)
    made = Frames(preset, place, "fine", rate_hz, lines=(line_of(preset, place),), internal_rate_hz=steps * rate_hz)
    x = np.array([(1.0 - seen_at) * made.position(made.line).length_m])
    shots = made.play(127, DRAWN * frames, frames, round(seconds * RATE_HZ), frames)
    return np.concatenate([made.displacement(each, x)[:, 0] for each in shots])


def exact_displacement(preset: Preset, note: int, seconds: float, seen_at: float) -> tuple[np.ndarray, np.ndarray]:
    """((n,), (n,)) of strings over nothing at 44.1 kHz: by the engine, and by the complex modes of the same strings and body
    from the engine's state after the release on."""
    place = find(preset, note)
    made = Frames(preset, place, "fine", float(RATE_HZ))
    count = round(seconds * RATE_HZ)
    shots = joined(list(made.play(127, DRAWN + 8, 1, count)))
    positions = [made.position(line) for line in range(made.directions * len(made.strings))]
    moving = made.moving_modes
    body = body_of(preset.body.mode)
    ends = [(table, table.notes[0]) for table in preset.string]
    directions = directions_of(preset, ends, body.axes)
    lines = tuple(
        Line(each.length_m, each.tension_n, each.mu, each.omega[:n], each.sigma[:n], direction)
        for each, n, direction in zip(positions, moving, directions, strict=True)
    )
    system = CoupledStrings(lines, body)
    state = np.zeros(system.size)
    w, rates, p, v = system.parts()
    for number, line in enumerate(lines):
        n = line.omega.size
        speed = float(shots.speed[0] @ made.body.direction[number])
        state[w[number]] = made.modes_of(number, shots.q)[0, :n]
        state[rates[number]] = made.modes_of(number, shots.v)[0, :n] + line.ramp * speed
    state[p], state[v] = shots.p[0], shots.p_speed[0]
    x = (1.0 - seen_at) * made.position(made.line).length_m
    row = system.displacement_rows([Place(made.line, x)])
    exact = system.modes().free_response(state, np.arange(count) / RATE_HZ, row)[:, 0]
    mine = made.displacement(shots, np.array([x]))[:, 0]
    return mine, exact


def converged(kind: str, index: int, verify: bool) -> tuple[np.ndarray, dict[str, float]]:
    """Displacement (n,) of a random instrument over something to touch, and how far it stands."""
    preset, note = instrument(np.random.default_rng(seed(kind, index, verify)), kind)
    seconds, seen_at, (frames, steps) = DURATION_S[kind], SEEN_AT[kind], REFERENCE[kind]
    exact = displacement(preset, note, seconds, frames, steps, seen_at)
    return exact, distances(displacement(preset, note, seconds, frames, steps // 2, seen_at), exact)


def sweep(kind: str, index: int, verify: bool) -> dict[str, Any]:
    """One random instrument: what it is, how far its reference stands and `rows`, of each number of steps a frame."""
    started = time.process_time()
    preset, note = instrument(np.random.default_rng(seed(kind, index, verify)), kind)
    place = find(preset, note)
    scene = speaking(place)
    seconds, seen_at = DURATION_S[kind], SEEN_AT[kind]
    record: dict[str, Any] = {
        "kind": string_kind(preset, scene.opened, scene.below),
        "f0_hz": midi_to_hz(place.opened),
        "strings": len(preset.string),
    }
    if record["kind"] == FREE:
        mine, exact = exact_displacement(preset, note, seconds, seen_at)
        rows, stands = [{"factor": 1, "e": relative_error(mine, exact)}], {"e": 0.0}
    else:
        exact, stands = converged(kind, index, verify)
        rows = [
            {"factor": factor, **distances(displacement(preset, note, seconds, 1, factor, seen_at), exact)}
            for factor in STEPS
        ]
    return {**record, "stands": stands, "rows": rows, "cpu_s": time.process_time() - started}
