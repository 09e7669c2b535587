"""Notes that are transposed, folded and given to another preset, and what is said of those that no string plays."""

import numpy as np
import pytest

from synth.host.compass import (
    Arrangement,
    Wishes,
    arrange,
    channel_line,
    channel_rows,
    fold,
    keys_of_parts,
    parse_transpose,
    skipped_line,
    stand_in_line,
    stand_ins,
    switches,
    unplayed_notes,
)
from synth.host.parts import Choice, cast, played_events
from synth.instrument.preset import load_preset, parse_preset, preset_text, read_preset_bytes
from synth.instrument.ways import switch_keys
from synth.midi.events import CONTROL, KEY_PRESSURE, NOTE_OFF, NOTE_ON, PROGRAM, make_events
from synth.midi.song import song_of

PRESETS = {name: load_preset(name) for name in ("tanpura-light", "jawari-harp", "fretted-bass")}
ALL = slice(0, 1 << 60)


def arranged(rows: list[tuple], wishes: Wishes, preset: str = "tanpura-light") -> Arrangement:
    song = song_of(make_events(rows), 44100, 10.0)
    return arrange(song, song.events, cast(song.channels, Choice(preset)), PRESETS, wishes)


def plain(arrangement: Arrangement) -> list[tuple[int, int, int, int]]:
    return [tuple(row)[:4] for row in arrangement.events.tolist()]


def test_without_wishes_the_events_are_the_songs_own() -> None:
    song = song_of(make_events([(0, NOTE_ON, 0, 48, 90), (9, NOTE_OFF, 0, 48, 64)]), 44100, 1.0)
    assert arrange(song, song.events, cast(song.channels, Choice("tanpura-light")), PRESETS, Wishes()).events is song.events


def test_transposing_takes_ends_and_pressure_along_and_nothing_else() -> None:
    rows = [(0, NOTE_ON, 0, 60, 90), (1, CONTROL, 0, 60, 5), (2, KEY_PRESSURE, 0, 60, 9), (3, NOTE_OFF, 0, 60, 64)]
    rows += [(4, NOTE_ON, 1, 60, 90), (5, NOTE_ON, 1, 60, 0)]
    found = plain(arranged(rows, Wishes({None: -12, 1: 7}), "jawari-harp"))
    assert found == [
        (0, NOTE_ON, 0, 48), (1, CONTROL, 0, 60), (2, KEY_PRESSURE, 0, 48), (3, NOTE_OFF, 0, 48),
        (4, NOTE_ON, 1, 67), (5, NOTE_ON, 1, 67),
    ]  # fmt: skip


def test_folding_goes_to_the_nearest_octave_that_has_a_string() -> None:
    can = frozenset((36, 43, 48))
    assert [fold(note, can) for note in (72, 60, 24, 31, 36, 42, 50)] == [48, 48, 36, 43, 36, None, None]
    found = arranged([(0, NOTE_ON, 0, 72, 90), (1, NOTE_ON, 0, 74, 90), (2, NOTE_OFF, 0, 72, 64)], Wishes(fold=True))
    assert plain(found) == [(0, NOTE_ON, 0, 48), (1, NOTE_ON, 0, 74), (2, NOTE_OFF, 0, 48)]
    assert keys_of_parts(found, 100) == [{48, 74}]


def test_two_keys_on_one_string_let_go_with_the_second() -> None:
    rows = [(0, NOTE_ON, 0, 72, 90), (1, NOTE_ON, 0, 60, 90), (2, NOTE_OFF, 0, 72, 64), (3, NOTE_OFF, 0, 60, 64)]
    assert plain(arranged(rows, Wishes(fold=True))) == [(0, NOTE_ON, 0, 48), (1, NOTE_ON, 0, 48), (3, NOTE_OFF, 0, 48)]


def test_the_fallback_plays_what_is_left_on_a_program_of_its_own() -> None:
    rows = [(0, PROGRAM, 2, 104, 0), (0, NOTE_ON, 2, 48, 90), (1, NOTE_ON, 2, 50, 90), (2, NOTE_OFF, 2, 50, 64)]
    found = arranged(rows, Wishes(fallback="jawari-harp"))
    assert [(part.channel, part.preset, part.notes) for part in found.casting.parts] == [
        (2, "tanpura-light", 1), (2, "jawari-harp", 1),
    ]  # fmt: skip
    assert not found.events["value"].any()
    spare = int(found.events["a"][found.events["kind"] == PROGRAM][1])
    assert found.casting.program_map[2, [104, spare]].tolist() == [0, 1]
    assert plain(found) == [
        (0, PROGRAM, 2, 104), (0, NOTE_ON, 2, 48),
        (1, PROGRAM, 2, spare), (1, NOTE_ON, 2, 50), (1, PROGRAM, 2, 104), (2, NOTE_OFF, 2, 50),
    ]  # fmt: skip
    assert keys_of_parts(found, 100) == [{48}, {50}]
    assert not any(row["unplayed"] for row in channel_rows(found, PRESETS, ALL))


