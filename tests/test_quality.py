"""What a quality promises, on whole notes of the shipped presets: finger, contact and decimation together.

The displacement of a plucked note at each quality against the same note at `reference`, over the 3 s of the criterion
(Issanchou et al. 2018).
"""

from __future__ import annotations

import numpy as np
import pytest

from synth.dsp.measures import log_spectral_distance, relative_error
from synth.engine.engine import Engine
from synth.fit.plan_strings import as_displacement
from synth.instrument.preset import Preset, load_preset
from synth.midi.events import NOTE_ON, make_events

RATE_HZ = 44100.0


def displacement(preset: Preset, note: int, quality: str, seconds: float) -> np.ndarray:
    engine = Engine([preset], quality=quality, only_notes=[{note}], limiter=False)
    engine.prepare(RATE_HZ)
    out = np.zeros((int(seconds * RATE_HZ), 2))
    engine.process(make_events([(0, NOTE_ON, 0, note, 64)]), out)
    return out[:, 0]


@pytest.mark.parametrize(
    ("name", "note"),
    [("tanpura-light", 36), ("tanpura-light", 43), ("tanpura-light", 48), ("jawari-harp", 40), ("jawari-harp", 60)],
)
def test_bridge_notes_keep_the_promise(name: str, note: int) -> None:
    preset = load_preset(name)
    preset = as_displacement(preset, preset.output.position)
    reference = displacement(preset, note, "reference", 3.0)
    for quality, promised in (("draft", 0.3), ("standard", 0.1), ("fine", 0.02)):
        assert relative_error(displacement(preset, note, quality, 3.0), reference) < promised


@pytest.mark.parametrize("note", [28, 38, 50])
def test_fretted_notes_keep_the_promise(note: int) -> None:
    preset = as_displacement(load_preset("fretted-bass"), 0.05)
    reference = displacement(preset, note, "reference", 1.0)
    for quality, promised_db in (("draft", 6.0), ("standard", 3.0), ("fine", 1.5)):
        sound = displacement(preset, note, quality, 1.0)
        assert log_spectral_distance(sound, reference, RATE_HZ) < promised_db


def test_without_contact_the_rate_does_not_matter() -> None:
    """The thread far above the bridge: what is left is the finger, whose draw is all that a rate can change."""
    preset = as_displacement(load_preset("tanpura-light").with_setting("obstacle.jiva_um", "900"))
    reference = displacement(preset, 48, "reference", 1.0)
    assert relative_error(displacement(preset, 48, "draft", 1.0), reference) < 2e-3
    assert relative_error(displacement(preset, 48, "fine", 1.0), reference) < 1e-4
