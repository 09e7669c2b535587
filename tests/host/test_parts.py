"""Which preset plays which channel."""

import math

import pytest

from synth.engine.events import CONTROL, N_PARAMETERS, NOTE_ON, PARAMETER, TUNING, make_events
from synth.host.parts import cast, parse_channel_map, played_events


def test_by_default_basses_are_basses_and_percussion_is_left_out() -> None:
    casting = cast({(0, 0): 5, (1, 32): 1, (1, 39): 2, (1, 40): 4, (9, 0): 7})
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
    casting = cast({(0, 0): 1, (0, 33): 1, (9, 0): 1}, "tanpura")
    assert [part.label for part in casting.parts] == ["ch01-tanpura"]
    assert casting.parts[0].notes == 2
    assert casting.left_out == {9: 1}


def test_the_map_goes_before_all_else() -> None:
    by_channel = parse_channel_map(["1=none, 10=my/own.toml", "3=tanpura"])
    assert by_channel == {0: "none", 9: "my/own.toml", 2: "tanpura"}
    casting = cast({(0, 0): 1, (2, 33): 1, (9, 0): 2, (4, 0): 1}, "fretted-bass", by_channel)
    assert [part.label for part in casting.parts] == ["ch03-tanpura", "ch05-fretted-bass", "ch10-own"]
    assert casting.left_out == {0: 1}


@pytest.mark.parametrize("text", ["tanpura", "1=", "=tanpura", "one=tanpura", "0=tanpura", "17=x", "1=a,,2=b", "-1=a"])
def test_maps_that_are_none(text: str) -> None:
    with pytest.raises(ValueError, match="--map"):
        parse_channel_map([text])


def test_parameters_of_a_file_that_are_not_there_are_not_played() -> None:
    casting = cast({(0, 0): 1, (2, 33): 1}, "tanpura", {2: "none"})
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
    assert played_events(make_events(rows), casting)["kind"].tolist() == [NOTE_ON, PARAMETER, TUNING]
