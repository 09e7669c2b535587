"""The lowest action and relief at which nothing buzzes that must not.

Until it touches, a string's clearance over a fret is affine in action and relief, so that the lowest set-up that touches
nothing is a linear programme. A note may touch a little before a buzz is heard; the strokes of the programme are made
smaller by one factor, found by bisection, as long as no note buzzes audibly at its full stroke.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linprog

from synth.instrument.preset import Preset
from synth.native.denormals import enable_ftz, restore
from synth.physics.string import String
from synth.setup.adjustments import RELIEF, Adjustment, adjusted, adjustments, settings
from synth.setup.audible import AUDIBLE_DB
from synth.setup.buzz_map import Prepared, computed, prepare
from synth.setup.places import Place, below, check_touches, opened_string, places_of
from synth.setup.wants import Want

#: what a millimetre of relief counts beside one of action
_RELIEF_COUNTS = 0.5
#: strokes are made smaller by this factor at most, which is found so closely
_LEAST_FACTOR, _WITHIN = 0.5, 0.002
#: what a millimetre counts that cannot be had
_MISSING_COUNTS = 1e4
#: proposals are rounded to this [mm]
_ROUNDED_MM = 0.01


@dataclass(frozen=True)
class Wanted:
    """A note at which nothing may buzz, by the stroke that is wanted there."""

    prepared: Prepared
    opened: String

    @property
    def place(self) -> Place:
        """Where it is."""
        return self.prepared.place

    def buzz_db(self, preset: Preset) -> float:
        """B of the stroke over the neck of a preset that differs in that alone; inf where the string rests on it."""
        under = below(preset, self.place, self.opened, self.prepared.note.position.length_m)
        if np.any(under.heights_m >= 0.0):
            return float("inf")
        displacement = self.prepared.note.stroke.displacement_m
        if displacement <= float(self.prepared.note.reach_m(under).min(initial=np.inf)):
            return 0.0
        flush = enable_ftz()
        try:
            return self.prepared.note.play(displacement, under).buzz_db
        finally:
            restore(flush)

    def least_clearance_m(self, preset: Preset) -> float:
        """The least clearance of the stroke over that neck [m], were nothing touched."""
        under = below(preset, self.place, self.opened, self.prepared.note.position.length_m)
        clearance = self.prepared.note.clearance_m(self.prepared.note.stroke.displacement_m, under)
        return float(clearance.min(initial=np.inf))


@dataclass(frozen=True)
class Proposal:
    """A set-up that keeps a want.

    adjustments   what may be turned, and how it is now
    values_mm     to what it is to be turned, in that order
    settings      [(path, value)] of the preset
    buzzing       notes that buzz now though they must not
    remaining     notes that still buzz in the proposed set-up: empty where the want can be kept
    limiting      notes that would be the first to buzz if it were lower
    notes         how many the want concerns
    """

    adjustments: tuple[Adjustment, ...]
    values_mm: tuple[float, ...]
    settings: tuple[tuple[str, Any], ...]
    buzzing: tuple[Place, ...]
    remaining: tuple[Place, ...]
    limiting: tuple[Place, ...]
    notes: int


def wanted_notes(
    preset: Preset,
    want: Want,
    *,
    place_m: float | None = None,
    quality: str = "standard",
    strings: Sequence[str] | None = None,
    threads: int = 1,
    told: Callable[[int, int], None] | None = None,
) -> list[Wanted]:
    """The notes that a want concerns, ready to be played. Raises PresetError, ValueError; KeyboardInterrupt."""
    check_touches(preset)
    concerned = [each for each in places_of(preset, strings) if want.velocity(each) is not None]

    def one(place: Place) -> Wanted:
        velocity = want.velocity(place)
        assert velocity is not None
        ready = prepare(preset, place, velocity, place_m, quality)
        _ = ready.note.deepest
        return Wanted(ready, opened_string(preset, place))

    made, complete = computed(one, concerned, threads, told)
    if not complete:
        raise KeyboardInterrupt
    return list(made)


def lowest(
    preset: Preset,
    notes: Sequence[Wanted],
    *,
    audible_db: float = AUDIBLE_DB,
    threads: int = 1,
    told: Callable[[int, int], None] | None = None,
) -> Proposal:
    """The lowest set-up of a preset's neck at which none of the notes buzzes. Raises PresetError for what has no neck."""
    turned = adjustments(preset)
    programme = _Programme(preset, notes, turned)

    def failing(values: Sequence[float]) -> list[Wanted]:
        at = adjusted(preset, values)
        found, complete = computed(lambda each: each.buzz_db(at), list(notes), threads)
        if not complete:
            raise KeyboardInterrupt
        return [each for each, level in zip(notes, found, strict=True) if level >= audible_db]

    now = [each.now_mm for each in turned]
    buzzing = failing(now)
    steps, done = int(np.ceil(np.log2((1.0 - _LEAST_FACTOR) / _WITHIN))), 0
    low, high = _LEAST_FACTOR, 1.0
    values, possible = programme.solve(high)
    while possible and high - low > _WITHIN:
        middle = 0.5 * (low + high)
        tried, _ = programme.solve(middle)
        if failing(tried):
            low = middle
        else:
            high, values = middle, tried
        done += 1
        if told is not None:
            told(min(done, steps), steps)
    remaining = failing(values)
    at = adjusted(preset, values)
    room = np.array([each.least_clearance_m(at) / each.prepared.note.stroke.displacement_m for each in notes])
    order = np.argsort(room)[:3]
    return Proposal(
        turned,
        tuple(values),
        tuple(settings(preset, values)),
        tuple(each.place for each in buzzing),
        tuple(each.place for each in remaining),
        tuple(notes[int(k)].place for k in order),
        len(notes),
    )


