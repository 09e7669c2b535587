"""Which string takes a note, and what MIDI's messages mean."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from synth.dsp.measures import click_ratios, sounding_fundamental
from synth.engine import layout
from synth.instrument.preset import load_preset
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, PROGRAM
from synth.units import cents

from .kit import BRIDGE, FREE, NECK, RATE_HZ, awake, bank_of, engine, place, play, preset, state_of, steel, until_state_at

CLICK = 4.0


@pytest.fixture(scope="module")
def neck():
    return engine(NECK, quality="draft")


@pytest.fixture(scope="module")
def free():
    return engine(FREE)


@pytest.fixture(scope="module")
def bridge():
    return engine(BRIDGE, quality="draft")


def places(made) -> list[tuple[str, int]]:
    return sorted(place(made, s) for s in awake(made))


def sound(made) -> list[int]:
    return sorted(int(n) for n in made._sounding.voices["note"][awake(made)])


# --- string allocation ------------------------------------------------------------------------------------------------


def test_nearest_position_to_the_hand(neck):
    neck.reset()
    play(neck, [(0, NOTE_ON, 0, 33, 80)], 200)
    assert places(neck) == [("A1", 0)]  # open A, not E at the fifth fret
    neck.reset()
    play(neck, [(0, NOTE_ON, 0, 38, 80), (100, NOTE_OFF, 0, 38), (6000, NOTE_ON, 0, 40, 80)], 7000)
    assert ("D2", 2) in places(neck)  # E on the D string at the second fret: the hand is at the nut
    neck.reset()
    neck._state.part_state["hand"] = 10
    play(neck, [(0, NOTE_ON, 0, 43, 80)], 200)
    assert ("A1", 10) in places(neck)  # where the hand is; not the open G


def test_open_string_is_near_wherever_the_hand_is(neck):
    neck.reset()
    neck._state.part_state["hand"] = 7
    play(neck, [(0, NOTE_ON, 0, 43, 80)], 200)
    assert places(neck) == [("G2", 0)]


def test_two_notes_never_share_a_string(neck):
    rng = np.random.default_rng(6)
    for _ in range(15):
        neck.reset()
        root = int(rng.integers(28, 38))
        chord = [root, root + 7, root + 12]
        play(neck, [(k, NOTE_ON, 0, note, 80) for k, note in enumerate(chord)], 1000)
        strings = awake(neck)
        assert len(strings) == 3 and sound(neck) == sorted(chord)
        for s in strings:  # and stopped where that note is
            model = neck._sounding.hands["model"][s]
            position = neck._bank.positions[neck._bank.positions["model"] == model][0]
            assert position["note"] == neck._sounding.voices["note"][s]


def test_a_fifth_note_takes_a_string_over(neck):
    neck.reset()
    play(neck, [(k, NOTE_ON, 0, note, 80) for k, note in enumerate((28, 33, 38, 43, 30))], 2000)
    assert sound(neck) == [30, 33, 38, 43]
    assert neck.report().unplayed == ()


def test_repeat_plucks_the_string_that_sounds(neck):
    neck.reset()
    play(neck, [(0, NOTE_ON, 0, 45, 80)], 3000)
    (first,) = places(neck)
    neck._state.part_state["hand"] = 0 if first[1] > 3 else 12
    play(neck, [(0, NOTE_OFF, 0, 45), (500, NOTE_ON, 0, 45, 80), (900, NOTE_ON, 0, 45, 90)], 1500)
    assert places(neck) == [first]


def test_repeat_within_the_stroke_of_the_left_hand(neck):
    """A sounding string is pressed for 4 ms before the fret is reached: the same note again belongs to it already."""
    neck.reset()
    play(
        neck,
        [(0, NOTE_ON, 0, 28, 80), (2000, NOTE_OFF, 0, 28), (2100, NOTE_ON, 0, 31, 80), (2150, NOTE_ON, 0, 31, 90)],
        4000,
    )
    assert places(neck) == [("E1", 3)]


def test_legato_stays_on_the_string(neck):
    """Hammer-on and pull-off: a held string takes the note, though another is nearer; the other strings rest."""
    neck.reset()
    play(neck, [(0, CONTROL, 0, 68, 127), (1, NOTE_ON, 0, 31, 100), (4000, NOTE_ON, 0, 33, 100)], 8000)
    assert places(neck) == [("E1", 5)]
    play(neck, [(0, NOTE_OFF, 0, 31), (10, NOTE_ON, 0, 28, 100)], 4000)
    assert places(neck) == [("E1", 0)]
    assert neck._sounding.voices["held"][awake(neck)[0]]
    play(neck, [(0, CONTROL, 0, 68, 0), (10, NOTE_ON, 0, 33, 100)], 4000)
    assert ("A1", 0) in places(neck)


def test_alike_strings_alternate(bridge):
    bridge.reset()
    play(bridge, [(0, NOTE_ON, 0, 48, 80)], 1000)
    assert places(bridge) == [("Sa 1", 0)]
    play(bridge, [(0, NOTE_ON, 0, 48, 80)], 1000)
    assert places(bridge) == [("Sa 1", 0), ("Sa 2", 0)]
    before = bridge._sounding.voices["plucked_at"].copy()
    play(bridge, [(0, NOTE_ON, 0, 48, 80)], 1000)
    after = bridge._sounding.voices["plucked_at"]
    assert after[1] > before[1] and after[2] == before[2]


def test_notes_without_a_string_are_reported(bridge, free):
    bridge.reset()
    play(bridge, [(0, NOTE_ON, 0, 45, 80), (5, NOTE_ON, 0, 45, 80), (9, NOTE_ON, 0, 20, 80), (9, NOTE_ON, 0, 100, 80)], 200)
    missing = {(u.part, u.note): (u.times, u.reason) for u in bridge.report().unplayed}
    assert missing[0, 45] == (2, "no string is tuned to it")
    assert missing[0, 20] == (1, "outside G2-C3") and missing[0, 100] == (1, "outside G2-C3")
    assert bridge.report().notes == 4
    assert bridge.silent
    table = np.full((16, 128), -1)
    table[0] = 0
    made = engine(FREE, program_map=table)
    play(made, [(0, NOTE_ON, 5, 50, 80)], 100)
    (lost,) = made.report().unplayed
    assert (lost.note, lost.times, lost.reason) == (50, 1, "its channel has no preset")


def test_the_quietest_is_stolen_without_a_click():
    made = engine(FREE, max_polyphony=2)
    loud, soft, new = 48, 50, 52
    at = 8000
    out = play(made, [(0, NOTE_ON, 0, loud, 120), (100, NOTE_ON, 0, soft, 40), (at, NOTE_ON, 0, new, 80)], 20000)
    assert made.report().stolen == 1
    assert sound(made) == [loud, new]
    assert made.report().most_strings == 3  # the stolen one rings out for a moment
    # up to the moment when the new note's finger lets go
    assert click_ratios(out[:, 0], at + made.latency_samples + np.arange(0, 250, 3)).max() < CLICK


def test_a_note_just_plucked_is_not_the_quietest():
    """Its level is not known yet when its finger has let go; it must not count as silent."""
    made = engine(FREE, max_polyphony=2, quality="draft")
    held = int(0.006 * RATE_HZ)
    for late in range(0, 200, 23):
        made.reset()
        play(made, [(0, NOTE_ON, 0, 48, 30), (6000, NOTE_ON, 0, 50, 120), (6000 + held + late, NOTE_ON, 0, 52, 80)], 16000)
        assert sound(made) == [50, 52], late


def test_trill_keeps_the_limit_and_a_stolen_note_off_does_not_slow_the_cut():
    made = engine(FREE, max_polyphony=1)
    events = [(700 * k, NOTE_ON, 0, 48 + 2 * (k % 2), 100) for k in range(20)]
    play(made, events, 700 * 20)
    rows = made._sounding.voices
    assert int(np.sum((rows["awake"] == 1) & (rows["stolen"] == 0))) == 1
    made.reset()
    play(made, [(0, NOTE_ON, 0, 48, 100), (5000, NOTE_ON, 0, 50, 100)], 5100)
    (stolen,) = np.flatnonzero(made._sounding.voices["stolen"])
    hand = made._sounding.expressions["hand"][stolen]
    play(made, [(0, NOTE_OFF, 0, 48)], 100)
    assert made._sounding.expressions["hand"][stolen] == hand > 0.0


# --- notes ------------------------------------------------------------------------------------------------------------


def test_note_off_damps_as_asked():
    """Mode by mode: decay rate = ln 1000/T60 of the hand + the string's own."""
    free = engine(FREE, precision="float64")
    off = 9600
    events = [(0, NOTE_ON, 0, 50, 110), (off, NOTE_OFF, 0, 50)]
    position = free.compiled[0].strings[2].positions[0]
    sigma = position.sigma[:5] + math.log(1000.0) / 0.2
    damped = np.sqrt(position.omega[:5] ** 2 - sigma**2)
    amplitude = []
    for frame in (off + 32, off + 4832):
        free.reset()
        until_state_at(free, events, frame)
        q, v = (x[:5] for x in state_of(free, 2))
        amplitude.append(np.sqrt(q**2 + ((v + sigma * q) / damped) ** 2))
    rate = np.log(amplitude[0] / amplitude[1]) * RATE_HZ / 4800
    assert np.allclose(rate, sigma, rtol=1e-6)
    free.reset()
    out = play(free, events, 30000)
    assert free.silent
    assert not free.mode_steps == 0 and np.abs(out[29000:]).max() < 1e-6


