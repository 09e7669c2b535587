"""Random strings over random obstacles in musical ranges, as case tables of `synth.simulate`.

Lengths, wave speeds, tensions, inharmonicities and losses are drawn between what is found from a bass guitar's E to a
harp's top octave. Heights are given as a part of how far the ideal string, plucked to a triangle, would swing down at the
obstacle: below 1 it is touched. The motion of all but the air scales with its amplitude, so one displacement serves all.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from synth.instrument.plan import BRIDGE_STIFFNESS
from synth.physics.obstacle import frets, fretted

KINDS = ("bridge", "point", "points", "frets", "far")
STEEL_KG_M3 = 7850.0


def lowest(length: float, pluck: float, height: float, x: float) -> float:
    """Greatest depth [m] that the ideal string reaches at x after a triangular pluck of `height` at `pluck`."""
    return height * min(x / (length - pluck), (length - x) / pluck)


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _string(rng: np.random.Generator, f0: float, longest: float) -> dict[str, Any]:
    length = min(longest, _log_uniform(rng, 120.0, 420.0) / (2.0 * f0))
    speed = 2.0 * f0 * length
    tension = _log_uniform(rng, 40.0, 200.0)
    mu = tension / speed**2
    return {
        "length_m": length,
        "tension_n": tension,
        "linear_density_kg_m": mu,
        "diameter_m": math.sqrt(4.0 * mu / (math.pi * STEEL_KG_M3)),
        "inharmonicity": _log_uniform(rng, 3e-6, 4e-4),
        "viscoelastic_loss": _log_uniform(rng, 1e-3, 1e-2),
        "thermoelastic_q_inverse": _log_uniform(rng, 6e-6, 5e-4),
        "stiffness_law": str(rng.choice(["sqrt", "linear"])),
    }


def seed(kind: str, index: int) -> list[int]:
    """What the random scene of this number is drawn from."""
    return [77, 0, index] if kind == "far" else [KINDS.index(kind), index]


def _far(rng: np.random.Generator, duration_s: float) -> dict[str, Any]:
    """A bridge, plucked beyond mid-string from it; half of the points raised into the string."""
    reach = math.inf
    while reach >= 1.0:
        f0 = _log_uniform(rng, 41.0, 500.0)
        string = _string(rng, f0, 1.35)
        length = string["length_m"]
        x = _log_uniform(rng, 0.003, 0.03) * length
        reach = BRIDGE_STIFFNESS * x / (length * math.sqrt(string["inharmonicity"]) / math.pi)
    displacement = 3e-3 * length
    pluck = (1.0 - _log_uniform(rng, 0.02, 0.5)) * length
    if rng.uniform() < 0.5:
        height = float(rng.uniform(0.0, 0.6)) * displacement * x / pluck
    else:
        height = -float(rng.choice([0.0, 0.5])) * float(rng.uniform()) * lowest(length, pluck, displacement, x)
    width = _log_uniform(rng, 0.005, 0.03) * length
    return {
        "string": string,
        "obstacle": {"positions_m": [x], "heights_m": [height]},
        "initial": {"shape": "triangle", "position_m": pluck, "displacement_m": displacement, "width_m": width},
        "run": {"duration_s": duration_s, "outputs_m": [0.99 * length]},
    }


def scene(rng: np.random.Generator, kind: str, duration_s: float) -> dict[str, Any]:
    """Tables of one case without internal rate and modes.

    far     one point within 3 % of an end, raised, at rest height or below, plucked beyond mid-string from there
    bridge  one point within 3 % of an end, at rest height or a little below
    point   one point anywhere else, 20 to 90 % of the way down
    points  two to four points anywhere, 40 to 95 % of the way down
    frets   the frets left above a stopped one, of 20, string plucked hard near the bridge
    """
    if kind == "far":
        return _far(rng, duration_s)
    several = kind in ("points", "frets")
    f0 = _log_uniform(rng, 41.0, 260.0 if several else 1050.0)
    string = _string(rng, f0, 1.35)
    length = string["length_m"]
    displacement = 3e-3 * length
    pluck = float(rng.uniform(0.08, 0.5)) * length
    if kind == "frets":
        open_length = length
        pluck = float(rng.uniform(0.7, 0.92)) * length
        action = float(rng.uniform(0.6, 1.1)) * lowest(length, pluck, displacement, 0.5 * length)
        neck = frets(
            open_length,
            20,
            action,
            relief_m=float(rng.uniform(0.0, 0.15)) * action,
            nut_height_m=float(rng.uniform(0.15, 0.3)) * action,
        )
        left = neck
        while True:
            try:
                length, left = fretted(neck, int(rng.integers(0, 13)), open_length)
                break
            except ValueError:  # the next fret would sound instead
                continue
        string["length_m"] = length
        pluck -= open_length - length
        positions, heights = list(left.positions_m), list(left.heights_m)
    else:
        count = int(rng.integers(2, 5)) if kind == "points" else 1
        if kind == "bridge":
            positions = [_log_uniform(rng, 0.003, 0.03) * length]
            depth = float(rng.choice([0.0, 0.5])) * float(rng.uniform(0.0, 1.0))
            heights = [-depth * lowest(length, pluck, displacement, positions[0])]
        else:
            while True:
                positions = sorted(float(x) * length for x in rng.uniform(0.03, 0.97, count))
                if count == 1 or min(np.diff(positions)) > 0.01 * length:
                    break
            low = 0.2 if kind == "point" else 0.4
            heights = [-float(rng.uniform(low, 0.9)) * lowest(length, pluck, displacement, x) for x in positions]
    return {
        "string": string,
        "obstacle": {"positions_m": positions, "heights_m": heights},
        "initial": {
            "shape": "triangle",
            "position_m": pluck,
            "displacement_m": displacement,
            "width_m": _log_uniform(rng, 0.005, 0.05) * length,
        },
        "run": {"duration_s": duration_s, "outputs_m": [0.99 * length]},
    }
