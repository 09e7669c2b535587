"""What is wrong with a neck that buzzes: a high fret, a backbow, a low nut, or an action that is low.

Each is told from the others by its repair: how many of the notes that touch at their strokes would not, were it mended.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from synth.instrument.compile import obstacle_of
from synth.instrument.preset import FretsObstacle, Preset, at_note
from synth.physics.obstacle import fret_positions
from synth.setup.adjustments import RELIEF, adjusted, adjustments
from synth.setup.fretwork import BACKBOW_M, FEWEST, Neck, neck_of
from synth.setup.lowest import Wanted
from synth.setup.places import FretPlace, places_of
from synth.setup.plucking import stroke_of

#: relief that a neck bent backwards is given [mm]
STRAIGHT_MM = 0.1
#: notes that touch nothing over a nut this much higher [m] touch because it is low
_MOST_NUT_M = 1e-3

#: frets that an open string is compared with, and how much softer its stroke at the touch must be
_FIRST_FRETS, _SOFTER = (1, 2, 3), 0.9

#: keys of [setup] that are measured at a fret, by its number
_MEASURED_AT = {1: ("nut_bass_mm", "nut_treble_mm"), 12: ("action_bass_mm", "action_treble_mm")}
#: heights under a note (C,) [m]
Heights = Callable[[Wanted], np.ndarray]

HIGH_FRET, BACKBOW, LOW_NUT, LOW_ACTION = "high fret", "backbow", "low nut", "low action"


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    kind     HIGH_FRET, BACKBOW, LOW_NUT or LOW_ACTION
    where    number of the fret, or name of the string, as text; "" for the whole neck
    by_m     by how much a fret is to be dressed, a nut slot or a string raised, or a neck is bent [m]
    clears   notes that touch now and would not, were it mended
    of       how many touch now
    """

    kind: str
    where: str
    by_m: float
    clears: tuple[FretPlace, ...]
    of: int


def _touching(notes: Sequence[Wanted], heights: Heights) -> list[Wanted]:
    """Those of the notes whose strokes touch over heights [m]."""
    return [each for each in notes if np.any(-heights(each) < _deepest_m(each))]


def _deepest_m(each: Wanted) -> np.ndarray:
    """How far down a note's stroke goes over each contact (C,) [m]."""
    note = each.prepared.note
    return note.stroke.displacement_m * note.deepest


def has_own_heights(preset: Preset) -> bool:
    """Whether every fret of a preset has a height of its own, so that one may be high."""
    shape, setup = preset.obstacle, preset.setup
    if not isinstance(shape, FretsObstacle) or shape.count < FEWEST:
        return False
    return bool(setup.fret_heights_mm if setup is not None and setup.shapes_the_neck else shape.heights_mm)


def neck_under(preset: Preset) -> Neck | None:
    """The neck under a preset's lowest string, where a round board adds nothing; None where frets have no heights of their
    own."""
    if not has_own_heights(preset):
        return None
    place = min(places_of(preset, None, {0}), key=lambda each: each.opened)
    table = place.table(preset)
    whole = obstacle_of(preset, table, place.opened, at_note(table.length_m, place.opened))
    return neck_of(np.array(whole.positions_m), np.array(whole.heights_m))


def relief_of(preset: Preset) -> float | None:
    """Hollow of a preset's neck [m]; negative: backbow. None where it has no frets."""
    neck = neck_under(preset)
    if neck is not None:
        return neck.relief_m
    if not isinstance(preset.obstacle, FretsObstacle):
        return None
    return 1e-3 * next(each.now_mm for each in adjustments(preset) if each.name == RELIEF)