def test_a_channel_begins_with_its_own_preset_still() -> None:
    """Without a program change a channel begins with the lowest program that has a part: not the fallback's."""
    found = arranged([(0, NOTE_ON, 0, 48, 90), (1, NOTE_ON, 0, 50, 90)], Wishes(fallback="jawari-harp"))
    assert (found.casting.program_map[0] >= 0).argmax() == 0


def test_one_line_a_channel_says_who_plays_and_what_helps() -> None:
    rows = [(n, NOTE_ON, 0, 60 + n % 3, 90) for n in range(30)] + [(40, NOTE_ON, 1, 48, 90)]
    told = [channel_line(row) for row in channel_rows(arranged(rows, Wishes()), PRESETS, ALL, "jawari-harp")]
    assert told == [
        "channel 1 (Acoustic Grand Piano) → tanpura-light: 30 of 30 notes not played, C4 to D4: "
        "--transpose 1=-12 plays 10; --fold plays 10; --fallback jawari-harp plays them all",
        "channel 2 (Acoustic Grand Piano) → tanpura-light: 1 note, C3",
    ]
    remedied = arranged(rows, Wishes({0: -12}, fallback="jawari-harp"))
    assert not any(row["unplayed"] for row in channel_rows(remedied, PRESETS, ALL))


def test_notes_beyond_all_keys_are_counted_too() -> None:
    found = arranged([(0, NOTE_ON, 0, 120, 90)], Wishes({None: 12}), "jawari-harp")
    assert [row["unplayed"] for row in channel_rows(found, PRESETS, ALL)] == [1]


def test_what_no_string_plays_by_part_and_note() -> None:
    rows = [(5, NOTE_ON, 0, 50, 90), (6, NOTE_ON, 0, 48, 90), (7, NOTE_ON, 0, 50, 90), (8, NOTE_ON, 0, 49, 90)]
    found = arranged([*rows, (9, NOTE_ON, 3, 51, 90)], Wishes())
    told = unplayed_notes(found, PRESETS, ALL)
    assert [(row["part"], row["note"], row["count"]) for row in told] == [
        ("ch01-tanpura-light", "C#3", 1), ("ch01-tanpura-light", "D3", 2), ("ch04-tanpura-light", "D#3", 1),
    ]  # fmt: skip
    assert all(row["reason"] for row in told)
    # from the first frame on, and before the last
    assert [(row["note"], row["count"]) for row in unplayed_notes(found, PRESETS, slice(7, 8))] == [("D3", 1)]
    assert [row["notes"] for row in channel_rows(found, PRESETS, slice(5, 7))] == [2]
    assert keys_of_parts(found, 8) == [{48, 50}, set()]


def test_a_row_in_words() -> None:
    row = {
        "channel": 3,
        "names": ["A", "B", "C"],
        "preset": "my\\dir/own",
        "notes": 1,
        "unplayed": 0,
        "low": "C4",
        "high": "C4",
        "folded": 0,
    }
    assert channel_line(row) == "channel 3 (A, B, C) → own: 1 note, C4"
    row |= {"names": ["A", "B", "C", "D", "E"], "notes": 5, "high": "D4"}
    assert channel_line(row) == "channel 3 (A, B, C and 2 more) → own: 5 notes, C4 to D4"
    row |= {"unplayed": 2, "unplayed_low": "C4", "unplayed_high": "C4", "remedies": {}}
    assert (
        channel_line(row)
        == "channel 3 (A, B, C and 2 more) → own: 2 of 5 notes not played, C4: choose another preset with --map"
    )


def test_of_transpositions_that_help_alike_the_nearest_is_offered() -> None:
    """48 and 36 are strings of the tanpura: 60 gets there an octave down or two; the row says how many notes are gained."""
    rows = [(0, NOTE_ON, 0, 60, 90), (1, NOTE_ON, 0, 60, 90), (2, NOTE_ON, 0, 48, 90)]
    (row,) = channel_rows(arranged(rows, Wishes()), PRESETS, ALL, "fretted-bass")
    assert (row["low"], row["high"], row["unplayed"], row["unplayed_low"], row["unplayed_high"]) == (
        "C3",
        "C4",
        2,
        "C4",
        "C4",
    )
    # an octave down all three are strings
    assert row["remedies"] == {"--transpose 1=-12": 2, "--fold": 2, "--fallback fretted-bass": 2}
    assert arranged(rows, Wishes()).casting.parts[0].notes == 3
    (still,) = channel_rows(arranged(rows[:2], Wishes({None: -24})), PRESETS, ALL, "tanpura-light")
    assert still["remedies"] == {} and still["unplayed"] == 0


