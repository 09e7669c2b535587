"""The lowest action and relief at which nothing buzzes that must not.

Until it touches, a string's clearance over a fret is affine in action and relief, so that the lowest set-up that touches
nothing is a linear programme. A note may touch a little before a buzz is heard: each stroke counts in the programme with the
share of its displacement at which the note touches when the whole of it just buzzes. That share is found at the set-up of
the programme before, in a few rounds. At the end what is proposed is played: shares are raised together until nothing
buzzes, then the action is lowered in steps as long as nothing does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from synth.instrument.preset import Preset
from synth.setup.adjustments import RELIEF, Adjustment, adjusted, adjustments, settings
from synth.setup.audible import AUDIBLE_DB
from synth.setup.buzz_map import QUALITY, Prepared, prepare
from synth.setup.places import Below, FretPlace, below, check_touches, places_of
from synth.setup.side_by_side import all_computed
from synth.setup.thresholds import first_reaching
from synth.setup.wants import Want

#: what a millimetre of relief counts beside one of action
_RELIEF_COUNTS = 0.5
#: rounds of the programme; notes that touch up to so many times their stroke count; least share, and how closely it is found
_ROUNDS, _NEAR, _LEAST_SHARE, _SHARE_WITHIN = 2, 1.2, 0.5, 4e-3
#: how much shares are raised at a time while something buzzes
_RAISED = 1.005
#: steps by which the action is lowered at the end, at most
_LOWERED = 40
#: what a millimetre counts that cannot be had
_MISSING_COUNTS = 1e4
#: proposals are rounded to this [mm]
_ROUNDED_MM = 0.01


@dataclass(frozen=True)
class Wanted:
    """A note at which nothing may buzz, by the stroke that is wanted there."""

    prepared: Prepared

    @property
    def place(self) -> FretPlace:
        """Where it is."""
        return self.prepared.place

    def below(self, preset: Preset) -> Below:
        """What lies below it on the neck of a preset."""
        return below(preset, self.place, self.prepared.opened, self.prepared.note.position.length_m)

    def buzz_db(self, preset: Preset) -> float:
        """B of the stroke over the neck of a preset that differs in that alone; inf where the string rests on it."""
        under, note = self.below(preset), self.prepared.note
        if np.any(under.heights_m >= 0.0):
            return math.inf
        displacement = note.stroke.displacement_m
        if displacement <= float(note.reach_m(under).min(initial=math.inf)):
            return 0.0
        return note.play(displacement, under).buzz_db

    def touching_share(self, preset: Preset, audible_db: float) -> float | None:
        """The displacement at which the note touches over that at which it buzzes; None where both lie well beyond the
        stroke, or the string rests on a fret."""
        under, note = self.below(preset), self.prepared.note
        displacement, touch = note.stroke.displacement_m, float(note.reach_m(under).min(initial=math.inf))
        if touch > _NEAR * displacement or touch <= 0.0:
            return None
        most = touch / _LEAST_SHARE
        buzz = first_reaching(lambda d: note.play(d, under).buzz_db, touch, most, audible_db, _SHARE_WITHIN)
        return max(_LEAST_SHARE, touch / buzz)

    def least_clearance_m(self, preset: Preset, share: float = 1.0) -> float:
        """The least clearance of a share of the stroke over that neck [m], were nothing touched."""
        note = self.prepared.note
        return float(note.clearance_m(share * note.stroke.displacement_m, self.below(preset)).min(initial=math.inf))


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
    buzzing: tuple[FretPlace, ...]
    remaining: tuple[FretPlace, ...]
    limiting: tuple[FretPlace, ...]
    notes: int


def wanted_notes(
    preset: Preset,
    want: Want,
    *,
    place_m: float | None = None,
    quality: str = QUALITY,
    strings: Sequence[str] | None = None,
    threads: int = 1,
    told: Callable[[int, int], None] | None = None,
) -> list[Wanted]:
    """The notes that a want concerns, ready to be played. Raises PresetError, ValueError; KeyboardInterrupt."""
    check_touches(preset)
    concerned = [each for each in places_of(preset, strings) if want.velocity(each) is not None]
    if not concerned:
        raise ValueError("the wish lets every note buzz; name notes that must not")

    def one(place: FretPlace) -> Wanted:
        velocity = want.velocity(place)
        assert velocity is not None
        ready = prepare(preset, place, velocity, place_m, quality)
        _ = ready.note.deepest
        return Wanted(ready)

    return list(all_computed(one, concerned, threads, told))


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
        found = all_computed(lambda each: each.buzz_db(at), notes, threads)
        return [each for each, level in zip(notes, found, strict=True) if level >= audible_db]

    def tell(done: int) -> None:
        if told is not None:
            told(done, _ROUNDS + 2)

    buzzing = failing([each.now_mm for each in turned])
    share = np.ones(len(notes))
    values, possible = programme.solve(share)
    for number in range(_ROUNDS):
        share = _shares(adjusted(preset, values), notes, share, audible_db, threads)
        values, possible = programme.solve(share)
        tell(number + 1)
    while possible and failing(values) and share.min() < 1.0:
        share = np.minimum(1.0, _RAISED * share)
        values, possible = programme.solve(share)
    tell(_ROUNDS + 1)
    if possible:
        values = _lowered(
            values, [each if moves else None for each, moves in zip(turned, programme.moves, strict=True)], failing
        )
    tell(_ROUNDS + 2)
    remaining = failing(values)
    at = adjusted(preset, values)
    room = np.array([each.least_clearance_m(at, part) for each, part in zip(notes, share, strict=True)])
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


def _shares(preset: Preset, notes: Sequence[Wanted], before: np.ndarray, audible_db: float, threads: int) -> np.ndarray:
    """(notes,) touching share of each note at a set-up; what it was before where that is not known."""
    found = all_computed(lambda each: each.touching_share(preset, audible_db), notes, threads)
    return np.array([old if here is None else here for old, here in zip(before, found, strict=True)])


def _lowered(
    values: list[float], turned: Sequence[Adjustment | None], failing: Callable[[Sequence[float]], Sequence[Wanted]]
) -> list[float]:
    """Values whose actions are lower, step by step, as long as nothing buzzes. None: what moves nothing."""
    for k, each in enumerate(turned):
        if each is None or each.name == RELIEF:
            continue
        for _ in range(_LOWERED):
            lower = list(values)
            lower[k] = round(values[k] - _ROUNDED_MM, 4)
            if lower[k] < each.low_mm or failing(lower):
                break
            values = lower
    return values


class _Programme:
    """Clearances of all notes over all contacts as affine functions of what is turned [mm]."""

    def __init__(self, preset: Preset, notes: Sequence[Wanted], turned: Sequence[Adjustment]) -> None:
        self._turned = turned
        now = np.array([each.now_mm for each in turned])
        presets = [adjusted(preset, now + step) for step in (np.zeros(now.size), *np.eye(now.size))]
        rows, offsets, needs = [], [], []
        for each in notes:
            note = each.prepared.note
            heights = [each.below(at).heights_m for at in presets]
            slopes = np.array([1e3 * (heights[0] - other) for other in heights[1:]]).T  # clearance by each [mm/mm]
            rows.append(slopes)
            offsets.append(-1e3 * heights[0] - slopes @ now)
            needs.append(1e3 * note.stroke.displacement_m * note.deepest)
        self._counts = [each.size for each in needs]
        self._rows, self._offsets, self._needs = np.vstack(rows), np.concatenate(offsets), np.concatenate(needs)

    @property
    def moves(self) -> list[bool]:
        """Whether each of what may be turned moves any of the notes."""
        return [bool(each > 1e-9) for each in np.abs(self._rows).max(axis=0)]

    def solve(self, share: np.ndarray) -> tuple[list[float], bool]:
        """(values, whether they lie within bounds) of the lowest set-up at which shares (notes,) of the strokes touch
        nothing; where there is none, of the one that comes nearest. Values are rounded: relief to the nearest, then the
        action that goes with it up."""
        bounds = [
            (each.low_mm, each.high_mm) if moves else (each.now_mm, each.now_mm)  # what moves nothing stays
            for each, moves in zip(self._turned, self.moves, strict=True)
        ]
        values, _ = self._solved(share, bounds)
        for k, (each, moves) in enumerate(zip(self._turned, self.moves, strict=True)):
            if each.name == RELIEF and moves:
                relief = _ROUNDED_MM * round(values[k] / _ROUNDED_MM)
                bounds[k] = (relief, relief)
        values, possible = self._solved(share, bounds)
        for k, each in enumerate(self._turned):
            up = _ROUNDED_MM * float(np.ceil(values[k] / _ROUNDED_MM - 1e-6))
            kept = each.name == RELIEF or bounds[k][0] == bounds[k][1]
            values[k] = round(values[k] if kept else min(each.high_mm, up), 4)
        return values, possible

    def _solved(self, share: np.ndarray, bounds: Sequence[tuple[float, float]]) -> tuple[list[float], bool]:
        from scipy.optimize import linprog

        count = len(self._turned)
        cost = [_RELIEF_COUNTS if each.name == RELIEF else 1.0 for each in self._turned]
        needed = np.maximum(np.repeat(share, self._counts) * self._needs, 0.0)
        found = linprog(
            [*cost, _MISSING_COUNTS],
            A_ub=np.hstack([-self._rows, -np.ones((self._rows.shape[0], 1))]),
            b_ub=self._offsets - needed,
            bounds=[*bounds, (0.0, None)],
            method="highs",
        )
        return [float(each) for each in found.x[:count]], bool(found.x[count] < 1e-6)
