"""Which articulation a note has, where harmonics are touched, what waits, what is slurred: the policy without strings."""

from __future__ import annotations

import pytest

from synth.engine.layout import N_NOTES, NO_FINGER, WAIT
from synth.midi.events import NOTE_OFF, NOTE_ON, PROGRAM, TUNING
from synth.midi.zones import LOWER
from tests.engine.voicekit import Fake

#: E A D G with twelve frets
NECK = [list(range(low, low + 13)) for low in (28, 33, 38, 43)]
HARP = [[60], [61], [62], [63], [64]]
#: keys 10, 11, 12 switch; controller 20 rules the second while it is high, the third while it is low
SWITCHED = (
    {"key": 10},
    {"key": 11, "controller": 20, "low": 64, "high": 127},
    {"key": 12, "controller": 20, "low": 1, "high": 30, "soft": 120, "hard": 127},
)
HARMONIC = ({"key": 10}, {"key": 11, "harmonic": 1})
STRUMMED = ({"key": 10}, {"key": 11, "strum_s": 0.02})


def way(fake: Fake, note: int, velocity: int = 100, channel: int = 0) -> int:
    """The articulation that a note is played with, counted within its part."""
    voices = fake.me.voices
    ((_, k, _),) = [row for row in fake.on(note, channel, velocity) if row[0] == "pluck"]
    s = fake.me.positions["string"][k]
    return int(voices["articulation"][s] - fake.me.parts["first_articulation"][fake.me.strings["part"][s]])


def test_a_key_switches_until_another_does_and_is_no_note():
    fake = Fake(HARP, articulations=SWITCHED)
    assert way(fake, 60) == 0
    assert fake.on(11) == [] and fake.off(11) == []
    assert [way(fake, 61), way(fake, 62)] == [1, 1]
    assert fake.on(10) == []
    assert way(fake, 63) == 0
    assert fake.count(N_NOTES) == 4 and not fake.state.unplayed.any()


def test_another_program_and_reset_controllers_bring_the_normal_one_back():
    for back in (lambda fake: fake.send(PROGRAM, 0, 5), lambda fake: fake.control(121, 0)):
        fake = Fake(HARP, HARP, articulations=SWITCHED)
        fake.me.program_map[0, 5] = 1  # another part
        fake.on(11)
        fake.control(20, 10)
        assert way(fake, 60) == 2
        back(fake)
        assert way(fake, 61) == 0


def test_a_controller_rules_while_it_stands_in_a_range():
    fake = Fake(HARP, articulations=SWITCHED)
    fake.control(20, 64)
    assert way(fake, 60) == 1
    fake.control(20, 30)  # out of one range into another
    assert way(fake, 61) == 2
    fake.on(11)
    assert way(fake, 62) == 2  # it goes before the keys
    fake.control(20, 0)
    assert way(fake, 63) == 1
    fake.control(21, 100)
    assert way(fake, 64) == 1


def test_a_controller_that_sets_a_live_parameter_rules_nothing():
    fake = Fake(HARP, articulations=SWITCHED, bindings=[(20, 0, 1, 0.1, 0.5)])
    fake.control(20, 127)
    assert way(fake, 60) == 0


def test_velocities_choose_where_nothing_else_has():
    fake = Fake(HARP, articulations=SWITCHED)
    assert [way(fake, 60, 119), way(fake, 61, 120), way(fake, 62, 127)] == [0, 2, 2]
    fake.on(11)
    assert way(fake, 63, 127) == 1


def test_parts_count_their_own():
    fake = Fake(HARP, [[70], [71]], articulations=SWITCHED)
    fake.on(12, channel=1)
    assert way(fake, 70, channel=1) == 2 and fake.strings("articulation")[5] == 5
    assert way(fake, 60, channel=0) == 0


def test_the_master_of_a_zone_rules_its_members():
    fake = Fake(HARP, articulations=SWITCHED)
    fake.control(101, 0)
    fake.control(100, 6)
    fake.control(6, 15)
    assert fake.state.zones[LOWER] == 15
    fake.on(11, channel=3)  # a key of the keyboard, on whichever channel it comes
    assert way(fake, 60, channel=5) == 1
    fake.control(20, 10, channel=0)
    assert way(fake, 61, channel=6) == 2
    fake.control(20, 100, channel=7)  # a member's own controller is its own note's
    assert [way(fake, 62, channel=7), way(fake, 63, channel=8)] == [1, 2]


