"""Random cases of strings on a body with all that hands do to them, for tests of the ledger and `tools/coupled-study`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from synth.physics.string import String
from tests.oracles.three_strings import steel

RATE_HZ = 48000.0


def _string(rng: np.random.Generator, axes: int, duration_s: float) -> dict[str, Any]:
    length = float(rng.uniform(0.3, 1.2))
    string: String = steel(float(10 ** rng.uniform(1.9, 2.6)), float(rng.uniform(0.25e-3, 0.8e-3)), length)
    lossy = bool(rng.integers(3))
    table: dict[str, Any] = {
        "length_m": length,
        "tension_n": string.tension_n,
        "linear_density_kg_m": string.linear_density_kg_m,
        "diameter_m": string.diameter_m,
        "bending_stiffness_n_m2": string.bending_stiffness_n_m2 if rng.integers(2) else 0.0,
        "viscoelastic_loss": 4.5e-3 if lossy else 0.0,
        "air_viscosity": 1.8e-5 if lossy else 0.0,
        "place_mm": float(rng.uniform(-40.0, 40.0)),
        "angle_deg": float(rng.choice([0.0, 0.0, 20.0])),
        "modes": int(rng.integers(10, 40)),
        "substeps": int(rng.choice([1, 1, 2, 4, 8])),
    }
    if axes > 1 and rng.integers(3) == 0:
        table["polarisation"] = {"detuning_cents": float(rng.uniform(-5.0, 5.0)), "loss_ratio": float(rng.uniform(1.0, 2.0))}
    rides = rng.integers(3) == 0
    count = int(rng.integers(0, 5))
    if count:
        where = np.sort(rng.uniform(0.95, 0.995, count) if rides else rng.uniform(0.2, 0.97, count)) * length
        table["obstacle"] = {
            "positions_m": [float(x) for x in where],
            "heights_m": [float(-(10 ** rng.uniform(-6.0, -3.3))) for _ in where],
            "rides": bool(rides),
        }
        if rng.integers(4) == 0:
            ramp = {"start_s": 0.1 * duration_s, "duration_s": 0.3 * duration_s, "displacement_m": 2e-4}
            table["obstacle"]["motion"] = {"ramp": [ramp]}
    turn = {"direction_deg": float(rng.uniform(0.0, 60.0))} if "polarisation" in table else {}
    start = str(rng.choice(["rest", "triangle", "drawn"]))
    place = float(rng.uniform(0.3, 0.8)) * length
    if start == "triangle":
        table["initial"] = {"shape": start, "position_m": place, "displacement_m": float(rng.uniform(5e-4, 3e-3)), **turn}
        table["initial"]["width_m"] = 0.02 * length
    elif start == "drawn":
        table["initial"] = {"shape": start, "position_m": place, "force_n": float(rng.uniform(0.3, 3.0)), **turn}
    if rng.integers(2):
        table["bend"] = [
            {
                "start_s": float(rng.uniform(0.0, 0.5)) * duration_s,
                "duration_s": float(rng.uniform(0.1, 0.5)) * duration_s,
                "cents": float(rng.uniform(-80.0, 200.0)),
            }
        ]
    if rng.integers(2):  # plucked again, and again
        table["finger"] = [
            {
                "position_m": float(rng.uniform(0.75, 0.93)) * length,
                "displacement_m": float(rng.uniform(3e-4, 2e-3)),
                "width_m": 0.02 * length,
                "start_s": start_s * duration_s,
                "draw_s": 0.12 * duration_s,
                "stiffness_n_m": float(10 ** rng.uniform(3.0, 4.7)),
                "resistance_n_s_m": float(rng.uniform(0.0, 1.0)),
                **turn,
            }
            for start_s in ((0.05, 0.6) if rng.integers(2) else (0.6,))
        ]
    if rng.integers(2):
        frets = [
            {
                "start_s": at * duration_s,
                "position_m": float(rng.uniform(0.05, 0.65)) * length,
                "height_m": float(-(10 ** rng.uniform(-4.5, -3.0))),
                "ramp_s": 0.08 * duration_s,
            }
            for at in (0.2, 0.4)
        ]
        frets.append({"start_s": 0.5 * duration_s, "position_m": 0.0})
        if rng.integers(2):
            frets.append({**frets[0], "start_s": 0.8 * duration_s})
        table["fret"] = frets[int(rng.integers(2)) :]
    return table


def random_case(seed: int, *, most_strings: int = 20, duration_s: float = 0.03) -> dict[str, Any]:
    """1 to `most_strings` strings on 1 to 3 axes: contacts that ride and that do not, moving obstacles, bends, re-plucks,
    changes of fret; bodies of plausible masses, and every fourth 30 or 300 times too light."""
    rng = np.random.default_rng(seed)
    axes = int(rng.integers(1, 4))
    lightness = float(rng.choice([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 30.0, 300.0]))
    modes = []
    for _ in range(int(rng.integers(1, 6))):
        shape = rng.normal(size=axes) * np.array([1.0, 0.5, 5.0])[:axes]
        modes.append(
            {
                "frequency_hz": float(10 ** rng.uniform(1.8, 3.3)),
                "q": float(10 ** rng.uniform(0.7, 3.5)),
                "mass_kg": float(10 ** rng.uniform(-1.0, 0.0) / lightness),
                "shape": [float(value) for value in shape],
            }
        )
    count = max(1, round(math.exp(rng.uniform(0.0, math.log(most_strings + 0.49)))))
    return {
        "string": [_string(rng, axes, duration_s) for _ in range(count)],
        "body": {"mode": modes},
        "scheme": {"tail": str(rng.choice(["static", "static", "none"]))},
        "run": {
            "internal_rate_hz": RATE_HZ,
            "output_rate_hz": RATE_HZ / 16,
            "modes": 30,
            "duration_s": duration_s,
            "ledger": True,
        },
    }
