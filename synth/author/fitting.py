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
    import soundfile

    from synth.fit import fit_recording, report, settings

    reason = missing()
    if reason is not None:
        raise ValueError(reason)
    try:
        samples, rate_hz = soundfile.read(io.BytesIO(data), dtype="float64", always_2d=True)
    except soundfile.LibsndfileError as error:
        raise ValueError(
            f"the recording cannot be read ({error.error_string.rstrip('.')}): give a WAV or FLAC file"
        ) from None
    found = fit_recording(samples, rate_hz)
    values = settings(found, preset, string)
    told = {**report(found), "settings": [{"path": path, "value": value} for path, value in values]}
    return FittedString(values, told)
