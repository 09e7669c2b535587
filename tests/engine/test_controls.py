"""Tunings, pressure, MPE zones, bound controllers and sparing: what reaches strings that sound."""

from __future__ import annotations

import math

import numpy as np
import pytest

from synth.dsp.measures import click_ratios, sounding_fundamental
from synth.engine import layout
from synth.instrument.preset import PresetError, load_preset
from synth.midi.events import (
    BEND,
    CONTROL,
    EVENT,
    KEY_PRESSURE,
    NOTE_OFF,
    NOTE_ON,
    PARAMETER,
    PRESSURE,
    PROGRAM,
    TUNING,
    make_events,
)
from synth.units import cents, midi_to_hz

from .kit import BRIDGE, FORCE, FREE, NECK, RATE_HZ, awake, bank_of, engine, go_on_from, play, preset, steel, what_sounds

G3_HZ = 196.0
#: bends by 40 cents under full pressure
TENSE = preset("tense", steel("C3-E3") + steel("G3"), more="pressure_cents = 40.0")
#: its bridge yields to pressure
YIELDING = preset(
    "yielding",
    steel("G2", "Pa") + steel("C3", "Sa"),
    obstacle='kind = "bridge"\ndistance_mm = 6.0\njiva_um = 3.0',
    damping="ring_on = true",
    output=FORCE,
    more="pressure_um = -30.0",
)
G3 = 5  # the string of G3 in FREE and TENSE
CONFIGURE = [(0, CONTROL, 0, 101, 0), (0, CONTROL, 0, 100, 6)]


@pytest.fixture(scope="module")
def free():
    return engine(FREE)


@pytest.fixture(scope="module")
def tense():
    return engine(TENSE)


@pytest.fixture(scope="module")
def zone():
    return engine(TENSE, mpe=True)


def pitch(x: np.ndarray, cents_up: float = 0.0, hz: float = G3_HZ) -> float:
    return sounding_fundamental(x, RATE_HZ, hz * 2.0 ** (cents_up / 1200.0))


def plucked(made, events, frames: int = 50000) -> np.ndarray:
    """Left channel from some time after a G3 plucked at frame 6000, with these events before or after."""
    made.reset()
    return play(made, [*events, (6000, NOTE_ON, 0, 55, 100)], frames)[10000:, 0]


# --- tuning ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("offset", [0.5, -0.31, 3.0, -7.0])
def test_a_tuning_before_the_pluck(free, offset):
    plain = pitch(plucked(free, []))
    for at_once in (0, 1):
        x = plucked(free, [(0, TUNING, 0, 55, at_once, 55.0 + offset)])
        assert abs(cents(pitch(x, 100.0 * offset), plain) - 100.0 * offset) < 0.3


def test_what_sounds_follows_at_once_or_stays(free):
    plain = pitch(plucked(free, []))
    for at_once, expected in ((1, 50.0), (0, 0.0)):
        free.reset()
        out = play(free, [(0, NOTE_ON, 0, 55, 100), (9000, TUNING, 0, 55, at_once, 55.5)], 40000)[:, 0]
        assert abs(cents(pitch(out[1000:9000]), plain)) < 1.0
        assert abs(cents(pitch(out[13000:], expected), plain) - expected) < 1.0
        assert click_ratios(out, np.arange(9000, 9800, 3)).max() < 5.0
        again = play(free, [(0, NOTE_ON, 0, 55, 100)], 40000)[5000:, 0]
        assert abs(cents(pitch(again, 50.0), plain) - 50.0) < 0.5


def test_other_keys_keep_their_pitch_and_nan_resets(free):
    free.reset()
    play(free, [(0, NOTE_ON, 0, 50, 100), (0, NOTE_ON, 0, 55, 100), (9, TUNING, 0, 55, 1, 56.0)], 6000)
    assert free._sounding.expressions["bend"][2] == 0.0 and free._sounding.expressions["bend"][G3] == 1.0
    for reset in (math.nan, math.inf, -math.inf):
        play(free, [(0, TUNING, 0, 55, 1, 56.0), (100, TUNING, 0, 55, 1, reset)], 6000)
        assert free._sounding.expressions["bend"][G3] == 0.0 and not free._state.tuning.any()


