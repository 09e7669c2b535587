"""Tension that follows the motion, soft contacts and friction, in the native core as in Python, bit for bit."""

from __future__ import annotations

import numpy as np
import pytest

from synth.engine.engine import Engine
from synth.instrument.preset import Preset
from synth.midi.events import make_events
from synth.plugin.bankfile import bank
from tests.engine import test_friction, test_soft_contact, test_tension
from tests.engine.kit import play

RATE_HZ, FRAMES = 44100.0, 6000
MADE = {
    "stretched": (test_tension.BRIDGE, test_tension.ROWS["bridge"]),
    "stretched-two-ways": (test_tension.TWO, test_tension.ROWS["two"]),
    "soft-bridge": (test_soft_contact.BRIDGE, test_soft_contact.ROWS["bridge"]),
    "soft-frets": (test_soft_contact.NECK, test_soft_contact.ROWS["neck"]),
    "soft-rough-bridge": (test_soft_contact.SHARED, test_soft_contact.ROWS["shared"]),
    "rough-bridge": (test_friction.ROUGH_BRIDGE, test_friction.ROWS["coupled-bridge"]),
    "rough-frets": (test_friction.ROUGH_NECK, test_friction.ROWS["coupled-neck"]),
}


@pytest.mark.parametrize("name", MADE)
def test_it_sounds_as_in_python(library, tmp_path, name: str) -> None:
    preset: Preset = MADE[name][0]
    events = make_events(list(MADE[name][1]))
    events = events[np.argsort(events["frame"], kind="stable")]
    engine = Engine([preset])
    engine.prepare(RATE_HZ, 4096)
    wanted = play(engine, events, FRAMES, 512)
    assert np.abs(wanted).max() > 1e-4
    (tmp_path / "touch.jawari").write_bytes(bank([preset], [RATE_HZ]))
    opened = library.open_bank(tmp_path / "touch.jawari")
    sizes = [int(size) for size in np.random.default_rng(3).integers(1, 700, FRAMES)]
    assert np.array_equal(opened.engine().play(events, FRAMES, sizes), wanted)
    assert np.array_equal(opened.engine(threads=2).play(events, FRAMES, 512), wanted)
