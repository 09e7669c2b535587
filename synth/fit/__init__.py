"""Fit of a plucked string to a recording: pitch, inharmonicity, losses, place of plucking, and a preset's values for them.

fit = fit_recording(samples, rate_hz)
preset = apply_settings(preset, settings(fit, preset, 0))
"""

from synth.fit.estimate import Fit, Partial, fit_recording
from synth.fit.recording import FitRefused
from synth.fit.report import report
from synth.fit.settings import apply_settings, settings

__all__ = ["Fit", "FitRefused", "Partial", "apply_settings", "fit_recording", "report", "settings"]
