"""A string of a preset fitted to a recording."""

from __future__ import annotations

import importlib.util
import io
from dataclasses import dataclass
from typing import Any

from synth.preset import Preset


@dataclass(frozen=True)
class FittedString:
    """settings: (path, value) of the preset; report: what `synth.fit.report` says, and they."""

    settings: list[tuple[str, Any]]
    report: dict[str, Any]


def missing() -> str | None:
    """Why nothing can be fitted here; None: it can."""
    if importlib.util.find_spec("scipy") is None:
        return "a fit needs scipy: pip install 'jawari[fit]'"
    return None


def fit_string(data: bytes, preset: Preset, string: int) -> FittedString:
    """Fit string number `string` to the bytes of an audio file. Raises ValueError with the reason."""
    from synth.fit import fit_recording, report, settings
    from synth.fit.recording import read_recording

    reason = missing()
    if reason is not None:
        raise ValueError(reason)
    found = fit_recording(*read_recording(io.BytesIO(data)))
    values = settings(found, preset, string)
    return FittedString(values, {**report(found), "settings": [{"path": path, "value": value} for path, value in values]})