def test_release_parameter_scales_the_damping(free):
    free.reset()
    play(free, [(0, PARAMETER, 0, layout.RELEASE, 0, 4.0), (0, NOTE_ON, 0, 50, 110), (5000, NOTE_OFF, 0, 50)], 6000)
    assert free._sounding.expressions["hand"][2] == pytest.approx(math.log(1000.0) / 0.8)


def test_a_note_off_counts_from_its_frame_on(free):
    """The finger lets go 6 ms after the note-on; the hand comes then, or with a later note-off."""

    def played(off: int) -> np.ndarray:
        free.reset()
        return play(free, [(0, NOTE_ON, 0, 50, 110), (off, NOTE_OFF, 0, 50)], 3000)

    sounds = [played(off) for off in range(256, 288)]
    same = [np.abs(a - b).max() < 1e-9 for a, b in pairwise(sounds)]
    assert same == sorted(same, reverse=True)
    assert abs(256 + sum(same) - 0.006 * RATE_HZ) <= 1.0


def test_a_parameter_counts_from_its_frame_on():
    """The damping time is read when the finger has let go, 6 ms after the note-on."""
    made = engine(FREE, precision="float64")

    def played(at: int) -> np.ndarray:
        made.reset()
        return play(
            made, [(0, NOTE_ON, 0, 50, 110), (100, NOTE_OFF, 0, 50), (at, PARAMETER, 0, layout.RELEASE, 0, 0.2)], 3000
        )

    early, late = played(101), played(2000)
    sounds = [played(at) for at in range(256, 288)]
    heeded = [np.abs(sound - early).max() < 1e-9 for sound in sounds]
    ignored = [np.abs(sound - late).max() < 1e-9 for sound in sounds]
    assert ignored == [not yes for yes in heeded] == sorted(ignored)
    assert abs(256 + sum(heeded) - 0.006 * RATE_HZ) <= 1.0


