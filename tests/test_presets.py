"""The presets that come with the program: they load, have their level, buzz, fade and stop; wrong ones say why."""

import itertools
import re

import numpy as np
import pyloudnorm
import pytest

from synth.dsp.measures import decay_time_s
from synth.engine.engine import Engine
from synth.fit.loudness import phrase_sound
from synth.fit.tune import measure
from synth.host import general_midi
from synth.host.parts import Choice
from synth.instrument.compile import open_string
from synth.instrument.loudness_phrase import RATE_HZ, TARGET_LUFS, TOLERANCE_LU
from synth.instrument.neck import single_strings
from synth.instrument.preset import (
    FORMAT,
    MIGRATIONS,
    Preset,
    PresetError,
    at_note,
    list_presets,
    load_preset,
    migrate,
    parse_preset,
    playable_notes,
    preset_folder,
)
from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON, make_events
from synth.units import midi_to_hz

RATE = 44100.0
#: highest peak of a note at velocity 127, which the limiter takes: short and choked notes peak higher for their loudness
MOST_PEAK_DB = 6.0
#: what is looked at closely
NAMES = ("fretless-bass", "fretted-bass", "jawari-harp", "steel-guitar", "tanpura-light")
#: all that come with the program
EVERY = (
    "banjo",
    "clavichord",
    "clavinet",
    "clavinet-mute",
    "clavinet-neck",
    "double-bass",
    "dulcimer",
    "electric-guitar",
    "electric-guitar-low",
    "electric-guitar-middle",
    "electric-guitar-neck",
    "flatwound-bass",
    "flatwound-fretless",
    "fretless-bass",
    "fretless-low",
    "fretted-bass",
    "harp",
    "harpsichord",
    "harpsichord-full",
    "harpsichord-lute",
    "jawari-harp",
    "jazz-guitar",
    "koto",
    "koto-hirajoshi",
    "low-action-bass",
    "nylon-guitar",
    "nylon-guitar-ponticello",
    "nylon-guitar-soft",
    "picked-bass",
    "pizzicato-strings",
    "roundwound-bass",
    "shamisen",
    "shamisen-clear",
    "sitar",
    "sitar-closed",
    "sitar-gandhar",
    "slap-bass",
    "spinet",
    "steel-guitar",
    "steel-guitar-low",
    "steel-guitar-old",
    "steel-guitar-picked",
    "steel-guitar-soft",
    "tanpura",
    "tanpura-clear",
    "tanpura-female",
    "tanpura-light",
    "tanpura-male",
    "tanpura-old",
    "ukulele",
    "veena",
    "veena-soft",
    "worn-bass",
)


def bare(preset: Preset) -> Preset:
    """The strings without what a gourd makes of them."""
    return preset.model_copy(update={"body": preset.body.model_copy(update={"resonance": (), "direct_db": 0.0})})


def prepared(preset: Preset, precision: str | None = None) -> Engine:
    engine = Engine([preset], limiter=False, precision=precision)
    engine.prepare(RATE)
    return engine


def play(engine: Engine, events: list[tuple], seconds: float) -> np.ndarray:
    """(frames,) left channel."""
    return sides_of(engine, events, seconds)[:, 0]


def sides_of(engine: Engine, events: list[tuple], seconds: float) -> np.ndarray:
    """(frames, 2)."""
    engine.reset()
    out = np.zeros((round(seconds * RATE), 2))
    engine.process(make_events(events), out)
    assert np.isfinite(out).all()
    assert engine.report().unsolved_contacts == 0
    return out


def db(amplitude: float) -> float:
    return 20.0 * float(np.log10(max(amplitude, 1e-15)))


def rms_db(x: np.ndarray) -> float:
    return db(np.sqrt(np.mean(x**2)))


def string_of(name: str, note: int, index: int | None = None) -> Preset:
    """Only the string (of a table, if given) that plays the note."""
    return next(alone for table, _, alone in single_strings(load_preset(name), {note}) if index in (None, table))


