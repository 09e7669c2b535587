"""The host's block size changes no bit; silence is silent; a stream can be stopped, kept and gone on with."""

from __future__ import annotations

import numpy as np
import pytest

from synth.engine import layout
from synth.engine.process import process
from synth.midi.events import CONTROL, EVENT, NOTE_OFF, NOTE_ON, PARAMETER, make_events

from .kit import BRIDGE, FREE, NECK, engine, go_on_from, play, random_events, what_sounds

FRAMES = 12000


def two_programs() -> np.ndarray:
    """Channels 0, 1 and 2 play parts 0, 1 and 2; program 1 of channel 0 is part 1."""
    table = np.full((16, 128), -1)
    table[0], table[1], table[2] = 0, 1, 2
    table[0, 1] = 1
    return table


def band(scheme: str, economy: bool, limiter: bool):
    rate = None if scheme == "exact-hold" else 4 * 44100.0
    return engine(
        FREE,
        BRIDGE,
        NECK,
        program_map=two_programs(),
        quality="draft" if not economy else "standard",
        scheme=scheme,
        internal_rate_hz=rate,
        economy=economy,
        limiter=limiter,
    )


@pytest.mark.parametrize(
    "scheme, economy",
    [
        ("exact-hold", True),
        ("exact-hold", False),
        ("moreau-jean", True),
        ("moreau-jean", False),
        ("moreau-jean-filtered", True),
        ("moreau-jean-filtered", False),
    ],
)
def test_block_size_changes_no_bit(scheme, economy):
    made = band(scheme, economy, limiter=economy)
    rng = np.random.default_rng([7, economy, len(scheme)])
    for trial in range(3 if scheme == "exact-hold" else 1):
        events = random_events(rng, 150, FRAMES - 2000, 3, (26, 56))
        if trial == 1:  # many at the same frame, and on the borders of quanta
            events["frame"] = np.sort(events["frame"] // 800 * 800)
        runs = []
        sizes = rng.choice([1, 2, 3, 17, 31, 32, 33, 63, 64, 100, 441, 1000, 4096], 12000)
        for blocks in (4096, list(sizes), 1 if trial == 0 else 7):
            made.reset()
            stems = np.zeros((3, FRAMES, 2))
            runs.append((play(made, events, FRAMES, blocks, stems), stems, made.report()))
        assert runs[0][0].any()
        for out, stems, report in runs[1:]:
            assert np.array_equal(out, runs[0][0])
            assert np.array_equal(stems, runs[0][1])
            assert report == runs[0][2]


def test_stems_add_up_to_the_mix_before_the_limiter():
    made = band("exact-hold", True, limiter=False)
    events = random_events(np.random.default_rng(3), 120, FRAMES, 3, (28, 56))
    stems = np.zeros((3, FRAMES, 2))
    out = play(made, events, FRAMES, stems=stems)
    assert np.abs(stems.sum(axis=0) - out).max() <= 1e-14 * np.abs(out).max()


def test_silence_in_silence_out():
    for parts in ((FREE, BRIDGE), (NECK,)):
        made = engine(*parts, limiter=True)
        quiet = [(5, CONTROL, 0, 7, 90), (900, CONTROL, 0, 64, 127), (1000, NOTE_OFF, 0, 40), (1200, NOTE_ON, 0, 40, 0)]
        assert not play(made, quiet, 5000).any()
        assert made.mode_steps == 0
        assert made.silent


def test_reset_begins_anew_and_state_goes_on():
    made = band("exact-hold", True, limiter=True)
    events = random_events(np.random.default_rng(11), 200, FRAMES, 3, (26, 56))
    whole = play(made, events, FRAMES)
    made.reset()
    half = 5003
    first = play(made, events[events["frame"] < half], half)
    kept = what_sounds(made)
    rest = events[events["frame"] >= half].copy()
    rest["frame"] -= half
    second = play(made, rest, FRAMES - half)
    assert np.array_equal(np.concatenate([first, second]), whole)
    other = band("exact-hold", True, limiter=True)
    play(other, [(0, NOTE_ON, 1, 43, 100)], 3000)
    go_on_from(other, kept)
    assert np.array_equal(play(other, rest, FRAMES - half), second)
    made.reset()
    assert np.array_equal(play(made, events, FRAMES), whole)


def test_queue_grows_for_a_flood():
    made = engine(FREE)
    count = 20000
    flood = np.zeros(count, EVENT)
    flood["kind"], flood["a"], flood["b"] = NOTE_ON, 48 + np.arange(count) % 5, 100
    out = play(made, flood, 4096, 4096)
    assert made.report().events_dropped == 0
    assert made.report().notes == count
    assert made._state.counters[layout.PENDING] == 0
    assert np.isfinite(out).all() and np.abs(out).max() > 0.01


def test_nonsense_in_events_is_no_harm():
    """Unknown kinds, channels and controllers, notes that do not exist, parameters that are no numbers: `Engine.process`
    refuses them; what the core makes of them where they come from a device is nothing."""
    made = engine(BRIDGE, NECK, quality="draft", limiter=True)
    rng = np.random.default_rng(5)
    count = 3000
    events = np.zeros(count, EVENT)
    events["frame"] = np.sort(rng.integers(0, 8000, count))
    events["kind"] = rng.integers(-2, 9, count)
    events["channel"] = rng.integers(-3, 20, count)
    events["a"] = rng.choice([-(2**31), -1, 0, 43, 48, 127, 128, 200, 2**31 - 1], count)
    events["b"] = rng.choice([-(2**31), -1, 0, 64, 127, 128, 2**31 - 1], count)
    events["value"] = rng.choice([np.nan, np.inf, -np.inf, 0.0, 1e300, -1e300, 1.0], count)
    out, no_stems = np.zeros((10000, 2)), np.zeros((0, 0, 2))
    made.reserve(2 * count)
    process(*made.addresses, events, out, no_stems)
    assert np.isfinite(out).all() and np.abs(out).max() <= 1.0
    for index in range(layout.N_PARAMETERS):
        low, high = layout.PARAMETER_RANGES[index]
        made.reset()
        high_then_none = make_events([(0, PARAMETER, 0, index, 0, 1e300), (100, PARAMETER, 0, index, 0, np.nan)])
        process(*made.addresses, high_then_none, out[:200], no_stems)
        assert made._state.parameters[0, index] == high
        none_then_low = make_events([(0, PARAMETER, 0, index, 0, -np.inf), (9, PARAMETER, 0, index, 0, -1e300)])
        process(*made.addresses, none_then_low, out[:200], no_stems)
        assert made._state.parameters[0, index] == low