def test_zero_length_note_still_sounds(free):
    free.reset()
    out = play(free, [(0, NOTE_ON, 0, 50, 110), (0, NOTE_OFF, 0, 50)], 6000)
    free.reset()
    held = play(free, [(0, NOTE_ON, 0, 50, 110)], 6000)
    assert np.abs(out).max() > 0.7 * np.abs(held).max()
    assert np.abs(out[5000:]).max() < 0.2 * np.abs(held[5000:]).max()


def test_sustain_holds_and_lets_go(free):
    free.reset()
    events = [(0, CONTROL, 0, 64, 127), (10, NOTE_ON, 0, 50, 110), (3000, NOTE_OFF, 0, 50)]
    play(free, events, 10000)
    assert free._sounding.expressions["hand"][2] == 0.0
    play(free, [(0, CONTROL, 0, 64, 63)], 40000)
    assert free.silent
    free.reset()  # pedal up while the key is down
    play(free, [(0, CONTROL, 0, 64, 127), (10, NOTE_ON, 0, 50, 110), (3000, CONTROL, 0, 64, 0)], 5000)
    assert free._sounding.expressions["hand"][2] == 0.0


def test_ring_on_rings_on(bridge):
    bridge.reset()
    play(bridge, [(0, NOTE_ON, 0, 43, 110), (2000, NOTE_OFF, 0, 43)], 30000)
    assert bridge._sounding.expressions["hand"][0] == 0.0 and not bridge.silent
    play(bridge, [(0, CONTROL, 0, 123, 0)], 5000)
    assert not bridge.silent
    play(bridge, [(0, CONTROL, 0, 120, 0)], 20000)
    assert bridge.silent