def test_strokes_differ_but_of_those_that_the_page_names() -> None:
    alike = {preset.name for preset in list_presets() if not preset.hand.varies}
    text = (preset_folder().parent / "docs" / "presets.md").read_text(encoding="utf-8")
    said = " ".join(text.split()).split("no two strokes are identical; only ")[1].split(" have none")[0]
    names = set(re.findall("`([^`]*)`(s?)", said))
    assert {each for each in EVERY for name, s in names if each == name or (s and each.startswith(f"{name}-"))} == alike


def test_the_presets_that_come_with_the_program() -> None:
    presets = list_presets()
    assert sorted(preset.name for preset in presets) == list(EVERY)
    for preset in presets:
        assert preset.title and preset.description and preset.sources
        assert preset.family and preset.tags


def test_strings_are_tuned_as_promised() -> None:
    tanpura, bass, harp = (load_preset(name) for name in ("tanpura-light", "fretted-bass", "jawari-harp"))
    assert [table.notes for table in tanpura.string] == [(43, 43), (48, 48), (48, 48), (36, 36)]
    assert [table.notes[0] for table in bass.string] == [28, 33, 38, 43]
    covered = sorted(note for table in harp.string for note in range(table.notes[0], table.notes[1] + 1))
    assert covered == list(range(28, 97))  # every note once
    assert tanpura.damping.ring_on and not harp.damping.ring_on and not bass.damping.ring_on


#: most that strings of a density [kg/m³] bear in use [Pa]: brass, bronze; gut, silk; nylon and other polymers
BEARS = {8500: 0.7e9, 8800: 0.7e9, 1300: 0.35e9, 1140: 0.4e9, 1380: 0.4e9, 1780: 0.4e9}


def test_no_wire_is_stretched_beyond_what_holds() -> None:
    # drawn steel breaks at 2 GPa and more (thin music wire at 2.4), bronze at 1; makers stay below 70 %
    for preset in list_presets():
        for alone in (alone for _, _, alone in single_strings(preset)):
            table = alone.string[0]
            tension = open_string(alone, table, table.notes[0])[0].tension_n
            core_mm = at_note(table.core_diameter_mm or table.diameter_mm, table.notes[0])
            stress = tension / (np.pi * (1e-3 * core_mm) ** 2 / 4.0)
            limit = BEARS.get(table.density_kg_m3, 1.7e9 if core_mm <= 0.31 else 1.4e9)  # type: ignore[call-overload]
            assert stress < limit, (preset.name, table.name, table.notes, stress)
            assert 20.0 < tension < 300.0, (preset.name, table.name, table.notes, tension)