def faults(preset: Preset, notes: Sequence[Wanted]) -> tuple[list[Fault], Neck | None]:
    """The faults of a preset's neck by what they clear, most first, and the neck as it is.

    notes: as `lowest.wanted_notes` has them. Without one that touches there is no fault but frets that are high.
    """

    def heights(each: Wanted) -> np.ndarray:
        return _heights(preset, each)

    now = _touching(notes, heights)
    neck, relief_m = neck_under(preset), relief_of(preset)
    found = []

    def fault(kind: str, where: str, by_m: float, mended: Heights) -> None:
        left = {id(each) for each in _touching(notes, mended)}
        clears = tuple(each.place for each in now if id(each) not in left)
        found.append(Fault(kind, where, by_m, clears, len(now)))

    if neck is not None:
        for number in neck.high:
            by = float(neck.excess_m[number - 1])
            dressed = with_dressed(preset, {number: by})
            fault(HIGH_FRET, str(number), by, lambda each, dressed=dressed: _heights(dressed, each))  # type: ignore[misc]
    if relief_m is not None and relief_m < -BACKBOW_M and now:
        more = 1e-3 * STRAIGHT_MM - relief_m
        straight = _turned(preset, relief_m=more)
        fault(BACKBOW, "", more, lambda each: _heights(straight, each))
    found += _low_nuts(preset, notes, now)
    if now:
        raised = _turned(preset, action_m=1e-3)

        def rise(each: Wanted) -> np.ndarray:
            return 1e3 * (heights(each) - _heights(raised, each))

        by = _missing_action_m(now, heights, rise)
        fault(LOW_ACTION, "", by, lambda each: heights(each) - by * rise(each))
    found.sort(key=lambda each: (each.kind == LOW_ACTION, -len(each.clears)))
    return found, neck


def _heights(preset: Preset, each: Wanted) -> np.ndarray:
    return each.below(preset).heights_m


def with_dressed(preset: Preset, by_m: dict[int, float]) -> Preset:
    """The preset with frets, by number, lower by so much [m], its strings where they are: only where each fret has a height
    of its own. Clearances that [setup] has at frets 1 and 12 are measured on the dressed ones."""
    shape, setup = preset.obstacle, preset.setup
    assert isinstance(shape, FretsObstacle)
    if setup is None or not setup.shapes_the_neck:
        lowered = _lowered(shape.heights_mm, by_m)
        return preset.model_copy(update={"obstacle": shape.model_copy(update={"heights_mm": lowered})})
    changed: dict[str, Any] = {"fret_heights_mm": _lowered(setup.fret_heights_mm, by_m)}
    for number, keys in _MEASURED_AT.items():
        for key in keys:
            if (value := getattr(setup, key)) is not None:
                changed[key] = value + 1e3 * by_m.get(number, 0.0)
    return preset.model_copy(update={"setup": setup.model_copy(update=changed)})


def _lowered(heights_mm: Sequence[float], by_m: dict[int, float]) -> tuple[float, ...]:
    return tuple(each - 1e3 * by_m.get(number, 0.0) for number, each in enumerate(heights_mm, start=1))


def _turned(preset: Preset, *, action_m: float = 0.0, relief_m: float = 0.0) -> Preset:
    """The preset with so much more action and relief."""
    return adjusted(
        preset, [each.now_mm + 1e3 * (relief_m if each.name == RELIEF else action_m) for each in adjustments(preset)]
    )


def _missing_action_m(notes: Sequence[Wanted], heights: Heights, rise: Heights) -> float:
    """Action that notes which touch are short of [m]; rise: clearance at each contact by a metre more of action."""
    missing = 0.0
    for each in notes:
        short, slope = _deepest_m(each) + heights(each), rise(each)
        able = slope > 1e-6
        missing = max(missing, float((short[able] / slope[able]).max(initial=0.0)))
    return missing * (1.0 + 1e-9)


def _low_nuts(preset: Preset, notes: Sequence[Wanted], now: Sequence[Wanted]) -> list[Fault]:
    """Open strings that touch, at softer strokes than the same string stopped at each of the first frets: their slots are
    low. Strings of which none of these frets is among the notes are left out, and those over a sawari."""
    shape = preset.obstacle
    found: list[Fault] = []
    if not isinstance(shape, FretsObstacle):
        return found
    for each in now:
        heights = _heights(preset, each)
        same = (each.place.index, each.place.opened)
        first = [
            other for other in notes if (other.place.index, other.place.opened) == same and other.place.fret in _FIRST_FRETS
        ]
        if each.place.fret != 0 or not first or heights.size != shape.count:
            continue
        if _strength(preset, each) > _SOFTER * min(_strength(preset, other) for other in first):
            continue
        raised = 1.0 - fret_positions(1.0, heights.size)
        by = float(((_deepest_m(each) + heights) / raised).max())
        if by <= _MOST_NUT_M:
            found.append(Fault(LOW_NUT, each.place.string, by, (each.place,), len(now)))
    return found


def _strength(preset: Preset, each: Wanted) -> float:
    """Displacement at which a note touches over that of the hardest stroke there, whatever stroke the wish has."""
    ready = each.prepared
    hardest = stroke_of(preset, ready.string, ready.note.position, 127.0)
    return float(ready.note.reach_m(each.below(preset)).min()) / hardest.displacement_m
