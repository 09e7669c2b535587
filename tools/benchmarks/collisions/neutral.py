"""NAME.json of a scene: the modal numbers that any solver can start from, made of the physical terms of NAME.toml."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.collisions import VERSION
from benchmarks.collisions.scene import path_of
from benchmarks.collisions.ways import tables_of

EQUATION = (
    "q_j'' + 2 decay_rates_1_s[j] q_j' + (2 pi frequencies_hz[j])^2 q_j = (1/linear_density_kg_m) sum_c phi_j(x_c) force_c; "
    "phi_j(x) = sqrt(2/length_m) sin(j pi x/length_m), j = 1, 2, ...; u(x, t) = sum_j q_j(t) phi_j(x); q(0) = q0_m_sqrt_m, "
    "q'(0) = 0; up is positive"
)
RIGID = "rigid: 0 <= u(x_c) - height_c, force_c >= 0, one of the two 0; a point gives nothing back (restitution 0)"
ELASTIC_WALL = "force per length stiffness_n_m2 * max(0, height(x) - u(x)), without loss"
NO_CONTACT = "no contact: no forces"
RIGID_WALL = "rigid all along, elastic: what hits it leaves with the opposite velocity (restitution 1)"


def words_of(path: Path) -> str:
    """What stands at the head of a scene's file."""
    head = path.read_text(encoding="utf-8").partition("\n\n")[0]
    return " ".join(re.sub(r"^# ?", "", line).strip() for line in head.splitlines())


def numbers(named: str | Path) -> dict[str, Any]:
    """The numbers of a scene (`path_of`), SI units, lists in the order of modes or points."""
    from synth.research.case import Case
    from synth.research.scene import Scene
    from synth.solver import driver

    path, given = path_of(named), tables_of(named)
    mark, run, obstacle = given["benchmark"], given["run"], given["obstacle"]
    tables = tables_of(named)
    rate = float(tables.pop("benchmark")["rate_hz"])
    tables["run"] |= {"internal_rate_hz": rate, "output_rate_hz": rate}
    wall = "wall" in obstacle
    tables["scheme"] = {"name": "wall"} if wall else {"name": "exact-hold", "residual_compliance": False}
    scene = Scene(Case.model_validate(tables), Path())
    q0, _ = scene.initial()
    if not wall:
        q0 = driver.static_contact(scene.model, q0)[0]
    string = scene.string
    found: dict[str, Any] = {
        "benchmark": VERSION,
        "name": path.stem,
        "title": mark["title"],
        "description": words_of(path),
        "equation": EQUATION,
        "length_m": string.length_m,
        "tension_n": string.tension_n,
        "linear_density_kg_m": string.linear_density_kg_m,
        "bending_stiffness_n_m2": string.bending_stiffness_n_m2,
        "modes_are_the_string": bool(mark.get("modes_are_the_string", False)),
        "contact_law": RIGID if wall or len(scene.eta) else NO_CONTACT,
    }
    if wall:
        table = obstacle["wall"]
        rigid = table["stiffness_n_m2"] == "rigid"
        found["contact_law"] = RIGID_WALL if rigid else ELASTIC_WALL
        found["wall"] = {
            "from_m": table["from_m"],
            "to_m": table["to_m"],
            "stiffness_n_m2": None if rigid else table["stiffness_n_m2"],
            "grid_positions_m": scene.positions.tolist(),
            "grid_heights_m": scene.eta.tolist(),
        }
    else:
        found["contacts"] = {"positions_m": scene.positions.tolist(), "heights_m": scene.eta.tolist()}
    ramps = obstacle.get("motion", {}).get("ramp", [])
    if ramps:
        found["obstacle_ramps"] = ramps
    found |= {
        "output_m": run["outputs_m"][0],
        "duration_s": run["duration_s"],
        "rate_hz": mark["rate_hz"],
        "samples": round(run["duration_s"] * mark["rate_hz"]) + 1,
        "windows_s": mark["windows_s"],
        "horizon_window_s": mark["horizon_window_s"],
        "start": {key: value for key, value in given["initial"].items() if key != "file"},
        "frequencies_hz": (scene.omega / (2 * np.pi)).tolist(),
        "decay_rates_1_s": scene.sigma.tolist(),
        "q0_m_sqrt_m": q0.tolist(),
    }
    return found


def text_of(found: dict[str, Any]) -> str:
    """JSON, a key a line."""
    lines = (f"  {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)}" for key, value in found.items())
    return "{\n" + ",\n".join(lines) + "\n}\n"
