"""What was measured of a body, to be laid over what a preset says of it."""

from __future__ import annotations

from pathlib import PurePath
from typing import Any

import numpy as np

from synth.fit.mobility import parse_mobility
from synth.physics.body_modes import AXES

#: rows that are shown of a table
MOST_ROWS = 2000


def measured_mobility(data: bytes, name: str) -> dict[str, Any]:
    """{name, hz: [rows], axes: {axis: [dB of 1 m/(N s) or 1 rad/(N m s)]}} of a table as `synth body fit` reads it: of
    more than `MOST_ROWS` rows the strongest of as many as there are beside each other. Raises ValueError, naming row and
    column."""
    table = parse_mobility(data, PurePath(name).name or "table")
    rows = table.frequency_hz.size
    starts = np.unique(np.arange(min(rows, MOST_ROWS)) * rows // min(rows, MOST_ROWS))
    axes = {}
    for axis, label in enumerate(AXES, start=1):
        if (axis, axis) in table.components:
            size = np.maximum.reduceat(np.abs(table.components[axis, axis]), starts)
            axes[label] = np.round(20.0 * np.log10(np.maximum(size, 1e-15)), 3).tolist()
    return {"name": name, "hz": np.round(table.frequency_hz[starts], 4).tolist(), "axes": axes}
