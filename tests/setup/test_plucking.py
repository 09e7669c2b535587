"""A stroke is the one that the engine makes of the same velocity."""

import numpy as np
import pytest

from synth.host.string_tape import Taped
from synth.instrument.place import NotePlace as Played
from synth.instrument.preset import Preset, load_preset
from synth.midi.events import NOTE_ON, make_events
from synth.setup.places import compiled, places_of
from synth.setup.plucking import Stroke, moved, stroke_of, velocity_of


def stroke(preset: Preset, string: str, fret: int, velocity: float, place_m: float | None = None) -> Stroke:
    place = next(each for each in places_of(preset, [string]) if each.fret == fret)
    made, position = compiled(preset, place, "standard")
    return stroke_of(preset, made, position, velocity, place_m)


@pytest.mark.parametrize(("string", "fret", "velocity"), [("E", 0, 120), ("G", 12, 40), ("A", 5, 80)])
def test_the_engine_draws_the_string_as_far(string: str, fret: int, velocity: int) -> None:
    """The finger's path in the engine: how far it goes, and how long it takes to get there."""
    preset = load_preset("fretted-bass").with_setting("polarisation.pluck_deg", "0")
    preset = preset.model_copy(update={"hand": preset.hand.varied(0.0)})
    place = next(each for each in places_of(preset, [string]) if each.fret == fret)
    single = preset.model_copy(update={"string": (place.table(preset),)})
    engine = Taped(Played(single, place.index, place.opened, place.fret), "standard", 44100, precision="float64")
    engine.reset(0)
    path, times = [], []
    for piece in engine.pieces(make_events([(0, NOTE_ON, 0, place.note, velocity)]), 4096):
        path.append(piece.finger.copy())
        times.append(piece.ends * engine.step_s)
    finger, t = np.concatenate(path), np.concatenate(times)
    expected = stroke(preset, string, fret, velocity)
    drawn = t <= expected.draw_s
    assert np.nanmax(finger[drawn]) == pytest.approx(expected.displacement_m, rel=2e-3)
    held = t[np.isfinite(finger)].max()
    assert held == pytest.approx(expected.seconds, abs=1e-3)


def test_a_pull_along_the_board_takes_more_of_the_finger_than_of_the_string() -> None:
    preset = load_preset("fretted-bass")
    plain = stroke(preset.with_setting("polarisation.pluck_deg", "0"), "D", 3, 80)
    aslant = stroke(preset, "D", 3, 80)
    assert aslant.displacement_m == pytest.approx(np.cos(np.radians(55.0)) * plain.displacement_m)


def test_width_and_slip_follow_the_velocity() -> None:
    preset = load_preset("fretted-bass")
    pluck = preset.pluck
    soft, hard = (stroke(preset, "A", 0, velocity) for velocity in (1, 127))
    assert hard.width_m == pytest.approx(1e-3 * pluck.hardest_width_mm) and hard.slip_s == pytest.approx(
        1e-3 * pluck.hardest_slip_ms
    )
    assert soft.width_m == pytest.approx(1e-3 * pluck.width_mm, rel=0.05) and soft.width_m > 1.5 * hard.width_m
    assert soft.slip_s == pytest.approx(1e-3 * pluck.slip_ms, rel=0.05) and soft.slip_s > 1.5 * hard.slip_s


def test_the_normal_articulation_counts() -> None:
    preset = load_preset("fretted-bass")
    other = preset.with_setting(
        "articulations.normal", '{ key = "C0", position = 0.1, displacement_ratio = 0.5, slip_ms = 1.0 }'
    )
    before, after = stroke(preset, "A", 0, 127), stroke(other, "A", 0, 127)
    place = preset.pluck.hardest_position
    assert after.distance_m == pytest.approx(0.0863) and before.distance_m == pytest.approx(place * 0.863)
    assert after.slip_s == pytest.approx(1e-3)
    # half the force, nearer to the saddle
    shares = 0.1 * 0.9 / (place * (1.0 - place))
    assert after.displacement_m == pytest.approx(0.5 * shares * before.displacement_m)


def test_a_place_of_ones_own() -> None:
    found = stroke(load_preset("fretted-bass"), "G", 0, 80, 0.09)
    assert found.distance_m == pytest.approx(0.09)
    assert moved(found, 0.005).distance_m == pytest.approx(0.095)


def test_the_velocity_that_draws_so_far() -> None:
    found = stroke(load_preset("fretted-bass"), "G", 0, 80)
    assert velocity_of(found, 80, 0.9, found.displacement_m) == pytest.approx(80.0)
    assert velocity_of(found, 80, 0.9, 2.0**0.9 * found.displacement_m) == pytest.approx(160.0)
    assert velocity_of(found, 80, 0.0, 1.0) == np.inf