def test_a_tuning_is_limited_and_wrong_keys_are_refused(free):
    free.reset()
    for key in (128, -1):
        with pytest.raises(ValueError, match=r"events\[0\].a of TUNING must lie between 0 and 127"):
            play(free, [(0, TUNING, 0, key, 1, 3.0)], 10)
    rows = [(0, TUNING, 0, 55, 1, 1e300), (0, TUNING, 0, 50, 1, -1e300)]
    out = play(free, [*rows, (5, NOTE_ON, 0, 55, 100), (5, NOTE_ON, 0, 50, 100)], 4000)
    assert free._state.tuning[55] == 24.0 and free._state.tuning[50] == -24.0
    assert np.count_nonzero(free._state.tuning) == 2
    assert np.isfinite(out).all()


def test_a_tuning_counts_from_the_compiled_one():
    note_hz = np.array([midi_to_hz(key + 0.3) for key in range(128)])
    made = engine(FREE, note_hz=note_hz)
    play(made, [(0, TUNING, 0, 55, 1, 55.3)], 100)
    assert abs(made._state.tuning[55]) < 1e-9
    x = plucked(made, [(0, TUNING, 0, 55, 1, 55.0)])
    assert abs(cents(pitch(x), pitch(plucked(engine(FREE), [])))) < 0.5


def test_tuning_bend_and_pressure_add_up(tense):
    plain = pitch(plucked(tense, []))
    rows = [(0, TUNING, 0, 55, 1, 54.7), (0, BEND, 0, 4096), (8000, PRESSURE, 0, 0, 127)]
    assert abs(cents(pitch(plucked(tense, rows), 110.0), plain) - 110.0) < 0.5


# --- pressure -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("press, expected", [((PRESSURE, 0, 0, 127), 40.0), ((KEY_PRESSURE, 0, 55, 127), 40.0)])
def test_pressure_bends_by_what_the_preset_says(tense, press, expected):
    plain = pitch(plucked(tense, []))
    x = plucked(tense, [(7000, *press)])
    assert abs(cents(pitch(x, expected), plain) - expected) < 0.3
    half = (*press[:3], 64)
    x = plucked(tense, [(7000, *half)])
    assert abs(cents(pitch(x, expected / 2), plain) - 64 / 127 * expected) < 0.3


def test_pressure_is_for_its_channel_and_its_key(tense):
    tense.reset()
    chord = [(0, NOTE_ON, 0, 50, 100), (0, NOTE_ON, 1, 52, 100), (0, NOTE_ON, 0, 55, 100)]
    play(tense, [*chord, (100, KEY_PRESSURE, 0, 50, 127), (100, KEY_PRESSURE, 0, 52, 127), (100, PRESSURE, 1, 0, 64)], 8000)
    bends = tense._sounding.expressions["bend"]
    assert bends[2] == pytest.approx(0.4) and bends[4] == pytest.approx(0.4 * 64 / 127) and bends[G3] == 0.0
    play(tense, [(0, PRESSURE, 0, 0, 127)], 8000)
    assert bends[2] == pytest.approx(0.4)  # both pressures together are no more than full
    assert bends[G3] == pytest.approx(0.4)


def test_pressure_ends_with_the_key_and_with_a_reset():
    made = engine(preset("ringing", steel("C3-E3"), damping="ring_on = true", more="pressure_cents = 40.0"))
    bend = made._sounding.expressions["bend"]
    for press in ((PRESSURE, 0, 0, 127), (KEY_PRESSURE, 0, 50, 127)):
        for end in ((NOTE_OFF, 0, 50), (CONTROL, 0, 121, 0), (CONTROL, 0, 123, 0), (*press[:3], 0)):
            made.reset()
            play(made, [(0, NOTE_ON, 0, 50, 100), (9, *press)], 6000)
            assert bend[2] == pytest.approx(0.4)
            play(made, [(0, *end)], 6000)
            assert bend[2] == 0.0 and awake(made) == [2]
    # a new note does not inherit the pressure on the key before
    made.reset()
    play(
        made,
        [(0, NOTE_ON, 0, 50, 100), (9, KEY_PRESSURE, 0, 50, 127), (6000, NOTE_OFF, 0, 50), (6001, NOTE_ON, 0, 50, 99)],
        9000,
    )
    assert bend[2] == pytest.approx(0.0, abs=0.4 * 0.02)


