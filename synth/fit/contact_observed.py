"""What the contact fit sees of a recorded note: its bands over time, and the noise that it stands in."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from synth.fit.contact_features import ContactBands, Observed, bands_of, observe
from synth.fit.recording import FitRefused, RecordedNote
from synth.physics.string import String

Real = NDArray[np.float64]
#: notes must last that long [s]
LEAST_S = 2.0


def seen_of(string: String, note: RecordedNote) -> Observed:
    """Features of a note with some of what stands before it. Raises FitRefused where it is too short."""
    seconds = note.samples.size / note.rate_hz
    if seconds < LEAST_S:
        raise FitRefused(
            f"the note must last at least {LEAST_S:g} s for its contact, got {seconds:.2g} s; let it ring longer"
        )
    bands = bands_of(string, note.rate_hz)
    before = note.before if note.before.size > 0.15 * note.rate_hz else None
    noise = quiet_power(note.samples, note.rate_hz, bands) if before is None else bands.powers(
        before, note.rate_hz, before.size / note.rate_hz
    ).mean(axis=0)  # fmt: skip
    # silence of numbers is no noise
    floor = 1e-9 * float(bands.powers(note.samples, note.rate_hz, 0.2).max())
    whole = np.concatenate([note.before, note.samples])
    return observe(whole, note.rate_hz, note.before.size, bands, np.maximum(noise, floor))


def quiet_power(x: Real, rate_hz: float, bands: ContactBands) -> Real:
    """(B,) power of the noise from what lies between the partials, towards the end of a note."""
    size = round(bands.window_s * rate_hz)
    padded = 2 ** math.ceil(math.log2(size))
    count = min(40, (x.size // 2) // size)
    tail = x[x.size - count * size :].reshape(count, size) * np.hanning(size)
    power = 2.0 * np.abs(np.fft.rfft(tail, padded)) ** 2 / np.sum(np.hanning(size) ** 2)
    first = np.ceil(bands.edges_hz * padded / rate_hz).astype(np.int64)
    found = []
    for low, high in pairwise(first):
        # the fifth part of what is distributed exponentially lies below 0.22 of its mean
        quiet = np.quantile(power[:, low:high], 0.2, axis=1) / 0.223
        found.append(float(np.median(quiet)) * (high - low) / padded)
    return np.array(found)
