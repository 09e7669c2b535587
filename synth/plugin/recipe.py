"""The recipe in a bank: all that a bank of another setup is made from, where Python is there (`rebuild`).

JSON: the presets as their files have them, the plans measured of them, what they are called together, options of the engine.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from synth.instrument import planfile
from synth.instrument.preset import Preset, validate_preset


@dataclass(frozen=True)
class BankRecipe:
    """Presets, name and options as `bankfile.bank` takes them."""

    presets: tuple[Preset, ...]
    name: str | None
    options: dict[str, Any]


def written(presets: Sequence[Preset], name: str | None, options: Mapping[str, Any]) -> bytes:
    """A recipe in bytes. Raises TypeError for an option that is no plain value nor an array of numbers."""
    whole = {
        "presets": [preset.model_dump(mode="json", exclude_unset=True) for preset in presets],
        "plans": [planfile.text_of(preset.measured) for preset in presets],
        "name": name,
        "options": {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in options.items()},
    }
    return json.dumps(whole, separators=(",", ":")).encode()


def read(data: bytes) -> BankRecipe:
    """The recipe that `written` has written. Raises ValueError."""
    whole = json.loads(data)
    nothing = planfile.text_of(planfile.MeasuredPlan())  # of plugins that were exported by 0.10
    plans = whole.get("plans", [nothing] * len(whole["presets"]))
    presets = tuple(
        validate_preset(each, str(each.get("name"))).with_measured(planfile.parse(plan, str(each.get("name"))))
        for each, plan in zip(whole["presets"], plans, strict=True)
    )
    return BankRecipe(presets, whole["name"], whole["options"])