def test_pressure_moves_the_bridge_within_its_range():
    made = engine(YIELDING)
    rows = [(0, NOTE_ON, 0, 43, 110), (6000, PRESSURE, 0, 0, 127)]
    out = play(made, rows, 20000)[:, 0]
    assert made._sounding.expressions["height"][0] == pytest.approx(-30e-6)
    made.reset()
    play(made, [*rows, (6000, PARAMETER, 0, layout.HEIGHT, 0, -200.0)], 20000)
    assert made._sounding.expressions["height"][0] == pytest.approx(-200e-6)
    made.reset()
    plain = play(made, rows[:1], 20000)[:, 0]
    assert click_ratios(out, np.arange(6000, 6800, 3)).max() < 1.2 * click_ratios(plain, np.arange(6000, 6800, 3)).max()


@pytest.mark.parametrize("name, key", [("tanpura", 43), ("jawari-harp", 52)])
def test_pressure_takes_the_buzz_off_the_presets(name, key):
    """The share of the sound above 2 kHz falls by more than 6 dB when the key is pressed fully."""
    made = engine(load_preset(name), quality="draft", only_notes=[{key}])
    shares = []
    for value in (0, 127):
        made.reset()
        x = play(made, [(0, NOTE_ON, 0, key, 90), (9000, PRESSURE, 0, 0, value)], 46000)[14000:, 0]
        power = np.abs(np.fft.rfft(x * np.hanning(x.size))) ** 2
        shares.append(power[np.fft.rfftfreq(x.size, 1.0 / RATE_HZ) > 2000.0].sum() / power.sum())
    assert 10.0 * math.log10(shares[0] / shares[1]) > 6.0


def test_pressure_of_the_bass_is_heard_in_cents():
    made = engine(load_preset("fretted-bass"), quality="draft", only_notes=[{43}])
    pitches = []
    for value in (0, 127):
        made.reset()
        x = play(made, [(0, NOTE_ON, 0, 43, 40), (9000, PRESSURE, 0, 0, value)], 60000)[16000:, 0]
        pitches.append(pitch(x, 0.0, 98.0))
    assert abs(cents(pitches[1], pitches[0]) - 40.0) < 2.0


def test_pressure_on_the_bridge_needs_one():
    with pytest.raises(PresetError, match=r"pressure_um needs obstacle.kind"):
        preset("wrong", steel("G2"), more="pressure_um = 5.0")


# --- MPE ------------------------------------------------------------------------------------------------------------------


def masters(made) -> list[int]:
    return made._state.channels["master"].tolist()


def test_zones_come_go_and_yield(free):
    free.reset()
    assert masters(free) == list(range(16))
    play(free, [*CONFIGURE, (0, CONTROL, 0, 6, 5)], 64)
    assert masters(free) == [0] * 6 + list(range(6, 16))
    assert free._state.channels["bend_range"].tolist() == [2.0] + [48.0] * 5 + [2.0] * 10
    upper = [(0, CONTROL, 15, 101, 0), (0, CONTROL, 15, 100, 6)]
    play(free, [*upper, (0, CONTROL, 15, 6, 7)], 64)
    assert masters(free) == [0] * 6 + [6, 7] + [15] * 8
    play(free, [(0, CONTROL, 0, 6, 10)], 64)  # the newer one takes from the older
    assert masters(free) == [0] * 11 + [15] * 5
    play(free, [(0, CONTROL, 0, 6, 15)], 64)
    assert masters(free) == [0] * 16
    play(free, [(0, CONTROL, 0, 6, 0)], 64)
    assert masters(free) == list(range(16))
    assert free._state.channels["bend_range"].tolist() == [2.0] * 16
    play(free, [(0, CONTROL, 3, 101, 0), (0, CONTROL, 3, 100, 6), (0, CONTROL, 3, 6, 5)], 64)  # no manager's channel
    assert masters(free) == list(range(16))


