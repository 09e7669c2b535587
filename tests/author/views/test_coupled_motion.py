"""Strings on one bridge in slow motion: what is seen is what sounds, the end of the string is the bridge, strings wake."""

import json

import numpy as np
import pytest

from synth.author.views.body_peaks import describe_body
from synth.author.views.coupled_motion import FLOOR_DB
from synth.author.views.motion import film
from synth.engine.engine import Engine
from synth.host.frames_tape import Frames, joined
from synth.host.string_tape import RATE_HZ
from synth.instrument.place import find
from synth.instrument.preset import Preset
from synth.midi.events import NOTE_ON, make_events

from .kit import LOW_NECK, ROLLED_ON, TWO_WAYS, preset, together

#: preset, note, velocity
NOTES = [
    (together(), 48, 100),
    (together(obstacle=ROLLED_ON), 43, 90),
    (together(more=TWO_WAYS, obstacle=LOW_NECK), 50, 127),
    (preset("steel-guitar"), 40, 110),
]


@pytest.mark.parametrize(("made", "note", "velocity"), NOTES)
def test_a_taped_instrument_sounds_as_the_engine(made: Preset, note: int, velocity: int) -> None:
    """For as long as contacts do not magnify how single frames are rounded."""
    engine = Engine([made], limiter=False, only_notes=[{note}], every_fret=False, precision="float64")
    engine.prepare(RATE_HZ)
    taped = Frames(made, find(made, note))
    out = joined(list(taped.play(velocity, 700, 3, 200))).out
    alone = np.zeros_like(out)
    engine.process(make_events([(0, NOTE_ON, 0, note, velocity)]), alone)
    assert np.abs(out - alone)[:1000].max() < 1e-9 * np.abs(alone).max()


def test_what_the_tape_has_is_the_engine_s_state_at_its_frames() -> None:
    """Looked at seldom or always, from a frame on or from another: the same frame is the same state."""
    made = together(more=TWO_WAYS)
    taped = Frames(made, find(made, 48))
    always = joined(list(taped.play(100, 40, 1, 300)))
    assert always.ends.tolist() == list(range(40, 340))
    seldom = joined(list(taped.play(100, 47, 25, 8, 8)))
    assert seldom.ends.tolist() == list(range(47, 247, 25))
    for name in ("q", "v", "p", "bridge", "speed"):
        one, other = getattr(seldom, name), getattr(always, name)[seldom.ends - 40]
        np.testing.assert_allclose(one, other, atol=1e-11 * np.abs(other).max())
    # β = Ψ p, and the bridge's speed of a frame is how far it goes in it
    np.testing.assert_allclose(always.bridge, always.p @ taped.body.shape.T, atol=1e-15)
    gone = np.diff(always.bridge, axis=0) * RATE_HZ
    np.testing.assert_allclose(always.speed[1:], gone, atol=1e-9 * np.abs(gone).max())


def test_only_the_lines_that_are_wanted_are_taped() -> None:
    made = together(more=TWO_WAYS)
    one = Frames(made, find(made, 43), lines=(4,))
    every = Frames(made, find(made, 43))
    assert one.line == 4 == every.line
    alone, all_of_them = (joined(list(frames.play(90, 300, 7, 40))) for frames in (one, every))
    assert alone.q.shape[1] < all_of_them.q.shape[1]
    np.testing.assert_array_equal(one.modes_of(4, alone.q), every.modes_of(4, all_of_them.q))


@pytest.mark.parametrize(("made", "note", "velocity"), NOTES)
def test_the_string_ends_on_the_bridge(made: Preset, note: int, velocity: int) -> None:
    shown = film(made, note, velocity, 0.02, 120, start_s=0.004)
    json.dumps(shown, allow_nan=False)
    frames, lift = np.array(shown["frames"]), np.array(shown["lift"])
    assert np.abs(frames[:, -1] - shown["rest"][-1] - lift).max() < 2e-4
    assert np.abs(lift).max() > 1e-4
    # the bridge's own motion along the string, from its components
    string = next(each for each in shown["strings"] if each["played"])
    angle = np.radians(string["angle_deg"])
    along = [np.cos(angle), np.sin(angle), 1e-3 * string["place_mm"] * np.cos(angle)]
    np.testing.assert_allclose(1e-3 * np.array(shown["bridge"]["motion"]) @ along, lift, atol=2e-5)
    assert shown["bridge"]["axes"] == ["normal", "lateral", "rocking"]


@pytest.mark.parametrize(("made", "note", "velocity"), NOTES[1:3])
def test_the_string_stays_above_what_it_touches_which_may_ride(made: Preset, note: int, velocity: int) -> None:
    shown = film(made, note, velocity, 0.06, 250)
    lift = np.array(shown["lift"]) if shown["rides"] else 0.0
    assert shown["rides"] == (made.obstacle.kind == "bridge")
    assert shown["largest_n"] > 0.0
    heights = np.array(shown["frames"])
    for point in shown["points"]:
        above = heights[:, point["at"]] - lift - point["height"]
        assert above.min() > -3e-3  # [mm]


def test_a_string_in_unison_wakes_and_another_does_less() -> None:
    shown = film(together(), 48, 100, 0.05, 60)
    a, b, c = shown["strings"]
    assert [each["played"] for each in (a, b, c)] == [True, False, False]
    assert b["level_db"][0] == c["level_db"][0] == -FLOOR_DB
    assert max(a["level_db"]) == 0.0 and a["opened"] == b["opened"] == 48
    later = film(together(), 48, 100, 0.05, 60, start_s=0.6)
    a, b, c = later["strings"]
    assert b["level_db"][-1] > -25.0 > c["level_db"][-1]
    assert np.abs(b["motion"]).max() > 10 * np.abs(c["motion"]).max()


def test_the_second_direction_moves_where_strings_have_one() -> None:
    one = film(together(), 48, 100, 0.02, 60, start_s=0.01)
    two = film(together(more=TWO_WAYS), 48, 100, 0.02, 60, start_s=0.01)
    across = [np.abs(np.array(each["strings"][0]["motion"])[:, 1]).max() for each in (one, two)]
    assert across[0] < 1e-3 < 0.1 < across[1]
    assert two["swing_mm"] == np.abs([each["motion"] for each in two["strings"]]).max()


def test_a_mode_beyond_the_band_is_shown_at_rest() -> None:
    shown = film(together(), 48, 100, 0.02, 60)
    motion = np.array(shown["body"]["motion"])
    assert motion.shape == (60, 4) and len(describe_body(together())["modes"]) == 4
    moving = np.abs(motion).max(axis=0)
    assert moving[:3].min() > 0.0 == moving[3] and shown["body"]["largest"] == moving.max()


def test_a_film_from_later_on_is_a_part_of_the_longer_one() -> None:
    made = together()
    whole = film(made, 48, 100, 0.02, 201, start_s=0.005)
    step = whole["dt_s"]
    part = film(made, 48, 100, 40 * step, 41, start_s=whole["start_s"] + 60 * step)
    assert part["dt_s"] == step and part["start_s"] == pytest.approx(whole["start_s"] + 60 * step, abs=1e-9)
    np.testing.assert_allclose(part["frames"], whole["frames"][60:101], atol=2e-4)
    np.testing.assert_allclose(part["lift"], whole["lift"][60:101], atol=2e-5)
