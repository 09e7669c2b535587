"""What is wrong with a neck that buzzes: a high fret, a backbow, a low nut, or an action that is low.

Each is told from the others by its repair: how many of the notes that touch at their strokes would not, were it mended.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from synth.instrument.compile import obstacle_of
from synth.instrument.preset import FretsObstacle, Preset, at_note
from synth.physics.obstacle import fret_positions
from synth.setup.adjustments import RELIEF, adjusted, adjustments
from synth.setup.fretwork import BACKBOW_M, FEWEST, Neck, neck_of
from synth.setup.lowest import Wanted
from synth.setup.places import Place, places_of
from synth.setup.plucking import stroke_of

#: relief that a neck bent backwards is given [mm]
STRAIGHT_MM = 0.1
#: notes that touch nothing over a nut this much higher [m] touch because it is low
_MOST_NUT_M = 1e-3

#: frets that an open string is compared with, and how much softer its stroke at the touch must be
_FIRST_FRETS, _SOFTER = (1, 2, 3), 0.9

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
    clears: tuple[Place, ...]
    of: int


@dataclass(frozen=True)
class Touching:
    """The notes of a want over the necks that are compared: which of them touch."""

    notes: Sequence[Wanted]

    def over(self, heights: Callable[[Wanted], np.ndarray]) -> list[Wanted]:
        """Those whose strokes touch over heights [m]."""
        found = []
        for each in self.notes:
            note = each.prepared.note
            eta = heights(each)
            if eta.size and np.any(-eta < note.stroke.displacement_m * note.deepest):
                found.append(each)
        return found


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
    touching = Touching(notes)
    now = touching.over(lambda each: _heights(preset, each))
    neck, relief_m = neck_under(preset), relief_of(preset)
    found = []

    def fault(kind: str, where: str, by_m: float, mended: Callable[[Wanted], np.ndarray]) -> None:
        left = {id(each) for each in touching.over(mended)}
        clears = tuple(each.place for each in now if id(each) not in left)
        found.append(Fault(kind, where, by_m, clears, len(now)))

    if neck is not None:
        for number in neck.high:
            by = float(neck.excess_m[number - 1])
            fault(HIGH_FRET, str(number), by, lambda each, n=number, h=by: _dressed_heights(preset, each, {n: h}))  # type: ignore[misc]
    if relief_m is not None and relief_m < -BACKBOW_M and now:
        more = 1e-3 * STRAIGHT_MM - relief_m
        straight = _bent(preset, more)
        fault(BACKBOW, "", more, lambda each: _heights(straight, each))
    found += _low_nuts(preset, notes, now)
    if now:
        by = _missing_action_m(preset, now)
        fault(LOW_ACTION, "", by, lambda each: _heights(preset, each) - by * _rise(preset, each))
    found.sort(key=lambda each: (each.kind == LOW_ACTION, -len(each.clears)))
    return found, neck


def _heights(preset: Preset, each: Wanted) -> np.ndarray:
    return each.below(preset).heights_m


def _dressed_heights(preset: Preset, each: Wanted, dressed_m: dict[int, float]) -> np.ndarray:
    """Heights under a note where some frets are lower by so much: the string that is stopped at one goes down with it."""
    heights = _heights(preset, each).copy()
    if not isinstance(preset.obstacle, FretsObstacle):
        return heights
    count = preset.obstacle.count
    fret, speaking = each.place.fret, each.prepared.note.position.length_m
    numbers = np.arange(fret + 1, count + 1)
    x = fret_positions(each.opened.length_m, count)[fret:]
    at = heights.size - numbers.size  # a sawari comes first
    for number, by in dressed_m.items():
        if number == fret:
            heights[at:] += by * (each.opened.length_m - x) / speaking
        heights[at:][numbers == number] -= by
    return heights


def _rise(preset: Preset, each: Wanted) -> np.ndarray:
    """Clearance at each contact of a note by a metre more of action."""
    turned = adjustments(preset)
    now = np.array([one.now_mm for one in turned])
    step = np.array([0.0 if one.name == RELIEF else 1.0 for one in turned])
    return 1e3 * (_heights(preset, each) - _heights(adjusted(preset, now + step), each))


def _missing_action_m(preset: Preset, now: Sequence[Wanted]) -> float:
    """Action that the notes which touch are short of [m]."""
    missing = 0.0
    for each in now:
        note, rise = each.prepared.note, _rise(preset, each)
        short = note.stroke.displacement_m * note.deepest + _heights(preset, each)
        able = rise > 1e-6
        missing = max(missing, float((short[able] / rise[able]).max(initial=0.0)))
    return missing * (1.0 + 1e-9)


def _bent(preset: Preset, by_m: float) -> Preset:
    """The preset with a neck so much more hollow, its action as it is."""
    turned = adjustments(preset)
    return adjusted(preset, [each.now_mm + (1e3 * by_m if each.name == RELIEF else 0.0) for each in turned])


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
        note = each.prepared.note
        raised = 1.0 - fret_positions(each.opened.length_m, heights.size) / each.opened.length_m
        short = note.stroke.displacement_m * note.deepest + heights
        by = float((short / raised).max())
        if by <= _MOST_NUT_M:
            found.append(Fault(LOW_NUT, each.place.string, by, (each.place,), len(now)))
    return found


def _strength(preset: Preset, each: Wanted) -> float:
    """Displacement at which a note touches over that of the hardest stroke there, whatever stroke the wish has."""
    ready = each.prepared
    hardest = stroke_of(preset, ready.string, ready.note.position, 127.0)
    return float(ready.note.reach_m(each.below(preset)).min()) / hardest.displacement_m
