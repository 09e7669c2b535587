"""Runs of random scenes: references that are known to stand, and what each internal rate makes of the same scene."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from synth.fit import plan_measures
from synth.instrument.plan import scene_kind
from synth.physics.modes import count_modes_below
from synth.research.case import load_case
from synth.research.methods import run as run_scene
from synth.research.scene import Scene

RATE_HZ = 44_100
#: seconds of a scene: what is promised for a bridge is promised over 3 s
DURATION_S = {"bridge": 3.0, "far": 3.0, "point": 0.3, "points": 0.3, "frets": 0.3}
#: internal steps per period of the reference, its largest multiple of 44.1 kHz, and its most modes
REFERENCE = {"bridge": (9000.0, 160, 1200), "far": (18000.0, 160, 1200), "point": (30000.0, 384, 1000),
             "points": (30000.0, 384, 1000), "frets": (30000.0, 384, 1000)}  # fmt: skip
FACTORS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64)


def fundamental_hz(tables: dict[str, Any]) -> float:
    """c/2L of the scene's string."""
    string = tables["string"]
    return math.sqrt(string["tension_n"] / string["linear_density_kg_m"]) / (2.0 * string["length_m"])


def build(tables: dict[str, Any], factor: int, modes: int, **scheme: Any) -> Scene:
    """The scene at factor × 44.1 kHz, rows at 44.1 kHz; the default scheme unless `scheme` names another."""
    case = load_case(
        {**tables, "scheme": scheme, "run": {**tables["run"], "internal_rate_hz": factor * RATE_HZ, "modes": modes}},
        output_rate_hz=RATE_HZ,
    )
    return Scene(case, Path())


def modes_below_half(tables: dict[str, Any], factor: int, most: int) -> int:
    """Modes below half the internal rate."""
    return max(1, min(most, count_modes_below(build(tables, factor, 1).string, factor * RATE_HZ / 2)))


def kind_of(tables: dict[str, Any]) -> str:
    """What the planner takes the scene for."""
    return scene_kind(build(tables, 1, 1).string, tables["obstacle"]["positions_m"], [tables["initial"]["position_m"]])


def distances(u: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """`plan_measures.distances` at 44.1 kHz."""
    return plan_measures.distances(u, reference, RATE_HZ)


def reference(tables: dict[str, Any], kind: str) -> tuple[np.ndarray, dict[str, Any]]:
    """Displacement (n,) at 44.1 kHz and how far it stands: `distances` to a run at half the rate with fewer modes."""
    steps, most_factor, most_modes = REFERENCE[kind]
    factor = int(min(most_factor, max(16, math.ceil(steps * fundamental_hz(tables) / RATE_HZ))))
    modes = modes_below_half(tables, factor, most_modes)
    finest = run_scene(build(tables, factor, modes, name="exact-hold"))
    half = run_scene(build(tables, factor // 2, max(1, int(0.7 * modes)), name="exact-hold"))
    return finest.u[:, 0], {
        "factor": factor,
        "modes": modes,
        "last_contact_s": finest.last_contact_step / (factor * RATE_HZ) if finest.last_contact_step >= 0 else None,
        "contact_part": finest.contact_steps / (factor * RATE_HZ * tables["run"]["duration_s"]),
        "stands": distances(half.u[:, 0], finest.u[:, 0]),
    }


def sweep(tables: dict[str, Any], kind: str) -> dict[str, Any]:
    """The reference's record and `rows`: factor, steps per period, modes and `distances` from low to high rates."""
    started = time.process_time()
    exact, record = reference(tables, kind)
    f0 = fundamental_hz(tables)
    rows = []
    for factor in FACTORS:
        if factor > record["factor"] // 3:
            break
        modes = modes_below_half(tables, factor, record["modes"])
        u = run_scene(build(tables, factor, modes)).u[:, 0]
        rows.append({"factor": factor, "steps_per_period": factor * RATE_HZ / f0, "modes": modes, **distances(u, exact)})
    return {"kind": kind, "f0_hz": f0, "tables": tables, **record, "rows": rows, "cpu_s": time.process_time() - started}
