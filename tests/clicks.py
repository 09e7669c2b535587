"""Clicks that are put into a sound, for the tests of what finds them (`synth.dsp.clicks`)."""

from __future__ import annotations

import numpy as np


def with_step(x: np.ndarray, frame: int, height: float) -> np.ndarray:
    """The signal with a click put in: from a frame on it is off by `height`, which a high-pass of 5 ms takes back."""
    out = x.copy()
    n = len(x) - frame
    fading = height * np.exp(-np.arange(n) / 220.0)
    out[frame:] += fading if x.ndim == 1 else fading[:, np.newaxis]
    return out
