"""Strings that are heard from a side: each to left and right by its pan, through decimators, flight, body and threads."""

from __future__ import annotations

import math

import numpy as np
import pytest

from synth.engine.engine import Engine
from synth.instrument.fingerprints import fingerprint
from synth.instrument.preset import Preset, load_preset
from synth.midi.events import NOTE_OFF, NOTE_ON, make_events

RATE = 44100.0


def panned(name: str, pans: list) -> Preset:
    """A preset whose string tables are heard from these sides in turn."""
    preset = load_preset(name)
    data = preset.model_dump(exclude_unset=True)
    data["string"] = [{**table, "pan": pans[k % len(pans)]} for k, table in enumerate(data["string"])]
    return Preset.model_validate(data).with_measured(preset.measured)


def played(preset: Preset | str, notes: list[int], block: int = 512, seconds: float = 0.5, **how) -> np.ndarray:
    engine = Engine([preset], limiter=False, **how)
    engine.prepare(RATE)
    events = [(64 * k, NOTE_ON, 0, note, 90) for k, note in enumerate(notes)]
    events += [(round(0.3 * RATE) + 64 * k, NOTE_OFF, 0, note, 0) for k, note in enumerate(notes)]
    out, sound = np.zeros((block, 2)), []
    for begin in range(0, round(seconds * RATE) // 512 * 512, block):
        now = [(e[0] - begin, *e[1:]) for e in events if begin <= e[0] < begin + block]
        engine.process(make_events(now), out)
        sound.append(out.copy())
    return np.concatenate(sound)


@pytest.mark.parametrize("name", ["fretted-bass", "koto", "electric-guitar"])
def test_a_string_is_heard_on_either_side_by_its_pan(name: str) -> None:
    """One with a body behind it, one without, one of two directions."""
    note = {"fretted-bass": 33, "koto": 62, "electric-guitar": 50}[name]
    plain, aside = (played(panned(name, [pan]), [note]) for pan in (0.0, -0.4))
    angle = 0.25 * math.pi * 0.6
    for channel, share in enumerate((math.cos(angle), math.sin(angle))):
        expected = math.sqrt(2.0) * share * plain[:, channel]
        np.testing.assert_allclose(aside[:, channel], expected, atol=1e-9 * np.abs(plain).max())


def test_strings_stand_where_they_are_put() -> None:
    """Of two strings at once each is where it is alone: left and right are sums."""
    preset = panned("koto", [{48: -0.8, 84: 0.8}])
    low, high, both = played(preset, [50]), played(preset, [81]), played(preset, [50, 81])
    late = np.concatenate([np.zeros((64, 2)), high[:-64]])
    same = slice(0, round(0.25 * RATE))
    np.testing.assert_allclose(both[same], low[same] + late[same], atol=1e-6 * np.abs(both).max())
    assert np.abs(low[:, 0]).max() > 2.0 * np.abs(low[:, 1]).max()
    assert np.abs(high[:, 1]).max() > 2.0 * np.abs(high[:, 0]).max()


def test_blocks_and_threads_do_not_matter() -> None:
    preset = panned("fretted-bass", [-0.6, 0.2])
    once = played(preset, [28, 33, 45])
    assert np.array_equal(once, played(preset, [28, 33, 45], block=128))
    assert np.array_equal(once, played(preset, [28, 33, 45], threads=2))


def test_a_pan_does_not_move_the_string() -> None:
    plain, aside = load_preset("fretted-bass"), panned("fretted-bass", [0.5])
    assert fingerprint(plain, plain.string[0], 28) == fingerprint(aside, aside.string[0], 28)


def test_a_pan_of_strings_that_share_a_body_is_refused() -> None:
    with pytest.raises(ValueError, match=r"string.0.pan has no meaning where strings share a body"):
        panned("steel-guitar", [0.5])
