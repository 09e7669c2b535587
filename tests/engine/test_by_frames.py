"""Hands that lie on strings cost what free flight does: coupled strings go by frames, others fly with what lies on them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from synth.dsp.clicks import clicks
from synth.engine.engine import Engine
from synth.engine.layout import DRAW, FLYING, HEIGHT, LANDED, STEPS_DUE, TOUCHED
from synth.instrument.preset import load_preset
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, make_events
from synth.solver.coupling import BY_FRAMES
from synth.solver.stringmodel import MOVING
from tests.engine.kit import FORCE, ONE_NECK, QUANTUM, RATE_HZ, engine, go_on_from, play, preset, steel, what_sounds
from tests.engine.test_flight import worst

MUTED = load_preset("ukulele")
#: palm mute, then notes that are let go of one by one
MUTES = [(0, NOTE_ON, 0, 26, 100), (200, NOTE_OFF, 0, 26)] + [
    event
    for k, note in enumerate((60, 67, 64, 72, 62, 69))
    for event in ((400 + 5000 * k, NOTE_ON, 0, note, 100), (400 + 5000 * k + 6500, NOTE_OFF, 0, note))
]
FREE = preset("free", steel("C3"), output=FORCE)
PALM = preset(
    "palm", steel("C3"), output=FORCE,
    more="[articulations.normal]\ntouch = { place = 0.1, width_mm = 20.0, resistance = 2.0 }\n",
)  # fmt: skip


def bands(x: np.ndarray) -> np.ndarray:
    """Levels in third octaves from 60 Hz to 12 kHz [dB]."""
    power = np.abs(np.fft.rfft(x * np.hanning(x.size))) ** 2
    frequency = np.fft.rfftfreq(x.size, 1.0 / RATE_HZ)
    edges = 60.0 * 2.0 ** (np.arange(24) / 3.0)
    return np.array(
        [10.0 * np.log10(power[(frequency >= a) & (frequency < b)].sum() + 1e-12) for a, b in itertools.pairwise(edges)]
    )


def watched(made: Engine, events: list, frames: int) -> tuple[np.ndarray, float, int]:
    """Sound, share of the quanta of strings under a touch in which they went by frames, and quanta of such strings."""
    rows, out = make_events(events), np.zeros((frames, 2))
    ends = made._strings.bridges.ends.items
    lain_on = went = 0
    for begin in range(0, frames, QUANTUM):
        here = rows[(rows["frame"] >= begin) & (rows["frame"] < begin + QUANTUM)].copy()
        here["frame"] -= begin
        made.process(here, out[begin : begin + QUANTUM])
        touched = made._sounding.hands["phase"] == TOUCHED
        lain_on += int(touched.sum())
        went += sum(int(end.counts[BY_FRAMES]) for end, on in zip(ends, touched, strict=True) if on)
    return out, went / max(1, lain_on), lain_on


def test_muted_strings_go_by_frames_and_sound_the_same() -> None:
    """As at every step and in every mode: third octaves of 100 ms that lie within 40 dB of the loudest."""
    frames = QUANTUM * 1200
    sound, share, lain_on = watched(engine(MUTED), MUTES, frames)
    assert lain_on > 2000 and share > 0.9
    whole, none, _ = watched(engine(MUTED, economy=False), MUTES, frames)
    assert none == 0.0
    assert not clicks(sound[:, 0], RATE_HZ)
    apart = []
    for begin in range(0, frames - 4410, 4410):
        a, b = bands(whole[begin : begin + 4410, 0]), bands(sound[begin : begin + 4410, 0])
        if a.max() > -40.0:
            apart.append(np.abs(b - a)[a > a.max() - 40.0].max())
    assert np.median(apart) < 0.5 and max(apart) < 4.0, apart


def test_it_is_the_same_in_any_block_and_from_a_state() -> None:
    made = engine(MUTED)
    whole = play(made, MUTES, 20_000, 4096)
    np.testing.assert_array_equal(whole, play(engine(MUTED), MUTES, 20_000, 33))
    first = engine(MUTED)
    play(first, [row for row in MUTES if row[0] < 8000], 8000, 32)
    assert any(end.counts[BY_FRAMES] for end in first._strings.bridges.ends.items)
    other = engine(MUTED)
    go_on_from(other, what_sounds(first))
    later = [(row[0] - 8000, *row[1:]) for row in MUTES if row[0] >= 8000]
    np.testing.assert_array_equal(play(first, later, 8000, 64), play(other, later, 8000, 64))


@pytest.mark.parametrize("change", [(NOTE_OFF, 0, 48, 0), (BEND, 0, 3000, 0), (CONTROL, 0, 120, 0)])
def test_hand_and_bend_do_not_end_flight(change: tuple) -> None:
    """The string goes on in flight, and a pluck finds it as it is at its internal rate."""
    events = [(0, NOTE_ON, 0, 48, 90), (9600, *change)]
    made = engine(FREE, internal_rate_hz=6 * RATE_HZ)
    play(made, events, 9600 + 320)
    assert made._sounding.motions["flying"][0] == STEPS_DUE
    later = [*events, (9600 + 400, NOTE_ON, 0, 48, 70)]
    at_every_step = play(engine(FREE, economy=False, internal_rate_hz=6 * RATE_HZ), later, 20_000)[:, 0]
    whole, low = worst(at_every_step, play(engine(FREE, internal_rate_hz=6 * RATE_HZ), later, 20_000)[:, 0])
    assert whole < 1e-4 and low < 6e-6, (whole, low)  # above 19 kHz a bent partial keeps the gain of the one that is not


def test_a_wheel_that_never_stops_leaves_a_string_in_flight_and_asleep_in_the_end() -> None:
    wheel = [(320 * k, BEND, 0, round(4000 * np.sin(0.3 * k))) for k in range(1, 900)]
    made = engine(FREE, internal_rate_hz=6 * RATE_HZ)
    play(made, [(0, NOTE_ON, 0, 48, 90), *wheel[:40]], 12_000)
    assert made._sounding.motions["flying"][0] in (FLYING, STEPS_DUE)
    play(made, [(0, NOTE_OFF, 0, 48), *wheel], 290_000)
    assert made._sounding.voices["awake"][0] == 0


def play_until_it_lands(made: Engine, events: list) -> int:
    """Quanta of a string's flight from these events on."""
    flew = 0
    while made._sounding.motions["flying"][0] != LANDED:
        play(made, events if flew == 0 else [], QUANTUM, QUANTUM)
        flew += 1
        assert flew < 1000
    return flew


