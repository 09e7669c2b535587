"""What a buzz map is written as: a table of the neck for the terminal, rows for files."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from typing import Any

from synth.instrument.preset import Preset
from synth.instrument.wires import INCH_M, POUND_KG
from synth.setup.buzz_map import BuzzMap, Spot
from synth.setup.fretwork import BACKBOW_M
from synth.setup.neck_faults import neck_under, relief_of
from synth.setup.places import FretPlace, opened_string, places_of
from synth.units import midi_to_note

#: columns of a file, with the rows' numbers in millimetres; empty where there is none
COLUMNS = (
    "string", "fret", "note", "clearance_mm", "touch_mm", "touches", "buzz_mm", "buzzes_on", "buzz_low_mm", "buzz_high_mm",
    "chaotic_up_to_mm", "buzz_velocity", "stroke_mm", "stroke_buzz_db", "buzzes", "place_percent", "gauge_percent",
    "rests", "limit_mm",
)  # fmt: skip


def rows(found: BuzzMap) -> list[dict[str, Any]]:
    """A row for each note; None where nothing is touched or heard up to the limit."""
    return [_row(each) for each in found.spots]


def _row(spot: Spot) -> dict[str, Any]:
    values = (
        spot.string, spot.fret, midi_to_note(spot.note), _mm(spot.clearance_m), _mm(spot.touch_m),
        spot.touched or None, _mm(spot.buzz_m),
        spot.buzzes_on or None, _mm(spot.low_m), _mm(spot.high_m), _mm(spot.returns_m), _number(spot.buzz_velocity, 1),
        _mm(spot.stroke_m), _number(spot.stroke_db, 2), spot.buzzes, _number(spot.place_percent, 2),
        _number(spot.gauge_percent, 2), spot.resting, _mm(spot.limit_m),
    )  # fmt: skip
    return dict(zip(COLUMNS, values, strict=True))


def _mm(metres: float) -> float | None:
    return _number(1e3 * metres, 4)


def _number(value: float, digits: int) -> float | None:
    return round(value, digits) if math.isfinite(value) else None


def csv_text(found: BuzzMap) -> str:
    """The rows as CSV with a header."""
    out = io.StringIO()
    writer = csv.DictWriter(out, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for row in rows(found):
        writer.writerow({key: "" if value is None else str(value).lower() if isinstance(value, bool) else value
                         for key, value in row.items()})  # fmt: skip
    return out.getvalue()


def terminal_text(found: BuzzMap) -> str:
    """The neck from nut to body, a column for each string: the displacement from which a note buzzes, and on what."""
    strings = list(dict.fromkeys(each.string for each in found.spots))
    cells = {(each.string, each.fret): _cell(each) for each in found.spots}
    frets = sorted({fret for _, fret in cells})
    width = {name: max(len(name), *(len(cells.get((name, fret), "")) for fret in frets)) for name in strings}
    lines = [
        f"{found.preset}: displacement in mm from which each note buzzes, and on what; "
        f"* = buzzes at this stroke ({found.stroke}, velocity {found.velocity}), ? = may"
    ]
    lines.append("  fret  " + "  ".join(name.ljust(width[name]) for name in strings))
    for fret in frets:
        name = "open" if fret == 0 else str(fret)
        lines.append(f"  {name:>4}  " + "  ".join(cells.get((s, fret), "").ljust(width[s]) for s in strings).rstrip())
    lines += summary(found)
    return "\n".join(lines)


def _cell(spot: Spot) -> str:
    if spot.resting:
        return f"rests on {_short(spot.touched)}"
    if not math.isfinite(spot.buzz_m):
        return f"> {1e3 * spot.limit_m:.2f}"
    mark = "?" if spot.uncertain else "*" if spot.buzzes else " "
    chaotic = "~" if math.isfinite(spot.returns_m) else ""
    return f"{1e3 * spot.buzz_m:.2f}{mark} {_short(spot.buzzes_on)}{chaotic}"


def _short(name: str) -> str:
    return name.removeprefix("fret ")


def summary(found: BuzzMap) -> list[str]:
    """Lines: which notes buzz at the map's stroke, which are uncertain, where it is chaotic."""
    spots = found.spots
    if not spots:
        return ["no note was computed"]
    lines = []
    buzzing = [each for each in spots if each.buzzes]
    lines.append(
        f"{len(buzzing)} of {len(spots)} notes buzz at this stroke: {by_string(buzzing)}"
        if buzzing
        else f"none of the {len(spots)} notes buzzes at this stroke"
    )
    uncertain = [each for each in spots if each.uncertain and not each.resting]
    if uncertain:
        lines.append(
            f"{len(uncertain)} notes have their threshold so near the stroke that they may or may not buzz: "
            f"{by_string(uncertain)}"
        )
    chaotic = [each for each in spots if math.isfinite(each.returns_m)]
    if chaotic:
        lines.append(f"~ the buzz comes and goes beyond the threshold (chaotic motion): {by_string(chaotic)}")
    resting = [each for each in spots if each.resting]
    if resting:
        lines.append(f"the string rests on a fret beyond its own: {by_string(resting)}; lower that fret or raise the string")
    tight = min(spots, key=lambda each: each.buzz_m / each.stroke_m)
    if math.isfinite(tight.buzz_m) and not tight.resting:
        where = "open" if tight.fret == 0 else f"fret {tight.fret}"
        lines.append(
            f"first to buzz: string {tight.string}, {where}, at {1e3 * tight.buzz_m:.3f} mm "
            f"({1e3 * tight.low_m:.3f} to {1e3 * tight.high_m:.3f}), {100.0 * tight.buzz_m / tight.stroke_m:.0f} % of "
            "the stroke"
        )
    return lines


