"""A map's thresholds beside the true ones."""

from __future__ import annotations

import math
from dataclasses import dataclass

from setup_truth.draw import Drawn
from setup_truth.scene import scene_of
from setup_truth.search import AUDIBLE_DB, Search
from synth.setup import buzz_map
from synth.setup.buzz_map import Spot
from synth.units import midi_to_note

#: deviations up to which two thresholds agree
AGREED = 0.03


@dataclass(frozen=True)
class Truth:
    """Thresholds of a note, inf: none up to the limit [m], and how many runs they took."""

    touch_m: float
    buzz_m: float
    limit_m: float
    runs: int


@dataclass(frozen=True)
class Row:
    """A note with both answers."""

    note: Drawn
    spot: Spot
    true: Truth

    @property
    def touch_deviation(self) -> float:
        """Of the map's touch from the true one; 0 where both have none, inf where they differ in that."""
        return deviation(self.spot.touch_m, self.true.touch_m, self.true.limit_m)

    @property
    def buzz_deviation(self) -> float:
        """Of the map's buzz from the true one, likewise."""
        return deviation(self.spot.buzz_m, self.true.buzz_m, self.true.limit_m)

    @property
    def held(self) -> bool:
        """Whether the map's interval holds the true buzz."""
        return self.spot.low_m <= self.true.buzz_m <= self.spot.high_m

    @property
    def cells(self) -> tuple[str, ...]:
        """The row of a table."""
        setup, stroke = self.note.words
        spot = self.spot
        return (
            self.note.preset, f"{spot.string} ({midi_to_note(self.note.opened)})", str(spot.fret), setup, stroke,
            _mm(spot.touch_m), _mm(self.true.touch_m), _percent(self.touch_deviation),
            _mm(spot.buzz_m), _mm(self.true.buzz_m), _percent(self.buzz_deviation),
            f"{_mm(spot.low_m)}–{_mm(spot.high_m)}", "yes" if self.held else "NO", "~" if spot.returns_m > 0.0 else "",
        )  # fmt: skip


#: what the cells are
HEADINGS = (
    "preset", "string", "fret", "setup, mm", "stroke", "touch", "true", "%", "buzz", "true", "%", "interval", "held",
    "chaotic",
)  # fmt: skip


def deviation(found_m: float, true_m: float, limit_m: float) -> float:
    """Relative deviation of a threshold. Where one of both is beyond the limit, it counts as at the limit if the other lies
    within `AGREED` of that, else as inf."""
    if math.isinf(found_m) and math.isinf(true_m):
        return 0.0
    if math.isinf(found_m) or math.isinf(true_m):
        other = min(found_m, true_m)
        return limit_m / other - 1.0 if other >= (1.0 - AGREED) * limit_m else math.inf
    return found_m / true_m - 1.0


def mapped(note: Drawn, quality: str = buzz_map.QUALITY) -> Spot:
    """What the map says of a note at a quality."""
    preset = note.loaded()
    return buzz_map.spot(
        preset, note.place(preset), velocity=note.velocity, place_m=note.place_m, quality=quality, audible_db=AUDIBLE_DB
    )


def truth(note: Drawn, quality: str = "reference") -> Truth:
    """What runs of `simulate` at a quality say of it."""
    scene = scene_of(note)
    search = Search(scene, quality)
    touch = search.touch_m()
    buzz = search.buzz_m(touch) if math.isfinite(touch) else math.inf
    return Truth(touch, buzz, scene.limit_m, search.runs)


def compared(note: Drawn, quality: str = "reference", of_map: str = buzz_map.QUALITY) -> Row:
    """Both: the truth at a quality, the map at another."""
    return Row(note, mapped(note, of_map), truth(note, quality))


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.3f}" if math.isfinite(metres) else "> limit"


def _percent(share: float) -> str:
    return f"{100.0 * share:+.2f}" if math.isfinite(share) else "missed"