def test_velocity_is_monotone(free):
    peaks = []
    for velocity in (1, 10, 30, 64, 100, 127):
        free.reset()
        peaks.append(np.abs(play(free, [(0, NOTE_ON, 0, 50, velocity)], 4000)).max())
    assert np.all(np.diff(peaks) > 0.0)
    # no hardness of its own: amplitude ∝ (velocity/127)^1.2
    assert peaks[3] / peaks[5] == pytest.approx((64 / 127) ** 1.2, rel=1e-6)


def test_all_notes_off_heeds_the_pedal(free):
    free.reset()
    play(free, [(0, CONTROL, 0, 64, 127), (1, NOTE_ON, 0, 50, 100), (3000, CONTROL, 0, 123, 0)], 5000)
    assert free._sounding.expressions["hand"][2] == 0.0
    play(free, [(0, CONTROL, 0, 64, 0)], 100)
    assert free._sounding.expressions["hand"][2] > 0.0


def test_all_sound_off_cuts_without_a_click(free):
    for at in (100, 5000):  # under the finger, and ringing
        free.reset()
        out = play(free, [(0, NOTE_ON, 0, 50, 110), (at, CONTROL, 0, 120, 0)], 20000)[:, 0]
        assert free.silent
        assert np.abs(out[at + 4000 :]).max() < 1e-3 * np.abs(out).max()
        assert click_ratios(out, at + free.latency_samples + np.arange(0, 100, 3)).max() < 2.0 * CLICK


# --- controllers ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "controller, value, gain",
    [(7, 127, (127 / 100) ** 2), (7, 50, 0.25), (7, 0, 0.0), (11, 127, 1.0), (11, 64, (64 / 127) ** 2), (11, 0, 0.0)],
)
def test_volume_and_expression(free, controller, value, gain):
    """40 log₁₀ of the value, unity at the power-up values 100 and 127."""
    free.reset()
    plain = play(free, [(0, NOTE_ON, 0, 50, 110)], 12000)
    free.reset()
    changed = play(free, [(0, CONTROL, 0, controller, value), (0, NOTE_ON, 0, 50, 110)], 12000)
    late = slice(9000, None)  # 14 time constants
    assert np.abs(changed[late] - gain * plain[late]).max() <= 2e-6 * np.abs(plain).max()


def test_pan(free):
    free.reset()
    events = [(0, NOTE_ON, 0, 50, 110)]
    plain = play(free, events, 12000)
    assert np.allclose(plain[:, 0], plain[:, 1], rtol=1e-12, atol=0)
    for value, left, right in ((0, math.sqrt(2.0), 0.0), (127, 0.0, math.sqrt(2.0)), (64, 1.0, 1.0)):
        free.reset()
        panned = play(free, [(0, CONTROL, 0, 10, value), *events], 12000)
        assert np.allclose(panned[9000:, 0], left * plain[9000:, 0], rtol=0, atol=2e-6 * np.abs(plain).max())
        assert np.allclose(panned[9000:, 1], right * plain[9000:, 1], rtol=0, atol=2e-6 * np.abs(plain).max())


def test_controllers_do_not_step(free):
    free.reset()
    at = 6000
    turns = [
        (at, CONTROL, 0, 7, 10),
        (at + 2000, CONTROL, 0, 7, 127),
        (at + 4000, CONTROL, 0, 10, 0),
        (at + 6000, CONTROL, 0, 11, 5),
    ]
    out = play(free, [(0, NOTE_ON, 0, 50, 110), *turns], 16000)[:, 0]
    near = np.concatenate([np.arange(t[0] - 40, t[0] + 200, 2) for t in turns])
    smooth = click_ratios(out, near).max()
    # the same turns without smoothing
    free.reset()
    plain = play(free, [(0, NOTE_ON, 0, 50, 110)], 16000)[:, 0]
    gain = np.ones(16000)
    for (at, *_), g in zip(turns, (0.01, 1.61, 2.28, 0.01), strict=True):
        gain[at + free.latency_samples :] = g
    bare = click_ratios(gain * plain, near).max()
    assert smooth < 0.05 * bare


def test_gain_is_there_from_the_first_frame():
    quiet, plain = (play(engine(FREE, gain_db=g), [(0, NOTE_ON, 0, 50, 110)], 4000) for g in (-40.0, 0.0))
    assert np.abs(quiet - 0.01 * plain).max() <= 1e-12 * np.abs(plain).max()