def by_string(spots: Sequence[Spot | FretPlace]) -> str:
    """String by string, frets that follow each other as a range."""
    parts = []
    for name in dict.fromkeys(each.string for each in spots):
        parts.append(f"{name} {fret_ranges([each.fret for each in spots if each.string == name])}")
    return "; ".join(parts)


def fret_ranges(frets: Sequence[int]) -> str:
    """ "open, 3-7, 12" of numbers of frets."""
    runs: list[list[int]] = []
    for fret in sorted(set(frets)):
        if runs and fret == runs[-1][1] + 1 and runs[-1][0] > 0:
            runs[-1][1] = fret
        else:
            runs.append([fret, fret])
    return ", ".join("open" if low == 0 else f"{low}" if low == high else f"{low}-{high}" for low, high in runs)


def neck_lines(preset: Preset) -> list[str]:
    """The neck's own shape: which frets are high, where each has a height of its own, and a backbow."""
    neck, relief_m = neck_under(preset), relief_of(preset)
    lines = []
    if neck is not None:
        lines += [
            f"fret {number} is high: it stands {1e6 * neck.excess_m[number - 1]:.0f} µm above the neck"
            for number in neck.high
        ]
    if relief_m is not None and relief_m < -BACKBOW_M:
        lines.append(f"the neck is bent backwards: its relief is {1e3 * relief_m:.2f} mm")
    return lines


#: newtons in a pound of force
_POUND_N = POUND_KG * 9.80665


def string_lines(preset: Preset) -> list[str]:
    """Each string that is played, as its maker has it: diameter, mass per length, tension at its pitch."""
    lines = []
    for place in places_of(preset, None, {0}):
        string = opened_string(preset, place)
        lines.append(
            f"string {place.string}: {1e3 * string.diameter_m:.2f} mm ({_inches(string.diameter_m)} in), "
            f"{1e3 * string.linear_density_kg_m:.2f} g/m, {string.tension_n:.0f} N ({string.tension_n / _POUND_N:.1f} lb)"
        )
    return lines


def _inches(diameter_m: float) -> str:
    """A gauge as makers write it: .045, and .0095 where it is no whole thousandth."""
    thousandths = 1e3 * diameter_m / INCH_M
    if abs(thousandths - round(thousandths)) < 0.25:  # diameters are in hundredths of a millimetre
        return f".{round(thousandths):03d}"
    return f".{round(10.0 * thousandths):04d}"


def options_line(edits: Sequence[tuple[str, Any]]) -> str:
    """[(path, value)] of a preset as options of the command line."""
    return " ".join(f"--set {path}={_written(value)}" for path, value in edits)


def _written(value: Any) -> str:
    if isinstance(value, dict):
        return "'{ " + ", ".join(f'"{note}" = {each:g}' for note, each in value.items()) + " }'"
    return f"'{json.dumps(value)}'" if isinstance(value, list) else f"{value:g}"