@pytest.mark.parametrize("name", EVERY)
def test_every_preset_plays_in_tune_at_its_level(name: str) -> None:
    """One note of each, near the middle of what it plays, by a string that has it; whole instruments are in test_playing."""
    preset = load_preset(name)
    notes = playable_notes(preset)
    note = notes[len(notes) // 2]
    *_, alone = next(iter(single_strings(preset, {note})))
    pitches = measure(alone, {note})
    assert max(abs(pitch.cents) for pitch in pitches) < 2.0, pitches
    assert Preset.model_validate(preset.model_dump(exclude_unset=True)) == preset
    loudest = np.abs(play(prepared(alone), [(0, NOTE_ON, 0, note, 127)], 0.5)).max()
    assert -30.0 < db(loudest) < MOST_PEAK_DB


def loudest_notes(name: str) -> list[tuple[float, float]]:
    """(peak of the louder side, peak of both by power) [dBFS] at velocity 127, a sample of the compass."""
    found = []
    for _, opened, alone in single_strings(load_preset(name)):
        if name == "jawari-harp" and (opened - 28) % 4:
            continue
        engine = prepared(alone)
        for position in engine.compiled[0].strings[0].positions[::3]:
            x = sides_of(engine, [(0, NOTE_ON, 0, position.note, 127)], 2.0)
            found.append((db(np.abs(x).max()), db(np.sqrt(np.mean(x**2, axis=1)).max())))
    return found


@pytest.mark.parametrize(
    ("name", "evenness_db"),
    [("tanpura-light", 5.0), ("jawari-harp", 2.0), ("fretted-bass", 8.0), ("fretless-bass", 8.0), ("steel-guitar", 12.0)],
)
@pytest.mark.slow
def test_velocity_127_is_even_and_leaves_the_limiter_little(name: str, evenness_db: float) -> None:
    """A struck bass is choked by its frets the more, the thicker the string: it may be less even; so may a body be."""
    sides, both = zip(*loudest_notes(name), strict=True)
    assert max(sides) < MOST_PEAK_DB
    assert max(both) - min(both) < evenness_db  # wherever a string stands


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.slow
def test_presets_are_equally_loud(name: str) -> None:
    """`tools/loudness` has set them; the meter is BS.1770's by pyloudnorm."""
    lufs = pyloudnorm.Meter(RATE_HZ).integrated_loudness(phrase_sound(load_preset(name)))
    assert lufs == pytest.approx(TARGET_LUFS, abs=TOLERANCE_LU)


@pytest.mark.parametrize("program", [number for number, each in enumerate(general_midi.ANSWERS) if each.articulations])
@pytest.mark.slow
def test_programs_in_an_articulation_are_as_loud_as_presets(program: int) -> None:
    """`tools/loudness --check` measures them."""
    preset = Choice().part(0, program).played(load_preset(general_midi.answer(program).preset))
    lufs = pyloudnorm.Meter(RATE_HZ).integrated_loudness(phrase_sound(preset))
    assert lufs == pytest.approx(TARGET_LUFS, abs=TOLERANCE_LU)


@pytest.mark.parametrize("name", NAMES)
def test_velocity_makes_louder(name: str) -> None:
    note = {"tanpura-light": 48, "fretted-bass": 40, "fretless-bass": 40, "jawari-harp": 60, "steel-guitar": 45}[name]
    engine = prepared(string_of(name, note))
    levels = [rms_db(play(engine, [(0, NOTE_ON, 0, note, v)], 1.0)) for v in (1, 16, 32, 64, 96, 127)]
    least = 0.5 if name == "fretted-bass" else 1.0  # frets choke a bass that is struck hard
    assert all(b > a + least for a, b in itertools.pairwise(levels))
    assert levels[-1] - levels[0] > 30.0


@pytest.mark.parametrize(
    ("name", "note", "low_s", "high_s"),
    [
        ("tanpura-light", 36, 15.0, 40.0),
        ("tanpura-light", 48, 7.0, 20.0),
        ("fretted-bass", 28, 8.0, 25.0),
        ("fretted-bass", 38, 5.0, 20.0),
        ("jawari-harp", 28, 15.0, 45.0),
        ("jawari-harp", 60, 5.0, 20.0),
        ("jawari-harp", 96, 1.5, 6.0),
        ("fretless-bass", 28, 8.0, 25.0),
        ("fretless-bass", 40, 3.0, 20.0),
        ("steel-guitar", 40, 6.0, 20.0),
        ("steel-guitar", 64, 2.0, 15.0),
    ],
)
def test_strings_ring_as_long_as_strings_do(name: str, note: int, low_s: float, high_s: float) -> None:
    x = play(prepared(bare(string_of(name, note))), [(0, NOTE_ON, 0, note, 64)], 6.0)
    assert low_s < decay_time_s(x[8820:], RATE) < high_s


def test_the_bass_has_dead_spots() -> None:
    def fundamental_s(note: int) -> float:
        x = play(prepared(string_of("fretted-bass", note, 3)), [(0, NOTE_ON, 0, note, 64)], 6.0)
        # early: along the frets, where a neck hardly gives way, a string rings on
        return decay_time_s(x[8820:], RATE, float(midi_to_hz(note)), fit_db=(-1.0, -8.0))

    assert fundamental_s(54) < 0.5 * min(fundamental_s(48), fundamental_s(43))


@pytest.mark.parametrize("note", [40, 52])
@pytest.mark.slow
def test_harmonics_by_a_program_are_those_that_there_are(note: int) -> None:
    """What is too low for one sounds as the key says, not an octave above."""
    preset = Choice(gm=True).part(0, 31).played(load_preset("electric-guitar-middle"))
    x = play(prepared(preset), [(0, NOTE_ON, 0, note, 80)], 1.5)[22050:] * np.hanning(44100)
    spectrum, hz = np.abs(np.fft.rfft(x)), np.fft.rfftfreq(44100, 1 / RATE)
    sounding = float(midi_to_hz(note))
    first, below = (spectrum[np.abs(hz - f) < 6.0].max() for f in (sounding, sounding / 2))
    # of the whole string the fundamental is there; of a touched one it is an octave below the key, and is not
    assert first > 0.05 * spectrum.max() and first > 30.0 * below


@pytest.mark.parametrize(("name", "note"), [("fretted-bass", 45), ("jawari-harp", 40), ("jawari-harp", 88)])
def test_release_stops_the_note(name: str, note: int) -> None:
    preset = string_of(name, note)
    x = play(prepared(preset), [(0, NOTE_ON, 0, note, 100), (22050, NOTE_OFF, 0, note, 0)], 1.5)
    before = rms_db(x[19845:22050])
    after = 22050 + round(1.1 * RATE * float(preset.damping.release_s))  # type: ignore[arg-type]
    assert rms_db(x[after : after + 4410]) < before - 55.0


def test_the_tanpura_rings_on_until_it_is_silenced() -> None:
    engine = prepared(string_of("tanpura-light", 43), "float64")
    held = play(engine, [(0, NOTE_ON, 0, 43, 100)], 2.0)
    released = play(engine, [(0, NOTE_ON, 0, 43, 100), (4410, NOTE_OFF, 0, 43, 0)], 2.0)
    # the event cuts a quantum of steps: other roundings, nothing more
    assert np.abs(held - released).max() < 1e-6
    silenced = play(engine, [(0, NOTE_ON, 0, 43, 100), (44100, CONTROL, 0, 120, 0)], 2.0)
    assert rms_db(silenced[66150:]) < rms_db(held[66150:]) - 60.0


@pytest.mark.parametrize(
    ("name", "note"),
    [
        ("tanpura-light", 48),
        ("fretted-bass", 43),
        ("fretless-bass", 45),
        ("jawari-harp", 72),
        ("jawari-harp", 96),
        ("steel-guitar", 50),
    ],
)
def test_plucking_again_does_not_build_up(name: str, note: int) -> None:
    engine = prepared(string_of(name, note))
    one = play(engine, [(0, NOTE_ON, 0, note, 127)], 0.5)
    # spacings that no period divides: each pluck finds the string elsewhere
    many = play(engine, [(i * 11027, NOTE_ON, 0, note, 127) for i in range(24)], 6.0)
    levels = [rms_db(many[i * 11027 : (i + 1) * 11027]) for i in range(24)]
    # a finger leaves some of what was there: at most twice the energy of one pluck, and no trend
    assert max(levels) < rms_db(one[:11027]) + 6.0
    assert np.mean(levels[16:]) < np.mean(levels[4:12]) + 1.0
    assert db(np.abs(many).max()) < 0.0


@pytest.mark.parametrize(
    ("name", "note"),
    [
        ("tanpura-light", 48),
        ("fretted-bass", 63),
        ("fretless-bass", 57),
        ("jawari-harp", 48),
        ("jawari-harp", 96),
        ("jawari-harp", 90),
        ("steel-guitar", 55),
    ],
)
def test_every_note_dies_away_and_has_no_offset(name: str, note: int) -> None:
    engine = prepared(string_of(name, note))
    x = play(engine, [(0, NOTE_ON, 0, note, 127)], 45.0)
    seconds = [rms_db(part) for part in np.array_split(x, 45)]
    assert all(b <= a + 0.1 for a, b in itertools.pairwise(seconds[1:]))
    assert seconds[-1] < -100.0
    assert engine.silent
    assert abs(x.mean()) < 1e-6


def test_a_hard_bass_note_slaps_and_a_soft_one_does_not() -> None:
    engine = prepared(string_of("fretted-bass", 43, 3))
    fretless = string_of("fretted-bass", 43, 3).model_dump(exclude_unset=True) | {"obstacle": {"kind": "none"}}
    free = prepared(Preset.model_validate(fretless))
    for velocity, touches in ((30, False), (64, False), (127, True)):
        a = play(engine, [(0, NOTE_ON, 0, 43, velocity)], 0.5)
        b = play(free, [(0, NOTE_ON, 0, 43, velocity)], 0.5)
        difference = np.sqrt(np.mean((a - b) ** 2) / np.mean(b**2))
        assert (difference > 0.3) == touches, (velocity, difference)


JIVA_UM = tuple(range(-5, 65, 5))


@pytest.mark.parametrize(("note", "velocity"), [(36, 64), (36, 127), (43, 64), (43, 127), (48, 64), (48, 127)])
def test_jiva_brings_the_buzz_without_a_jump_in_loudness(note: int, velocity: int) -> None:
    """Level (rms over 2 s) and buzz (share of the energy above 2 kHz) from a thread that lies on the bridge to none."""
    levels, buzz = [], []
    for jiva in JIVA_UM:
        preset = bare(string_of("tanpura-light", note)).with_setting("obstacle.jiva_um", str(jiva))
        x = play(prepared(preset), [(0, NOTE_ON, 0, note, velocity)], 2.0)
        power = np.abs(np.fft.rfft(x)) ** 2
        frequency = np.fft.rfftfreq(x.size, 1.0 / RATE)
        levels.append(rms_db(x))
        buzz.append(10.0 * float(np.log10(power[frequency > 2000.0].sum() / power.sum())))
    assert np.abs(np.diff(levels)).max() < 1.5
    assert max(levels) - min(levels) < 4.0
    free = buzz[-1]
    assert buzz[0] > free + 9.0
    assert abs(buzz[-1] - buzz[-2]) < 1e-3 and abs(levels[-1] - levels[-2]) < 1e-3  # 60 µm: nothing is touched
    # towards the bridge it only rises, but where the string just grazes: a light touch rounds its corners before it buzzes
    grazing = 3.0
    for wider, closer in zip(buzz[:0:-1], buzz[-2::-1], strict=True):
        assert closer > wider or (closer > free - grazing and wider < free + grazing), buzz


@pytest.mark.parametrize("name", NAMES)
def test_settings_and_round_trip(name: str) -> None:
    preset = load_preset(name)
    assert Preset.model_validate(preset.model_dump()) == preset
    assert Preset.model_validate(preset.model_dump(exclude_unset=True)) == preset
    changed = preset.with_setting("pluck.position", "0.31").with_setting("string.0.cents", "-14.5")
    assert changed.pluck.position == 0.31
    assert changed.string[0].cents == -14.5
    assert changed.string[1:] == preset.string[1:]
    assert preset.pluck.position != 0.31  # the old one stays
    back = changed.with_setting("pluck.position", str(preset.pluck.position)).with_setting("string.0.cents", "0.0")
    assert back.pluck == preset.pluck and back.string == preset.string
    anchored = preset.with_setting("pluck.draw_ms", "{ E1 = 8, 'C#4' = 4.5 }")
    assert anchored.pluck.draw_ms == {28: 8.0, 61: 4.5}
    assert preset.with_setting("string.0.notes", "A2").string[0].notes == (45, 45)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("pluck.position", "2", r"pluck\.position: .*less than 1, got 2"),
        ("pluck.position", "near", r"pluck\.position: .*got 'near'"),
        ("obstacle", '{kind = "frets", count = 19.5}', r"obstacle\.count: must be a whole number, got 19\.5"),
        ("title", "3", r"title: must be text, got 3"),
        ("pluck.positon", "0.2", r"pluck\.positon: no such key"),
        ("plucks.position", "0.2", r"plucks: no such key"),
        ("string.9.cents", "1", r"no setting 'string\.9\.cents' \('9' does not exist\)"),
        ("string.-1.cents", "1", r"no setting"),
        ("string.x.cents", "1", r"no setting"),
        ("pluck.position.deep", "1", r"no setting"),
        ("string.0.notes", "C3-", r"string\.0\.notes: must be one note"),
        ("string.0.notes", "G9-G10", r"string\.0\.notes: .*got 'G10'"),
        ("obstacle.jiva_um", "1e9", r"obstacle\.jiva_um: must lie between -100 and 1000, got 1e\+09"),
        ("obstacle.kind", "wall", r"obstacle: .*'none', 'bridge', 'points', 'frets'"),
        ("", "1", r"no such key"),
    ],
)
def test_wrong_settings_name_the_key(key: str, value: str, message: str) -> None:
    with pytest.raises(PresetError, match=message):
        load_preset("tanpura-light").with_setting(key, value)