def test_a_second_press_of_a_key_is_ended_second() -> None:
    """Ends go to the notes in the order of their beginnings; what is held twice sounds until it is let go twice."""
    rows = [(0, NOTE_ON, 0, 60, 90), (1, NOTE_ON, 0, 60, 90), (2, NOTE_OFF, 0, 60, 64), (3, NOTE_OFF, 0, 60, 64)]
    rows += [(4, NOTE_OFF, 0, 60, 64), (5, KEY_PRESSURE, 1, 70, 9)]
    found = plain(arranged(rows, Wishes({None: -12})))
    # an end without a beginning stays where it is, and so does pressure on a key that was never pressed
    assert [(frame, a) for frame, _, _, a in found] == [(0, 48), (1, 48), (2, 48), (3, 48), (4, 60), (5, 70)]


def test_every_note_of_a_thicket_moves_alike() -> None:
    rows = [(n, NOTE_ON if n % 2 else NOTE_OFF, n % 8, 40 + n % 50, 90) for n in range(3000)]
    song = song_of(make_events(rows), 44100, 1.0)
    both = arrange(song, song.events, cast(song.channels, Choice("jawari-harp")), PRESETS, Wishes({None: 2}))
    assert np.array_equal(both.events["a"][both.part >= 0], song.events["a"][song.players >= 0] + 2)


@pytest.mark.parametrize(
    ("text", "found"), [("-12", {None: -12}), ("-12,3=7, 1=0", {None: -12, 2: 7, 0: 0}), ("1=-96,16=96", {0: -96, 15: 96})]
)
def test_transpositions(text: str, found: dict) -> None:
    assert parse_transpose([text]) == found


@pytest.mark.parametrize("text", ["x", "1=", "=3", "0=1", "17=1", "1.5", "97", "1=-97", ""])
def test_transpositions_that_are_none(text: str) -> None:
    with pytest.raises(ValueError, match="--transpose"):
        parse_transpose([text])


def gm(rows: list[tuple], wishes: Wishes, **choice: bool) -> Arrangement:
    """As `arranged`, by the programs' own choice of two presets."""
    song = song_of(make_events(rows), 44100, 10.0)
    casting = cast(song.channels, Choice(gm=False, **choice))
    played = song.events[played_events(song.events, song.players, casting)]
    return arrange(song, played, casting, PRESETS, wishes)


def test_what_a_program_chose_is_folded_and_counted() -> None:
    rows = [(0, PROGRAM, 0, 33, 0), (1, NOTE_ON, 0, 24, 90), (2, NOTE_ON, 0, 40, 90), (3, NOTE_OFF, 0, 24, 64)]
    found = gm(rows, Wishes(fold_programs=True))
    assert [a for _, kind, _, a in plain(found) if kind != PROGRAM] == [36, 40, 36]
    assert found.folded.tolist() == [False, True, False, False]
    (row,) = channel_rows(found, PRESETS, ALL)
    assert (row["unplayed"], row["folded"]) == (0, 1)
    assert channel_line(row) == (
        "channel 1 (Electric Bass (finger)) → fretted-bass: 2 notes, C2 to E2, 1 of them octaves away"
    )
    # what the user chose is not, and where every note has a string the events are the song's own
    assert plain(arranged(rows, Wishes(fold_programs=True), "fretted-bass"))[1] == (1, NOTE_ON, 0, 24)
    assert not gm(rows[:1] + rows[2:3], Wishes(fold_programs=True)).folded.any()


def test_what_is_no_string_is_told_with_its_stand_in() -> None:
    rows = [(0, PROGRAM, 0, 73, 0), (1, NOTE_ON, 0, 60, 90), (1, NOTE_ON, 1, 60, 90), (1, PROGRAM, 2, 38, 0)]
    rows += [(2, NOTE_ON, 2, 40, 90), (2, PROGRAM, 0, 19, 0), (3, NOTE_ON, 0, 62, 90), (9, NOTE_ON, 0, 64, 90)]
    told = stand_ins(gm(rows, Wishes()), slice(0, 9))
    assert told == [
        {"preset": "jawari-harp", "names": ["Church Organ", "Flute"], "notes": 2},
        {"preset": "fretted-bass", "names": ["Synth Bass 1"], "notes": 1},
    ]
    line = "jawari-harp plays Church Organ, Flute (2 notes); fretted-bass plays Synth Bass 1 (1 note)"
    assert stand_in_line(told) == f"no plucked or struck strings: {line}; --only-strings leaves them out"
    assert stand_ins(arranged(rows, Wishes(), "jawari-harp"), ALL) == []


