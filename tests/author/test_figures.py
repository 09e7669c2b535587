"""The figure of the page suits the instrument: by its family, in its compass, on the keys that sound as written."""

import itertools

import pytest

from synth.author.phrases import phrase
from synth.instrument.preset import list_presets, load_preset, playable_notes
from synth.midi.events import NOTE_ON

BASS_LINE = (0, 0, 12, 0, 10, 7, 0, 3, 0, 0, 12, 0, 7, 10, 12, 0)
HIRAJOSHI = {0, 2, 3, 7, 8}


def keys(name: str, note: int) -> list[int]:
    events = phrase("riff", load_preset(name), note, 90, 44100).events
    return [int(row["a"]) for row in events if row["kind"] == NOTE_ON]


def test_only_a_bass_plays_the_bass_line() -> None:
    for preset in list_presets():
        there = playable_notes(preset)
        note = there[len(there) // 3]
        played = keys(preset.name, note)
        assert set(played) <= set(there)
        assert (tuple(key - played[0] for key in played) == BASS_LINE) == (preset.family == "bass"), preset.name


@pytest.mark.parametrize(("name", "note"), [("sitar", 61), ("veena", 52), ("sitar-gandhar", 62)])
def test_an_alap_is_slow_and_goes_by_steps_round_its_tonic(name: str, note: int) -> None:
    events = phrase("riff", load_preset(name), note, 90, 44100).events
    begins = [int(row["frame"]) for row in events if row["kind"] == NOTE_ON]
    played = keys(name, note)
    assert played[0] == played[-1] == note
    assert all(abs(a - b) <= 4 for a, b in itertools.pairwise(played))
    assert max(b - a for a, b in itertools.pairwise(begins)) >= 44100


def test_keys_that_stand_for_another_pitch_are_left_out() -> None:
    """The sitar's keys A#1, B1 and C2 strike its chikari, whose pitches lie two octaves higher."""
    for note in (34, 35, 36, 37, 78):
        assert not {34, 35, 36} & set(keys("sitar", note))


@pytest.mark.parametrize(("name", "note"), [("koto", 60), ("koto-hirajoshi", 62), ("shamisen", 60)])
def test_a_koto_and_a_shamisen_play_in_hirajoshi(name: str, note: int) -> None:
    played = keys(name, note)
    if name != "koto-hirajoshi":  # whose strings are tuned to five notes of an octave
        assert {(key - played[-1]) % 12 for key in played} == HIRAJOSHI
    assert len(set(played)) > 4