def test_a_number_that_no_articulation_has_is_the_normal_one():
    fake = Fake(HARP, articulations=SWITCHED)
    fake.state.channels["articulation"][0] = 31
    fake.state.channels["ruled"][0] = 31
    assert way(fake, 60) == 0


@pytest.mark.parametrize(
    ("key", "string", "fret", "n"),
    [(40, 0, 0, 2), (47, 0, 0, 3), (50, 2, 0, 2), (52, 1, 0, 3), (55, 3, 0, 2), (56, 0, 0, 5), (59, 0, 0, 6), (62, 3, 0, 3)],
)
def test_a_harmonic_of_an_open_string_is_touched_at_its_node(key, string, fret, n):
    fake = Fake(NECK, articulations=HARMONIC)
    fake.on(11)
    assert fake.plucked(key) == (string, fret)
    assert fake.strings("node")[string] == pytest.approx(1.0 - 1.0 / n)


def test_other_harmonics_are_those_of_a_string_stopped_an_octave_below():
    fake = Fake(NECK, articulations=HARMONIC)
    fake.on(11)
    string, fret = fake.plucked(42)
    assert NECK[string][fret] == 30 and fake.strings("node")[string] == 0.5
    fake = Fake(NECK, articulations=HARMONIC)
    fake.on(11)
    string, _ = fake.plucked(29)  # too low for any: a note like any other
    assert fake.strings("node")[string] == 0.0 and fake.strings("articulation")[string] == 0
    fake.on(10)
    fake.plucked(40)
    assert fake.strings("node") == [0.0] * 4


def test_a_string_that_sounds_another_note_than_its_key_has_no_harmonics():
    fake = Fake([[28], [33]], articulations=HARMONIC)
    fake.me.positions["elsewhere"][0] = 1
    fake.on(11)
    fake.on(40)
    assert fake.asked == [] and fake.state.unplayed[0, 40] == 1
    assert fake.plucked(45) == (1, 0)


def test_a_program_of_the_same_part_keeps_the_articulation():
    for program in (0, 5):
        fake = Fake(HARP, articulations=SWITCHED)
        fake.on(11)
        fake.send(PROGRAM, 0, program)
        assert way(fake, 60) == 1


def test_harmonics_of_a_chord_lie_on_different_strings():
    fake = Fake(NECK, articulations=HARMONIC)
    fake.on(11)
    taken = [fake.plucked(key) for key in (40, 45, 50, 55)]
    assert taken == [(0, 0), (1, 0), (2, 0), (3, 0)]
    assert fake.plucked(52)[0] == 1  # E4 is on none that is free: the A string's, which sounds an octave below


def waits(fake: Fake, *notes: int, frame: int = 0) -> list[int]:
    """HAND.wait as every string is asked to be plucked with it last."""
    for note in notes:
        fake.state.event[0] = (frame, NOTE_ON, 0, note, 100, 0.0)
        fake._policy.ctypes(fake.address)
    return fake.me.hands["wait"].tolist()


@pytest.mark.parametrize("order", [(28, 33, 38, 43), (43, 38, 33, 28), (38, 28, 43, 33)])
def test_a_chord_is_strummed_in_the_order_of_its_strings_in_whatever_order_it_comes(order):
    fake = Fake(NECK, articulations=STRUMMED)
    fake.on(11)
    assert waits(fake, *order, frame=1000) == [0, 20, 40, 60]
    for note in order:
        fake.off(note)
    assert waits(fake, *order, frame=3000) == [60, 40, 20, 0]  # and up the next time
    for note in order:
        fake.off(note)
    assert waits(fake, *order, frame=5000) == [0, 20, 40, 60]


def test_a_note_alone_waits_for_nobody_and_turns_nothing_round():
    fake = Fake(NECK, articulations=STRUMMED)
    fake.on(11)
    for frame in (100, 1100, 2100):
        assert waits(fake, 40, frame=frame) == [0, 0, 0, 0]
        fake.off(40)
    assert waits(fake, 43, 28, frame=4000) == [0, 0, 0, 20]


def test_what_has_begun_to_sound_is_not_put_off():
    fake = Fake(NECK, articulations=STRUMMED)
    fake.on(11)
    waits(fake, 43, frame=1000)
    assert waits(fake, 28, frame=1010) == [0, 0, 0, 0]  # the G string has been struck
    assert waits(fake, 33, frame=1012) == [0, 8, 0, 0]  # its turn is the second, at 1020
    fake.me.hands["phase"][1] = WAIT
    fake.me.hands["wait"][1] = 0  # taken over by the string
    waits(fake, 38, frame=1014)
    assert fake.me.hands["wait"][2] == 26  # third, at 1040