def test_a_bent_string_that_lands_moves_all_of_its_modes() -> None:
    """It flies over a low bridge, bent, until that comes up."""
    low = preset("low", steel("G2"), obstacle='kind = "bridge"\ndistance_mm = 6.0\njiva_um = 50.0', output=FORCE)
    made = engine(low, internal_rate_hz=4 * RATE_HZ)
    play(made, [(0, NOTE_ON, 0, 43, 12), (20_000, BEND, 0, 500, 0)], 20_320)
    assert made._sounding.motions["flying"][0] == STEPS_DUE
    model, moving = made._bank.models[int(made._sounding.hands["model"][0])], made._strings.states.items[0].counts
    flew = play_until_it_lands(made, [(0, PARAMETER, 0, HEIGHT, 0, 48.0)])
    assert flew > 0 and moving[MOVING] == model["n"] > model["audible"]


def test_a_wheel_that_comes_back_in_flight_leaves_a_state_that_can_be_loaded() -> None:
    """Of a string over several frets: nothing of its own is due when it has the model's coefficients again."""
    made = engine(ONE_NECK)
    play(made, [(0, BEND, 0, 500, 0), (6000, NOTE_ON, 0, 45, 20)], 24_000)  # bent before it flies: all responses were due
    assert made._sounding.motions["flying"][0] and made._sounding.motions["altered"][0]
    assert made._strings.states.items[0].due.any()
    play(made, [(0, BEND, 0, 0, 0)], 16_000)
    assert made._sounding.motions["flying"][0] == FLYING
    assert not made._strings.states.items[0].due.any()
    other = engine(ONE_NECK)
    go_on_from(other, what_sounds(made))
    later = [(100, NOTE_ON, 0, 45, 100)]
    np.testing.assert_array_equal(play(made, later, 4000), play(other, later, 4000))


def test_what_lies_on_a_string_flies_with_it() -> None:
    """Once it has settled and the string has too little energy to reach anything; −54 dB of the sound in which the palm acts
    at every step."""
    events = [(0, NOTE_ON, 0, 48, 100)]
    made = engine(PALM, internal_rate_hz=6 * RATE_HZ)
    play(made, events, 6000)
    hands, motions = made._sounding.hands, made._sounding.motions
    assert hands["phase"][0] == TOUCHED and motions["flying"][0] == FLYING
    play(made, [(0, NOTE_ON, 0, 48, 60)], 64)
    assert motions["flying"][0] == LANDED
    later = [*events, (6000, NOTE_ON, 0, 48, 60)]
    whole = play(engine(PALM, economy=False, internal_rate_hz=6 * RATE_HZ), later, 12_000)[:, 0]
    sound = play(engine(PALM, internal_rate_hz=6 * RATE_HZ), later, 12_000)[:, 0]
    assert np.abs(sound - whole).max() < 2e-3 * np.abs(whole).max()


@pytest.mark.parametrize(
    "name, note, velocity", [("nylon-guitar", 64, 115), ("nylon-guitar", 45, 60), ("double-bass", 35, 100)]
)
def test_what_is_drawn_by_frames_sounds_as_in_steps(name: str, note: int, velocity: int) -> None:
    """From the hand's arrival until after the string has slipped off, with all that is rough about the stroke; modes that
    rested while it was drawn do not begin to ring as it slips."""
    rows, sound, drawn = make_events([(0, NOTE_ON, 0, note, velocity)]), [], 0
    for economy in (False, True):
        made, out = engine(load_preset(name), economy=economy, precision="float64"), np.zeros((QUANTUM * 400, 2))
        for begin in range(0, len(out), QUANTUM):
            made.process(rows if begin == 0 else rows[:0], out[begin : begin + QUANTUM])
            drawing = made._sounding.hands["phase"] == DRAW
            went = [end.counts[BY_FRAMES] for end in made._strings.bridges.ends.items]
            drawn += sum(int(each) for each, draws in zip(went, drawing, strict=True) if draws)
        sound.append(out)
    assert drawn > 10
    apart = np.abs(sound[1] - sound[0])
    assert 1e-6 < apart.max() / np.abs(sound[0]).max() < 0.015
    assert np.sqrt(np.sum(apart**2) / np.sum(sound[0] ** 2)) < 0.007
