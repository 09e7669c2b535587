"""What the engine is given: each thing that is wrong is named, with what was got and what to do, and changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from synth.engine.engine import Engine
from synth.midi.events import (
    BEND,
    CONTROL,
    EVENT,
    KEY_PRESSURE,
    NOTE_ON,
    PARAMETER,
    PRESSURE,
    PROGRAM,
    TUNING,
    make_events,
)

from .kit import FREE, NECK, engine, play

NONE = np.zeros(0, EVENT)


@pytest.fixture(scope="module")
def made() -> Engine:
    return engine(FREE, NECK, quality="draft")


def read_only(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array


def test_a_prepared_engine_says_what_it_is(made):
    assert repr(made) == "<Engine free, neck: draft, exact-hold, 44100 Hz, blocks of 4096, 10 strings>"
    assert repr(Engine([FREE])) == "<Engine free: standard, exact-hold, not prepared>"


@pytest.mark.parametrize(
    ("out", "error", "said"),
    [
        (np.zeros((10, 2), np.float32), ValueError, r"got \(10, 2\) float32"),
        (np.zeros((2, 10)).T, ValueError, "not contiguous"),
        (np.zeros((20, 2))[::2], ValueError, "not contiguous"),
        (np.zeros((10, 1)), ValueError, r"got \(10, 1\)"),
        (np.zeros(10), ValueError, r"got \(10,\)"),
        (np.zeros((10, 2), ">f8"), ValueError, "got .* >f8"),
        (np.zeros(161, np.uint8)[1:].view(np.float64).reshape(10, 2), ValueError, "contiguous"),
        (read_only(np.zeros((10, 2))), ValueError, "read-only; give a copy"),
        ([[0.0, 0.0]], TypeError, "float64 array, got"),
        (None, TypeError, "got None"),
    ],
)
def test_wrong_outputs_are_refused(made, out, error, said):
    with pytest.raises(error, match=f"out must be .*{said}"):
        made.process(NONE, out)


@pytest.mark.parametrize(
    "stems",
    [
        np.zeros((1, 10, 2)),
        np.zeros((2, 9, 2)),
        np.zeros((2, 10, 2), np.float32),
        np.zeros((10, 2, 2)).transpose(1, 0, 2),
        read_only(np.zeros((2, 10, 2))),
        np.zeros((0, 0, 2)),
        [],
    ],
)
def test_wrong_stems_are_refused(made, stems):
    with pytest.raises((ValueError, TypeError), match="stems must be"):
        made.process(NONE, np.zeros((10, 2)), stems)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ((-1, NOTE_ON, 0, 50, 100), r"events\[1\].frame must lie between 0 and the block's 100 frames, got -1"),
        ((101, NOTE_ON, 0, 50, 100), r"events\[1\].frame must lie between 0 and the block's 100 frames, got 101"),
        ((3, NOTE_ON, 0, 50, 100), r"events\[1\].frame is 3, after 5; sort events by frame"),
        ((9, 10, 0, 50, 100), r"events\[1\].kind must be one of 1 NOTE_ON, .*, got 10"),
        ((9, -1, 0, 50, 100), r"events\[1\].kind must be one of"),
        ((9, NOTE_ON, 16, 50, 100), r"events\[1\].channel of NOTE_ON must lie between 0 and 15, got 16"),
        ((9, NOTE_ON, 0, 128, 100), r"events\[1\].a of NOTE_ON must lie between 0 and 127, got 128"),
        ((9, NOTE_ON, 0, 50, 128), r"events\[1\].b of NOTE_ON must lie between 0 and 127, got 128"),
        ((9, CONTROL, 0, -1, 0), r"events\[1\].a of CONTROL"),
        ((9, BEND, 0, 8192, 0), r"events\[1\].a of BEND must lie between -8192 and 8191, got 8192"),
        ((9, PROGRAM, 0, 128, 0), r"events\[1\].a of PROGRAM"),
        ((9, PRESSURE, 0, 0, 128), r"events\[1\].b of PRESSURE"),
        ((9, KEY_PRESSURE, 0, 200, 1), r"events\[1\].a of KEY_PRESSURE"),
        ((9, PARAMETER, 2, 0, 0, 1.0), r"events\[1\].channel \(the part\) of PARAMETER must lie between 0 and 1, got 2"),
        ((9, PARAMETER, 0, 7, 0, 1.0), r"events\[1\].a of PARAMETER must lie between 0 and 6, got 7"),
        ((9, PARAMETER, 0, 1, 0, np.nan), r"events\[1\].value of PARAMETER must be finite, got nan"),
        ((9, TUNING, 0, 128, 0, 60.0), r"events\[1\].a of TUNING"),
    ],
)
def test_events_that_are_none_are_refused(made, row, said):
    made.reset()
    with pytest.raises(ValueError, match=said):
        made.process(make_events([(5, NOTE_ON, 0, 50, 100), row]), np.zeros((100, 2)))
    assert made.silent and made.report().notes == 0 and made._state.counters.sum() == 0


def test_events_of_another_type_are_refused(made):
    rows = [(0, NOTE_ON, 0, 50, 100)]
    for given in (rows, None, np.zeros((3, 6)), np.zeros(3, [("frame", "i8"), ("kind", "i4")])):
        with pytest.raises(TypeError, match=r"events must be an array of the type EVENT, .*; make_events\(rows\) makes one"):
            made.process(given, np.zeros((10, 2)))
    with pytest.raises(ValueError, match="one dimension"):
        made.process(np.zeros((2, 2), EVENT), np.zeros((10, 2)))


def test_events_may_be_a_view_or_read_only(made):
    notes = make_events([(0, NOTE_ON, 0, 50, 100), (3, 0, 0, 0), (40, NOTE_ON, 1, 40, 90)])
    made.reset()
    wanted = play(made, notes, 600)
    for given in (read_only(notes.copy()), np.repeat(notes, 2)[::2]):
        made.reset()
        out = np.zeros((600, 2))
        made.process(given, out[:512])
        made.process(NONE, out[512:])
        assert np.array_equal(out, wanted)


@pytest.mark.parametrize(
    ("rate_hz", "block", "error", "said"),
    [
        (0, 64, ValueError, "rate_hz must lie between 44100 and 768000 Hz, got 0; 44100.0 is the usual one"),
        (-44100.0, 64, ValueError, "rate_hz must lie between"),
        (float("nan"), 64, ValueError, "rate_hz must lie between .*, got nan"),
        (float("inf"), 64, ValueError, "rate_hz must lie between .*, got inf"),
        (1e300, 64, ValueError, "rate_hz must lie between"),
        (10**400, 64, ValueError, "rate_hz must lie between"),
        ("44100", 64, TypeError, "rate_hz must be a number, got '44100'"),
        (None, 64, TypeError, "rate_hz must be a number"),
        (44100.0, 0, ValueError, "max_block must be at least 1, got 0"),
        (44100.0, -1, ValueError, "max_block must be at least 1"),
        (44100.0, 64.5, TypeError, "max_block must be a whole number, got 64.5"),
        (44100.0, 1 << 40, ValueError, "max_block must be at most"),
    ],
)
def test_rates_and_blocks_that_cannot_be(rate_hz, block, error, said):
    made = Engine([FREE], quality="draft")
    with pytest.raises(error, match=said):
        made.prepare(rate_hz, block)
    with pytest.raises(ValueError, match="not prepared; call prepare"):
        made.process(NONE, np.zeros((10, 2)))


def test_an_engine_prepared_in_vain_sounds_as_before(made):
    made.reset()
    wanted = play(made, [(0, NOTE_ON, 0, 50, 100)], 600)
    with pytest.raises(ValueError, match="rate_hz"):
        made.prepare(0.0, 64)
    made.reset()
    assert np.array_equal(play(made, [(0, NOTE_ON, 0, 50, 100)], 600), wanted)


@pytest.mark.parametrize(
    ("parts", "options", "error", "said"),
    [
        ([], {}, ValueError, "at least one preset"),
        (FREE, {}, TypeError, "parts must be a list of presets"),
        ("tanpura-light", {}, TypeError, "parts must be a list of presets, got 'tanpura-light'"),
        (["tanpurra"], {}, ValueError, r"preset 'tanpurra' is not one of .*perhaps tanpura"),
        ([FREE, None], {}, TypeError, r"parts\[1\] must be a preset, its name or its file, got None"),
        ([FREE], {"quality": "x"}, ValueError, "quality must be one of draft, standard, fine, reference, got 'x'"),
        ([FREE], {"quality": None}, ValueError, "quality must be one of"),
        ([FREE], {"scheme": "x"}, ValueError, "unknown contact scheme 'x'; use one of exact-hold"),
        ([FREE], {"scheme": ["exact-hold"]}, ValueError, "unknown contact scheme"),
        ([FREE], {"restitution": 1.5}, ValueError, "restitution must lie between 0 and 1, got 1.5"),
        ([FREE], {"restitution": float("nan")}, ValueError, "restitution must lie between 0 and 1, got nan"),
        ([FREE], {"restitution": "much"}, TypeError, "restitution must be a number, got 'much'"),
        ([FREE], {"gain_db": float("inf")}, ValueError, "gain_db must lie between -200 and 200 dB, got inf"),
        ([FREE], {"gain_db": 1e4}, ValueError, "gain_db must lie between"),
        ([FREE], {"internal_rate_hz": float("nan")}, ValueError, "internal_rate_hz must lie between"),
        ([FREE], {"internal_rate_hz": "x"}, TypeError, "internal_rate_hz must be a number"),
        ([FREE], {"max_polyphony": 0}, ValueError, "polyphony must be at least 1, got 0"),
        ([FREE], {"polyphony": 2.5}, TypeError, "polyphony must be a whole number, got 2.5"),
        ([FREE], {"limiter": "soft"}, TypeError, "limiter must be True or False, got 'soft'"),
        (
            [FREE],
            {"precision": "half"},
            ValueError,
            "precision must be one of float64, float32, or None for",
        ),
        ([FREE], {"precision": "float32", "scheme": "moreau-jean"}, ValueError, "leave out one of the two"),
        ([FREE], {"seed": -1}, ValueError, "seed must be at least 0, got -1"),
        ([FREE], {"qualty": "draft"}, TypeError, "unexpected keyword argument 'qualty'"),
        ([FREE], {"program_map": np.zeros((16, 127), int)}, ValueError, r"program_map must be \(16, 128\), got \(16, 127\)"),
        ([FREE], {"program_map": np.ones((16, 128), int)}, ValueError, "numbers from 0 to 0, or −1 for no part, got 1"),
        ([FREE], {"program_map": np.full((16, 128), -2)}, ValueError, "or −1 for no part, got -2"),
        ([FREE], {"program_map": np.zeros((16, 128))}, TypeError, "program_map must hold whole numbers, got float64"),
        ([FREE], {"note_hz": [440.0]}, ValueError, r"note_hz must be \(128,\)"),
        ([FREE], {"note_hz": "x"}, TypeError, "note_hz must be 128 frequencies, got 'x'"),
        ([FREE], {"only_notes": [{50}, {51}]}, ValueError, "only_notes must have a set for each of 1 parts, got 2"),
        ([FREE], {"only_notes": {50}}, TypeError, "only_notes must be a list of sets of notes"),
        ([FREE], {"only_notes": [50]}, TypeError, r"only_notes\[0\] must be a set of MIDI notes or None"),
        ([FREE], {"threads": True}, ValueError, "threads must be a whole number from 1 on or 'auto', got True"),
    ],
)
def test_engines_that_cannot_be(parts, options, error, said):
    with pytest.raises(error, match=said):
        Engine(parts, **options)


@pytest.mark.parametrize(
    "asked",
    [
        lambda made: made.process(NONE, np.zeros((10, 2))),
        lambda made: made.reset(),
        lambda made: made.report(),
        lambda made: made.addresses,
        lambda made: made.strings_sounding,
        lambda made: made.events_dropped,
        lambda made: made.expressions,
        lambda made: made.gains,
        lambda made: made.latency_samples,
        lambda made: made.tail_seconds,
        lambda made: made.silent,
        lambda made: made.spare,
        lambda made: setattr(made, "spare", 0.1),
        lambda made: made.reserve(5),
        lambda made: made.mode_steps,
    ],
)
def test_what_needs_a_prepared_engine_says_so(asked):
    with pytest.raises(ValueError, match=r"the engine is not prepared; call prepare\(rate_hz, max_block\) first"):
        asked(Engine([FREE]))


def test_numbers_of_a_prepared_engine_that_cannot_be(made):
    for wrong in (-1.0, float("nan"), float("inf"), 1e300):
        with pytest.raises(ValueError, match="the level below which strings are spared must lie between"):
            made.spare = wrong
    with pytest.raises(TypeError, match="the level below which strings are spared must be a number"):
        made.spare = "loud"
    with pytest.raises(ValueError, match="events must be at most"):
        made.reserve(1 << 60)
    with pytest.raises(TypeError, match="events must be a whole number"):
        made.reserve(1.5)