GOOD = """
format = 2
name = "mine"
[[string]]
notes = "C3"
length_m = 0.9
diameter_mm = 0.33
density_kg_m3 = 7850
youngs_modulus_gpa = 200
[obstacle]
kind = "bridge"
distance_mm = 6
[pluck]
displacement_mm = 2
"""


def test_the_shortest_preset() -> None:
    preset = parse_preset(GOOD, "mine.toml")
    x = play(prepared(preset), [(0, NOTE_ON, 0, 48, 100)], 0.2)
    assert np.abs(x).max() > 0.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("format = 2\n", "", r"format: missing"),
        ("format = 2", "format = 3", r"format: 3 is newer than what this program reads, which is 1 to 2"),
        ("format = 2", "format = 0", r"format: must be a whole number from 1 to 2, got 0"),
        ("format = 2", "format = true", r"format: must be a whole number from 1 to 2, got True"),
        ("format = 2", 'format = "2"', r"format: must be a whole number from 1 to 2, got '2'"),
        ('"mine"', '"My Preset"', r"name: must be lower-case"),
        ('name = "mine"\n', "", r"name: missing"),
        ('"mine"', '"mine"\nfamily = "Bass guitar"', r"family: must be a word of lower-case .*got 'Bass guitar'"),
        ('"mine"', '"mine"\nfamily = 4', r"family: must be a word of lower-case .*got 4"),
        ('"mine"', '"mine"\ntags = "buzz"', r"tags: must be a list, got 'buzz'"),
        ('"mine"', '"mine"\ntags = ["buzz", "-"]', r"tags\.1: must be a word of lower-case .*got '-'"),
        ('"mine"', f'"mine"\ntags = ["{25 * "a"}"]', r"tags\.0: must be a word .*up to 24"),
        ('"mine"', '"mine"\ntags = ["buzz", "steel", "buzz"]', r"tags: has 'buzz' twice"),
        ('"mine"', f'"mine"\ntags = {[f"t{i}" for i in range(17)]}', r"tags: .*at most 16"),
        ('"C3"', '"H3"', r"string\.0\.notes: must be one note"),
        ('"C3"', '"C4-C3"', r"string\.0: notes must go from low to high, got C4-C3"),
        ('"C3"', "300", r"string\.0\.notes: .*between 0 and 127, got 300"),
        ('"C3"', "true", r"string\.0\.notes: must be one note"),
        ("0.9", "0", r"string\.0\.length_m: must lie between 0\.02 and 5, got 0"),
        ("0.9", '"long"', r"string\.0\.length_m: must be a number, .*got 'long'"),
        ("0.9", "true", r"string\.0\.length_m: must be a number, .*got True"),
        ("0.9", "nan", r"string\.0\.length_m: must be finite"),
        ("0.9", "{}", r"string\.0\.length_m: anchors need at least one note"),
        ("0.9", "{ X1 = 1.0 }", r"string\.0\.length_m: .*'X1'"),
        ("0.9", "{ C3 = [1] }", r"string\.0\.length_m: must be a number at every note, got \[1\]"),
        ("0.9", "{ C3 = 0.9, C4 = 50 }", r"string\.0\.length_m: must lie .* got 50"),
        ("density_kg_m3 = 7850\n", "", r"string\.0: give either linear_density_g_m or density_kg_m3"),
        ("diameter_mm", "linear_density_g_m = 1\ndiameter_mm", r"string\.0: give either linear_density_g_m"),
        ("youngs_modulus_gpa = 200", "inharmonicity = 1\n", r"string\.0\.inharmonicity: must lie between 0 and 0\.1"),
        ("diameter_mm", "core_diameter_mm = 0.2\ndiameter_mm", r"string\.0: a wound string has both"),
        ("diameter_mm", "thickness = 1\ndiameter_mm", r"string\.0\.thickness: no such key"),
        ("distance_mm = 6", "", r"obstacle: give either distance_mm or distance_ratio"),
        ("distance_mm = 6", "distance_ratio = 0.9", r"obstacle\.distance_ratio: .*less than or equal to 0\.2, got 0\.9"),
        ('"bridge"', '"frets"', r"obstacle\.count: missing"),
        ('"bridge"', '"floor"', r"obstacle: .*'bridge'"),
        ("displacement_mm = 2", "", r"pluck\.displacement_mm: missing"),
        ("displacement_mm = 2", "displacement_mm = 2\nwidth_mm = 0", r"pluck\.width_mm: .*greater than 0, got 0"),
        ("[pluck]", "[damping]\nrelease_s = -1\n[pluck]", r"damping\.release_s: must lie between 0\.01 and 60, got -1"),
        ("[pluck]", '[output]\nkind = "smell"\n[pluck]', r"output\.kind: .*'pickup', 'flux' or 'body', got 'smell'"),
        ("[pluck]", "[mapping]\npolyphony = 0\n[pluck]", r"mapping\.polyphony: .*got 0"),
        ("[pluck]", "[[nut]]\nfrequency_hz = 100\nq = 0\nmass_kg = 1\n[pluck]", r"nut\.0\.q: .*greater than 0, got 0"),
        ("[pluck]", "[tuning]\na4_hz = 40\n[pluck]", r"tuning\.a4_hz: .*got 40"),
        ("[pluck]", "[tuning]\ncontact_cents = 3\n[pluck]", r"tuning\.contact_cents: "),
        ("[pluck]", "[pluck", r"not valid TOML"),
        ("[pluck]", "x = " + 5000 * "[", r"not valid TOML"),
        ("[pluck]", "x = " + 5000 * "9", r"not valid TOML"),
    ],
)
def test_wrong_presets_name_table_and_key(old: str, new: str, message: str) -> None:
    assert GOOD.count(old) >= 1
    with pytest.raises(PresetError, match=r"^mine\.toml: " + message):
        parse_preset(GOOD.replace(old, new, 1), "mine.toml")


