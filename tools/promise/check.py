"""How the planner's promises stand on the scenes of tests/scenes, which no calibration has seen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from promise.calibrate import PROMISED, distribution, ratios
from promise.runs import RATE_HZ, build, distances
from synth.measures import relative_error
from synth.methods import run as run_scene
from synth.plan import BRIDGE, IMPACTS, plan_string, scene_kind

FOLDER = Path(__file__).resolve().parents[2] / "tests" / "scenes"


def planned(record: dict[str, Any], reference: np.ndarray, quality: str) -> dict[str, Any]:
    """The record with its kind and, as its only row, what the plan of a quality makes of the scene."""
    tables = record["tables"]
    string, positions = build(tables, 1, 1).string, tables["obstacle"]["positions_m"]
    kind = scene_kind(string, positions)
    plan = plan_string(string, record["f0_hz"], len(positions), kind, quality=quality, rate_hz=RATE_HZ)
    u = run_scene(build(tables, plan.factor, plan.modes)).u[:: record["every"], 0]
    # a thinned reference can judge e alone
    found = distances(u, reference) if record["every"] == 1 else {"e": relative_error(u, reference)}
    stands = (
        record["stands"] if record["every"] == 1 else {**dict.fromkeys(record["stands"], np.inf), "e": record["stands"]["e"]}
    )
    return {**record, "kind": kind, "stands": stands, "rows": [{"factor": 1, **found}]}


def report() -> None:
    """Prints, for every quality and kind of scene, how many can judge and how the errors are spread."""
    records = json.loads((FOLDER / "scenes.json").read_text(encoding="utf-8"))
    with np.load(FOLDER / "references.npz") as data:
        references = {name: data[name].astype(float) for name in data.files}
    for quality in PROMISED:
        scenes = [planned(record, references[record["name"]], quality) for record in records]
        found = ratios(scenes, quality, lambda f0: 0.0)
        missed = np.sum(found >= 1.0)
        print(f"{quality}: {found.size} of {len(scenes)} scenes can judge, {missed} miss, worst by {found.max():.2f}")
        for kind in (BRIDGE, IMPACTS):
            print(f"    {kind}: {distribution([s for s in scenes if s['kind'] == kind], quality, 0.0)}")
