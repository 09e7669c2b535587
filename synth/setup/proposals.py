"""A want answered: the lowest set-up that keeps it, what is wrong with the neck, and what a dressed fret would gain."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from synth.instrument.preset import Preset
from synth.setup.adjustments import Adjustment, adjustments
from synth.setup.audible import AUDIBLE_DB
from synth.setup.buzz_map import QUALITY
from synth.setup.fretwork import Neck
from synth.setup.lowest import Proposal, lowest, wanted_notes
from synth.setup.neck_faults import BACKBOW, HIGH_FRET, LOW_NUT, Fault, faults, with_dressed
from synth.setup.places import FretPlace
from synth.setup.report import by_string
from synth.setup.wants import Want

#: notes of a list that are named
_NAMED = 3


@dataclass(frozen=True)
class SetupAnswer:
    """What is proposed for a preset.

    proposal   the lowest set-up
    faults     what is wrong with the neck, what clears most first
    neck       the neck as it is; None where it has too few frets, or none
    dressed    the lowest set-up once the high frets are dressed; None where none is high
    """

    preset: str
    proposal: Proposal
    faults: tuple[Fault, ...]
    neck: Neck | None
    dressed: Proposal | None

    def lines(self) -> list[str]:
        """The answer as text."""
        found = self.proposal
        lines = [f"{self.preset}: {found.notes} notes that must not buzz; {_counted(found.buzzing)} now"]
        for fault in self.faults:
            lines.append("  " + _fault_text(fault))
        if self.neck is not None and not self.faults:
            lines.append("  no fret is high, and the neck is sound")
        lines.append("proposed:")
        for each, value in zip(found.adjustments, found.values_mm, strict=True):
            lines.append(
                f"  {each.name}: {each.now_mm:.2f} → {value:.2f} mm ({value - each.now_mm:+.2f}; bounds "
                f"{each.low_mm:g} and {each.high_mm:g}{_at_bound(value, each)})"
            )
        if found.remaining:
            lines.append(
                f"  not enough within these bounds: {_counted(found.remaining)}; ask for softer strokes, or raise the nut"
            )
        else:
            lines.append("  none of them buzzes there")
        lines.append(f"  first to buzz if it were lower: {_named(found.limiting)}")
        if self.dressed is not None:
            frets = " and ".join(
                f"fret {each.where} by {1e6 * each.by_m:.0f} µm" for each in self.faults if each.kind == HIGH_FRET
            )
            values = ", ".join(
                f"{each.name} {value:.2f} mm"
                for each, value in zip(self.dressed.adjustments, self.dressed.values_mm, strict=True)
            )
            lines.append(f"  with {frets} dressed: {values}")
        return lines

    def about(self) -> dict[str, Any]:
        """The answer as plain values."""
        found = self.proposal
        return {
            "notes": found.notes,
            "buzzing": [_plain(each) for each in found.buzzing],
            "proposed": [
                {
                    "name": each.name,
                    "now_mm": round(each.now_mm, 4),
                    "mm": value,
                    "low_mm": each.low_mm,
                    "high_mm": each.high_mm,
                }
                for each, value in zip(found.adjustments, found.values_mm, strict=True)
            ],
            "remaining": [_plain(each) for each in found.remaining],
            "limiting": [_plain(each) for each in found.limiting],
            "settings": dict(found.settings),
            "faults": [
                {"kind": each.kind, "where": each.where, "by_um": round(1e6 * each.by_m, 1),
                 "clears": [_plain(place) for place in each.clears], "touching": each.of}
                for each in self.faults
            ],
            "dressed": None
            if self.dressed is None
            else {each.name: value for each, value in zip(self.dressed.adjustments, self.dressed.values_mm, strict=True)},
        }  # fmt: skip


def propose(
    preset: Preset,
    want: Want,
    *,
    place_m: float | None = None,
    quality: str = QUALITY,
    audible_db: float = AUDIBLE_DB,
    strings: Sequence[str] | None = None,
    threads: int = 1,
    told: Callable[[int, int], None] | None = None,
) -> SetupAnswer:
    """The lowest set-up of a preset that keeps a want, and the faults of its neck. Raises PresetError, ValueError;
    KeyboardInterrupt."""
    adjustments(preset)  # raises, before anything is computed, where there is no neck
    parts = _Parts(told)
    notes = wanted_notes(
        preset, want, place_m=place_m, quality=quality, strings=strings, threads=threads, told=parts.of(0.0, 0.3)
    )
    wrong, neck = faults(preset, notes)
    high = {int(each.where): each.by_m for each in wrong if each.kind == HIGH_FRET}
    end = 0.65 if high else 1.0
    found = lowest(preset, notes, audible_db=audible_db, threads=threads, told=parts.of(0.3, end))
    dressed = None
    if high:
        other = with_dressed(preset, high)
        dressed = lowest(other, notes, audible_db=audible_db, threads=threads, told=parts.of(end, 1.0))
    return SetupAnswer(preset.name, found, tuple(wrong), neck, dressed)


class _Parts:
    """One progress, in hundredths, of computations that follow each other."""

    def __init__(self, told: Callable[[int, int], None] | None) -> None:
        self._told = told

    def of(self, begin: float, end: float) -> Callable[[int, int], None]:
        """What the computation is told that goes from a share of the whole to another."""

        def told(done: int, total: int) -> None:
            if self._told is not None:
                self._told(round(100.0 * (begin + (end - begin) * done / max(1, total))), 100)

        return told


def _fault_text(fault: Fault) -> str:
    gain = f"{len(fault.clears)} of the {fault.of} notes that touch would be clear"
    if not fault.of:
        gain = "no note touches it at these strokes"
    if fault.kind == HIGH_FRET:
        return f"high fret: fret {fault.where} stands {1e6 * fault.by_m:.0f} µm above the neck; dressed by that, {gain}"
    if fault.kind == BACKBOW:
        return f"backbow: the neck is bent backwards; with {1e3 * fault.by_m:.2f} mm more relief {gain}"
    if fault.kind == LOW_NUT:
        return f"low nut: the slot of string {fault.where} is {1e3 * fault.by_m:.2f} mm too low; raised by that, {gain}"
    return f"low action: {1e3 * fault.by_m:.2f} mm more at fret 12 at this relief, and {gain}"


def _at_bound(value: float, each: Adjustment) -> str:
    """That a value lies at a bound, which then decides, and not the strings."""
    return ", at its bound" if value in (each.low_mm, each.high_mm) else ""


def _counted(places: Sequence[FretPlace]) -> str:
    if not places:
        return "none buzzes"
    return f"{len(places)} buzz{'es' if len(places) == 1 else ''} ({by_string(places)})"


def _named(places: Sequence[FretPlace]) -> str:
    return "; ".join(
        f"string {each.string}, {'open' if each.fret == 0 else f'fret {each.fret}'}" for each in places[:_NAMED]
    )


def _plain(place: FretPlace) -> dict[str, Any]:
    return {"string": place.string, "fret": place.fret}