def test_notes_further_apart_are_no_chord():
    fake = Fake(NECK, articulations=STRUMMED)
    fake.on(11)
    waits(fake, 43, frame=1000)
    assert waits(fake, 28, frame=1036) == [0, 0, 0, 0]  # 15 ms after the chord's one string has had its 20


def test_legato_goes_back_to_the_lower_key_struck_last_that_is_still_held():
    fake = Fake(NECK)
    fake.control(68, 127)
    fake.on(30)
    fake.on(31)
    fake.on(33)
    asked = fake.off(33)
    assert [fake.place(k) for action, k, _ in asked] == [(0, 3)] and asked[0][0] == "slur"
    assert fake.strings("note")[0] == 31 and fake.strings("held")[0] == 1
    assert fake.off(30) == []  # not what sounds
    assert [action for action, *_ in fake.off(31)] == ["let go"]
    assert fake.strings("held")[0] == 0


def test_legato_goes_back_to_no_key_that_another_string_sounds_and_not_without_its_pedal():
    fake = Fake(NECK)
    fake.on(28)
    fake.on(38)
    fake.control(68, 127)
    fake.on(40)  # hammered on the D string
    fake.state.keys[0, 38] = 0
    assert [action for action, *_ in fake.off(40)] == ["let go"]
    fake = Fake(NECK)
    fake.control(68, 127)
    fake.on(30)
    fake.on(33)
    fake.control(68, 0)
    assert [action for action, *_ in fake.off(33)] == ["let go"]


@pytest.mark.parametrize("end", [123, 120])
def test_all_notes_off_lets_every_key_go(end):
    fake = Fake(NECK)
    fake.control(68, 127)
    fake.on(30)
    fake.control(end, 0)
    assert not fake.state.keys.any()


def test_legato_pulls_the_string_as_far_as_the_hand_can_and_lets_it_back():
    fake = Fake(NECK, meend=3.0)
    fake.control(68, 127)
    fake.on(30)
    assert fake.on(33) == []
    assert fake.strings("pull_to")[0] == 3.0 and fake.strings("note")[0] == 33
    assert fake.on(32) == [] and fake.strings("pull_to")[0] == 2.0
    assert fake.on(33) == [] and fake.strings("pull_to")[0] == 3.0
    assert fake.on(30) == [] and fake.strings("pull_to")[0] == 0.0  # its own fret
    fake.on(32)
    assert fake.off(32) == [] and fake.strings("pull_to")[0] == 0.0 and fake.strings("note")[0] == 30
    ((action, k, _),) = fake.on(34)  # too far: another fret
    assert action == "slur" and fake.place(k) == (0, 6)


def test_a_stroke_pulls_nothing_and_is_made_where_the_string_was_pulled_to():
    fake = Fake(NECK, meend=3.0)
    fake.control(68, 127)
    fake.on(30)
    fake.on(33)
    fake.control(68, 0)
    assert fake.on(33)[0][0] == "pluck" and fake.strings("pull_to")[0] == 0.0
    fake = Fake(NECK, meend=3.0)
    fake.control(68, 127)
    fake.on(28)
    assert [action for action, *_ in fake.on(30)] == ["slur"]  # an open string is stopped: there is no fret to pull it over


def test_a_pull_follows_the_tuning_of_its_key():
    fake = Fake(NECK, meend=3.0)
    fake.send(TUNING, 0, 33, 0, 33.4)
    fake.control(68, 127)
    fake.on(30)
    fake.on(33)
    assert fake.strings("pull_to")[0] == 0.0 and fake.place(fake.asked[-1][1]) == (0, 5)  # 3.4 are too far
    fake = Fake(NECK, meend=3.0)
    fake.control(68, 127)
    fake.on(30)
    fake.on(32)
    fake.send(TUNING, 0, 32, 1, 32.25)
    assert fake.strings("pull_to")[0] == pytest.approx(2.25) and fake.strings("retune_to")[0] == 0.0


def test_what_slides_is_not_pulled():
    fake = Fake(NECK, meend=3.0, articulations=({"slide_s": 0.03},))
    fake.control(68, 127)
    fake.on(30)
    assert [action for action, *_ in fake.on(33)] == ["slur"]
    assert fake.me.hands["phase"][0] == NO_FINGER and fake.send(NOTE_OFF, 0, 40) == []