def test_the_message_and_the_argument_are_one(zone):
    other = engine(TENSE)
    music = [(40, NOTE_ON, 3, 55, 100), (50, BEND, 3, 400), (60, NOTE_ON, 9, 50, 90), (900, BEND, 0, 8000)]
    zone.reset()
    by_message = play(other, [*CONFIGURE, (0, CONTROL, 0, 6, 15), *music], 4000)
    assert np.array_equal(play(zone, music, 4000), by_message)
    assert by_message.any()


def test_bends_of_member_and_master_add_up(zone):
    zone.reset()
    plain = pitch(play(zone, [(0, NOTE_ON, 4, 55, 100)], 40000)[4000:, 0])
    zone.reset()
    rows = [(0, BEND, 4, 1024), (0, BEND, 0, 2048), (0, BEND, 5, 8191), (6000, NOTE_ON, 4, 55, 100)]
    x = play(zone, rows, 50000)[10000:, 0]
    expected = 100.0 * (48.0 / 8.0 + 2.0 / 4.0)
    assert abs(cents(pitch(x, expected), plain) - expected) < 0.5


def test_a_members_bend_range_is_that_of_all(zone):
    zone.reset()
    rpn = [(0, CONTROL, 7, 101, 0), (0, CONTROL, 7, 100, 0)]
    play(zone, [*rpn, (0, CONTROL, 7, 6, 24), (0, CONTROL, 7, 38, 50)], 64)
    assert zone._state.channels["bend_range"].tolist() == [2.0] + [24.5] * 15


def test_pressure_of_member_and_master(zone):
    zone.reset()
    play(zone, [(0, NOTE_ON, 1, 50, 100), (0, NOTE_ON, 2, 55, 100), (9, PRESSURE, 1, 0, 60), (9, PRESSURE, 0, 0, 30)], 8000)
    bends = zone._sounding.expressions["bend"]
    assert bends[2] == pytest.approx(0.4 * 90 / 127) and bends[G3] == pytest.approx(0.4 * 30 / 127)


def test_the_masters_pedal_level_program_and_reset_are_the_zones():
    table = np.full((16, 128), -1)
    table[0, 0], table[0, 1] = 0, 1
    made = engine(FREE, TENSE, program_map=table, mpe=True)
    held = made._sounding.voices["held"]
    note = [(0, NOTE_ON, 3, 50, 100)]
    plain = play(made, note, 12000)
    made.reset()
    softer = play(made, [(0, CONTROL, 0, 7, 50), (0, CONTROL, 3, 7, 0), *note], 12000)
    assert np.abs(softer[9000:] - 0.25 * plain[9000:]).max() <= 2e-6 * np.abs(plain).max()
    # programs: members take their master's
    made.reset()
    play(made, [(0, PROGRAM, 3, 7), (0, PROGRAM, 0, 1), *note], 200)
    assert awake(made) == [8]
    # the pedal holds all members, and lets all go
    made.reset()
    play(
        made,
        [(0, CONTROL, 0, 64, 127), *note, (9, NOTE_ON, 4, 52, 100), (900, NOTE_OFF, 3, 50), (900, NOTE_OFF, 4, 52)],
        3000,
    )
    assert not held.any() and not made._sounding.expressions["hand"].any()
    play(made, [(0, CONTROL, 0, 64, 0)], 300)
    assert (made._sounding.expressions["hand"][[2, 4]] > 0.0).all()
    # reset and silence on the master reach the members
    made.reset()
    play(made, [*note, (0, BEND, 3, 900), (0, PRESSURE, 3, 0, 90)], 400)
    play(made, [(0, CONTROL, 0, 121, 0)], 400)
    assert made._state.channels["bend_raw"][3] == 0.0 and made._state.channels["pressure"][3] == 0.0
    play(made, [(0, CONTROL, 0, 123, 0)], 400)
    assert not held.any()
    play(made, [*note, (3000, CONTROL, 0, 120, 0)], 20000)
    assert made.silent


