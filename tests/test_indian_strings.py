"""Tanpuras, sitars and veenas: what their sound is held to, strings that ring along, bridges that are curved."""

from __future__ import annotations

import functools
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from synth.author.views.instrument import draw
from synth.dsp.measures import click_ratios, log_spectral_distance, sounding_fundamental, third_octave_distance
from synth.engine.engine import Engine
from synth.fit.tune import measure, sympathetic_played
from synth.instrument.check import check
from synth.instrument.compile import describe_plan, note_frequency, obstacle_of
from synth.instrument.plan import IMPACT_BANDS_DB, IMPACT_DISTANCE_DB
from synth.instrument.preset import (
    Preset,
    PresetError,
    list_presets,
    load_preset,
    parse_preset,
    playable_notes,
    playable_range,
)
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, make_events
from synth.units import cents, midi_to_hz

TOOLS = Path(__file__).parents[1] / "tools"
sys.path.insert(0, str(TOOLS))

import indian_strings as indian  # noqa: E402

RATE = 44100
TANPURAS = ("tanpura", "tanpura-male", "tanpura-female")
FAMILIES = ("tanpura", "sitar", "veena")
ALL = tuple(preset.name for preset in list_presets() if preset.family in FAMILIES)


preset_of = functools.cache(load_preset)
_engines: dict[tuple, Engine] = {}


def prepared(preset: Preset, *notes: int) -> Engine:
    """One engine for a preset and some of its notes, which keeps the preset."""
    key = id(preset), notes
    if key not in _engines:
        _engines[key] = Engine([preset], limiter=False, only_notes=[set(notes)], every_fret=False)
        _engines[key].prepare(RATE, 512)
    return _engines[key]


def play(engine: Engine, rows: list[tuple], seconds: float) -> np.ndarray:
    """(frames,) left and right together."""
    engine.reset()
    out = np.zeros((round(seconds * RATE), 2))
    engine.process(make_events(sorted(rows, key=lambda row: row[0])), out)
    assert np.isfinite(out).all() and engine.report().unsolved_contacts == 0
    return out.mean(axis=1)


def level_db(x: np.ndarray) -> float:
    return 10.0 * float(np.log10(max(np.mean(x**2), 1e-30)))


def open_notes(preset: Preset) -> list[int]:
    return [table.notes[0] for table in preset.string if not table.sympathetic]


def energies(engine: Engine) -> dict[str, float]:
    """Of every string's first direction, by its name, up to a factor common to strings of one wire."""
    strings = engine.compiled[0].strings
    lines = len(engine._strings.states.items) // len(strings)
    found = {}
    for number, string in enumerate(strings):
        state, position = engine._strings.states.items[lines * number], string.positions[0]
        n = position.own
        found[string.name] = 0.5 * position.mu * float(np.sum(state.v[:n] ** 2 + (position.omega[:n] * state.q[:n]) ** 2))
    return found


@functools.cache
def cycle_of(name: str) -> np.ndarray:
    """(frames, 2) one cycle of a tanpura."""
    return indian.drone(preset_of(name), cycles=1)


@functools.cache
def sa_of(name: str) -> tuple[np.ndarray, float]:
    """(frames,) of the middle Sa alone, and its frequency."""
    note = preset_of(name).string[1].notes[0]
    engine = indian.engine_of(preset_of(name), [note])
    return indian.play(engine, [(0, NOTE_ON, 0, note, 64)], 3.0).mean(axis=1), float(midi_to_hz(note))


def high_passed(x: np.ndarray) -> np.ndarray:
    """Above 500 Hz: what a filter can do."""
    return sosfiltfilt(butter(4, 500.0, "highpass", fs=RATE, output="sos"), x)


@pytest.mark.parametrize("name", TANPURAS)
def test_a_drone_lies_on_its_grid(name: str) -> None:
    """Energy between the multiples of half the kharaj, 0.3 to 1.3 s after each stroke: at most -20 dB."""
    preset = preset_of(name)
    begins = [1.3 * i for i in range(4)]
    assert indian.off_grid_db(cycle_of(name).mean(axis=1), indian.common_hz(preset), begins) <= -20.0


