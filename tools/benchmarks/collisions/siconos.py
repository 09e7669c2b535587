"""Runs of Siconos, the solver of the paper's authors, scored where they are at hand: the folder in JAWARI_REFERENCE."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.collisions import ContestError, contest, references
from benchmarks.collisions.runfile import brought
from benchmarks.collisions.scene import outside_names
from benchmarks.collisions.score import score
from benchmarks.collisions.ways import reference_folder
from synth.files.npz import read_npz

SOURCE = (
    "Siconos 4.4 on the data that the paper's authors publish (siconos/siconos-tutorials, examples/mechanics/Music), "
    "Moreau–Jean filtered, exact LCP (Lemke), 0.1 s each; cost as noted in those files, one core of another machine"
)


def scored(
    rounds: int, budget_s: float, out: Path, say: Callable[[str], None]
) -> tuple[list[dict[str, Any]], list[dict[str, Any]], dict[str, Any]]:
    """(records of Siconos, of this program on the same scenes, references' records). Raises ContestError."""
    folder = reference_folder()
    if folder is None:
        raise ContestError("the runs of Siconos are not here; name their folder in JAWARI_REFERENCE")
    theirs, ours, records = [], [], {}
    for name in outside_names():
        facts, reference, records[name] = references.outside(name, out, say)
        for path in sorted(folder.glob(f"siconos_{name.partition('-')[0]}_*.npz")):
            data = read_npz(path)
            rate = float(data["fs"])
            run = {
                "scene": name,
                "u": data["u"],
                "rate_hz": rate,
                "cost_s": float(data["cpu_per_s"]) * facts.duration_s,
                "solver": "Siconos 4.4",
                "scheme": f"Moreau–Jean, filtered, e = {float(data['e']):g}",
                "internal_rate_hz": rate,
                "modes": data["q0"].size,
                "contact_force": data["impulse_over_mu"] * rate * references.numbers(name)["linear_density_kg_m"],
            }
            arrays = {key: np.asarray(value) for key, value in run.items()}
            theirs.append(score(brought(path, arrays, facts, reference), facts, reference).record)
            say(f"{path.name}: e = {theirs[-1]['e']}")
        ours += contest.entered(name, facts, reference, rounds, budget_s, say)
    return theirs, ours, records
