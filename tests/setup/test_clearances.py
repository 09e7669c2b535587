"""Clearances of a string that is held still, by hand."""

import numpy as np
import pytest

from synth.instrument.compile import Position
from synth.instrument.preset import Preset, load_preset
from synth.setup.buzz_map import prepare
from synth.setup.note import SetupNote
from synth.setup.places import Below, FretPlace, below, compiled, opened_string, places_of
from synth.setup.plucking import Stroke, stroke_of


@pytest.fixture(scope="module")
def bass() -> Preset:
    return _by_action(load_preset("fretted-bass"))


def _by_action(preset: Preset) -> Preset:
    changed = {"heights_mm": (), "action_12th_mm": 2.1, "relief_mm": 0.3, "nut_height_mm": 0.45}
    return preset.model_copy(update={"obstacle": preset.obstacle.model_copy(update=changed)})


def place(preset: Preset, string: str, fret: int) -> FretPlace:
    return next(each for each in places_of(preset, [string]) if each.fret == fret)


def under(preset: Preset, at: FretPlace) -> tuple[Below, float]:
    opened = opened_string(preset, at)
    speaking = opened.length_m * 2.0 ** (-at.fret / 12.0)
    return below(preset, at, opened, speaking), speaking


def by_hand(fret: int) -> tuple[np.ndarray, np.ndarray]:
    """(clearances at rest, distances from the saddle) of the frets beyond a fret: 2.1 mm at the twelfth fret, 0.45 mm at the
    first, a hollow of 0.3 mm, on a string of 863 mm."""
    length = 863.0
    x = [length - length / 2.0 ** (n / 12.0) for n in range(1, 21)]
    s = [(each - x[0]) / (x[19] - x[0]) for each in x]
    bow = [0.3 * 4.0 * each * (1.0 - each) for each in s]
    slope = (2.1 - 0.45 - bow[11]) / (x[11] - x[0])
    gap = [0.45 + slope * (x[n] - x[0]) + bow[n] for n in range(20)]
    clearances, distances = [], []
    for n in range(fret, 20):
        stopped = 0.0 if fret == 0 else gap[fret - 1]
        share = 1.0 if fret == 0 else (length - x[n]) / (length - x[fret - 1])
        clearances.append(1e-3 * (gap[n] - stopped * share))
        distances.append(1e-3 * (length - x[n]))
    return np.array(clearances), np.array(distances)


@pytest.mark.parametrize("fret", [0, 1, 5, 12, 19])
def test_the_clearance_at_rest_is_that_of_straight_lines(bass: Preset, fret: int) -> None:
    found, speaking = under(bass, place(bass, "A", fret))
    clearances, distances = by_hand(fret)
    assert np.abs(found.clearance_m(speaking) - clearances).max() < 1e-9
    assert np.abs(found.distances_m - distances).max() < 1e-12
    assert found.names == tuple(f"fret {n}" for n in range(fret + 1, 21))


@pytest.mark.parametrize("fret", [0, 3, 12])
@pytest.mark.parametrize("displacement", [-1.2e-3, 0.7e-3])
def test_the_least_clearance_of_a_string_that_is_drawn(bass: Preset, fret: int, displacement: float) -> None:
    at = place(bass, "D", fret)
    found, speaking = under(bass, at)
    finger = 0.14
    clearances, distances = by_hand(fret)
    length = 0.863 * 2.0 ** (-fret / 12.0)
    expected = []
    for clearance, distance in zip(clearances, distances, strict=True):
        corner = displacement * (distance / finger if distance < finger else (length - distance) / (length - finger))
        expected.append(clearance + corner)
    least = found.clearance_m(speaking, finger, displacement).min()
    assert abs(least - min(expected)) < 1e-9


def test_a_string_over_nothing_moves_as_far_as_its_stroke_says(bass: Preset) -> None:
    """The dynamic clearance of a slow, narrow stroke is that of the string held still, until it is let go."""
    at = place(bass, "A", 5)
    string, position = compiled(bass, at, "fine")
    stroke = Stroke(0.2, 1e-3, 0.4, 0.0, 1e6, 50.0, 1e-3)
    note = _Held(position, stroke)
    found, speaking = under(bass, at)
    still = found.clearance_m(speaking, 0.2, 1e-3) - found.clearance_m(speaking)
    assert string.open_length_m == pytest.approx(0.863)
    assert np.abs(note.at_release() - still).max() < 1.5e-5  # of 1 mm; the bending length L √B/π is 3.7 mm


class _Held(SetupNote):
    def __init__(self, position: Position, stroke: Stroke) -> None:
        super().__init__(position, stroke, speed=True, seconds=0.01)

    def at_release(self) -> np.ndarray:
        """(C,) displacements at the contacts as the string is let go, of a stroke of 1 mm."""
        return 1e-3 * self._shapes @ self._unit.released[0]


def test_a_stroke_touches_where_it_is_said_to(bass: Preset) -> None:
    """Just below the least displacement no contact gives an impulse, just above it the named one does."""
    for string, fret in (("E", 0), ("A", 3), ("G", 12)):
        ready = prepare(bass, place(bass, string, fret), 80, None, "standard")
        reach = ready.note.reach_m(ready.below)
        least, first = float(reach.min()), int(reach.argmin())
        assert not ready.note.play(0.999 * least, ready.below).impulse_ns.any()
        impulse = ready.note.play(1.002 * least, ready.below).impulse_ns
        assert impulse[first] > 0.0
        clearance = ready.note.clearance_m(least, ready.below)
        assert abs(clearance[first]) < 1e-9
        assert clearance.min() > -1e-9


def test_a_stroke_early_enough_to_touch_under_the_finger_is_played_with_its_contacts() -> None:
    """A finger that lets go so slowly that the string reaches a fret before it is free: the run begins with the finger."""
    preset = load_preset("low-action-bass")
    at = place(preset, "E", 0)
    string, position = compiled(preset, at, "standard")
    plain = stroke_of(preset, string, position, 120)
    opened = opened_string(preset, at)
    ground = below(preset, at, opened, position.length_m)
    long_slip = Stroke(plain.distance_m, plain.width_m, 0.01, 0.05, plain.stiffness_n_m, plain.resistance_n_s_m, 2e-3)
    note = SetupNote(position, long_slip, speed=True)
    down = 8e-3
    assert np.any(down * note._unit.early <= ground.heights_m)
    assert note.play(down, ground).impulse_ns.any()