@pytest.mark.parametrize("name", TANPURAS)
def test_the_formant_of_sa_falls_and_does_not_rise_again(name: str) -> None:
    """Of partials each measured against its own best, so that no filter makes it so or hides it."""
    x, f1 = sa_of(name)
    for sound in (x, high_passed(x)):
        hz = np.array(indian.Waking(sound, f1).formant_hz((0.1, 0.4, 0.7, 1.0, 1.4, 1.9)))
        assert hz[0] > 1.8 * hz[-1]
        assert (hz[1:] < 1.1 * np.minimum.accumulate(hz)[:-1]).all(), hz


@pytest.mark.parametrize("name", TANPURAS)
def test_partials_wake_from_above_and_late(name: str) -> None:
    """Those from the eighth to the sixteenth are strongest long after the stroke, the higher the sooner; a string that
    touches nothing has them at once, and a filter of its sound does not change that."""
    x, f1 = sa_of(name)
    waking = indian.Waking(x, f1)
    assert waking.order() < -0.4
    assert np.median(waking.strongest_s()[5:14]) > 0.3
    free = preset_of(name).with_setting("obstacle.jiva_um", "500")
    note = free.string[1].notes[0]
    control = indian.play(indian.engine_of(free, [note]), [(0, NOTE_ON, 0, note, 64)], 3.0).mean(axis=1)
    for sound in (control, high_passed(control)):
        assert np.median(indian.Waking(sound, f1).strongest_s()[5:14]) < 0.15


@pytest.mark.parametrize("name", TANPURAS)
def test_left_is_not_right(name: str) -> None:
    """…above the first modes of the table, and both together have no hole."""
    x = cycle_of(name)
    assert -25.0 < indian.wide_db(x, 500.0, 2000.0) < 0.0
    assert -25.0 < indian.wide_db(x, 2000.0, 8000.0) < 3.0


