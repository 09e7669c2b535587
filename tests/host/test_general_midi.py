"""The table of General MIDI: every program has an answer that can play."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from synth.host.compass import fold, playable
from synth.host.general_midi import ANSWERS, BASS, HARP, answer
from synth.host.parts import Choice, Part, cast, cast_live, headroom_db
from synth.host.render import RenderSettings
from synth.instrument.articulations import Articulation, Touch
from synth.instrument.preset import load_preset, preset_folder
from synth.live.take import TakeFile
from synth.midi.events import NOTE_ON, make_events
from synth.midi.programs import PROGRAMS
from synth.midi.song import read_song, song_of
from synth.units import note_to_midi


def programs(*names: str) -> list[int]:
    return [number for number, name in enumerate(PROGRAMS) if any(part in name for part in names)]


def test_every_program_has_an_answer_a_reason_and_a_last_resort() -> None:
    assert len(ANSWERS) == len(PROGRAMS) == 128
    for each in ANSWERS:
        assert each.presets[-1] in (HARP, BASS) and each.why
        assert load_preset(each.preset).name == each.preset
        assert len(set(each.presets)) == len(each.presets)


def test_the_table_names_nothing_that_is_not_there() -> None:
    there = {path.stem for path in preset_folder().glob("*.toml")}
    for each in ANSWERS:
        assert set(each.presets) <= there
        assert set(each.articulations) <= set(load_preset(each.preset).articulations), each.preset


def test_no_note_of_any_program_goes_unplayed() -> None:
    for name in {each.preset for each in ANSWERS}:
        notes = playable(load_preset(name))
        assert all(fold(note, notes) is not None for note in range(128)), name


def test_what_a_preset_can_be_and_what_stands_in() -> None:
    strings = programs("Piano", "Harpsichord", "Clavi", "Dulcimer", "Guitar", "Bass", "Pizzicato", "Harp", "Sitar", "Banjo")
    strings += programs("Shamisen", "Koto")
    not_strings = programs("Electric Piano", "Synth Bass", "bass + lead", "Bassoon", "Harmonica", "Fret Noise")
    assert {number for number, each in enumerate(ANSWERS) if each.string} == set(strings) - set(not_strings)


@pytest.mark.parametrize(
    ("names", "low", "high"),
    [
        (["Acoustic Bass", "Electric Bass", "Fretless Bass", "Slap Bass", "Synth Bass"], "E1", "D#4"),
        (["Guitar (", "Overdriven", "Distortion", "Guitar Harmonics"], "E2", "E5"),
        (["Harpsichord", "Clavi", "Grand Piano"], "F1", "E6"),
        (["Orchestral Harp", "Pizzicato"], "E1", "C7"),
        (["Sitar", "Shamisen", "Koto", "Banjo"], "D3", "A5"),
    ],
)
def test_the_usual_compass_of_what_it_answers(names: list[str], low: str, high: str) -> None:
    for number in programs(*names):
        notes = playable(load_preset(answer(number).preset))
        usual = range(note_to_midi(low), note_to_midi(high) + 1)
        missing = [note for note in usual if note not in notes]
        assert len(missing) <= 0.25 * len(usual), (PROGRAMS[number], answer(number).preset)


def test_the_nearest_that_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    assert answer(35).preset == "fretless-bass" and answer(32).preset == "double-bass"
    monkeypatch.setattr("synth.host.general_midi._there", lambda: frozenset({HARP, BASS, "veena", "koto"}))
    assert [answer(number).preset for number in (104, 107, 105, 36)] == ["veena", "koto", HARP, BASS]


def test_a_song_is_cast_by_the_table_and_live_by_two() -> None:
    channels = {(0, 25): 5, (1, 35): 1, (2, 25): 2, (9, 0): 7}
    casting = cast(channels, Choice())
    assert [(part.channel, part.preset, part.by_program) for part in casting.parts] == [
        (0, answer(25).preset, True),
        (1, "fretless-bass", True),
        (2, answer(25).preset, True),
    ]
    assert casting.left_out == {9: 7} and not casting.skipped
    mapped = cast(channels, Choice(by_channel={1: "tanpura-light"}, only_strings=True))
    assert [(part.preset, part.by_program) for part in mapped.parts][1] == ("tanpura-light", False)
    whole = cast_live(Choice())
    assert {part.preset for part in whole.parts} == {each.preset for each in ANSWERS}
    assert (np.delete(whole.program_map, 9, axis=0) >= 0).all()
    assert [whole.parts[part].preset for part in whole.program_map[3]] == [each.preset for each in ANSWERS]
    assert len(cast_live(Choice(gm=False)).parts) == 2


def test_only_strings_skips_what_programs_chose_and_not_what_the_user_did() -> None:
    channels = {(0, 73): 5, (0, 46): 1, (1, 73): 2, (2, 48): 3}
    casting = cast(channels, Choice(by_channel={1: "tanpura-light"}, only_strings=True))
    assert casting.skipped == {(0, 73): 5, (2, 48): 3} and casting.left_out == {}
    assert [(part.channel, part.notes) for part in casting.parts] == [(0, 1), (1, 2)]
    assert not cast(channels, Choice("tanpura-light", only_strings=True)).skipped
    live = cast_live(Choice(gm=False, only_strings=True))
    assert live.program_map[0, [46, 73, 38]].tolist() == [0, -1, -1] and live.program_map[0, 33] >= 0


def test_programs_of_one_preset_that_are_played_otherwise_are_parts_of_their_own() -> None:
    casting = cast({(0, 26): 1, (0, 28): 2, (0, 31): 3}, Choice())
    assert [part.articulations for part in casting.parts[-2:]] == [("palm-mute",), ("harmonic",)]
    assert len({part.label for part in casting.parts}) == 3
    assert casting.parts[-2].label.endswith("-palm-mute")
    assert casting.program_map[0, [28, 31]].tolist() == [len(casting.parts) - 2, len(casting.parts) - 1]
    assert all(not part.articulations for part in cast({(0, 28): 1}, Choice("tanpura-light")).parts)


def test_a_part_plays_the_first_of_its_articulations_that_the_preset_has() -> None:
    mute = Articulation(key=20, touch=Touch(place=0.05, resistance=1.0))
    tables = {"normal": Articulation(key=19, strum_ms=10.0), "palm-mute": mute}
    preset = load_preset("fretted-bass").model_copy(update={"articulations": tables})
    part = Part(0, "fretted-bass", 1, articulations=("slap", "palm-mute"))
    alone = replace(part, switching=False).played(preset).articulations
    assert alone["normal"] == alone["palm-mute"] == Articulation(touch=mute.touch)
    played = part.played(preset).articulations
    assert played["normal"] == Articulation(key=19, touch=mute.touch) and played["palm-mute"] == mute
    assert Part(0, "fretted-bass", 1, articulations=("slap",)).played(preset) is preset
    assert Part(0, "fretted-bass", 1).played(preset) is preset


def test_velocities_still_choose_where_keys_do_not() -> None:
    layers = {"normal": Articulation(key=19), "pop": Articulation(key=20, controller=80, velocity=(110, 127))}
    preset = load_preset("fretted-bass").model_copy(update={"articulations": layers})
    plain = Part(0, "fretted-bass", 1, switching=False).played(preset).articulations
    assert plain == {"normal": Articulation(), "pop": Articulation(velocity=(110, 127))}
    chosen = Part(0, "fretted-bass", 1, articulations=("pop",)).played(preset).articulations
    assert chosen["normal"] == Articulation(key=19) and chosen["pop"].velocity is None and chosen["pop"].key == 20


def test_a_song_is_lowered_by_what_its_channels_are_louder_together() -> None:
    song = song_of(make_events([]), 44100, 1.0)
    for channels, expected in ((1, 0.0), (2, 3.0), (8, 9.0), (16, 12.0)):
        casting = cast({(channel, 0): 1 for channel in range(channels)}, Choice("tanpura-light", {9: "tanpura-light"}))
        assert headroom_db(song, casting) == expected
        assert headroom_db(replace(song, take=True, headroom_db=4.5), casting) == 4.5
    assert headroom_db(song, cast({(9, 0): 3}, Choice())) == 0.0
    two_programs = cast({(0, 0): 1, (0, 33): 1}, Choice())
    assert len(two_programs.parts) == 2 and headroom_db(song, two_programs) == 0.0


@pytest.mark.parametrize(("gm", "headroom"), [(False, 0.0), (True, 0.0), (True, 7.8)])
def test_a_take_says_who_chose_and_how_far_its_song_was_lowered(tmp_path: Path, gm: bool, headroom: float) -> None:
    take = TakeFile(tmp_path / "take.mid", 44100, gm, headroom)
    take.open()
    take.append(make_events([(0, NOTE_ON, 0, 60, 90)]))
    take.close(100)
    song = read_song(tmp_path / "take.mid", 44100)
    assert (song.take, song.gm, song.headroom_db) == (True, gm, headroom)
    wishes = RenderSettings("take.mid", None).wishes(song)
    assert not wishes.fold and not wishes.fold_programs
    assert RenderSettings("take.mid", None).choice(song).gm == gm
    assert RenderSettings("take.mid", None, gm=True).choice(song).gm


@pytest.mark.parametrize("gm", [False, True])
def test_a_take_says_whether_keys_switched(tmp_path: Path, gm: bool) -> None:
    for switching in (True, False):
        take = TakeFile(tmp_path / "take.mid", 44100, gm, 3.0, switching)
        take.open()
        take.append(make_events([(7, NOTE_ON, 0, 60, 90)]))
        take.close(100)
        song = read_song(tmp_path / "take.mid", 44100)
        assert (song.take, song.gm, song.switching) == (True, gm, switching)
        assert song.events["frame"].tolist()[0] == 7 and not song.warnings
        assert RenderSettings("take.mid", None).choice(song).switching is switching
    assert not song_of(make_events([]), 44100, 1.0).switching


def test_live_a_part_that_keys_do_not_switch_is_not_shared_with_one_that_they_do() -> None:
    choice = Choice(by_channel={0: "electric-guitar"})
    program = next(n for n in range(128) if answer(n).preset == "electric-guitar" and not answer(n).articulations)
    made = cast_live(choice, song=cast({(0, 0): 1}, choice))
    mine, chosen = (made.parts[made.program_map[channel, program]] for channel in (0, 3))
    assert mine.switching and not chosen.switching and mine.preset == chosen.preset


def test_in_a_song_low_notes_switch_nothing_of_what_a_program_chose() -> None:
    casting = cast({(0, 0): 1, (1, 0): 1}, Choice(by_channel={1: "tanpura-light"}))
    assert [part.switching for part in casting.parts] == [False, True]
    assert all(part.switching for part in cast({(0, 0): 1}, Choice(switching=True)).parts)
    song = song_of(make_events([]), 44100, 1.0)
    wanted = RenderSettings("song.mid", None)
    assert not wanted.choice(song).switching and wanted.choice(replace(song, take=True)).switching
