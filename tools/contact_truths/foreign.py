"""Bridges of two points, of which `synth fit --contact` knows one: spacing and heights at random."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import soxr

from contact_truths.misleading import Misleading
from contact_truths.notes import RATE_HZ, drawn, noisy
from synth.fit.contact_model import ContactModel, ContactStroke
from synth.instrument.preset import load_preset

#: steps a period, seconds, and silence before the note [s]
_STEPS, _SECONDS, _SILENCE_S = 1000.0, 3.2, 0.02


def two_points(seed: int) -> Misleading:
    """A recording over a second point at 0.3 to 0.8 of the distance, from 1 µm above to 4 µm below the line from the edge to
    the end, and what is known of its edge. The forward model makes it, on a finer grid than the fit's: presets space points
    evenly."""
    rng = np.random.default_rng(seed)
    model = ContactModel.of_preset(load_preset("tanpura-light"), 0)
    grid, length = model.grid(_STEPS, RATE_HZ), model.string.length_m
    truth = drawn(seed, "tanpura-light", string=0)
    distance = rng.uniform(5e-3, 14e-3)
    height = rng.uniform(0.05, 0.4) * distance * truth.amplitude_m / ((1.0 - truth.position) * length)
    place = rng.uniform(0.3, 0.8)
    inner = place, place * height + rng.uniform(-1e-6, 4e-6)
    truth = replace(truth, distance_m=distance, height_m=height)
    stroke = ContactStroke(height, distance, truth.position, truth.amplitude_m, truth.draw_s, inner=inner)
    x = soxr.resample(model.sound(stroke, grid, _SECONDS).frames, grid.rate_hz, RATE_HZ)
    recording = noisy(np.concatenate([np.zeros(round(_SILENCE_S * RATE_HZ)), x - x.mean()]), truth.snr_db, seed)
    return recording, "tanpura-light", 0, truth