@pytest.mark.parametrize("name", ["tanpura-male", "sitar"])
@pytest.mark.slow
def test_the_modes_below_1600_hz_are_those_of_the_table(name: str) -> None:
    """`tools/tabli` computes them; the file has them rounded."""
    done = subprocess.run(
        [sys.executable, str(TOOLS / "tabli"), name],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    computed = tomllib.loads(done.stdout)["body"]["mode"]
    written = [mode for mode in preset_of(name).body.mode if mode.to_hz is None]
    assert len(written) == len(computed) > 15
    for mine, theirs in zip(written, computed, strict=True):
        for key in ("frequency_hz", "q", "mass_kg"):
            assert getattr(mine, key) == pytest.approx(theirs[key], rel=0.02)


def test_a_sitar_opens() -> None:
    """Half a second after the stroke eight of ten notes are brighter than at first, and the stroke is a fast one."""
    notes = (50, 53, 55, 57, 59, 62, 65, 67, 69, 71)
    opened, attacks = [], []
    for _, x in indian.melody(preset_of("sitar"), notes, 1.2):
        early, late = indian.opens(x)
        opened.append(late > early)
        attacks.append(indian.attack_ms(x[max(0, round((indian.onset_s(x) - 0.01) * RATE)) :]))
    assert sum(opened) >= 8, opened
    assert np.median(attacks) < 12.0, attacks


@pytest.mark.slow
def test_no_two_strokes_of_a_sitar_are_the_same() -> None:
    apart = []
    for note in (50, 57, 62, 67, 71):
        first, second = indian.strokes(preset_of("sitar"), note)
        apart.append(indian.apart_db(first, second, float(midi_to_hz(note))))
    assert 1.5 <= np.median(apart) <= 5.0, apart


def test_a_plucked_string_wakes_its_neighbours() -> None:
    """Sa 1 is plucked: Sa 2 in unison and the kharaj an octave below take over some of it, Pa, a fourth below, much less."""
    preset = preset_of("tanpura-male")
    engine = prepared(preset, *open_notes(preset))
    play(engine, [(0, NOTE_ON, 0, 49, 100)], 1.0)
    with_it = energies(engine)
    assert min(with_it["Sa 2"], with_it["kharaj"]) > 1e-3 * with_it["Sa 1"]
    assert min(with_it["Sa 2"], with_it["kharaj"]) > 10.0 * with_it["Pa"] > 0.0
    apart = prepared(preset.on_rigid_ends, *open_notes(preset))
    play(apart, [(0, NOTE_ON, 0, 49, 100)], 1.0)
    without = energies(apart)
    assert without["Sa 1"] > 0.0 and without["Sa 2"] == without["Pa"] == without["kharaj"] == 0.0


def sitar(*, tarafs: bool = True) -> Preset:
    preset = preset_of("sitar")
    if tarafs:
        return preset
    return preset.model_copy(update={"string": tuple(table for table in preset.string if not table.sympathetic)})


WITH, WITHOUT = sitar(), sitar(tarafs=False)


def left_db(preset: Preset, note: int) -> float:
    """Level from 0.4 s after the note's end, when the hand has damped it, against the note [dB]."""
    engine = prepared(preset, 65, 67)
    x = play(engine, [(0, NOTE_ON, 0, note, 100), (RATE, NOTE_OFF, 0, note, 64)], 2.0)
    return level_db(x[round(1.4 * RATE) :]) - level_db(x[RATE // 2 : RATE])


def test_tarafs_of_a_note_ring_on_after_it_and_others_do_not() -> None:
    """F4 is one of the tarafs, G4 is none."""
    ringing, none = left_db(WITH, 65), left_db(WITH, 67)
    assert ringing > none + 10.0
    assert ringing > left_db(WITHOUT, 65) + 10.0
    left_db(WITH, 65)
    found = energies(prepared(WITH, 65, 67))
    tarafs = {name: energy for name, energy in found.items() if name.startswith("taraf")}
    assert len(tarafs) == 13
    loudest = max(tarafs, key=lambda name: tarafs[name])
    assert loudest == next(table.name for table in WITH.string if table.sympathetic and table.notes[0] == 65)
    others = [energy for name, energy in tarafs.items() if name != loudest]
    assert max(others) < 0.25 * tarafs[loudest] and min(others) > 0.0  # 6 dB


def meend(seconds: float) -> list:
    """Events: a note that is pulled by five semitones from 0.5 s on."""
    bends = [(round((0.5 + seconds * i / 30) * RATE), BEND, 0, 8191 * i // 30) for i in range(31)]
    reach = [(0, CONTROL, 0, 101, 0), (0, CONTROL, 0, 100, 0), (0, CONTROL, 0, 6, 5)]
    return [*reach, (0, NOTE_ON, 0, 65, 90), *bends]


def test_meend_of_five_semitones_has_neither_click_nor_jump() -> None:
    """The string is pulled from 0.5 to 0.8 s; the detector knows a step of a tenth of the peak. Partials pass modes of table
    and neck: the level follows, less steeply where the string is pulled more slowly, which a jump would not be."""
    engine = prepared(WITH, 65, 67)
    steady = play(engine, [(0, NOTE_ON, 0, 65, 90)], 1.0)
    x = play(engine, meend(0.3), 2.2)
    places = round(0.5 * RATE) + engine.latency_samples + np.arange(0, round(0.3 * RATE), 5)
    known = steady.copy()
    known[places[4000 // 5] :] += 0.1 * np.abs(steady).max()
    assert click_ratios(known, places).max() > 1.5 * click_ratios(steady, places).max()
    assert click_ratios(x, places).max() < 1.2 * click_ratios(steady, places).max()
    steepest = []
    for seconds in (0.3, 0.6):
        part = play(prepared(WITH, 65, 67), meend(seconds), 1.4)[round(0.45 * RATE) : round((0.7 + seconds) * RATE)]
        levels = np.array([level_db(each) for each in np.array_split(part, round(part.size / (0.02 * RATE)))])
        steepest.append(np.abs(np.diff(levels)).max())
    assert steepest[0] < 6.0 and steepest[1] < 0.9 * steepest[0]
    heard = sounding_fundamental(x[round(1.2 * RATE) :], RATE, float(midi_to_hz(70)))
    assert abs(float(cents(heard, float(midi_to_hz(70))))) < 5.0


@pytest.mark.parametrize("velocity", [40, 100])
def test_points_two_millimetres_apart_are_enough(velocity: int) -> None:
    """The baj alone with ends at rest, against twice as many points, and against eight steps a frame instead of two: within
    what `standard` promises of a string that touches several points."""
    baj = WITH.on_rigid_ends.model_copy(update={"string": (WITH.string[0],), "articulations": {}})
    # not pressed: a string that is ends at the first point, wherever that stands
    baj = baj.with_setting("obstacle.jiva_um", "0")
    baj = baj.with_setting("output.position", "0.05").with_setting("output.gain_db", "0")

    def sound(preset: Preset, rate_hz: float | None = None) -> np.ndarray:
        engine = Engine([preset], limiter=False, only_notes=[{54}], every_fret=False, internal_rate_hz=rate_hz)
        engine.prepare(RATE, 512)
        return play(engine, [(0, NOTE_ON, 0, 54, velocity)], 0.7)[engine.latency_samples : RATE // 2]

    mine = sound(baj)
    for finer in (sound(baj.with_setting("obstacle.points", "8")), sound(baj, 8.0 * RATE)):
        assert log_spectral_distance(mine, finer, RATE) < IMPACT_DISTANCE_DB["standard"]
        assert third_octave_distance(mine, finer, RATE) < IMPACT_BANDS_DB["standard"]


@pytest.mark.parametrize(
    ("name", "notes"), [("tanpura-male", {37, 44, 49}), ("sitar", {37, 49, 54, 65}), ("veena", {40, 52, 59})]
)
def test_notes_are_in_tune(name: str, notes: set[int]) -> None:
    assert all(abs(pitch.cents) <= 2.0 for pitch in measure(preset_of(name), notes))


def test_strings_that_ring_along_are_in_tune() -> None:
    along = sympathetic_played(WITH)
    assert along is not None and sympathetic_played(WITHOUT) is None
    assert all(abs(pitch.cents) <= 2.0 for pitch in measure(along, {61, 72}, velocity=16))


@pytest.mark.parametrize("name", ALL)
def test_every_one_can_sound_and_is_tuned(name: str) -> None:
    preset = check(preset_of(name), name, everywhere=False)
    assert preset.sources and preset.tags
    measured = preset.tuning.contact_cents or {}
    assert set(playable_notes(preset)) <= set(measured)
    along = {table.notes[0] for table in preset.string if table.sympathetic}
    assert along <= set(preset.tuning.sympathetic_cents or {})


SMALL = """
format = 2
name = "small"
[[string]]
name = "played"
notes = "C3"
length_m = 0.9
diameter_mm = 0.33
density_kg_m3 = 7850
youngs_modulus_gpa = 200
[[string]]
name = "along"
notes = "C4"
sympathetic = true
length_m = 0.5
diameter_mm = 0.25
density_kg_m3 = 7850
youngs_modulus_gpa = 200
[[string]]
name = "high"
notes = "A2"
sounds = "C5"
frets = 0
bridge_points = 1
length_m = 0.38
diameter_mm = 0.23
density_kg_m3 = 7850
youngs_modulus_gpa = 200
[obstacle]
kind = "bridge"
distance_mm = 6
points = 3
radius_mm = 2000
frets = 2
[pluck]
displacement_mm = 2
[output]
kind = "body"
gain_db = -30
[[body.mode]]
frequency_hz = 300
q = 10
mass_kg = 0.3
"""


def test_no_key_plays_a_string_that_rings_along() -> None:
    preset = parse_preset(SMALL, "small")
    assert playable_notes(preset) == [45, 48, 49, 50] and playable_range(preset) == (45, 50)
    engine = Engine([preset], limiter=False)
    engine.prepare(RATE, 512)
    play(engine, [(0, NOTE_ON, 0, 60, 100)], 0.1)
    assert engine.notes_unplayed == 1 and engine.silent
    play(engine, [(0, NOTE_ON, 0, 48, 100)], 0.5)
    assert engine.strings_sounding == 1  # what rings along is not counted among those that are played
    assert energies(engine)["along"] > 0.0


def test_no_hand_bends_a_string_that_rings_along() -> None:
    engine = Engine([parse_preset(SMALL, "small")], limiter=False)
    engine.prepare(RATE, 512)
    play(engine, [(0, BEND, 0, 8191), (0, NOTE_ON, 0, 48, 100)], 0.5)
    bends = engine._sounding.expressions["bend"]
    assert bends[0] > 1.99 and bends[1] == 0.0


def test_the_plan_names_strings_that_ring_along() -> None:
    plan = describe_plan(parse_preset(SMALL, "small"))
    assert [row["sympathetic"] for row in plan["strings"]] == [False, True, False]
    assert "along C4 (sympathetic): 3 contacts" in plan["text"]
    assert [row["string"] for row in describe_plan(parse_preset(SMALL, "small"), 50)["strings"]] == ["played"]


def test_a_curved_bridge_falls_away_from_the_string() -> None:
    preset = parse_preset(SMALL, "small")
    played, _, high = preset.string
    below = obstacle_of(preset, played, 48, 0.9)
    np.testing.assert_allclose(below.positions_m, [0.894, 0.896, 0.898], atol=1e-12)
    np.testing.assert_allclose(below.heights_m, [-9e-6, -4e-6, -1e-6], atol=1e-12)
    near = obstacle_of(preset, high, 45, 0.38)
    np.testing.assert_allclose((*near.positions_m, *near.heights_m), [0.378, -1e-6], atol=1e-12)
    assert note_frequency(preset, high, 45, None) == pytest.approx(float(midi_to_hz(72)))
    drawing = draw(preset, 50)
    assert drawing["fret"] == 2 and len(drawing["points"]) == 3
    assert drawing["length_m"] == pytest.approx(0.9 * 2.0 ** (-2.0 / 12.0), abs=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "[[body.mode]]\nfrequency_hz = 300\nq = 10\nmass_kg = 0.3",
            "",
            r"string\.1\.sympathetic: .*give \[\[body\.mode\]\]",
        ),
        ('notes = "C4"', 'notes = "C4-D4"', r"string\.1: sympathetic applies to a single string, got notes C4-D4; give one"),
        ("sympathetic = true", "sympathetic = true\nfrets = 2", r"string\.1: frets has no meaning for a sympathetic string"),
        ("sympathetic = true", 'sympathetic = true\nsounds = "C5"', r"string\.1: sounds has no meaning"),
        ("frets = 0", "frets = 3", r"string\.2\.frets must be at most 2, the number that the neck has"),
        (
            "bridge_points = 1",
            "bridge_points = 4",
            r"string\.2\.bridge_points must be at most 3, the number that the bridge has",
        ),
        ("points = 3", "points = 0", r"obstacle\.points: .*got 0"),
    ],
)
def test_nonsense_is_said(old: str, new: str, message: str) -> None:
    text = SMALL.replace(old, new, 1)
    if "[[body.mode]]" in old:
        text = text.replace('kind = "body"', 'kind = "force"')
    with pytest.raises(PresetError, match=message):
        parse_preset(text, "small.toml")


def test_one_string_at_least_is_played() -> None:
    text = SMALL.replace('notes = "C3"', 'notes = "C3"\nsympathetic = true')
    text = text.replace('notes = "A2"\nsounds = "C5"\nfrets = 0', 'notes = "A2"\nsympathetic = true')
    for more in ("", '\n[articulations.normal]\nkey = "C0"\n[articulations.mute]\nkey = "D0"\n'):
        with pytest.raises(PresetError, match="all strings are sympathetic, and no key plays one"):
            parse_preset(text + more, "small.toml")
