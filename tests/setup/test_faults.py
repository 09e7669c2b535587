"""Random necks with one fault each, which must be told from the others."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from synth.instrument.compile import obstacle_of
from synth.instrument.preset import FretsObstacle, Preset, load_preset
from synth.instrument.setup_table import Setup
from synth.physics.obstacle import fret_positions
from synth.setup.fretwork import neck_of
from synth.setup.lowest import Wanted, wanted_notes
from synth.setup.neck_faults import BACKBOW, HIGH_FRET, LOW_ACTION, LOW_NUT, faults, with_dressed
from synth.setup.proposals import propose
from synth.setup.wants import parse

COUNT = 20
#: standard deviation of a fret's height as a good luthier leaves it [m]
SCATTER_M = 4e-6


@pytest.fixture(scope="module")
def bass() -> Preset:
    return load_preset("fretted-bass")


@pytest.fixture(scope="module")
def notes(bass: Preset) -> list[Wanted]:
    """Their strings do not depend on the neck."""
    return wanted_notes(bass, parse("no buzz at medium", ["E", "A", "D", "G"]), threads=2)


def neck(bass: Preset, rng: np.random.Generator, high: int | None = None, **changed: Any) -> Preset:
    """A random neck that is sound but for what is changed: crowns of 1.1 mm that scatter, one of them 50 µm higher."""
    crowns = 1.1 + 1e3 * rng.normal(0.0, SCATTER_M, COUNT)
    if high is not None:
        crowns[high - 1] += 0.05
    action = rng.uniform(3.0, 3.4)
    values = {
        "action_bass_mm": action,
        "action_treble_mm": action + rng.uniform(0.0, 0.2),
        "relief_mm": rng.uniform(0.35, 0.5),
        "nut_bass_mm": rng.uniform(0.75, 0.9),
        "fall_away_mm": rng.choice([0.0, rng.uniform(0.05, 0.25)]),
        "fall_away_fret": int(rng.integers(11, 15)),
        "fret_heights_mm": tuple(crowns.tolist()),
    } | changed
    shape = FretsObstacle.model_construct(kind="frets", count=COUNT, **_rest(bass))
    return bass.model_copy(update={"obstacle": shape, "setup": Setup.model_validate(values)})


def _rest(bass: Preset) -> dict[str, Any]:
    given = bass.obstacle.model_dump()
    return {key: value for key, value in given.items() if key not in ("kind", "count")} | {
        "heights_mm": (),
        "action_12th_mm": None,
    }


def kinds(preset: Preset, notes: list[Wanted]) -> list[str]:
    return [each.kind for each in faults(preset, notes)[0]]


def test_one_high_fret_is_found_with_its_number_and_its_height(bass: Preset, notes: list[Wanted]) -> None:
    rng = np.random.default_rng(34)
    found = 0
    for _ in range(20):
        number = int(rng.integers(1, COUNT + 1))
        wrong, _ = faults(neck(bass, rng, number), notes)
        high = [each for each in wrong if each.kind == HIGH_FRET]
        found += [each.where for each in high] == [str(number)] and abs(high[0].by_m - 50e-6) <= 10e-6
        assert BACKBOW not in [each.kind for each in wrong]
        assert LOW_NUT not in [each.kind for each in wrong]
    assert found >= 19


@pytest.mark.slow
def test_a_backbow_is_told_from_a_high_fret_and_a_low_nut(bass: Preset, notes: list[Wanted]) -> None:
    rng = np.random.default_rng(35)
    for _ in range(10):
        found = kinds(neck(bass, rng, relief_mm=rng.uniform(-0.5, -0.15), action_bass_mm=2.4, action_treble_mm=2.4), notes)
        assert found[0] == BACKBOW
        assert HIGH_FRET not in found


@pytest.mark.slow
def test_a_low_nut_is_told_from_a_high_fret_and_a_backbow(bass: Preset, notes: list[Wanted]) -> None:
    rng = np.random.default_rng(36)
    for _ in range(10):
        found = kinds(neck(bass, rng, nut_bass_mm=rng.uniform(0.03, 0.15), action_bass_mm=3.8, action_treble_mm=3.8), notes)
        assert found[0] == LOW_NUT
        assert HIGH_FRET not in found and BACKBOW not in found


@pytest.mark.slow
def test_a_sound_neck_has_no_fault(bass: Preset, notes: list[Wanted]) -> None:
    rng = np.random.default_rng(37)
    wrong = [kinds(neck(bass, rng, action_bass_mm=4.5, action_treble_mm=4.5, nut_bass_mm=1.2), notes) for _ in range(20)]
    assert sum(bool(each) for each in wrong) <= 1


def test_a_raised_nut_slot_clears_the_open_string(bass: Preset, notes: list[Wanted]) -> None:
    preset = neck(bass, np.random.default_rng(38), nut_bass_mm=0.1, action_bass_mm=3.8, action_treble_mm=3.8)
    low = [each for each in faults(preset, notes)[0] if each.kind == LOW_NUT and each.where == "G"]
    open_g = next(each for each in notes if each.place.string == "G" and each.place.fret == 0)
    (fault,) = low
    x = fret_positions(open_g.prepared.opened.length_m, COUNT)
    for raised, clear in ((0.98 * fault.by_m, False), (1.02 * fault.by_m, True)):
        gap = open_g.prepared.note.clearance_m(open_g.prepared.note.stroke.displacement_m, _under(preset, open_g))
        assert bool((gap + raised * (1.0 - x / open_g.prepared.opened.length_m)).min() > 0.0) == clear


def _under(preset: Preset, each: Wanted) -> Any:
    from synth.setup.places import below

    return below(preset, each.place, each.prepared.opened, each.prepared.note.position.length_m)


def test_a_fret_that_is_dressed_clears_what_touched_it(bass: Preset, notes: list[Wanted]) -> None:
    """What the fault says that dressing clears is what the dressed neck itself clears."""
    rng = np.random.default_rng(40)
    compared = 0
    for number in (4, 7, 15):
        preset = neck(bass, rng, number, action_bass_mm=2.9, action_treble_mm=2.95)
        fault = next(each for each in faults(preset, notes)[0] if each.kind == HIGH_FRET)
        dressed = with_dressed(preset, {number: fault.by_m})
        touching = {id(each) for each in notes if each.least_clearance_m(dressed) < 0.0}
        cleared = {each.place for each in notes if each.least_clearance_m(preset) < 0.0 and id(each) not in touching}
        assert cleared == set(fault.clears)
        compared += len(cleared)
    assert compared > 0


def test_low_action_is_what_is_left(bass: Preset, notes: list[Wanted]) -> None:
    preset = neck(bass, np.random.default_rng(39), action_bass_mm=1.8, action_treble_mm=1.8)
    wrong, _ = faults(preset, notes)
    (fault,) = [each for each in wrong if each.kind == LOW_ACTION]
    assert len(fault.clears) == fault.of > 10


@pytest.mark.parametrize("shape", [lambda s: 0.0 * s, lambda s: 0.4e-3 * 4.0 * s * (1.0 - s)])
def test_the_smooth_neck_is_no_fret(shape: Callable[[np.ndarray], np.ndarray]) -> None:
    x = fret_positions(0.648, 22)
    s = (x - x[0]) / (x[-1] - x[0])
    found = neck_of(x, -(1e-3 + 2e-3 * x) - shape(s))
    assert found.high == ()
    assert np.abs(found.excess_m).max() < 1e-9
    assert found.relief_m == pytest.approx(float(shape(np.array(0.5))), abs=1e-9)


def test_a_fall_away_is_no_backbow_and_no_high_fret() -> None:
    x = fret_positions(0.648, 22)
    s = (x - x[0]) / (x[-1] - x[0])
    fallen = 0.3e-3 * np.maximum(0.0, s - s[13]) / (1.0 - s[13])
    found = neck_of(x, -1e-3 - 0.2e-3 * 4.0 * s * (1.0 - s) - fallen)
    assert found.high == ()
    assert found.fall_away_m == pytest.approx(0.3e-3, abs=1e-6)
    assert found.relief_m == pytest.approx(0.2e-3, abs=1e-6)


def test_too_few_frets_are_refused() -> None:
    with pytest.raises(ValueError, match="must be 8 or more"):
        neck_of(np.arange(1.0, 5.0), np.zeros(4))


@pytest.mark.slow
def test_dressing_a_high_fret_lowers_the_action(bass: Preset) -> None:
    preset = neck(bass, np.random.default_rng(41), 2)
    answer = propose(preset, parse("no buzz at medium", ["E", "A", "D", "G"]), strings=["G"], threads=2)
    assert answer.dressed is not None
    assert not answer.proposal.remaining and not answer.dressed.remaining
    assert sum(answer.dressed.values_mm[:2]) < sum(answer.proposal.values_mm[:2]) - 0.05
    assert any("fret 2 by" in line for line in answer.lines())


@pytest.mark.parametrize("knee", range(3, 20))
def test_a_fall_away_from_any_fret_is_no_high_fret(knee: int) -> None:
    x = fret_positions(0.864, 22)
    s = (x - x[0]) / (x[-1] - x[0])
    fallen = 0.3e-3 * np.maximum(0.0, s - s[knee - 1]) / (1.0 - s[knee - 1])
    assert neck_of(x, -1e-3 - 0.3e-3 * 4.0 * s * (1.0 - s) - fallen).high == ()


@pytest.mark.slow
def test_a_low_nut_does_not_depend_on_what_is_wished() -> None:
    """The nut of the electric guitar is sound, however hard open strings alone are to be plucked."""
    guitar = load_preset("electric-guitar")
    names = [each.name for each in guitar.string]
    for text in ("no buzz at hard", "no buzz at medium, except open strings hard"):
        found = wanted_notes(guitar, parse(text, names), strings=["E4"], threads=2)
        assert LOW_NUT not in kinds(guitar, found)
    low = guitar.model_copy(update={"obstacle": guitar.obstacle.model_copy(update={"nut_height_mm": 0.15})})
    for text in ("no buzz at hard", "no buzz at medium, except open strings hard"):
        assert LOW_NUT in kinds(low, wanted_notes(low, parse(text, names), strings=["E4"], threads=2))


@pytest.mark.slow
def test_a_neck_given_by_its_action_has_no_high_fret() -> None:
    guitar = load_preset("electric-guitar")
    setup = Setup(action_bass_mm=1.8, relief_mm=0.2, fall_away_mm=0.3, fall_away_fret=16)
    shape = guitar.obstacle.model_copy(update={"action_12th_mm": None})
    fallen = guitar.model_copy(update={"obstacle": shape, "setup": setup})
    answer = propose(fallen, parse("no buzz at soft", [each.name for each in guitar.string]), strings=["E2"], threads=2)
    assert answer.dressed is None and answer.neck is None
    assert HIGH_FRET not in [each.kind for each in answer.faults]


@pytest.mark.parametrize("number", [1, 7, 12, 20])
@pytest.mark.parametrize("by_setup", [True, False])
def test_dressing_lowers_one_fret_and_moves_no_string(bass: Preset, number: int, by_setup: bool) -> None:
    """Also the frets at which the clearances of [setup] are measured."""
    preset = neck(bass, np.random.default_rng(42), number, nut_treble_mm=0.7) if by_setup else bass
    dressed = with_dressed(preset, {number: 50e-6})
    for table in (preset.string[0], preset.string[2]):
        before, after = (np.array(obstacle_of(each, table, table.notes[0], 0.863).heights_m) for each in (preset, dressed))
        expected = np.where(np.arange(1, COUNT + 1) == number, 50e-6, 0.0)
        assert np.abs(before - after - expected).max() < 1e-12
