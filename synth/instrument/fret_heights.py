"""Heights of frets as they are measured, from a table in a file: what `setup.fret_heights_mm` takes.

    fret,height_mm        or height_thou (thousandths of an inch), or height_um
    1,1.02
    2,1.00

Rows stand in any order, one for each fret from 1 on. Columns are separated by commas, or by semicolons, with which numbers
may have a decimal comma. Lines that begin with # are remarks.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence

from synth.files.sources import read_bytes
from synth.instrument.setup_table import HIGHEST_CROWN_MM, LOWEST_CROWN_MM, MOST_FRETS
from synth.instrument.wires import INCH_M
from synth.spelling import perhaps

#: largest file that is read [bytes]
MOST_BYTES = 1 << 20
#: columns of a height, and millimetres of one
_UNITS = {"height_mm": 1.0, "height_thou": INCH_M, "height_um": 1e-3}


class FretHeightsError(ValueError):
    """A file that does not have the heights of frets; the message names file and line."""


def read_fret_heights(path: str | os.PathLike[str]) -> tuple[float, ...]:
    """Heights of frets 1, 2, … in a file [mm]. Raises FretHeightsError or OSError."""
    origin = os.fspath(path)
    try:
        text = read_bytes(path, MOST_BYTES, "table of fret heights").decode("utf-8-sig")
    except UnicodeDecodeError:
        raise FretHeightsError(f"{origin}: not a text file in UTF-8; save it as CSV in UTF-8") from None
    except ValueError as error:
        raise FretHeightsError(str(error)) from None
    return parse_fret_heights(text, origin)


def parse_fret_heights(text: str, origin: str) -> tuple[float, ...]:
    """As `read_fret_heights`, of a text; `origin` names it in messages."""
    rows = [(number, line) for number, line in enumerate(text.splitlines(), start=1)]
    rows = [(number, line) for number, line in rows if line.strip() and not line.lstrip().startswith("#")]
    if not rows:
        raise FretHeightsError(f"{origin}: is empty; begin with the line fret,height_mm")
    first, head = rows[0]
    separator = ";" if ";" in head else ","
    names = [_cell(each).lower() for each in head.split(separator)]
    fret_at, height_at = _columns(names, f"{origin}: line {first}")
    found: dict[int, float] = {}
    for number, line in rows[1:]:
        place = f"{origin}: line {number}"
        cells = [_cell(each) for each in line.split(separator)]
        if len(cells) != len(names):
            more = "; separate columns by semicolons where numbers have a decimal comma" if separator == "," else ""
            raise FretHeightsError(f"{place}: must have {len(names)} columns, as the first line has, got {len(cells)}{more}")
        fret = _fret(cells[fret_at], place)
        if fret in found:
            raise FretHeightsError(f"{place}: has fret {fret} again; leave one of its lines out")
        found[fret] = _height(cells[height_at], names[height_at], separator == ";", place)
    if not found:
        raise FretHeightsError(f"{origin}: has no fret; give a line for each")
    missing = next((fret for fret in range(1, max(found) + 1) if fret not in found), None)
    if missing is not None:
        raise FretHeightsError(f"{origin}: fret {missing} is missing, of 1 to {max(found)}; give a line for every fret")
    return tuple(found[fret] for fret in sorted(found))


def _cell(text: str) -> str:
    return text.strip().strip('"').strip()


def _columns(names: Sequence[str], place: str) -> tuple[int, int]:
    """Where the fret's number stands and where its height."""
    heights = [name for name in names if name in _UNITS]
    if names.count("fret") != 1 or len(heights) != 1:
        wrong = next((name for name in names if name != "fret" and name not in _UNITS), "")
        near = perhaps(wrong, ["fret", *_UNITS]) if wrong else ""
        raise FretHeightsError(
            f"{place}: must name a column fret and one of {', '.join(_UNITS)}, got {', '.join(names)}{near}; name "
            "the columns there"
        )
    return names.index("fret"), names.index(heights[0])


def _fret(text: str, place: str) -> int:
    number = int(text) if text.isascii() and text.isdecimal() and len(text) < 4 else 0
    if not 1 <= number <= MOST_FRETS:
        raise FretHeightsError(f"{place}: fret must be a whole number from 1 to {MOST_FRETS}, got {text[:20]!r}")
    return number


def _height(text: str, column: str, decimal_comma: bool, place: str) -> float:
    """A height in mm."""
    try:
        value = float(text.replace(",", ".") if decimal_comma else text)
    except ValueError:
        raise FretHeightsError(f"{place}: {column} must be a number, got {text[:20]!r}; measure this fret") from None
    unit = _UNITS[column]
    if not (math.isfinite(value) and LOWEST_CROWN_MM <= value * unit <= HIGHEST_CROWN_MM):
        low, high = LOWEST_CROWN_MM / unit, HIGHEST_CROWN_MM / unit
        raise FretHeightsError(f"{place}: {column} must lie between {low:.4g} and {high:.4g}, got {value:g}; check its unit")
    return value * unit