def test_bend_range_by_rpn(free):
    def bent(events, expected_cents):
        free.reset()
        x = play(free, [*events, (6000, NOTE_ON, 0, 55, 100)], 50000)[10000:, 0]
        return sounding_fundamental(x, RATE_HZ, 196.0 * 2.0 ** (expected_cents / 1200.0))

    plain = bent([], 0.0)
    rpn = [(0, CONTROL, 0, 101, 0), (0, CONTROL, 0, 100, 0)]
    for events, expected in (
        ([(0, BEND, 0, 4096)], 100.0),
        ([*rpn, (0, CONTROL, 0, 6, 12), (0, BEND, 0, 4096)], 600.0),
        ([*rpn, (0, CONTROL, 0, 6, 12), (0, BEND, 0, -8192)], -1200.0),
        ([*rpn, (0, CONTROL, 0, 6, 1), (0, CONTROL, 0, 38, 50), (0, BEND, 0, 8191)], 150.0 * 8191 / 8192),
        # another parameter number, or none: data entry is not for the bend
        ([(0, CONTROL, 0, 101, 0), (0, CONTROL, 0, 100, 1), (0, CONTROL, 0, 6, 12), (0, BEND, 0, 4096)], 100.0),
        ([*rpn, (0, CONTROL, 0, 101, 127), (0, CONTROL, 0, 100, 127), (0, CONTROL, 0, 6, 12), (0, BEND, 0, 4096)], 100.0),
        ([*rpn, (0, CONTROL, 0, 99, 0), (0, CONTROL, 0, 98, 0), (0, CONTROL, 0, 6, 12), (0, BEND, 0, 4096)], 100.0),
    ):
        assert abs(cents(bent(events, expected), plain) - expected) < 0.3


def test_bend_glides_and_comes_back(free):
    free.reset()
    out = play(free, [(0, NOTE_ON, 0, 55, 100), (9000, BEND, 0, 8191), (20000, BEND, 0, 0)], 80000)[:, 0]
    before, bent, after = out[2000:9000], out[13000:20000], out[26000:40000]
    start = sounding_fundamental(before, RATE_HZ, 196.0)
    assert abs(cents(sounding_fundamental(bent, RATE_HZ, 220.0), start) - 200.0) < 1.0
    assert abs(cents(sounding_fundamental(after, RATE_HZ, 196.0), start)) < 0.5
    assert click_ratios(out, np.concatenate([np.arange(9000, 9800, 3), np.arange(20000, 20800, 3)])).max() < CLICK
    assert free._sounding.expressions["bend"][5] == 0.0


def test_reset_all_controllers(free):
    free.reset()
    mess = [
        (0, CONTROL, 0, 11, 0),
        (0, BEND, 0, 8191),
        (0, CONTROL, 0, 64, 127),
        (0, CONTROL, 0, 68, 127),
        (0, CONTROL, 0, 7, 50),
    ]
    play(free, [*mess, (10, NOTE_ON, 0, 50, 100), (500, NOTE_OFF, 0, 50)], 3000)
    play(free, [(0, CONTROL, 0, 121, 0)], 6000)
    channel = free._state.channels[0]
    assert channel["expression"] == 1.0 and channel["bend"] == 0.0 and channel["sustain"] == 0 and channel["legato"] == 0
    assert channel["volume"] == pytest.approx(0.25)  # stays, by the recommended practice
    assert free._sounding.expressions["hand"][2] > 0.0  # the pedal let go


# --- programs ---------------------------------------------------------------------------------------------------------


def test_program_change_moves_new_notes_only():
    table = np.full((16, 128), -1)
    table[0, 0], table[0, 32] = 0, 1
    made = engine(FREE, NECK, program_map=table, quality="draft")
    play(made, [(0, NOTE_ON, 0, 50, 100), (2000, PROGRAM, 0, 32), (2001, NOTE_ON, 0, 28, 100)], 4000)
    strings = bank_of(made).strings["part"][awake(made)]
    assert sorted(strings) == [0, 1]
    old = awake(made)[0]
    assert made._sounding.expressions["hand"][old] == 0.0
    play(made, [(0, NOTE_OFF, 0, 50)], 100)
    assert made._sounding.expressions["hand"][old] > 0.0
    play(made, [(0, PROGRAM, 0, 99), (5, NOTE_ON, 0, 50, 100)], 100)
    assert made.report().unplayed[-1].reason == "its channel has no preset"


def test_parts_keep_their_channels_apart():
    made = engine(FREE, FREE)
    stems = np.zeros((2, 6000, 2))
    play(made, [(0, NOTE_ON, 0, 50, 100), (0, CONTROL, 1, 7, 0), (0, NOTE_ON, 1, 50, 100)], 6000, stems=stems)
    assert np.abs(stems[0, 4000:]).max() > 1e-2
    assert np.abs(stems[1, 5000:]).max() < 2e-3 * np.abs(stems[0, 5000:]).max()
    play(made, [(0, NOTE_OFF, 0, 50)], 100)
    assert [bool(made._sounding.expressions["hand"][s]) for s in awake(made)] == [True, False]


