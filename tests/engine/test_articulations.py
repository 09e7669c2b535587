"""Articulations heard: strums, slides, harmonics, vibrato, pulls; whatever the blocks and threads, and without a click."""

from __future__ import annotations

import numpy as np
import pytest

from synth.dsp.clicks import clicks
from synth.engine.layout import HIT, NO_FINGER, TOUCHED, WAIT
from synth.instrument.preset import load_preset
from synth.midi.events import CONTROL, make_events
from tests.clicks import with_step
from tests.engine.handed import (
    BUSY,
    FLAGEOLET,
    HANDED,
    LEGATO,
    MUTE,
    NORMAL,
    PULLED,
    PULLS,
    SLAP,
    SLIDE,
    STRUM,
    TOGETHER,
    WAYS_TOGETHER,
    key,
    up,
)
from tests.engine.kit import QUANTUM, RATE_HZ, engine, go_on_from, place, play, preset, steel, what_sounds


@pytest.fixture(scope="module")
def handed():
    return engine(HANDED)


@pytest.fixture(scope="module")
def pulled():
    return engine(PULLED)


def watch(made, events, frames: int, look) -> list:
    """What `look` says after every quantum, from the start."""
    made.reset()
    rows = make_events(list(events))
    rows = rows[np.argsort(rows["frame"], kind="stable")]
    out, seen = np.zeros((QUANTUM, 2)), []
    for begin in range(0, frames, QUANTUM):
        here = rows[(rows["frame"] >= begin) & (rows["frame"] < begin + QUANTUM)].copy()
        here["frame"] -= begin
        made.process(here, out)
        seen.append(look())
    return seen


def changes(seen: list) -> list[tuple[int, object]]:
    """(frame, value) where what was seen changes."""
    return [(i * QUANTUM, seen[i]) for i in range(1, len(seen)) if seen[i] != seen[i - 1]]


def semitones(x: np.ndarray, about_hz: float) -> float:
    """Pitch of the strongest partial within a third of a frequency, in semitones above it."""
    spectrum = np.abs(np.fft.rfft(x * np.hanning(len(x)), 1 << 18))
    hz = np.fft.rfftfreq(1 << 18, 1.0 / RATE_HZ)
    near = (hz > 0.75 * about_hz) & (hz < 1.34 * about_hz)
    return 12.0 * np.log2(hz[near][spectrum[near].argmax()] / about_hz)


def hz_of(note: float) -> float:
    return 440.0 * 2.0 ** ((note - 69.0) / 12.0)


def test_blocks_and_threads_change_no_bit(handed):
    rng = np.random.default_rng(3)
    handed.reset()
    whole = play(handed, BUSY, 36_000, 4096)
    assert np.isfinite(whole).all() and np.abs(whole).max() > 0.02
    handed.reset()
    assert np.array_equal(whole, play(handed, BUSY, 36_000, (int(n) for n in rng.integers(1, 300, 36_000))))
    with_threads = engine(HANDED, threads=2)
    assert np.array_equal(whole, play(with_threads, BUSY, 36_000, 333))
    with_threads.close()


@pytest.mark.parametrize("at", [10_208, 15_392, 19_904, 28_064])
def test_a_state_goes_on_as_it_was(handed, at):
    handed.reset()
    whole = play(handed, BUSY, 36_000, 4096)
    handed.reset()
    rows = make_events(BUSY)
    play(handed, rows[rows["frame"] < at], at, 512)
    state = what_sounds(handed)
    handed.reset()
    go_on_from(handed, state)
    later = rows[rows["frame"] >= at].copy()
    later["frame"] -= at
    assert np.array_equal(whole[at:], play(handed, later, 36_000 - at, 77))


def test_strings_that_share_a_body_have_them_too():
    made, rows, at = engine(TOGETHER), make_events(WAYS_TOGETHER), 10_240
    whole = play(made, rows, 26_000, 4096)
    assert np.isfinite(whole).all() and np.abs(whole).max() > 0.02 and clicks(whole, RATE_HZ) == []
    made.reset()
    assert np.array_equal(whole, play(made, rows, 26_000, 77))
    made.reset()
    play(made, rows[rows["frame"] < at], at, 512)
    state = what_sounds(made)
    made.reset()
    go_on_from(made, state)
    later = rows[rows["frame"] >= at].copy()
    later["frame"] -= at
    assert np.array_equal(whole[at:], play(made, later, 26_000 - at, 100))


def test_a_chord_sounds_string_by_string(handed):
    events = [key(0, STRUM), *(key(96, note) for note in (43, 38, 33, 28))]
    seen = watch(handed, events, 4000, lambda: [bool(one) for one in handed._sounding.hands["phase"] > WAIT])
    began = [next(i for i, row in enumerate(seen) if row[s]) * QUANTUM for s in range(4)]
    gap = 0.012 * RATE_HZ
    assert began == pytest.approx([96, 96 + gap, 96 + 2 * gap, 96 + 3 * gap], abs=QUANTUM)


