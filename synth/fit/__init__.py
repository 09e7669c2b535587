"""Fit of a plucked string to a recording: pitch, inharmonicity, losses and place of plucking, and a preset's values for them.

    fit = fit_recording(samples, rate_hz)
    for path, value in settings(fit, preset, 0): …
"""

from synth.fit.estimate import Fit, Partial, fit_recording
from synth.fit.recording import FitRefused

__all__ = ["Fit", "FitRefused", "Partial", "fit_recording"]
