"""A string whose motion blows up is silenced and counted; nothing that is not finite leaves the engine, or stays in it."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from synth.engine import layout
from synth.engine.engine import Engine
from synth.instrument.preset import load_preset
from synth.midi.events import BEND, CONTROL, NOTE_ON
from synth.solver.schemes import energy_warning

from .kit import BRIDGE, FREE, NECK, RATE_HZ, awake, bank_of, engine, play, preset, steel, string_of

WIDEST = [(0, CONTROL, 0, 101, 0), (0, CONTROL, 0, 100, 0), (0, CONTROL, 0, 6, 96)]


def wild_bends(frames: int) -> list[tuple]:
    """The wheel from end to end every 2500 frames, over eight octaves each way."""
    return [*WIDEST, *((at, BEND, 0, 8191 if k % 2 else -8191) for k, at in enumerate(range(2500, frames, 2500)))]


@pytest.fixture(scope="module")
def tanpura() -> Engine:
    whole = load_preset("tanpura-light")
    made = Engine(
        [whole], quality="draft", scheme="moreau-jean", only_notes=[{48}], every_fret=False, warn=lambda text: None
    )
    made.prepare(48000.0, 512)
    return made


def test_a_scheme_that_gains_energy_is_silenced_and_the_next_note_sounds(tanpura):
    frames = 59904  # of whole checks, as what follows
    tanpura.reset()
    stems = np.zeros((1, frames, 2))
    out = play(tanpura, [(0, NOTE_ON, 0, 48, 110), *wild_bends(50000)], frames, stems=stems)
    report = tanpura.report()
    assert np.isfinite(out).all() and np.abs(out).max() <= 1.0
    assert np.isfinite(stems).all() and np.abs(stems).max() < 1e6
    assert report.silenced > 0 and np.isfinite(report.peak) and np.isfinite(report.limiter_reduction_db)
    # and once more from silence on, as an engine that has never blown up plays it
    play(tanpura, [(0, CONTROL, 0, 120, 0), (0, BEND, 0, 0)], 200064)
    assert tanpura.silent and not play(tanpura, [], 1024).any()
    note = [(0, NOTE_ON, 0, 48, 110)]
    again = play(tanpura, note, 8192)
    changing = tanpura.memory.changing.values()
    assert all(np.isfinite(array).all() for array in changing if array.dtype.kind == "f")
    tanpura.reset()
    assert tanpura.report().silenced == 0
    play(tanpura, WIDEST, 1024)
    assert np.array_equal(play(tanpura, note, 8192), again)


def test_neither_blocks_nor_threads_change_what_is_silenced():
    events = [(0, NOTE_ON, 0, 48, 110), (7, NOTE_ON, 0, 43, 100), *wild_bends(20000)]
    runs = []
    for threads in (1, 2):
        made = engine(BRIDGE, quality="draft", scheme="moreau-jean", limiter=True, threads=threads)
        for blocks in (4096, 97):
            made.reset()
            runs.append((play(made, events, 22000, blocks), made.report()))
        made.close()
    for out, report in runs[1:]:
        assert np.array_equal(out, runs[0][0]) and report == runs[0][1]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e200, -1e200, 1e30])
@pytest.mark.parametrize("array", ["q", "v"])
@pytest.mark.parametrize("scheme", ["exact-hold", "moreau-jean-filtered"])
def test_whatever_gets_into_a_string_ends_there(scheme, array, value):
    """Of three strings that sound one is spoilt: the others go on as they were."""
    made = engine(FREE, scheme=scheme, quality="draft", limiter=True)
    spoilt, whole = (made, engine(FREE, scheme=scheme, quality="draft", limiter=True))
    notes = [(0, NOTE_ON, 0, note, 90) for note in (48, 50, 55)]
    for each in (spoilt, whole):
        play(each, notes, 9600)
    s = 2
    assert s in awake(spoilt)
    getattr(string_of(spoilt, s), array)[3] = value
    # the same silence where the string is taken out by hand
    whole._sounding.motions["fade_to"][s] = whole._sounding.motions["fade_at"][s] = 0
    whole._sounding.voices["awake"][s] = 0
    stems = np.zeros((1, 6400, 2))
    out = play(spoilt, [], 6400, stems=stems)
    assert np.isfinite(stems).all()
    assert np.array_equal(out, play(whole, [], 6400))
    assert spoilt.report().silenced == 1 and s not in awake(spoilt)
    after = play(spoilt, [(0, NOTE_ON, 0, 50, 90)], 6400)
    assert np.isfinite(after).all() and s in awake(spoilt)


BODIED = preset("bodied", steel("C3-E3"), more="[[body.resonance]]\nfrequency_hz = 300\nq = 20\ngain_db = 0")


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
@pytest.mark.parametrize("array", ["lines", "effect_numbers", "part_state"])
def test_whatever_gets_into_filters_ends_there(array, value):
    made = engine(BODIED, FREE, quality="draft", limiter=True)
    play(made, [(0, NOTE_ON, 0, 48, 100), (0, NOTE_ON, 1, 50, 100)], 6400)
    spoilt = made.memory.changing[array]
    if array == "part_state":
        spoilt["dc_out"][0] = value
    elif array == "lines":
        buses = bank_of(made).buses
        b = np.flatnonzero((buses["part"] == 0) & (made._stream.quiet < buses["n_taps"]))[0]
        spoilt[buses["off"][b] + buses["n_taps"][b] // 2] = value
    else:
        spoilt[0] = value  # of the body, the first effect
    stems = np.zeros((2, 6400, 2))
    out = play(made, [], 6400, stems=stems)
    assert np.isfinite(out).all() and np.isfinite(stems).all() and np.abs(out).max() <= 1.0
    assert stems[1].any() and stems[0, -1000:].any()
    assert made.report().silenced == 1
    assert all(np.isfinite(each).all() for each in made.memory.changing.values() if each.dtype.kind == "f")


def test_exact_hold_is_never_silenced():
    """Bends from end to end over eight octaves, plucks as hard as can be, and everything else at its ends."""
    made = engine(BRIDGE, NECK, FREE, limiter=True)
    loud = [(0, 6, part, index, 0, high) for part in range(3) for index, (_, high) in enumerate(layout.PARAMETER_RANGES)]
    bends = wild_bends(30000)
    events = loud + [(row[0], row[1], c, *row[3:]) for row in bends for c in range(3)]
    for at in range(0, 30000, 3000):
        events += [
            (at, NOTE_ON, 0, 43, 127),
            (at, NOTE_ON, 1, 28, 127),
            (at, NOTE_ON, 1, 55, 127),
            (at, NOTE_ON, 2, 50, 127),
        ]
    out = play(made, events, 32000)
    assert np.isfinite(out).all()
    assert made.report().silenced == 0


def test_prepare_warns_of_a_scheme_that_can_gain_energy():
    made = Engine([FREE], quality="draft", scheme="moreau-jean", restitution=0.5)
    assert made.warnings == []
    with pytest.warns(RuntimeWarning, match=r"moreau-jean with restitution 0.5 can gain energy .* internal_rate_hz"):
        made.prepare(RATE_HZ)
    told: list[str] = []
    made = Engine([FREE], quality="draft", scheme="moreau-jean", restitution=0.5, warn=told.append)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made.prepare(RATE_HZ)
    assert told == made.warnings and len(told) == 1
    factor = made.compiled[0].strings[0].factor
    assert told[0].startswith(str(energy_warning("moreau-jean", 0.5, factor * RATE_HZ, "", 1.0))[:40])
    safe = Engine([FREE], quality="draft")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        safe.prepare(RATE_HZ)
    assert safe.warnings == []
