"""Strings on a moving bridge that press on one point without a break: they go a frame at a time, and are not missed."""

from __future__ import annotations

import numpy as np
import pytest

from synth.engine import bank as banks
from synth.engine import layout
from synth.engine.engine import Engine
from synth.host.frames_tape import Frames, joined
from synth.instrument.place import find
from synth.instrument.preset import Preset
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER
from tests.engine.kit import SITAR, bank_of, engine, go_on_from, play, what_sounds

from .test_coupled_economy import error

#: its strings pressed on the bridge, and so little that what others do lifts them
PRESSING, LIGHTLY = (SITAR.with_setting("obstacle.jiva_um", height) for height in ("-20.0", "-0.5"))
#: strings by their numbers, and notes that they play
JOR, BAJ, CHIKARI = range(3)
NOTES = (43, 48, 55)
#: what flight may change of a sound
PROMISED = 1e-3


def flying(made: Engine) -> list[bool]:
    return [bool(each) for each in made._sounding.motions["flying"]]


def without_flight(monkeypatch, of: Preset = PRESSING) -> Engine:
    """An engine whose strings never fly."""
    with monkeypatch.context() as patched:
        patched.setattr(banks._Lists, "_pressed", lambda *_: None)
        return engine(of, precision="float64")


def test_strings_that_nobody_plays_fly_and_sound_as_if_they_stood(monkeypatch) -> None:
    rows = [(0, NOTE_ON, 0, NOTES[BAJ], 80), (30_000, NOTE_ON, 0, NOTES[BAJ] + 1, 60)]
    made, standing = engine(PRESSING, precision="float64"), without_flight(monkeypatch)
    sound, whole = play(made, rows, 80_000), play(standing, rows, 80_000)
    assert flying(made) == [True, False, True] and not any(flying(standing))
    assert 0.0 < error(sound, whole) < PROMISED


@pytest.mark.parametrize("quality", ["fine", "reference"])
def test_finer_qualities_do_without(quality: str) -> None:
    made = engine(PRESSING, quality=quality)
    play(made, [(0, NOTE_ON, 0, NOTES[BAJ], 80)], 2000)
    assert not any(flying(made))


def test_what_a_hand_does_to_a_string_in_flight(monkeypatch) -> None:
    """It is struck, bent, its bridge raised, let go and damped: as one that stood all the time."""
    rows = [
        (0, NOTE_ON, 0, NOTES[BAJ], 80), (4000, NOTE_ON, 0, NOTES[CHIKARI], 110), (9000, NOTE_ON, 0, NOTES[JOR] + 2, 90),
        (12_000, BEND, 0, 4000), (15_000, BEND, 0, 0), (18_000, PARAMETER, 0, layout.HEIGHT, 0, 20.0),
        (22_000, PARAMETER, 0, layout.HEIGHT, 0, 0.0), (24_000, NOTE_OFF, 0, NOTES[BAJ]), (25_000, CONTROL, 0, 120, 0),
    ]  # fmt: skip
    sound, whole = play(engine(PRESSING, precision="float64"), rows, 30_000), play(without_flight(monkeypatch), rows, 30_000)
    assert error(sound, whole) < PROMISED


def test_a_string_that_is_about_to_lift_stands(monkeypatch) -> None:
    """A stroke so strong that strings beside it leave their points; one that flew on would be heard."""
    hard = [(0, NOTE_ON, 0, NOTES[BAJ], 20), (8000, PARAMETER, 0, layout.PLUCK_AMOUNT, 0, 2.0)]
    hard += [(9000 + 3000 * k, NOTE_ON, 0, NOTES[BAJ], 127) for k in range(6)]
    made, standing = engine(LIGHTLY, precision="float64"), without_flight(monkeypatch, LIGHTLY)
    whole = play(standing, hard, 60_000)
    assert error(play(made, hard, 60_000), whole) < PROMISED
    forced = engine(LIGHTLY, precision="float64")
    bank, models = bank_of(forced), bank_of(forced).models
    for model in models[models["pressed_modes"] > 0]:
        bank.settled[model["pressed"] + 2] *= 1e6  # as if nothing could lift it
    assert error(play(forced, hard, 60_000), whole) > 3.0 * PROMISED


def test_neither_blocks_nor_a_state_that_is_taken_up_matter() -> None:
    rows = [(5, NOTE_ON, 0, NOTES[BAJ], 90), (5003, NOTE_ON, 0, NOTES[CHIKARI], 60)]
    whole = play(engine(PRESSING), rows, 12_000, 4096)
    assert np.array_equal(play(engine(PRESSING), rows, 12_000, 37), whole)
    made = engine(PRESSING)
    play(made, rows[:1], 3000)
    assert any(flying(made))
    state = what_sounds(made)
    expected = play(made, [(2003, *rows[1][1:])], 5000)
    other = engine(PRESSING)
    play(other, [(0, NOTE_ON, 0, NOTES[JOR], 127)], 700)
    go_on_from(other, state)
    assert np.array_equal(play(other, [(2003, *rows[1][1:])], 5000, 77), expected)


def test_a_tape_has_it_where_it_stands() -> None:
    """Displacements of a string in flight are those that lie on its point: S q + ξ b + R λ = η, λ near the force at rest."""
    taped = Frames(PRESSING, find(PRESSING, NOTES[CHIKARI]))
    before = joined(list(taped.play(1, 300, 1, 2)))
    assert flying(taped)[BAJ] and not flying(taped)[CHIKARI]  # the one that is struck stands
    shots = joined(list(taped.play(60, 6000, 50, 20)))
    assert flying(taped)[BAJ] and before.q.shape[1] == shots.q.shape[1]
    position, rest = taped.position(BAJ), taped.memory.strings.models[bank_of(taped).strings["open_model"][BAJ]].q_rest
    q = taped.modes_of(BAJ, shots.q)
    assert np.abs(q - rest[: q.shape[1]]).max() < 0.5 * np.abs(rest).max()  # z would be as far off as all of it
    bridge = shots.bridge @ taped.body.direction[BAJ]
    sunk = q @ position.shapes.T + np.outer(bridge, position.leverage) - position.eta
    point = int(np.argmin(np.abs(sunk).max(axis=0)))
    force = -sunk[:, point] / position.residual[point, point]
    assert np.abs(np.diff(force)).max() > 0.0 and force.min() > 0.2 * force.max() > 0.0
    assert (np.delete(sunk, point, axis=1) < 0.0).all() or (np.delete(sunk, point, axis=1) > 0.0).all()
