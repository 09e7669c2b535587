"""A scene run by one of this program's schemes, or by the example's solver: how references and entries are made."""

from __future__ import annotations

import json
import os
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.collisions import ContestError
from benchmarks.collisions.scene import OUTSIDE, path_of


@dataclass(frozen=True)
class Way:
    """A scheme, its internal rate over the scene's, modes and what else its table has; shorter than the scene or not."""

    scheme: str
    factor: int
    modes: int
    table: tuple[tuple[str, Any], ...] = ()
    duration_s: float | None = None
    nudge: float = 0.0  # the start is that much larger, relative
    nodes: int | None = None  # of a wall, as points

    @property
    def label(self) -> str:
        """The scheme as tables name it."""
        table = dict(self.table)
        if self.scheme == "exact-hold":
            if table.get("residual_compliance") is False:
                return "exact-hold, no R"
            label = "exact-hold + R" if table.get("tail") == "static" else "exact-hold + lumped tail"
            return label + (f", {table['substeps']} sub-steps" if "substeps" in table else "")
        if self.scheme.startswith("moreau-jean"):
            form = "filtered" if self.scheme.endswith("filtered") else "printed"
            return f"Moreau–Jean, {form}, e = {table.get('restitution', 1.0):g}"
        return {"compliant": "compliant (penalty), Newton"}.get(self.scheme, self.scheme)


def way(scheme: str, factor: int, modes: int, duration_s: float | None = None, nudge: float = 0.0,
        nodes: int | None = None, **table: Any) -> Way:  # fmt: skip
    """A `Way`, the rest of the scheme's table by name."""
    return Way(scheme, factor, modes, tuple(sorted(table.items())), duration_s, nudge, nodes)


def reference_folder() -> Path | None:
    """Where the files of the paper's authors are: JAWARI_REFERENCE; None where it does not say."""
    given = os.environ.get("JAWARI_REFERENCE")
    return Path(given) if given and (Path(given) / "authors_data.npz").is_file() else None


def tables_of(named: str | Path) -> dict[str, Any]:
    """The tables of a scene (`path_of`). Raises ContestError where the authors' files are not there."""
    path = path_of(named)
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    if path.parent == OUTSIDE:
        folder = reference_folder()
        if folder is None:
            raise ContestError(
                f"scene {path.stem!r}: needs the files of the paper's authors; name their folder in JAWARI_REFERENCE"
            )
        for table in (tables["string"]["measured"], tables["initial"]):
            table["file"] = str(folder / table["file"])
    return tables


def case_of(named: str | Path, chosen: Way, keep: int = 1) -> dict[str, Any]:
    """The tables of `synth.simulate` for a scene in a certain way, rows at `keep` times the scene's rate."""
    tables = tables_of(named)
    rate = tables.pop("benchmark")["rate_hz"]
    run = tables["run"]
    run |= {"internal_rate_hz": float(rate * chosen.factor), "output_rate_hz": float(rate * keep), "modes": chosen.modes}
    if chosen.duration_s is not None:
        run["duration_s"] = chosen.duration_s
    tables["scheme"] = {"name": chosen.scheme, **dict(chosen.table)}
    start = tables["initial"]
    path = path_of(named)
    if path.stem == "pressed":  # the static shape that the scene says, not that of fewer modes
        numbers = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        start = tables["initial"] = {"shape": "modes", "q": numbers["q0_m_sqrt_m"]}
    if chosen.nudge:
        if "q" in start:
            start["q"] = (np.array(start["q"]) * (1.0 + chosen.nudge)).tolist()
        else:
            start["displacement_m"] *= 1.0 + chosen.nudge
    wall = tables["obstacle"].get("wall")
    if wall is not None and chosen.scheme != "wall":
        stiffness = wall.pop("stiffness_n_m2")
        wall["nodes" if chosen.nodes else "spacing_m"] = chosen.nodes or tables["string"]["length_m"] / (chosen.modes + 1)
        if not chosen.nodes:
            wall["to_m"] = spacing_end(wall["to_m"], wall["spacing_m"])
        if stiffness != "rigid" and chosen.scheme in ("compliant", "energy-quadratisation", "scalar-auxiliary-variable"):
            # the board's law itself: K·Δx at every point, linear
            tables["scheme"] |= {"stiffness": stiffness * wall["spacing_m"], "exponent": 1.0}
    return tables


def spacing_end(to_m: float, spacing_m: float) -> float:
    """The last point of the grid of a spacing that a wall reaches."""
    return spacing_m * int(np.floor(to_m / spacing_m + 1e-9))


def run(named: str | Path, chosen: Way, keep: int = 1) -> Any:
    """`synth.Result` of a scene. Raises `synth.CaseError` where the scheme does not take it."""
    import synth

    return synth.simulate(case_of(named, chosen, keep))
