"""Who plays and who yields, without a string: the policy, and a responder that writes down what it is asked."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synth.engine.layout import GAIN, N_NOTES, N_STOLEN, N_TAKEN, PLUCK_POSITION, PLUCK_WIDTH, PRESS, RELEASE
from synth.engine.voices.retuning import MOST_RETUNING
from synth.midi.events import (
    BEND,
    CONTROL,
    KEY_PRESSURE,
    NOTE_OFF,
    NOTE_ON,
    PARAMETER,
    PRESSURE,
    PROGRAM,
    TUNING,
)
from tests.engine.voicekit import Fake

#: E A D G with twelve frets, and five strings with a note each
NECK = [list(range(low, low + 13)) for low in (28, 33, 38, 43)]
HARP = [[60], [61], [62], [63], [64]]


def test_nobody_yields_before_all_voices_are_taken():
    fake = Fake(HARP, polyphony=3)
    for note in (60, 61, 62):
        assert [action for action, _, _ in fake.on(note)] == ["pluck"]
    assert fake.count(N_STOLEN) == 0


def test_the_quietest_yields_and_of_equals_the_one_plucked_first():
    fake = Fake(HARP, polyphony=3)
    for note in (61, 60, 62):
        fake.on(note)
    fake.me.voices["level"][:3] = 0.5, 0.5, 0.1
    assert fake.on(63) == [("cut", 2, 0), ("pluck", 3, 100)]
    assert fake.strings("stolen") == [0, 0, 1, 0, 0] and fake.strings("held") == [1, 1, 0, 1, 0]
    assert fake.on(64) == [("cut", 1, 0), ("pluck", 4, 100)]
    assert fake.count(N_STOLEN) == 2


def test_who_yields_first_goes_on_to_the_event():
    fake = Fake(HARP, polyphony=1)
    fake.on(60)
    fake.went_on.clear()
    fake.on(61)
    assert fake.went_on == [1, 0]


def test_one_that_sleeps_makes_room_and_one_that_is_stolen_makes_none_twice():
    fake = Fake(HARP, polyphony=2)
    for note in (60, 61, 62):
        fake.on(note)
    assert fake.strings("stolen") == [1, 0, 0, 0, 0]
    assert fake.on(60) == [("cut", 1, 0), ("pluck", 0, 100)]  # comes back: no longer stolen
    assert fake.strings("stolen") == [0, 1, 0, 0, 0]
    fake.me.voices["awake"][2] = 0
    assert fake.on(63) == [("pluck", 3, 100)]


def test_a_string_that_sounds_is_plucked_again_without_anybody_yielding():
    fake = Fake(HARP, polyphony=2)
    fake.on(60)
    fake.on(61)
    assert fake.on(60, velocity=7) == [("pluck", 0, 7)]
    assert fake.count(N_TAKEN) == 0


def test_a_note_is_plucked_again_where_it_sounds_wherever_the_hand_is():
    fake = Fake(NECK)
    assert fake.plucked(45) == (3, 2)
    fake.off(45)
    fake.state.part_state["hand"] = 12
    assert fake.plucked(45) == (3, 2)


def test_a_note_belongs_to_the_string_that_is_being_pressed_to_it():
    fake = Fake(NECK)
    fake.on(28)
    hand = fake.me.hands[0]
    hand["phase"], hand["pending_model"] = PRESS, 7
    fake.state.part_state["hand"] = 0
    assert fake.plucked(35) == (0, 7)
    fake.me.hands["phase"][0] = 0
    fake.me.hands["model"][0] = 0
    fake.state.part_state["hand"] = 0
    assert fake.plucked(35) == (1, 2)


def test_the_hand_stays_where_it_is_and_an_open_string_is_always_one_fret_away():
    fake = Fake(NECK)
    fake.state.part_state["hand"] = 12
    assert fake.plucked(46) == (2, 8) and fake.state.part_state["hand"][0] == 8
    assert fake.plucked(43) == (3, 0) and fake.state.part_state["hand"][0] == 8
    fake.state.part_state["hand"] = 1
    assert fake.plucked(35) == (1, 2)


def test_held_strings_are_left_alone_until_there_is_no_other():
    fake = Fake(NECK)
    places = [fake.plucked(note) for note in (28, 33, 38, 43)]
    assert places == [(0, 0), (1, 0), (2, 0), (3, 0)] and fake.count(N_TAKEN) == 0
    assert fake.plucked(30) == (0, 2)
    assert fake.count(N_TAKEN) == 1
    assert fake.off(28) == []  # its string belongs to another note


def test_taken_over_is_what_another_key_or_channel_held():
    fake = Fake([[60]])
    fake.on(60)
    fake.on(60)
    assert fake.count(N_TAKEN) == 0
    fake.on(60, channel=3)
    assert fake.count(N_TAKEN) == 1
    fake.off(60, channel=3)
    fake.on(60)
    assert fake.count(N_TAKEN) == 1


def test_alike_strings_take_turns():
    fake = Fake([[48], [48], [48]])
    assert [fake.plucked(48)[0] for _ in range(5)] == [0, 1, 2, 0, 1]


def test_hammer_on_and_pull_off_stay_on_the_string():
    fake = Fake(NECK)
    fake.control(68, 127)
    assert fake.plucked(31) == (0, 3)
    assert fake.on(33) == [("slur", 5, 100)] and fake.place(5) == (0, 5)
    assert fake.off(31) == [] and fake.count(N_TAKEN) == 0
    assert fake.on(28) == [("slur", 0, 100)]
    fake.off(28)
    assert fake.on(28) == [("pluck", 0, 100)]  # not held: nothing to be slurred from
    fake.control(68, 0)
    assert fake.plucked(33) == (1, 0)


def test_a_slur_is_of_one_channel():
    fake = Fake(NECK)
    fake.control(68, 127, channel=0)
    fake.control(68, 127, channel=1)
    fake.on(28, channel=0)
    assert fake.plucked(33, channel=1) == (1, 0)


def test_a_note_ends_with_its_key():
    fake = Fake(HARP)
    fake.on(60)
    assert fake.off(60, channel=1) == [] and fake.off(61) == []
    assert fake.off(60) == [("let go", 0, 0)]
    assert fake.off(60) == []
    assert fake.on(60) and fake.on(60, velocity=0) == [("let go", 0, 0)]


def test_the_pedal_holds_and_lets_go():
    fake = Fake(HARP)
    fake.control(64, 64)
    fake.on(60)
    fake.on(61)
    fake.off(60)
    assert fake.strings("held")[:2] == [0, 1] and fake.strings("sustained")[:2] == [1, 0]
    assert fake.control(64, 63, channel=1) == []
    assert fake.control(64, 63) == [("let go", 0, 0)]
    assert fake.strings("sustained")[:2] == [0, 0]


def test_all_notes_off_heeds_the_pedal_and_all_sound_off_does_not():
    fake = Fake(HARP)
    fake.control(64, 127)
    fake.on(60)
    fake.control(123, 0)
    assert fake.strings("held")[0] == 0 and fake.strings("sustained")[0] == 1
    assert fake.control(120, 0) == [("cut", 0, 0)]
    assert fake.strings("sustained")[0] == 0
    fake.on(61, channel=1)
    assert fake.control(120, 0) == [("cut", 0, 0)]  # it is still awake; the other channel's goes on


def test_key_pressure_is_of_the_key_and_ends_with_the_next_note():
    fake = Fake(HARP)
    fake.on(60)
    fake.on(61)
    fake.send(KEY_PRESSURE, 0, 60, 127)
    fake.send(KEY_PRESSURE, 1, 61, 127)
    assert fake.strings("key_pressure")[:2] == [1.0, 0.0]
    fake.on(60)
    assert fake.strings("key_pressure")[0] == 0.0
    fake.off(60)
    fake.send(KEY_PRESSURE, 0, 60, 127)
    assert fake.strings("key_pressure")[0] == 0.0


def test_levels_of_a_channel():
    fake = Fake(HARP)
    fake.control(7, 127)
    fake.control(11, 64)
    fake.control(10, 0)
    fake.send(BEND, 0, -8192)
    fake.send(PRESSURE, 0, 0, 127)
    channel = fake.state.channels[0]
    assert channel["volume"] == pytest.approx(1.27**2) and channel["expression"] == pytest.approx((64 / 127) ** 2)
    assert channel["pan"] == -1.0 and channel["bend_raw"] == -1.0 and channel["pressure"] == 1.0


def test_a_part_heeds_the_channel_that_spoke_last():
    fake = Fake(HARP)
    fake.on(60, channel=5)
    assert fake.state.part_state["channel"][0] == 5
    fake.control(7, 100, channel=9)
    assert fake.state.part_state["channel"][0] == 9


def rpn(fake: Fake, number: int, value: int, channel: int = 0) -> None:
    for controller, data in ((101, number >> 7), (100, number & 127), (6, value)):
        fake.control(controller, data, channel)


def test_bend_range_by_its_registered_parameter():
    fake = Fake(HARP)
    rpn(fake, 0, 12)
    fake.control(38, 50)
    assert fake.state.channels["bend_range"][:2].tolist() == [12.5, 2.0]
    rpn(fake, 0x3FFF, 5)
    fake.control(98, 0)
    fake.control(6, 5)
    assert fake.state.channels["bend_range"][0] == 12.5


def test_zones_come_and_yield_and_begin_anew():
    fake = Fake(HARP)
    fake.on(60, channel=3)
    fake.control(64, 127, channel=3)
    rpn(fake, 6, 4)
    assert fake.state.zones.tolist() == [4, 0]
    assert fake.state.channels["master"].tolist() == [0] * 5 + list(range(5, 16))
    assert fake.state.channels["bend_range"].tolist() == [2.0] + [48.0] * 4 + [2.0] * 11
    assert fake.strings("held")[0] == 0 and ("let go", 0, 0) in fake.asked
    rpn(fake, 6, 12, channel=15)
    assert fake.state.zones.tolist() == [2, 12]
    rpn(fake, 6, 3, channel=7)  # no channel that could lead a zone
    assert fake.state.zones.tolist() == [2, 12]


def test_what_is_said_to_the_master_is_said_to_its_zone():
    fake = Fake(HARP)
    rpn(fake, 6, 15)
    fake.on(60, channel=1)
    fake.on(61, channel=2)
    fake.control(64, 127, channel=0)
    fake.off(60, channel=1)
    assert fake.strings("sustained")[:2] == [1, 0]
    fake.send(KEY_PRESSURE, 0, 61, 127)
    assert fake.strings("key_pressure")[1] == 1.0
    assert fake.control(64, 0, channel=0) == [("let go", 0, 0)]
    assert fake.control(123, 0, channel=0) == [("let go", 1, 0)]
    rpn(fake, 0, 24, channel=3)
    assert set(fake.state.channels["bend_range"][1:]) == {24.0} and fake.state.channels["bend_range"][0] == 2.0


def test_a_members_own_pedal_holds_when_the_masters_comes_up():
    fake = Fake(HARP)
    rpn(fake, 6, 15)
    fake.on(60, channel=1)
    fake.control(64, 127, channel=0)
    fake.control(64, 127, channel=1)
    fake.off(60, channel=1)
    assert fake.control(64, 0, channel=0) == [] and fake.strings("sustained")[0] == 1
    assert fake.control(64, 0, channel=1) == [("let go", 0, 0)]


@pytest.mark.parametrize(
    ("member", "master", "timbre"), [(127, 64, 1.0), (0, 64, -1.0), (64, 64, 0.0), (96, 127, 1.0), (32, 96, 0.0)]
)
def test_timbre_of_a_member_and_its_master(member, master, timbre):
    fake = Fake(HARP)
    fake.control(74, 100, channel=1)
    fake.on(60, channel=1)
    assert fake.strings("timbre")[0] == 0.0
    rpn(fake, 6, 15)
    fake.control(74, member, channel=1)
    fake.control(74, master, channel=0)
    fake.on(60, channel=1)
    assert fake.strings("timbre")[0] == timbre


def test_reset_all_controllers():
    fake = Fake(HARP)
    fake.on(60)
    fake.send(KEY_PRESSURE, 0, 60, 50)
    for controller in (64, 68, 11, 7):
        fake.control(controller, 70)
    fake.off(60)
    fake.send(BEND, 0, 100)
    volume = fake.state.channels["volume"][0]
    assert fake.control(121, 0) == [("let go", 0, 0)]
    channel = fake.state.channels[0]
    assert (channel["sustain"], channel["legato"], channel["expression"], channel["bend_raw"]) == (0, 0, 1.0, 0.0)
    assert channel["volume"] == volume and fake.strings("key_pressure")[0] == 0.0


def test_a_bound_controller_sets_what_its_channel_plays():
    bindings = [(1, 0, PLUCK_POSITION, 0.1, 0.3), (7, 0, PLUCK_WIDTH, 1.0, 16.0), (7, 1, GAIN, 0.0, 4.0)]
    fake = Fake([[60]], [[60]], bindings=bindings)
    fake.control(1, 0)
    assert fake.state.parameters[0, PLUCK_POSITION] == 0.1
    fake.control(1, 127)
    assert fake.state.parameters[0, PLUCK_POSITION] == pytest.approx(0.3)
    volume = fake.state.channels["volume"].copy()
    fake.control(7, 127, channel=1)
    assert fake.state.parameters[1, GAIN] == 4.0 and fake.state.parameters[0, PLUCK_WIDTH] == 0.0
    fake.control(7, 0, channel=0)
    assert fake.state.parameters[0, PLUCK_WIDTH] == 1.0
    np.testing.assert_array_equal(fake.state.channels["volume"], volume)  # 7 means nothing else any more


def test_a_parameter_waits_for_what_a_finger_has_yet_to_read():
    fake = Fake(HARP)
    fake.on(60)
    fake.on(61)
    fake.me.hands["phase"][1] = 2
    fake.went_on.clear()
    fake.send(PARAMETER, 0, GAIN, value=3.0)
    assert fake.went_on == []
    fake.send(PARAMETER, 0, RELEASE, value=1e9)
    assert fake.went_on == [1] and fake.state.parameters[0, RELEASE] == 20.0
    fake.send(PARAMETER, 0, RELEASE, value=math.nan)
    fake.send(PARAMETER, 1, RELEASE, value=1.0)
    assert fake.state.parameters[0, RELEASE] == 20.0


def test_a_key_is_tuned_now_or_from_its_next_note_on():
    fake = Fake(HARP)
    fake.on(60)
    fake.send(TUNING, 0, 60, 0, 60.25)
    assert fake.strings("retune_to")[0] == 0.0
    fake.on(60)
    assert fake.strings("retune_to")[0] == 0.25
    fake.send(TUNING, 0, 60, 1, 1e6)
    assert fake.strings("retune_to")[0] == MOST_RETUNING
    fake.send(TUNING, 0, 60, 1, math.nan)
    assert fake.strings("retune_to")[0] == 0.0 and fake.state.tuning[60] == 0.0


def test_what_no_string_plays_is_counted():
    fake = Fake([[60]], [[62]])
    assert fake.on(61) == [] and fake.on(60, channel=1) == [] and fake.on(60, channel=7) == []
    assert fake.state.unplayed[0, 61] == fake.state.unplayed[1, 60] == fake.state.unplayed[2, 60] == 1
    fake.send(NOTE_ON, 0, 200, 100)
    fake.send(NOTE_ON, 77, 60, 100)
    assert fake.asked == [] and fake.count(N_NOTES) == 3


def test_a_program_of_another_part():
    fake = Fake([[60]], [[60]])
    fake.me.program_map[0, 5] = 1
    fake.send(PROGRAM, 0, 5)
    assert fake.plucked(60) == (1, 0)


# --- whatever is played ---

#: what a player may send, to two parts of a neck and a harp with a limit of four voices; (99, s, …): string s falls asleep
SLEEPS = 99
EVENTS = st.lists(
    st.one_of(
        st.tuples(st.just(NOTE_ON), st.integers(0, 3), st.integers(26, 66), st.integers(0, 127)),
        st.tuples(st.just(NOTE_ON), st.integers(0, 2), st.sampled_from([28, 33, 38, 60, 61, 62]), st.integers(0, 127)),
        st.tuples(st.just(NOTE_OFF), st.integers(0, 3), st.integers(26, 66), st.just(0)),
        st.tuples(
            st.just(CONTROL),
            st.sampled_from([0, 1, 2, 15]),
            st.sampled_from([6, 64, 64, 68, 68, 100, 101, 120, 121, 123]),
            st.sampled_from([0, 0, 6, 15, 64, 127]),
        ),
        st.tuples(st.just(KEY_PRESSURE), st.integers(0, 3), st.integers(26, 66), st.integers(0, 127)),
        st.tuples(st.just(SLEEPS), st.integers(0, 8), st.just(0), st.just(0)),
    ),
    max_size=60,
)


def played(events: list[tuple[int, int, int, int]]) -> Fake:
    """What has been played; after every event there are no more voices than allowed, and every note is accounted for."""
    fake = Fake(NECK, HARP, polyphony=4)
    fake.me.voices["level"] = 1.0
    for kind, c, a, b in events:
        if kind == SLEEPS:
            fake.me.voices["awake"][c] = fake.me.voices["stolen"][c] = fake.me.hands["phase"][c] = 0
            continue
        unplayed, notes = int(fake.state.unplayed.sum()), fake.count(N_NOTES)
        asked = fake.send(kind, c, a, b)
        begun = [place for action, place, _ in asked if action in ("pluck", "slur")]
        if kind == NOTE_ON and b > 0:
            assert fake.count(N_NOTES) == notes + 1
            assert len(begun) + int(fake.state.unplayed.sum()) - unplayed == 1
            assert all(fake.me.positions["note"][k] == a for k in begun)
            assert all(fake.me.voices["note"][fake.place(k)[0]] == a for k in begun)
        else:
            assert not begun
        sounding = fake.me.voices[(fake.me.voices["awake"] == 1) & (fake.me.voices["stolen"] == 0)]
        assert len(sounding) <= 4
    return fake


@given(EVENTS)
def test_never_more_voices_than_allowed_and_every_note_accounted_for(events):
    fake = played(events)
    begun = [1 for action, _, _ in fake.asked if action in ("pluck", "slur")]
    assert fake.count(N_NOTES) == len(begun) + int(fake.state.unplayed.sum())
    assert fake.count(N_TAKEN) <= len(begun)
    assert fake.count(N_STOLEN) <= sum(action == "cut" for action, _, _ in fake.asked)


@given(EVENTS, st.booleans())
def test_all_notes_off_and_pedals_up_and_nothing_is_held(events, pedals_first):
    fake = played(events)
    for controllers in ((64, 123), (123, 64))[pedals_first], (64,):
        for controller in controllers:
            for c in range(16):
                fake.control(controller, 0, c)
    assert not fake.me.voices["held"].any() and not fake.me.voices["sustained"].any()


@given(EVENTS)
def test_before_a_string_is_touched_it_goes_on_to_the_event(events):
    """Each action but GO_ON is asked of a string that has been told to go on since the event began."""
    fake = Fake(NECK, HARP, polyphony=4)
    for kind, c, a, b in events:
        if kind == SLEEPS:
            continue
        fake.went_on.clear()
        for action, place, _ in fake.send(kind, c, a, b):
            s = fake.place(place)[0] if action in ("pluck", "slur") else place
            assert s in fake.went_on
