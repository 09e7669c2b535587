"""Fit of a plucked string to a recording: pitch, inharmonicity, losses, place of plucking, and a preset's values for them.

fit = fit_recording(samples, rate_hz)
preset = apply_settings(preset, settings(fit, preset, 0))
"""

from importlib.util import find_spec

from synth.fit.estimate import Fit, Partial, fit_recording
from synth.fit.recording import FitCancelled, FitRefused
from synth.fit.report import report
from synth.fit.settings import apply_settings, settings

__all__ = [
    "Fit",
    "FitCancelled",
    "FitRefused",
    "Partial",
    "apply_settings",
    "fit_recording",
    "missing",
    "missing_for_contact",
    "report",
    "settings",
]


def missing() -> str | None:
    """Why nothing can be fitted here; None: it can."""
    return "a fit needs scipy: pip install 'jawari[fit]'" if find_spec("scipy") is None else None


def missing_for_contact(*, picture: bool = False) -> str | None:
    """Why no contact can be fitted here, or drawn; None: it can."""
    for name in ("scipy", "cma", *(("matplotlib",) if picture else ())):
        if find_spec(name) is None:
            extra = "plot" if name == "matplotlib" else "fit"
            return f"a fit of contacts needs {name}: pip install 'jawari[{extra}]'"
    return None