def test_a_preset_of_format_1() -> None:
    assert parse_preset(GOOD.replace("format = 2", "format = 1"), "mine.toml") == parse_preset(GOOD, "mine.toml")


def test_every_older_format_has_a_way_to_todays() -> None:
    assert sorted(MIGRATIONS) == list(range(1, FORMAT))
    data = {"format": 1, "name": "mine"}
    assert migrate(data, "mine.toml") == [words for words, _ in MIGRATIONS.values()]
    assert data == {"format": FORMAT, "name": "mine"}
    assert migrate(data, "mine.toml") == []


def test_problems_by_field() -> None:
    with pytest.raises(PresetError) as error:
        parse_preset(GOOD.replace("0.9", "-1").replace('"mine"', '"Mine"'), "mine.toml")
    assert dict(error.value.problems).keys() == {"name", "string.0.length_m"}


def test_all_errors_at_once() -> None:
    text = GOOD.replace("0.9", "-1").replace('"mine"', '"Mine"').replace("distance_mm = 6", "distance_mm = 900")
    text = text.replace("displacement_mm = 2", "displacement_mm = 200\nposition = 1.5\ncolour = 3").replace('"C3"', '"Q"')
    with pytest.raises(PresetError) as error:
        parse_preset(text + "[extra]\n", "mine.toml")
    lines = str(error.value).splitlines()
    places = sorted(line.split(": ")[1] for line in lines)
    assert places == [
        "extra", "name", "obstacle.distance_mm", "pluck.colour", "pluck.displacement_mm", "pluck.position",
        "string.0.length_m", "string.0.notes",
    ]  # fmt: skip


def test_a_preset_that_is_not_there() -> None:
    with pytest.raises(PresetError, match="'theremin' is not one of banjo, "):
        load_preset("theremin")
    with pytest.raises(PresetError, match=r"nowhere\.toml does not exist"):
        load_preset("nowhere.toml")