def test_only_strings_leaves_out_the_notes_of_others_and_nothing_else() -> None:
    rows = [(0, CONTROL, 0, 7, 90), (0, PROGRAM, 0, 73, 0), (1, NOTE_ON, 0, 60, 90), (2, NOTE_OFF, 0, 60, 64)]
    rows += [(3, PROGRAM, 0, 46, 0), (4, NOTE_ON, 0, 62, 90), (5, NOTE_ON, 1, 64, 90)]
    found = gm(rows, Wishes(), only_strings=True)
    assert [a for _, kind, _, a in plain(found) if kind == NOTE_ON] == [62, 64]
    assert len(found.events) == len(rows) - 1 and found.casting.skipped == {(0, 73): 1}
    assert skipped_line([{"channel": 1, "name": "Flute", "notes": 1}]) == (
        "no plucked or struck strings, left out: channel 1 (Flute, 1 note)"
    )


def test_keys_that_switch_are_no_notes() -> None:
    bass = PRESETS["fretted-bass"]
    switched = parse_preset(
        preset_text(read_preset_bytes("fretted-bass"), "fretted-bass").split("[articulations")[0]
        + '[articulations.normal]\nkey = "C0"\n'
        + '[articulations.mute]\nkey = "D0"\ntouch = { place = 0.1, resistance = 1.0 }\n',
        "switched",
    )
    presets = {**PRESETS, "switched": switched}
    song = song_of(make_events([(0, NOTE_ON, 0, key, 90) for key in (14, 15, 40)]), 44100, 1.0)
    casting = cast(song.channels, Choice("switched"))
    found = arrange(song, song.events, casting, presets, Wishes({None: 12}, fold=True))
    assert [row[3] for row in plain(found)] == [14, 39, 52]  # 15 + 12 is folded up by an octave, 14 stays
    untouched = arrange(song, song.events, casting, presets, Wishes())
    assert [row["note"] for row in unplayed_notes(untouched, presets, ALL)] == ["D#0"]
    (row,) = channel_rows(untouched, presets, ALL)
    assert (row["notes"], row["unplayed"], row["low"]) == (2, 1, "D#0")
    assert untouched.note.tolist() == [False, True, True] and found.note.tolist() == [False, True, True]
    assert switches(switched) == {12, 14} and switches(bass) == {
        each.key for each in bass.articulations.values() if each.key is not None
    }


def guitar(rows: list[tuple], wishes: Wishes) -> Arrangement:
    presets = {**PRESETS, "electric-guitar": load_preset("electric-guitar")}
    song = song_of(make_events(rows), 44100, 1.0)
    return arrange(song, song.events, cast(song.channels, Choice("electric-guitar")), presets, wishes)


def test_a_note_that_is_transposed_onto_a_key_that_switches_is_not_played_and_counted() -> None:
    presets = {**PRESETS, "electric-guitar": load_preset("electric-guitar")}
    assert switch_keys(presets["electric-guitar"])[26] == "palm-mute"
    rows = [(0, NOTE_ON, 0, 50, 90), (1, KEY_PRESSURE, 0, 50, 9), (2, NOTE_OFF, 0, 50, 64), (3, NOTE_ON, 0, 64, 90)]
    found = guitar([*rows, (4, NOTE_ON, 0, 26, 90)], Wishes({None: -24}))
    # 50 comes to lie on 26 and strikes nothing there; 26 itself is no note and switches
    assert [tuple(row)[:5] for row in found.events.tolist() if row[1] == NOTE_ON] == [
        (0, NOTE_ON, 0, 26, 0), (3, NOTE_ON, 0, 40, 90), (4, NOTE_ON, 0, 26, 90),
    ]  # fmt: skip
    (row,) = channel_rows(found, presets, ALL)
    assert (row["notes"], row["unplayed"], row["unplayed_low"], row["folded"]) == (2, 1, "D1", 0)
    assert [(each["note"], each["count"]) for each in unplayed_notes(found, presets, ALL)] == [("D1", 1)]
    assert found.casting.parts[0].notes == 2
    folded = guitar(rows, Wishes({None: -24}, fold=True))
    assert [a for _, kind, _, a in plain(folded) if kind == NOTE_ON] == [50, 40] and folded.folded.tolist()[0]
    assert switch_keys(presets["electric-guitar"])[35] == "neck"
    rescued = guitar([(0, NOTE_ON, 0, 47, 90)], Wishes({None: -12}, fallback="jawari-harp"))
    assert [(row["preset"], row["unplayed"]) for row in channel_rows(rescued, presets, ALL)] == [("jawari-harp", 0)]
    assert [tuple(row)[3:5] for row in rescued.events.tolist() if row[1] == NOTE_ON] == [(35, 90)]