# --- limiter ----------------------------------------------------------------------------------------------------------


def test_limiter_holds_the_ceiling_and_says_so():
    events = [(0, NOTE_ON, 0, n, 127) for n in (48, 49, 50, 51, 52, 55)]
    limited = engine(FREE, gain_db=12.0, limiter=True)
    bare = engine(FREE, gain_db=12.0)
    assert limited.latency_samples - bare.latency_samples == 64
    out, wild = play(limited, events, 20000), play(bare, events, 20000)
    assert np.abs(wild).max() > 1.5
    assert np.abs(out).max() <= 1.0
    assert limited.report().peak == np.abs(out).max()
    assert limited.report().limiter_reduction_db >= 20.0 * math.log10(np.abs(wild).max()) - 1e-6
    assert bare.report().limiter_reduction_db == 0.0 and bare.report().peak == np.abs(wild).max()


def test_limiter_is_a_delay_below_the_ceiling():
    events = [(0, NOTE_ON, 0, 50, 100)]
    limited, bare = engine(FREE, limiter=True), engine(FREE)
    assert np.array_equal(play(limited, events, 6000)[64:], play(bare, events, 6000)[:-64])


# --- engine's own arguments -------------------------------------------------------------------------------------------


def test_arguments_are_checked():
    from synth.engine.engine import Engine

    with pytest.raises(ValueError, match="at least one preset"):
        Engine([])
    with pytest.raises(ValueError, match="restitution"):
        Engine([FREE], restitution=1.5)
    with pytest.raises(ValueError, match="polyphony"):
        Engine([FREE], max_polyphony=0)
    with pytest.raises(ValueError, match="program_map must be"):
        Engine([FREE], np.zeros((16, 127), int))
    with pytest.raises(ValueError, match="program_map must hold part numbers from 0 to 0, or −1 for no part, got 1"):
        Engine([FREE], np.ones((16, 128), int))
    with pytest.raises(ValueError, match="scheme"):
        Engine([FREE], scheme="leapfrog").prepare(44100.0)
    with pytest.raises(ValueError, match="prepare"):
        Engine([FREE]).reset()
    with pytest.raises(ValueError, match="max_block"):
        Engine([FREE]).prepare(44100.0, 0)


def test_parameters_describe_what_events_may_set():
    made = engine(BRIDGE, FREE, quality="draft")
    rows = made.parameters
    assert [(p.part, p.id) for p in rows if p.id == "obstacle.height"] == [(0, "obstacle.height")]
    for p in rows:
        assert p.minimum <= p.default <= p.maximum
        assert made._state.parameters[p.part, p.index] == p.default
    assert len({(p.part, p.index) for p in rows}) == len(rows)


def test_tail_is_the_longest_strings():
    made = engine(preset("one", steel("G3")))
    sigma = made.compiled[0].strings[0].positions[0].sigma.min()
    assert made.tail_seconds == pytest.approx(min(60.0, math.log(1000.0) / sigma))


def test_a_part_without_wanted_notes_is_silent():
    made = engine(FREE, NECK, only_notes=[set(), {28}], quality="draft")
    out = play(made, [(0, NOTE_ON, 0, 50, 100), (0, NOTE_ON, 1, 28, 100)], 3000)
    assert out.any()
    assert {(u.part, u.note) for u in made.report().unplayed} == {(0, 50)}
    alone = engine(FREE, only_notes=[set()])
    assert not play(alone, [(0, NOTE_ON, 0, 50, 100)], 3000).any()


def test_notes_prepared_alone_sound_the_same():
    """The same string and fret is chosen where the other frets are not there, and again while it sounds."""
    bass = load_preset("fretted-bass")
    whole = engine(bass, quality="draft")
    for note in (28, 38, 45, 63):
        alone = engine(bass, quality="draft", only_notes=[{note}], every_fret=False)
        rows = [(0, NOTE_ON, 0, note, 100), (4000, NOTE_OFF, 0, note), (6000, NOTE_ON, 0, note, 60)]
        heard = []
        for made in (whole, alone):
            made.reset()
            heard.append(play(made, rows, 12000))
        assert np.array_equal(*heard) and np.abs(heard[0]).max() > 0.05
