"""Rows of the studies that `tools/calibrate-plan`, `tools/calibrate-coupled` and `tools/scene-references` are made of."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from kept_rows import ROOMS, files

from promise import runs
from promise.scenes import scene, seed

#: what scenes and their runs depend on, beside the rooms of the package
SOURCES = files("tools/promise/runs.py", "tools/promise/scenes.py", "synth/fit/plan_measures.py", "synth/instrument/plan.py")
#: what instruments whose strings share a body depend on: not what is written by their calibration
TOGETHER_ROOMS = (*ROOMS, "engine", "midi")
_WRITTEN = ("coupled_calibration.py", "coupled_plan.py")


def together_sources() -> list[str]:
    """Of instruments whose strings share a body."""
    return [
        *files("tools/promise/*.py", "synth/fit/plan_measures.py", "synth/author/views/*.py", "synth/units.py"),
        *(file for file in files("synth/instrument/*.py") if not file.endswith(_WRITTEN)),
    ]


def rounded(u: np.ndarray) -> np.ndarray:
    """float32 to 16 bits below the peak: zeros that compress, 20 dB below what a log-spectral distance looks at."""
    step = 2.0 ** (math.ceil(math.log2(np.abs(u).max())) - 15)
    return (np.round(u / step) * step).astype(np.float32)


def tested(kind: str, number: int, index: int, duration_s: float) -> dict[str, Any]:
    """Tables of a scene that tests have: drawn from `number` of its kind and `index`."""
    tables = scene(np.random.default_rng([number, index]), kind, duration_s)
    tables["run"]["duration_s"] = duration_s
    return tables


def converged(row: dict[str, Any]) -> dict[str, Any]:
    """The record of a scene's reference, and every so many samples of its displacement."""
    u, record = runs.reference(tested(row["kind"], row["number"], row["seed"], row["duration_s"]), row["kind"])
    return {**record, "u": rounded(u[:: row["every"]])}


def swept(row: dict[str, Any]) -> dict[str, Any]:
    """A scene's reference and what each internal rate makes of it."""
    kind, index = row["kind"], row["index"]
    found = runs.sweep(scene(np.random.default_rng(seed(kind, index)), kind, row["duration_s"]), kind)
    return {name: value for name, value in found.items() if name not in ("kind", "tables")}


def swept_together(row: dict[str, Any]) -> dict[str, Any]:
    """A random instrument whose strings share a body, with each number of steps a frame."""
    from promise import together

    found = together.sweep(row["drawn"], row["index"], row["verify"])
    return {"string_kind": found.pop("kind"), **found}
