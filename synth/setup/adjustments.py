"""What a maker turns on a neck: action and relief, as the preset's own keys.

Heights under a string are affine in them, which `lowest` makes use of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from synth.fit.fret_model import action_mm, raised
from synth.instrument.preset import BoardObstacle, FretsObstacle, Preset, PresetError
from synth.physics.obstacle import fret_positions

RELIEF = "relief"
#: lowest and highest action [mm] and relief [mm] that are proposed
ACTION_MM, RELIEF_MM = (0.3, 6.0), (0.0, 0.5)


@dataclass(frozen=True)
class Adjustment:
    """One thing to turn: its name, its value now, and between which values it may lie [mm]."""

    name: str
    now_mm: float
    low_mm: float
    high_mm: float


def adjustments(preset: Preset) -> tuple[Adjustment, ...]:
    """What may be turned on a preset's neck, within bounds that hold its present values. Raises PresetError for one without
    frets or board."""
    return tuple(
        replace(each, low_mm=min(each.low_mm, each.now_mm), high_mm=max(each.high_mm, each.now_mm))
        for each in _turned_now(preset)
    )


def _turned_now(preset: Preset) -> tuple[Adjustment, ...]:
    shape, setup = preset.obstacle, preset.setup
    if setup is not None and setup.shapes_the_neck:
        bass, treble = setup.actions_mm
        return (
            Adjustment("action, bass", bass, *ACTION_MM),
            Adjustment("action, treble", treble, *ACTION_MM),
            Adjustment(RELIEF, setup.relief_mm, *RELIEF_MM),
        )
    if isinstance(shape, BoardObstacle) and shape.action_12th_mm is not None:
        return Adjustment("action", shape.action_12th_mm, *ACTION_MM), Adjustment(RELIEF, shape.relief_mm, *RELIEF_MM)
    if isinstance(shape, FretsObstacle):
        return Adjustment("action", action_mm(preset), *ACTION_MM), Adjustment(RELIEF, _relief_mm(shape), *RELIEF_MM)
    raise PresetError(
        f"{preset.name}: obstacle.kind must be frets or board to set an action, got {shape.kind}; over a bridge ask for "
        '"longest buzz"'
    )


def _relief_mm(shape: FretsObstacle) -> float:
    """Gap under a straightedge on the first and the last fret, at the fret nearest to the middle between them [mm]."""
    if not shape.heights_mm:
        return shape.relief_mm
    x, h = fret_positions(1.0, shape.count), np.array(shape.heights_mm)
    if x.size < 3:
        return 0.0
    s = (x - x[0]) / (x[-1] - x[0])
    k = int(np.abs(s - 0.5).argmin())
    return float((1.0 - s[k]) * h[0] + s[k] * h[-1] - h[k])


def settings(preset: Preset, values_mm: Sequence[float]) -> list[tuple[str, Any]]:
    """[(path, value)] of the preset that turn it to values in the order of `adjustments`."""
    shape, setup = preset.obstacle, preset.setup
    if setup is not None and setup.shapes_the_neck:
        names = ("setup.action_bass_mm", "setup.action_treble_mm", "setup.relief_mm")
        return [(name, round(float(value), 3)) for name, value in zip(names, values_mm, strict=True)]
    action, relief = (float(each) for each in values_mm)
    if isinstance(shape, FretsObstacle) and shape.heights_mm:
        turned = _turned(shape, action, relief)
        return [("obstacle.heights_mm", [round(each, 4) for each in turned])]
    return [("obstacle.action_12th_mm", round(action, 3)), ("obstacle.relief_mm", round(relief, 3))]


def adjusted(preset: Preset, values_mm: Sequence[float]) -> Preset:
    """The preset turned to values in the order of `adjustments`; not rounded."""
    shape, setup = preset.obstacle, preset.setup
    if setup is not None and setup.shapes_the_neck:
        bass, treble, relief = (float(each) for each in values_mm)
        changed: dict[str, Any] = {"action_bass_mm": bass, "action_treble_mm": treble, "relief_mm": relief}
        return preset.model_copy(update={"setup": setup.model_copy(update=changed)})
    action, relief = (float(each) for each in values_mm)
    if isinstance(shape, FretsObstacle) and shape.heights_mm:
        changed = {"heights_mm": _turned(shape, action, relief)}
    else:
        changed = {"action_12th_mm": action, "relief_mm": relief}
    return preset.model_copy(update={"obstacle": shape.model_copy(update=changed)})


def _turned(shape: FretsObstacle, action: float, relief: float) -> tuple[float, ...]:
    """Heights of frets that were measured one by one, the neck bent to a relief and the saddle raised to an action [mm]."""
    x, h = fret_positions(1.0, shape.count), np.array(shape.heights_mm)
    if x.size > 2:
        s = (x - x[0]) / (x[-1] - x[0])
        h = h - (relief - _relief_mm(shape)) * 4.0 * s * (1.0 - s)
    return raised(shape.model_copy(update={"heights_mm": tuple(h.tolist())}), action)