def test_a_slide_goes_through_every_fret_up_and_down(handed):
    events = [LEGATO, key(0, SLIDE), key(96, 29), key(9600, 33), up(24_000, 33)]
    seen = changes(watch(handed, events, 36_000, lambda: place(handed, 0)[1]))
    assert [fret for _, fret in seen] == [1, 2, 3, 4, 5, 4, 3, 2, 1]
    gaps = np.diff([frame for frame, _ in seen])
    assert gaps[1:4] == pytest.approx(0.03 * RATE_HZ, abs=QUANTUM)
    assert gaps[5:] == pytest.approx(0.03 * RATE_HZ, abs=QUANTUM)


def test_a_slide_whose_key_is_let_go_arrives_and_is_damped_there(handed):
    events = [LEGATO, key(0, SLIDE), key(96, 29), up(200, 29), key(300, 29), key(9600, 36), up(9700, 36), up(9701, 29)]
    handed.reset()
    play(handed, events, 60_000)
    assert place(handed, 0)[1] in (1, 8) and handed._sounding.voices["held"][0] == 0
    assert handed._sounding.expressions["hand"][0] > 0.0


def test_the_order_in_which_a_chords_keys_come_changes_no_bit(handed):
    sounds = []
    for notes in ((28, 33, 38, 43), (43, 28, 38, 33)):
        handed.reset()
        sounds.append(play(handed, [key(0, STRUM), *(key(96, note) for note in notes)], 8000))
        assert handed._sounding.strokes["strokes"].tolist() == [1, 1, 1, 1]
    assert np.array_equal(*sounds)


