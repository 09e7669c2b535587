"""Resonances of a body to the sides: stereo of a preset whose strings end in nothing that moves."""

import numpy as np
import pytest

from synth.dsp.measures import band_levels_db
from synth.engine.engine import Engine
from synth.instrument.preset import Preset, load_preset
from synth.midi.events import CONTROL, NOTE_ON, make_events

RATE = 44100.0
PEAKS = ((300.0, 20.0, 0.0), (900.0, 20.0, 0.0))


def with_pans(*pans: float) -> Preset:
    peaks = [
        {"frequency_hz": hz, "q": q, "gain_db": gain, **({"pan": pan} if pan else {})}
        for (hz, q, gain), pan in zip(PEAKS, pans, strict=True)
    ]
    tables = ", ".join("{ " + ", ".join(f"{key} = {value}" for key, value in peak.items()) + " }" for peak in peaks)
    preset = load_preset("jawari-harp")
    middle = tuple(table.model_copy(update={"pan": 0.0}) for table in preset.string)
    bodied = preset.model_copy(update={"string": middle})
    return bodied.with_setting("body", f"{{ direct_db = -60, resonance = [{tables}] }}")


def play(preset: Preset, blocks: int = 1, events: tuple[tuple, ...] = ()) -> np.ndarray:
    engine = Engine([preset], limiter=False, only_notes=[{50}])
    engine.prepare(RATE)
    out = np.zeros((round(0.5 * RATE), 2))
    given = make_events([*events, (0, NOTE_ON, 0, 50, 100)])
    for number, block in enumerate(np.array_split(out, blocks)):
        engine.process(given if number == 0 else given[:0], block)
    return out


def test_each_peak_is_heard_from_its_side() -> None:
    sound = play(with_pans(-1.0, 1.0))
    edges = [250.0, 350.0, 800.0, 1000.0]
    left, right = (band_levels_db(sound[:, side], RATE, edges)[[0, 2]] for side in (0, 1))
    assert left[0] - right[0] > 20.0 and right[1] - left[1] > 20.0


def test_without_sides_both_channels_are_the_same_and_power_is_kept() -> None:
    middle, wide = play(with_pans(0.0, 0.0)), play(with_pans(-0.5, 0.5))
    assert np.array_equal(middle[:, 0], middle[:, 1]) and not np.array_equal(wide[:, 0], wide[:, 1])
    power = 10.0 * np.log10(np.mean(wide**2) / np.mean(middle**2))
    assert power == pytest.approx(0.0, abs=0.3)


def test_one_to_a_side_changes_nothing_of_the_others() -> None:
    """Where the second peak is in the middle, left and right have of it what a mono part has."""
    mono, wide = play(with_pans(0.0, 0.0)), play(with_pans(0.3, 0.0))
    level = [band_levels_db(sound[:, 0], RATE, [860.0, 940.0])[0] for sound in (mono, wide)]
    assert level[0] == pytest.approx(level[1], abs=0.2)


def test_any_cut_into_blocks_is_the_same_to_the_bit_and_panning_is_balance() -> None:
    preset = with_pans(-0.7, 0.4)
    assert np.array_equal(play(preset), play(preset, 7))
    left = play(preset, events=((0, CONTROL, 0, 10, 0),))
    late = np.abs(left[15000:]).max(axis=0)
    assert late[1] < 1e-4 * late[0]


def test_constants_stay_what_they_are() -> None:
    """Plugins hold them in memory that nobody can write."""
    engine = Engine([with_pans(-0.7, 0.4)], limiter=False, only_notes=[{50}])
    engine.prepare(RATE)
    body = engine._chains.placed[0]
    assert body.effect.kind == "body"
    constants = [value for value in body.made if isinstance(value, np.ndarray)]
    before = [value.tobytes() for value in constants]
    out = np.zeros((4096, 2))
    engine.process(make_events([(0, NOTE_ON, 0, 50, 100)]), out)
    assert out.any() and [value.tobytes() for value in constants] == before