def test_timbre_moves_the_pluck_of_the_next_note(zone):
    """The levels of the partials follow sin(jπx/L) of the place that is plucked."""

    def fingers(value: int | None, channel: int = 3, master: int = 64) -> float:
        zone.reset()
        before = [] if value is None else [(0, CONTROL, channel, 74, value)]
        x = play(zone, [(0, CONTROL, 0, 74, master), *before, (64, NOTE_ON, 3, 48, 60)], 40000)[4000:, 0]
        power = np.abs(np.fft.rfft(x * np.hanning(x.size))) ** 2
        f = np.fft.rfftfreq(x.size, 1.0 / RATE_HZ)
        return power[f > 500.0].sum() / power.sum()

    plain = fingers(None)
    assert fingers(64) == plain
    assert fingers(127, channel=4) == plain  # another note's
    assert fingers(127) > 3.0 * plain
    # the second and fourth partial vanish in the middle
    zone.reset()
    x = play(zone, [(0, CONTROL, 3, 74, 0), (64, NOTE_ON, 3, 48, 60)], 40000)[4000:, 0]
    power = np.abs(np.fft.rfft(x * np.hanning(x.size))) ** 2
    f = np.fft.rfftfreq(x.size, 1.0 / RATE_HZ)
    first, second = (power[np.abs(f - k * midi_to_hz(48)) < 8.0].sum() for k in (1, 2))
    assert second < 1e-4 * first
    assert fingers(0, master=127) == pytest.approx(plain, rel=0.2)  # they add up
    # sounding strings do not mind
    zone.reset()
    still = play(zone, [(0, NOTE_ON, 3, 48, 60)], 3000)
    zone.reset()
    assert np.array_equal(play(zone, [(0, NOTE_ON, 3, 48, 60), (1000, CONTROL, 3, 74, 127)], 3000), still)


def test_controller_74_means_nothing_outside_of_zones(free):
    free.reset()
    plain = play(free, [(0, NOTE_ON, 0, 48, 60)], 2000)
    free.reset()
    assert np.array_equal(play(free, [(0, CONTROL, 0, 74, 127), (0, NOTE_ON, 0, 48, 60)], 2000), plain)


# --- parts that several channels play --------------------------------------------------------------------------------------


def test_a_shared_part_heeds_the_channel_that_plays_it(free):
    free.reset()
    plain = play(free, [(0, NOTE_ON, 5, 50, 110)], 20000)
    free.reset()
    out = play(free, [(0, NOTE_ON, 5, 50, 110), (0, CONTROL, 5, 7, 50)], 20000)
    assert np.abs(out[9000:] - 0.25 * plain[9000:]).max() <= 2e-6 * np.abs(plain).max()
    # set on another channel that then plays
    free.reset()
    out = play(free, [(0, CONTROL, 6, 11, 0), (0, NOTE_ON, 5, 50, 110)], 20000)
    assert np.array_equal(out[9000:], plain[9000:])
    out = play(free, [(0, NOTE_ON, 6, 55, 110)], 20000)
    assert np.abs(out[9000:]).max() <= 2e-6 * np.abs(plain).max()


# --- bound controllers -----------------------------------------------------------------------------------------------------


