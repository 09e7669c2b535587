"""The lowest set-up: it keeps the want, and a lower one does not."""

import numpy as np
import pytest

from synth.instrument.preset import Preset, PresetError, load_preset
from synth.setup.adjustments import RELIEF, adjusted, adjustments, settings
from synth.setup.lowest import Proposal, Wanted, lowest, wanted_notes
from synth.setup.places import below
from synth.setup.wants import parse

AUDIBLE_DB = 3.0


def notes_of(preset: Preset, text: str, strings: list[str] | None = None, quality: str = "standard") -> list[Wanted]:
    return wanted_notes(
        preset, parse(text, [each.name for each in preset.string]), strings=strings, quality=quality, threads=2
    )


@pytest.fixture(scope="module")
def guitar() -> Preset:
    return load_preset("electric-guitar")


@pytest.fixture(scope="module")
def wanted(guitar: Preset) -> list[Wanted]:
    return notes_of(guitar, "no buzz at medium, except open strings hard", ["E2", "G3"])


@pytest.fixture(scope="module")
def found(guitar: Preset, wanted: list[Wanted]) -> Proposal:
    return lowest(guitar, wanted, threads=2)


def buzzing(preset: Preset, notes: list[Wanted]) -> int:
    return sum(each.buzz_db(preset) >= AUDIBLE_DB for each in notes)


@pytest.mark.slow
def test_nothing_buzzes_in_the_proposed_set_up(guitar: Preset, wanted: list[Wanted], found: Proposal) -> None:
    assert found.remaining == ()
    preset = guitar
    for path, value in found.settings:
        preset = preset.with_setting(path, str(value))
    assert buzzing(preset, wanted) == 0


@pytest.mark.slow
def test_a_little_lower_something_buzzes(guitar: Preset, wanted: list[Wanted], found: Proposal) -> None:
    action, relief = found.values_mm
    assert buzzing(adjusted(guitar, (action - 0.04, relief)), wanted) > 0


@pytest.mark.slow
def test_no_other_relief_allows_a_set_up_that_counts_less(guitar: Preset, wanted: list[Wanted], found: Proposal) -> None:
    """Among reliefs on a grid, each with its own lowest action by trial, none is better by more than the rounding."""
    cost = found.values_mm[0] + 0.5 * found.values_mm[1]
    for relief in np.arange(0.0, 0.51, 0.1):
        for action in np.arange(cost - 0.5 * relief - 0.06, 0.3, -0.25):
            assert buzzing(adjusted(guitar, (float(action), float(relief))), wanted) > 0


@pytest.mark.slow
def test_what_buzzes_now_is_named(guitar: Preset, wanted: list[Wanted], found: Proposal) -> None:
    assert len(found.buzzing) == buzzing(guitar, wanted)
    assert found.notes == len(wanted) == 44


@pytest.mark.slow
def test_heights_are_affine_in_what_is_turned(guitar: Preset, wanted: list[Wanted]) -> None:
    now = np.array([each.now_mm for each in adjustments(guitar)])
    for each in wanted[:12]:

        def at(values: np.ndarray, each: Wanted = each) -> np.ndarray:
            preset = adjusted(guitar, values)
            return below(preset, each.place, each.prepared.opened, each.prepared.note.position.length_m).heights_m

        step = np.array([0.3, -0.1])
        assert at(now + 2.0 * step) - at(now) == pytest.approx(2.0 * (at(now + step) - at(now)), abs=1e-12)


@pytest.mark.slow
def test_a_want_beyond_the_bounds_says_what_still_buzzes(guitar: Preset) -> None:
    loud = guitar.with_setting("pluck.displacement_mm", "19")
    found = lowest(loud, notes_of(loud, "no buzz at hard", ["G3"], "draft"), threads=2)
    assert found.remaining
    assert found.values_mm[0] == found.adjustments[0].high_mm


def test_frets_measured_one_by_one_are_turned_as_a_neck_is() -> None:
    preset = load_preset("fretted-bass")
    action, relief = adjustments(preset)
    assert (action.now_mm, relief.name) == (2.33, RELIEF)
    other = adjusted(preset, (3.0, relief.now_mm))
    heights = np.array(other.obstacle.heights_mm) - np.array(preset.obstacle.heights_mm)
    x = 1.0 - 2.0 ** (-np.arange(1, 21) / 12.0)
    assert heights == pytest.approx(-0.67 * x / x[11], abs=1e-12)
    assert adjustments(adjusted(preset, (3.0, 0.2)))[1].now_mm == pytest.approx(
        0.2, abs=2e-6
    )  # the middle fret is not half way
    ((path, values),) = settings(preset, (3.0, 0.2))
    assert path == "obstacle.heights_mm"
    assert values == pytest.approx(adjusted(preset, (3.0, 0.2)).obstacle.heights_mm, abs=1e-4)


def test_a_setup_table_has_an_action_for_each_side() -> None:
    preset = load_preset("electric-guitar")
    shape = preset.obstacle.model_dump(exclude_unset=True)
    for key in ("action_12th_mm", "relief_mm", "nut_height_mm"):
        shape.pop(key, None)
    data = preset.model_dump(exclude_unset=True) | {
        "obstacle": shape,
        "setup": {"action_bass_mm": 2.0, "action_treble_mm": 1.5, "relief_mm": 0.2},
    }
    from synth.instrument.preset import validate_preset

    found = validate_preset(data, "test")
    assert [each.now_mm for each in adjustments(found)] == [2.0, 1.5, 0.2]
    assert settings(found, (1.8, 1.4, 0.25)) == [
        ("setup.action_bass_mm", 1.8),
        ("setup.action_treble_mm", 1.4),
        ("setup.relief_mm", 0.25),
    ]
    treble = lowest(found, notes_of(found, "no buzz at medium", ["E4"], "draft"), threads=2)
    assert treble.values_mm[0] == 2.0  # nothing was asked of the bass side
    assert not treble.remaining


def test_an_instrument_without_a_neck_is_refused() -> None:
    with pytest.raises(PresetError, match='ask for "longest buzz"'):
        adjustments(load_preset("tanpura-light"))


def test_bounds_hold_what_is_there_now() -> None:
    preset = load_preset("double-bass")
    action = adjustments(preset)[0]
    assert action.now_mm == 9.0 == action.high_mm


def test_a_wish_that_lets_every_note_buzz_is_refused(guitar: Preset) -> None:
    with pytest.raises(ValueError, match="lets every note buzz"):
        notes_of(guitar, "no buzz at medium, except open strings may buzz, except frets 1-30 may buzz")


@pytest.mark.slow
def test_progress_goes_to_the_end_and_never_back() -> None:
    from synth.setup.proposals import propose

    told: list[float] = []
    guitar = load_preset("electric-guitar")
    want = parse("no buzz at medium", [each.name for each in guitar.string])
    propose(guitar, want, strings=["E2"], threads=2, told=lambda done, total: told.append(done / total))
    assert told == sorted(told) and told[-1] == 1.0 and len({*told}) > 6
