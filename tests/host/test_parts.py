"""Which preset plays which channel."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from synth.host.parts import (
    Choice,
    cast,
    cast_live,
    files_read,
    load_presets,
    parse_channel_map,
    played_events,
    unplayed_rows,
)
from synth.instrument.preset import load_preset, preset_folder
from synth.midi.events import CONTROL, N_PARAMETERS, NOTE_ON, PARAMETER, TUNING, make_events
from synth.midi.song import players


def test_by_default_basses_are_basses_and_percussion_is_left_out() -> None:
    casting = cast({(0, 0): 5, (1, 32): 1, (1, 39): 2, (1, 40): 4, (9, 0): 7}, Choice(gm=False))
    assert [(part.label, part.notes) for part in casting.parts] == [
        ("ch01-jawari-harp", 5),
        ("ch02-fretted-bass", 3),
        ("ch02-jawari-harp", 4),
    ]
    assert casting.left_out == {9: 7}
    assert casting.program_map[0, 0] == 0
    assert casting.program_map[1, [32, 39, 40]].tolist() == [1, 1, 2]
    assert (casting.program_map >= 0).sum() == 4


def test_a_preset_for_all_leaves_percussion_out_still() -> None:
    casting = cast({(0, 0): 1, (0, 33): 1, (9, 0): 1}, Choice("tanpura-light"))
    assert [part.label for part in casting.parts] == ["ch01-tanpura-light"]
    assert casting.parts[0].notes == 2
    assert casting.left_out == {9: 1}


def test_the_map_goes_before_all_else() -> None:
    by_channel = parse_channel_map(["1=none, 10=my/own.toml", "3=tanpura-light"])
    assert by_channel == {0: "none", 9: "my/own.toml", 2: "tanpura-light"}
    casting = cast({(0, 0): 1, (2, 33): 1, (9, 0): 2, (4, 0): 1}, Choice("fretted-bass", by_channel))
    assert [part.label for part in casting.parts] == ["ch03-tanpura-light", "ch05-fretted-bass", "ch10-own"]
    assert casting.left_out == {0: 1}


@pytest.mark.parametrize("text", ["tanpura-light", "1=", "=tanpura", "one=tanpura", "0=tanpura", "17=x", "1=a,,2=b", "-1=a"])
def test_maps_that_are_none(text: str) -> None:
    with pytest.raises(ValueError, match="--map"):
        parse_channel_map([text])


def test_the_ends_of_the_channels() -> None:
    assert parse_channel_map(["1=a,16= b "]) == {0: "a", 15: "b"}
    for entry, number in (("0=a", 0), ("17=a", 17)):
        with pytest.raises(ValueError, match=f"--map channel must be 1 to 16, got {number}; correct '{entry}'"):
            parse_channel_map([entry])
    with pytest.raises(ValueError, match="--map '2=' is not CHANNEL=PRESET"):
        parse_channel_map(["1=a,2="])


def test_labels_are_channel_and_name() -> None:
    by_channel = {8: "my\\own.toml", 15: "a/b/c.toml"}
    labels = [part.label for part in cast({(8, 0): 1, (15, 0): 1}, Choice(None, by_channel)).parts]
    assert labels == ["ch09-own", "ch16-c"]


def test_live_every_channel_has_a_part_and_shares_it() -> None:
    casting = cast_live(Choice(gm=False))
    assert [(part.channel, part.preset, part.notes) for part in casting.parts] == [
        (0, "jawari-harp", 0),
        (0, "fretted-bass", 0),
    ]
    expected = np.zeros((16, 128), int)
    expected[:, 32:40] = 1
    expected[9] = -1
    assert np.array_equal(casting.program_map, expected) and casting.left_out == {}
    one = cast_live(Choice("tanpura-light"), only_channel=3)
    assert [(part.channel, part.preset) for part in one.parts] == [(3, "tanpura-light")]
    assert (one.program_map[3] == 0).all() and (np.delete(one.program_map, 3, axis=0) == -1).all()
    with pytest.raises(ValueError, match="no channel has a preset"):
        cast_live(Choice(by_channel={channel: "none" for channel in range(16)}))


def test_live_beside_a_song_its_parts_come_first() -> None:
    song = cast({(1, 0): 5, (2, 0): 4, (9, 0): 3}, Choice("tanpura-light", {2: "jawari-harp"}))
    casting = cast_live(Choice("jawari-harp", {1: "tanpura-light", 3: "tanpura-light"}), song=song)
    assert casting.parts == song.parts and casting.left_out == {9: 3}
    # of a song's channel the other programs go to a part of its own channel, of others to the first that fits
    assert [casting.program_map[channel, 7] for channel in (1, 2, 3, 4, 9)] == [0, 1, 0, 1, -1]
    both = cast({(1, 0): 5, (2, 0): 4}, Choice("tanpura-light"))
    assert cast_live(Choice("tanpura-light"), song=both).program_map[[0, 1, 2], 7].tolist() == [0, 0, 1]
    assert (song.program_map >= 0).sum() == 2  # the song's own is as it was


def test_rows_of_notes_that_found_no_string() -> None:
    found = [
        SimpleNamespace(part=1, note=60, times=2, reason="why"),
        SimpleNamespace(part=-1, note=21, times=1, reason="so"),
    ]
    assert unplayed_rows(found, ["a", "b"]) == [
        {"part": "b", "note": "C4", "count": 2, "reason": "why"},
        {"part": "no part", "note": "A0", "count": 1, "reason": "so"},
    ]
    found[1].part = 0
    assert [row["part"] for row in unplayed_rows(found, ["a", "b"])] == ["b", "a"]


def test_presets_are_set_by_name_or_all_together() -> None:
    names = ["tanpura-light", "jawari-harp", "tanpura-light"]
    loaded = load_presets(names, [(None, "pluck.position", "0.2"), ("tanpura-light", "pluck.position", "0.3")])
    assert list(loaded) == ["tanpura-light", "jawari-harp"]
    assert [preset.pluck.position for preset in loaded.values()] == [0.3, 0.2]
    with pytest.raises(
        ValueError, match=r"--set tampura:x: no part plays 'tampura'.*tanpura.*the parts play tanpura-light, jawari"
    ):
        load_presets(names, [("tampura", "x", "1")])
    with pytest.raises(ValueError, match="the parts play nothing"):
        load_presets([], [("tanpura-light", "x", "1")])
    own = load_preset("tanpura-light").with_setting("pluck.position", "0.4")
    assert load_presets(["mine"], [], {"mine": own}) == {"mine": own}


def test_what_was_changed_is_named_where_it_does_not_fit() -> None:
    settings = [("tanpura-light", "string.0.length_m", "0.02"), ("jawari-harp", "pluck.position", "0.2")]
    with pytest.raises(ValueError, match=r"^tanpura-light with string\.0\.length_m=0\.02: string\.0\.youngs_modulus_gpa: "):
        load_presets(["tanpura-light", "jawari-harp"], settings)


def test_files_that_are_read() -> None:
    read = files_read(["tanpura-light", None, "none", "nowhere.toml"], midi="a.mid", tuning=None)
    assert [(each.what, str(each.path)) for each in read] == [
        ("midi", "a.mid"),
        ("preset", str(preset_folder() / "tanpura-light.toml")),
    ]


def test_parameters_of_a_file_that_are_not_there_are_not_played() -> None:
    casting = cast({(0, 0): 1, (2, 33): 1}, Choice("tanpura-light", {2: "none"}))
    rows = [
        (0, NOTE_ON, 0, 60, 100, 0.0),
        (0, PARAMETER, 0, N_PARAMETERS - 1, 0, 1.0),
        (1, PARAMETER, 1, 0, 0, 1.0),
        (1, PARAMETER, 0, N_PARAMETERS, 0, 1.0),
        (2, PARAMETER, 0, 0, 0, math.nan),
        (2, PARAMETER, 0, 0, 0, -math.inf),
        (3, TUNING, 9, 60, 1, math.nan),
        (3, CONTROL, 2, 7, 100, 0.0),
    ]
    events = make_events(rows)
    played = played_events(events, players(events), casting)
    assert events["kind"][played].tolist() == [NOTE_ON, PARAMETER, TUNING]
