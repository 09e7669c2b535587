"""`synth author` whose contact fit answers at once: python -m tests.author.quick_contact author …

The fit itself stands in for: pitch, strings, settings, report and jobs are the program's own. By the amplitude that is given
it finds (none, 0.5 mm), finds no contact (0.1 mm), or goes on until it is cancelled (9 mm).
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np

import synth.fit.contact_group as group
from synth.cli import main
from synth.fit.contact_features import bands_of
from synth.fit.contact_fit import NoContact, NoteFit
from synth.fit.contact_group import ContactFit, amplitude_of, tuned_model
from synth.fit.contact_model import ContactStroke
from synth.fit.contact_space import Estimate
from synth.fit.recording import FitCancelled

HEIGHT, DISTANCE, POSITION = 0.012, 0.006, 0.21


def quick(recordings: Any, preset: Any, index: int, *, amplitude_m: float | None = None, progress: Any) -> ContactFit:
    model, warnings = tuned_model(preset, index, recordings)
    if amplitude_m is not None and amplitude_m < 2e-4:
        raise NoContact("the string hardly touches the bridge, or not at all; strike harder for a number", 1.0)
    endless = amplitude_m is not None and amplitude_m > 8e-3
    for share in np.linspace(0.1, 0.9, 10**6 if endless else 3):
        if not progress(float(share)):
            raise FitCancelled
        time.sleep(0.02)
    amplitude = amplitude_of(preset, index) if amplitude_m is None else amplitude_m
    values = {
        name: Estimate(value, 0.98 * value, 1.02 * value)
        for name, value in (("height", HEIGHT), ("distance", DISTANCE), ("position", POSITION))
    }
    bands = bands_of(model.string, 44100.0)
    count = bands.centres_hz.size
    levels = np.linspace(-20.0, -70.0, count) * np.ones((8, 1))
    stroke = ContactStroke(HEIGHT * amplitude, DISTANCE * model.string.length_m, POSITION, amplitude, 0.01)
    note = NoteFit(
        stroke, values, 0.02, 0.5, 0.3, bands, np.zeros(count), levels, levels + 0.5, 0.5, 100, 0.0, (),
        np.zeros(5), np.eye(5), np.eye(5),
    )  # fmt: skip
    known = amplitude_m is not None
    obstacle = {name: values[name] for name in ("height", "distance")}
    return ContactFit(preset, index, model, (note,), obstacle, amplitude, known, tuple(warnings))


if __name__ == "__main__":
    group.fit_contact = quick  # type: ignore[assignment]
    sys.exit(main())