def test_a_bound_controller_runs_through_the_range():
    made = engine(FREE, BRIDGE, bindings={74: "pluck.position", 1: [(1, "obstacle.height", 20.0, -50.0)], 7: "output.gain"})
    parameters = made._state.parameters
    for value, position in ((0, 0.02), (127, 0.5), (64, 0.02 + 0.48 * 64 / 127)):
        play(made, [(0, CONTROL, 0, 74, value)], 64)
        assert parameters[0, layout.PLUCK_POSITION] == pytest.approx(position)
        assert parameters[1, layout.PLUCK_POSITION] == 0.3  # another channel's
    for value, height in ((0, 20.0), (127, -50.0)):
        play(made, [(0, CONTROL, 1, 1, value), (0, CONTROL, 0, 1, 64)], 64)
        assert parameters[1, layout.HEIGHT] == pytest.approx(height)
        assert parameters[0, layout.HEIGHT] == 0.0
    play(made, [(0, CONTROL, 0, 7, 64)], 64)
    assert parameters[0, layout.GAIN] == pytest.approx(4.0 * (64 / 127) ** 2)
    assert made._state.channels["volume"][0] == 1.0  # its built-in meaning is lost
    ratios = engine(FREE, bindings={20: "damping.release", 21: "pluck.width"})
    for value in (0, 127):
        play(ratios, [(0, CONTROL, 0, 20, value), (0, CONTROL, 0, 21, value)], 64)
        for index in (layout.RELEASE, layout.PLUCK_WIDTH):
            assert ratios._state.parameters[0, index] == pytest.approx(layout.PARAMETER_RANGES[index][value // 127])
    play(ratios, [(0, CONTROL, 0, 21, 63), (0, CONTROL, 0, 21, 64)], 64)
    assert ratios._state.parameters[0, layout.PLUCK_WIDTH] == pytest.approx(5.0, rel=0.03)


def test_members_of_a_zone_set_their_masters_parts():
    table = np.full((16, 128), -1)
    table[0] = 0
    made = engine(FREE, mpe=True, bindings={74: "pluck.position"}, program_map=table)
    play(made, [(0, CONTROL, 9, 74, 127)], 64)
    assert made._state.parameters[0, layout.PLUCK_POSITION] == 0.5


@pytest.mark.parametrize("controller", [0, 6, 32, 38, 64, 96, 101, 120, 127, -1, 128])
def test_controllers_that_cannot_be_bound(controller):
    with pytest.raises(ValueError, match=rf"controller.* {controller}"):
        engine(FREE, bindings={controller: "output.gain"})


@pytest.mark.parametrize(
    "bound, problem",
    [
        ("nonsense", "no live parameter 'nonsense'; there are output.gain, "),
        ("obstacle.height", r"which no part has \(free\)"),
        ([(1, "output.gain", None, None)], "bound to part 1, but parts go from 0 to 0"),
        ([(None, "pluck.width", 0.0, 5.0)], "pluck.width must lie between 0.5 and 50, got 0"),
        ([(None, "pluck.width", math.nan, 5.0)], "pluck.width must lie between"),
    ],
)
def test_wrong_bindings_are_refused(bound, problem):
    with pytest.raises(ValueError, match=problem):
        engine(FREE, bindings={20: bound})


def above(x: np.ndarray, low_hz: float) -> float:
    """Share of a sound above a frequency [dB]."""
    power = np.abs(np.fft.rfft(x * np.hanning(x.size))) ** 2
    return 10.0 * math.log10(power[np.fft.rfftfreq(x.size, 1.0 / RATE_HZ) > low_hz].sum() / power.sum())


@pytest.mark.parametrize("velocity", [20, 100])
@pytest.mark.parametrize(
    "identity, low, high",
    [("obstacle.height", -50.0, 20.0), ("obstacle.height", -5.0, 0.0), ("output.gain", 0.0, 2.0)],
)
def test_a_sweep_in_128_steps_sounds_like_a_smooth_one(identity, low, high, velocity):
    """What lies above 4 kHz of the smooth sweep is raised by less than 2 dB, or stays 90 dB below the sound."""
    made = engine(BRIDGE, bindings={20: [(None, identity, low, high)]})
    index = next(p.index for p in made.parameters if p.id == identity)
    start, length = 22048, 32 * 1378
    fine = np.arange(start, start + length, 32)
    x = (fine - start) / length
    values = low + (high - low) * (x * x if identity == "output.gain" else x)
    begin = [(0, PARAMETER, 0, index, 0, low), (1000, NOTE_ON, 0, 43, velocity)]
    smooth = [(int(f), PARAMETER, 0, index, 0, float(v)) for f, v in zip(fine, values, strict=True)]
    stepped = [(start + k * length // 128, CONTROL, 0, 20, k) for k in range(128)]
    shares = []
    for events in (smooth, stepped):
        made.reset()
        shares.append(above(play(made, begin + events, start + length)[start + 300 :, 0], 4000.0))
    assert shares[1] < max(shares[0] + 2.0, -90.0)


@pytest.mark.parametrize("identity", ["damping.release", "pluck.position", "pluck.amount", "pluck.width"])
def test_what_belongs_to_pluck_and_release_leaves_sounding_strings_alone(identity):
    made = engine(FREE, bindings={20: identity})
    notes = [(0, NOTE_ON, 0, 48, 100), (0, NOTE_ON, 0, 55, 100), (3000, NOTE_OFF, 0, 55)]
    plain = play(made, notes, 12000)
    made.reset()
    swept = play(made, notes + [(4000 + 50 * k, CONTROL, 0, 20, k) for k in range(128)], 12000)
    assert np.array_equal(swept, plain)


# --- sparing, the queue, floods --------------------------------------------------------------------------------------------


def test_spared_strings_fade_and_sleep_held_ones_do_not():
    made = engine(preset("long", steel("C3-E3"), damping="ring_on = true"))
    notes = [(0, NOTE_ON, 0, 48, 20), (0, NOTE_ON, 0, 50, 20), (6000, NOTE_OFF, 0, 48)]
    play(made, notes, 10000)
    level = made._sounding.voices["level"]
    assert awake(made) == [0, 2] and level[0] > 1e-3
    assert made.spare == 0.0
    made.spare = float(2.0 * level.max())
    out = play(made, [], 20000)[:, 0]
    assert awake(made) == [2]
    assert click_ratios(out, np.arange(0, 1000, 3)).max() < 5.0
    made.reset()
    assert made.spare == 0.0
    with pytest.raises(ValueError, match=r"must lie between 0 and .*, got -1"):
        made.spare = -1.0


@pytest.mark.parametrize("value", [8191, -8192])
def test_what_rests_in_bent_strings_is_not_heard(value):
    """Sparing of modes and contacts out of reach knows bent frequencies, and strings in flight do: it changes less than −100
    dBFS, as changes of rate do."""
    notes = [(0, BEND, 0, value), (6000, NOTE_ON, 0, 28, 60), (6000, NOTE_ON, 0, 43, 60)]
    runs, work = [], []
    for economy in (True, False):
        made = engine(NECK, economy=economy, precision="float64")
        bent = play(made, notes, 40000)
        work.append(made.mode_steps)
        runs.append(np.concatenate([bent, play(made, [(0, BEND, 0, 0)], 20000)]))
    assert np.abs(runs[0] - runs[1]).max() < 1e-5
    assert np.abs(runs[0]).max() > 0.01
    assert work[0] < 0.5 * work[1]


def test_a_level_below_all_strings_spares_none_bitwise(free):
    notes = [(0, NOTE_ON, 0, 48, 100), (0, NOTE_ON, 0, 55, 30), (3000, NOTE_OFF, 0, 48)]
    free.reset()
    plain = play(free, notes, 30000)
    free.reset()
    free.spare = 1e-9
    assert np.array_equal(play(free, notes, 30000), plain)


def test_the_queue_is_as_long_as_reserved():
    made = engine(FREE)
    play(made, [(0, NOTE_ON, 0, 48, 100)], 500)
    kept = what_sounds(made)
    made.reserve(100)
    assert made._stream.pending.size >= 1 << 14
    made.reserve(50000)
    assert made._stream.pending.size >= 50000
    after = play(made, [], 2000)
    go_on_from(made, kept)
    assert np.array_equal(play(made, [], 2000), after)
    with pytest.raises(ValueError, match="call prepare"):
        type(made)([FREE]).reserve(10)


# --- all together ----------------------------------------------------------------------------------------------------------


def wild(rng: np.random.Generator, count: int, frames: int) -> np.ndarray:
    """Everything a player of MPE can do, on all channels."""
    rows = []
    for frame in np.sort(rng.integers(0, frames, count)):
        c, note = int(rng.integers(16)), int(rng.integers(28, 56))
        value = int(rng.integers(128))
        rows.append(
            [
                (frame, NOTE_ON, c, note, value),
                (frame, NOTE_ON, c, note, value),
                (frame, NOTE_OFF, c, note, 64),
                (frame, PRESSURE, c, 0, value),
                (frame, KEY_PRESSURE, c, note, value),
                (frame, BEND, c, int(rng.integers(-400, 400)), 0),
                (frame, TUNING, 0, note, int(rng.integers(2)), note + rng.uniform(-1, 1)),
                (frame, CONTROL, c, int(rng.choice([1, 7, 10, 11, 20, 64, 74, 74, 121])), value),
                (frame, PARAMETER, int(rng.integers(3)), layout.HEIGHT, 0, rng.uniform(-20, 20)),
                (frame, CONTROL, int(rng.choice([0, 15])), int(rng.choice([6, 100, 101])), int(rng.choice([0, 6, 6]))),
            ][int(rng.integers(10))]
        )
    return make_events(rows)


def all_of_it(threads: int = 1):
    table = np.zeros((16, 128), int)
    table[:, 1:3] = 1, 2
    table[8:] = 2
    bindings = {
        1: "obstacle.height",
        20: "damping.release",
        11: [(0, "output.gain", 0.1, 2.0), (2, "pluck.amount", 0.2, 1.5)],
    }
    parts = TENSE, YIELDING, NECK
    return engine(*parts, program_map=table, mpe=True, limiter=True, max_polyphony=7, threads=threads, bindings=bindings)


def test_neither_blocks_nor_threads_nor_a_stop_change_a_bit():
    frames = 12000
    rng = np.random.default_rng(23)
    made, team = all_of_it(), all_of_it(threads=2)
    for _ in range(2):
        events = wild(rng, 300, frames - 2000)
        made.reset()
        whole = play(made, events, frames, 4096)
        assert whole.any() and np.isfinite(whole).all()
        for blocks in (list(rng.integers(1, 513, frames)), 1):
            made.reset()
            assert np.array_equal(play(made, events, frames, blocks), whole)
        for blocks in (4096, list(rng.integers(1, 513, frames))):
            team.reset()
            assert np.array_equal(play(team, events, frames, blocks), whole)
        made.reset()
        half = 5003
        first = play(made, events[events["frame"] < half], half)
        other = all_of_it()
        go_on_from(other, what_sounds(made))
        rest = events[events["frame"] >= half].copy()
        rest["frame"] -= half
        assert np.array_equal(np.concatenate([first, play(other, rest, frames - half)]), whole)
    team.close()


def test_a_flood_of_controllers_does_not_cut_quanta():
    """Bends, pressures and controllers between notes are no reason for strings to go step by step."""
    made = engine(TENSE, bindings={20: "output.gain"})
    flood = np.zeros(4000, EVENT)
    flood["frame"] = np.sort(np.random.default_rng(1).integers(3000, 9000, flood.size))
    flood["kind"], flood["a"], flood["b"] = CONTROL, 20, 30
    out = play(made, np.concatenate([make_events([(0, NOTE_ON, 0, 55, 100)]), flood]), 10000)
    work = made.mode_steps
    # as if it had come at the start of each quantum
    made.reset()
    quanta = np.unique(flood["frame"] // 32)
    fewer = np.zeros(quanta.size, EVENT)
    fewer["frame"], fewer["kind"], fewer["a"], fewer["b"] = 32 * quanta, CONTROL, 20, 30
    again = play(made, np.concatenate([make_events([(0, NOTE_ON, 0, 55, 100)]), fewer]), 10000)
    assert np.array_equal(out, again)
    assert made.mode_steps == work
    assert bank_of(made).strings.size == 6