class _Programme:
    """Clearances of all notes over all contacts as affine functions of what is turned [mm]."""

    def __init__(self, preset: Preset, notes: Sequence[Wanted], turned: Sequence[Adjustment]) -> None:
        self._turned = turned
        now = np.array([each.now_mm for each in turned])
        presets = [adjusted(preset, now + step) for step in (np.zeros(now.size), *np.eye(now.size))]
        rows, offsets, needs = [], [], []
        for each in notes:
            note = each.prepared.note
            heights = [below(at, each.place, each.opened, note.position.length_m).heights_m for at in presets]
            slopes = np.array([1e3 * (heights[0] - other) for other in heights[1:]]).T  # clearance by each [mm/mm]
            rows.append(slopes)
            offsets.append(-1e3 * heights[0] - slopes @ now)
            needs.append(1e3 * note.stroke.displacement_m * note.deepest)
        self._rows, self._offsets, self._needs = np.vstack(rows), np.concatenate(offsets), np.concatenate(needs)

    def solve(self, factor: float) -> tuple[list[float], bool]:
        """(values, whether they lie within bounds) of the lowest set-up at which strokes so many times as large touch
        nothing; where there is none, of the one that comes nearest. Values are rounded: relief to the nearest, then the
        action that goes with it up."""
        bounds = [(each.low_mm, each.high_mm) for each in self._turned]
        values, _ = self._solved(factor, bounds)
        for k, each in enumerate(self._turned):
            if each.name == RELIEF:
                relief = _ROUNDED_MM * round(values[k] / _ROUNDED_MM)
                bounds[k] = (relief, relief)
        values, possible = self._solved(factor, bounds)
        for k, each in enumerate(self._turned):
            up = values[k] if each.name == RELIEF else _ROUNDED_MM * float(np.ceil(values[k] / _ROUNDED_MM - 1e-6))
            values[k] = round(min(each.high_mm, up), 4)
        return values, possible

    def _solved(self, factor: float, bounds: Sequence[tuple[float, float]]) -> tuple[list[float], bool]:
        count = len(self._turned)
        cost = [_RELIEF_COUNTS if each.name == RELIEF else 1.0 for each in self._turned]
        needed = np.maximum(factor * self._needs, 0.0)
        found = linprog(
            [*cost, _MISSING_COUNTS],
            A_ub=np.hstack([-self._rows, -np.ones((self._rows.shape[0], 1))]),
            b_ub=self._offsets - needed,
            bounds=[*bounds, (0.0, None)],
            method="highs",
        )
        return [float(each) for each in found.x[:count]], bool(found.x[count] < 1e-6)
