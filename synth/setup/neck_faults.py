"""What is wrong with a neck that buzzes: a high fret, a backbow, a low nut, or an action that is low.

Each is told from the others by its repair: how many of the notes that touch at their strokes would not, were it mended.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from synth.instrument.compile import obstacle_of
from synth.instrument.preset import FretsObstacle, Preset
from synth.physics.obstacle import fret_positions
from synth.setup.adjustments import RELIEF, adjusted, adjustments
from synth.setup.fretwork import BACKBOW_M, FEWEST, Neck, neck_of
from synth.setup.lowest import Wanted
from synth.setup.places import Place, below

#: relief that a neck bent backwards is given [mm]
STRAIGHT_MM = 0.1
#: notes that touch nothing over a nut this much higher [m] touch because it is low
_MOST_NUT_M = 1e-3

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


def neck_under(preset: Preset, notes: Sequence[Wanted]) -> Neck | None:
    """The neck under the first of the notes; None where it has too few frets, or none."""
    if not isinstance(preset.obstacle, FretsObstacle) or preset.obstacle.count < FEWEST or not notes:
        return None
    first = notes[0]
    whole = obstacle_of(preset, first.place.table(preset), first.place.opened, first.opened.length_m)
    return neck_of(np.array(whole.positions_m), np.array(whole.heights_m))


def faults(preset: Preset, notes: Sequence[Wanted]) -> tuple[list[Fault], Neck | None]:
    """The faults of a preset's neck by what they clear, most first, and the neck as it is.

    notes: as `lowest.wanted_notes` has them. Without one that touches there is no fault but frets that are high.
    """
    touching = Touching(notes)
    now = touching.over(lambda each: _heights(preset, each))
    neck = neck_under(preset, notes)
    found = []

    def fault(kind: str, where: str, by_m: float, mended: Callable[[Wanted], np.ndarray]) -> None:
        left = {id(each) for each in touching.over(mended)}
        clears = tuple(each.place for each in now if id(each) not in left)
        found.append(Fault(kind, where, by_m, clears, len(now)))

    if neck is not None:
        for number in neck.high:
            by = float(neck.excess_m[number - 1])
            fault(HIGH_FRET, str(number), by, lambda each, n=number, h=by: _dressed_heights(preset, each, {n: h}))  # type: ignore[misc]
        if neck.relief_m < -BACKBOW_M and now:
            straight = _bent(preset, 1e-3 * STRAIGHT_MM - neck.relief_m)
            by = 1e-3 * STRAIGHT_MM - neck.relief_m
            fault(BACKBOW, "", by, lambda each: _heights(straight, each))
    found += _low_nuts(preset, now)
    if now:
        by = _missing_action_m(preset, now)
        fault(LOW_ACTION, "", by, lambda each: _heights(preset, each) - by * _rise(preset, each))
    found.sort(key=lambda each: (each.kind == LOW_ACTION, -len(each.clears)))
    return found, neck


def _heights(preset: Preset, each: Wanted) -> np.ndarray:
    return below(preset, each.place, each.opened, each.prepared.note.position.length_m).heights_m


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


def _low_nuts(preset: Preset, now: Sequence[Wanted]) -> list[Fault]:
    """Open strings that touch while the same string, stopped at the first frets, does not: their slots are low."""
    found = []
    for each in now:
        if each.place.fret != 0:
            continue
        stopped = [other for other in now if other.place.string == each.place.string and 1 <= other.place.fret <= 3]
        note, heights = each.prepared.note, _heights(preset, each)
        if not isinstance(preset.obstacle, FretsObstacle) or heights.size != preset.obstacle.count:
            continue
        raised = 1.0 - fret_positions(each.opened.length_m, heights.size) / each.opened.length_m
        short = note.stroke.displacement_m * note.deepest + heights
        by = float((short / raised).max())
        if by <= _MOST_NUT_M and not stopped:
            found.append(Fault(LOW_NUT, each.place.string, by, (each.place,), len(now)))
    return found