def test_a_chord_struck_again_is_damped_until_its_turn(handed):
    chord = (28, 33, 38, 43)
    events = [key(0, STRUM), *(key(96, note) for note in chord), *(up(9000, note) for note in chord)]
    hands = watch(
        handed, [*events, *(key(9600, note) for note in chord)], 12_000, lambda: handed._sounding.expressions["hand"].copy()
    )
    waiting = hands[(9600 + 300) // QUANTUM]
    assert np.count_nonzero(waiting > 0.0) >= 3


def test_a_slide_that_is_taken_back_strikes_nothing(handed):
    handed.reset()
    play(handed, [LEGATO, key(0, SLIDE), key(96, 31), key(5000, 35), up(5600, 35)], 12_000)
    assert handed._sounding.strokes["strokes"][0] == 1 and place(handed, 0)[1] == 3
    handed.reset()
    play(handed, [LEGATO, key(0, SLIDE), key(96, 31), key(5000, 38 - 3), key(7000, 32)], 16_000)
    assert handed._sounding.strokes["strokes"][0] == 1


def test_a_palm_stays_while_the_left_hand_moves(handed):
    for notes in ((31, 33), (33, 31)):  # pressed down, pulled off
        handed.reset()
        play(handed, [LEGATO, key(0, MUTE), key(96, notes[0]), key(6000, notes[1])], 9000)
        assert handed._sounding.hands["phase"][0] == TOUCHED and handed._sounding.strokes["strokes"][0] == 1
        assert place(handed, 0)[1] == notes[1] - 28


def test_a_finger_that_ends_a_note_is_lifted_in_its_time():
    lifted = preset(
        "lifted", steel("G2"), more="[hand]\nrelease = { place = 0.9, width_mm = 20, resistance = 0.3, lift_ms = 50 }\n"
    )
    made = engine(lifted)
    phases = watch(made, [key(96, 43), up(4000, 43)], 9000, lambda: int(made._sounding.hands["phase"][0]))
    assert phases[4400 // QUANTUM] == TOUCHED and set(phases[7000 // QUANTUM :]) == {NO_FINGER}


@pytest.mark.parametrize(("note", "n"), [(40, 2), (47, 3)])
def test_a_harmonic_sounds_its_key_and_hardly_its_string(handed, note, n):
    handed.reset()
    x = play(handed, [key(0, FLAGEOLET), key(96, note, 100)], 60_000)[:, 0]
    sounding = x[20_000:52_000] * np.hanning(32_000)
    spectrum = np.abs(np.fft.rfft(sounding, 1 << 18))
    hz = np.fft.rfftfreq(1 << 18, 1.0 / RATE_HZ)

    def level(about: float) -> float:
        return 20.0 * np.log10(spectrum[np.abs(hz - about) < 2.0].max())

    open_hz = hz_of(28)
    for other in (1, 2, 3):
        assert other == n or level(n * open_hz) - level(other * open_hz) > 30.0
    assert abs(semitones(x[20_000:52_000], hz_of(note))) < 0.1


@pytest.mark.parametrize("note", [50, 53])
def test_a_pull_sounds_as_its_key_and_comes_back(pulled, note):
    pulled.reset()
    events = [LEGATO, key(0, 48 + 1), key(20_000, note), up(50_000, note)]
    x = play(pulled, events, 90_000)[:, 0]
    assert place(pulled, 0)[1] == 1 and pulled._sounding.expressions["pull"][0] == 0.0
    assert abs(semitones(x[8_000:20_000], hz_of(49))) < 0.1
    assert abs(semitones(x[34_000:50_000], hz_of(note)) - semitones(x[8_000:20_000], hz_of(49))) < 0.05
    assert abs(semitones(x[68_000:88_000], hz_of(49))) < 0.1
    energy = np.array([np.sqrt(np.mean(x[i : i + 2000] ** 2)) for i in range(6_000, 88_000, 2000)])
    assert (energy[1:] / energy[:-1]).max() < 1.2  # what pulls the string adds no more than its stretch


def test_the_wheel_shakes_at_its_rate_and_only_upwards_where_it_pulls(pulled):
    seen = watch(
        pulled, [key(96, 60), (9600, CONTROL, 0, 1, 127)], 60_000, lambda: float(pulled._sounding.expressions["bend"][0])
    )
    assert max(seen[:300]) == 0.0
    shaken = np.array(seen[600:])
    assert shaken.min() >= 0.0 and shaken.max() == pytest.approx(0.5, abs=0.005)
    turns = np.flatnonzero((shaken[:-1] < 0.25) & (shaken[1:] >= 0.25))
    assert np.diff(turns) * QUANTUM / RATE_HZ == pytest.approx(1.0 / 5.5, abs=2 * QUANTUM / RATE_HZ)


def test_without_vibrato_the_wheel_changes_no_bit():
    plain = preset("plain", steel("C3"), polyphony=1)
    heard = []
    for wheel in (0, 127):
        made = engine(plain)
        heard.append(play(made, [(0, CONTROL, 0, 1, wheel), key(100, 48)], 20_000))
    assert np.array_equal(*heard)


#: single changes, of which none may click
CHANGES = {
    "keys": [key(100, 40), *(key(4000 + 1000 * i, k) for i, k in enumerate((MUTE, FLAGEOLET, STRUM, SLIDE, SLAP, NORMAL)))],
    "controller": [key(100, 40), *((4000 + 2000 * i, CONTROL, 0, 20, 127 * (i % 2)) for i in range(6))],
    "muted": [key(100, 40), key(9000, MUTE), key(10_000, 40), key(20_000, NORMAL), key(20_000, 40)],
    "harmonic": [key(100, 40), key(9000, FLAGEOLET), key(10_000, 40), key(20_000, 47)],
    "strum": [key(0, STRUM), *(key(100, n) for n in (28, 35, 40, 44)), *(key(15_000, n) for n in (30, 37, 42, 46))],
    "slide": [LEGATO, key(0, SLIDE), key(100, 29), key(8000, 36), up(24_000, 36)],
    "slur": [LEGATO, key(100, 28), key(8000, 32), up(18_000, 32)],
    "vibrato": [key(100, 30), (6000, CONTROL, 0, 1, 127), (24_000, CONTROL, 0, 1, 0)],
}


@pytest.mark.parametrize("name", CHANGES)
def test_no_change_of_articulation_clicks(handed, name):
    handed.reset()
    x = play(handed, CHANGES[name], 36_000)
    assert clicks(x, RATE_HZ) == []
    # and the same detector finds a click of a tenth of the level around wherever one is put in
    for frame in (6_500, 14_321, 23_000, 30_000):
        step = 0.1 * np.abs(x[frame - 500 : frame + 500]).max()
        assert [abs(found - frame) <= 2 for found, _ in clicks(with_step(x, frame, step), RATE_HZ)] == [True]


@pytest.mark.parametrize("name, notes", [("fretted-bass", (35, 46, 40, 56)), ("shamisen", (55, 66, 61, 77))])
def test_the_left_hand_may_jump(name, notes):
    """Over many frets, on strings that still sound: neither the way to a pickup nor the pull on a bridge jumps with it.

    A plectrum or finger that lets go is found with 3.1 to 3.6, a step of a tenth of the peak with 8.
    """
    rows = []
    for number, note in enumerate(notes):
        rows += [key(441 + 4410 * number, note, 60), up(441 + 4410 * number + 6174, note)]
    made = engine(load_preset(name), only_notes=[set(notes)])
    assert [(frame, size) for frame, size in clicks(play(made, rows, 22_000), RATE_HZ) if size > 4.5] == []


def test_a_bridge_feels_no_hand_at_once():
    """The hand that damps a string at its end, and the finger that takes hold of it again, are soft."""
    made = engine(load_preset("double-bass"), only_notes=[{34, 53}])
    x = play(made, [key(441, 34, 60), up(6615, 34), key(9000, 34, 60)], 12_000)
    around = [frame for frame, _ in clicks(x, RATE_HZ) if min(abs(frame - 6615 - k) for k in range(64)) < 100]
    assert np.abs(x[6000:6600]).max() > 0.03 and around == []


def test_a_pull_does_not_click(pulled):
    pulled.reset()
    assert clicks(play(pulled, PULLS, 36_000), RATE_HZ) == []


def test_what_is_left_out_of_an_engine_is_not_what_articulations_go_through():
    few = engine(HANDED, only_notes=[{33}], every_fret=False)
    assert len(few.compiled[0].strings) == 4 and all(len(each.positions) == 13 for each in few.compiled[0].strings)


def test_what_flies_keeps_its_articulation(handed):
    seen = watch(handed, [key(0, SLAP), key(96, 28, 120)], 2000, lambda: int(handed._sounding.hands["phase"][0]))
    assert HIT in seen
