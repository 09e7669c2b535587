"""How the planner's promises stand on the scenes of tests/scenes, which no calibration has seen."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from promise.calibrate import distribution, law, ratios
from promise.runs import RATE_HZ, build, distances, kind_of
from synth.dsp.measures import relative_error
from synth.instrument.plan import BRIDGE, FAR, IMPACTS, plan_string
from synth.instrument.planfile import PROMISED
from synth.research.methods import run as run_scene

FOLDER = Path(__file__).resolve().parents[2] / "tests" / "scenes"


def scenes() -> list[dict[str, Any]]:
    """Every scene's record with its `kind` and the displacement `u` of its reference; thinned, that can judge e alone."""
    records = json.loads((FOLDER / "scenes.json").read_text(encoding="utf-8"))
    found = []
    with np.load(FOLDER / "references.npz") as data:
        for record in records:
            stands = record["stands"]
            if record["every"] > 1:
                stands = {**dict.fromkeys(stands, np.inf), "e": stands["e"]}
            u = data[record["name"]].astype(float)
            found.append({**record, "kind": kind_of(record["tables"]), "stands": stands, "u": u})
    return found


def planned(scene: dict[str, Any], quality: str) -> dict[str, Any]:
    """The scene with, as its only row, what the plan of a quality makes of it."""
    tables = scene["tables"]
    string, contacts = build(tables, 1, 1).string, len(tables["obstacle"]["positions_m"])
    plan = plan_string(string, scene["f0_hz"], contacts, scene["kind"], quality=quality, rate_hz=RATE_HZ)
    u = run_scene(build(tables, plan.factor, plan.modes)).u[:: scene["every"], 0]
    found = distances(u, scene["u"]) if scene["every"] == 1 else {"e": relative_error(u, scene["u"])}
    return {**scene, "rows": [{"factor": 1, **found}]}


def misses(scene: dict[str, Any], quality: str) -> float | None:
    """The worst of error over promise in a `planned` scene; None where its reference can judge nothing."""
    found = ratios([scene], quality, law(0.0))
    return float(found[0]) if found.size else None


def report() -> None:
    """Prints, for every quality and kind of scene, how many can judge and how the errors are spread."""
    known = scenes()
    for quality in PROMISED:
        ready = [planned(scene, quality) for scene in known]
        found = np.array([miss for scene in ready if (miss := misses(scene, quality)) is not None])
        missed = np.sum(found >= 1.0)
        print(f"{quality}: {found.size} of {len(ready)} scenes can judge, {missed} miss, worst by {found.max():.2f}")
        for kind in (BRIDGE, FAR, IMPACTS):
            if mine := [scene for scene in ready if scene["kind"] == kind]:
                print(f"    {kind}: {distribution(mine, quality, 0.0)}")
