"""Measured mobilities of a bridge out of a table: which column is what, in what unit, and what is refused."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from synth.files.sources import read_bytes

#: bytes of a table that are read, and rows that a fit needs
MOST_BYTES = 1 << 28
LEAST_ROWS = 24
#: frequencies that a table may hold [Hz]; beyond them the unit is another
LOWEST_HZ, HIGHEST_HZ = 1e-2, 1e6
#: below that nothing has been measured [m/(N s)]
SILENT = 1e-12
#: no bridge moves more than that [m/(N s)]: a free hair does not
LOUDEST = 1e6

Component = tuple[int, int]
#: what columns call the parts of a complex number
_WORDS = {"real": "re", "imag": "im", "mag": "abs", "magnitude": "abs", "arg": "phase"}
_PART = "(real|re|imag|im|abs|magnitude|mag|db|phase|arg)"
_UNIT = r"[\s_]*[\[(]?(?P<unit>[^\[\]]*?)[\])]?"
_FREQUENCY = re.compile(rf"(?:frequency|freq|f){_UNIT}")
_COLUMN = re.compile(rf"y[\s_]*(?P<i>\d)[\s_,]*(?P<j>\d)[\s_]*{_PART.replace('(', '(?P<part>', 1)}{_UNIT}")
_TURNED = re.compile(rf"{_PART.replace('(', '(?P<part>', 1)}[\s_(]*y[\s_]*(?P<i>\d)[\s_,]*(?P<j>\d)\)?{_UNIT}")
_HERTZ = {"hz": 1.0, "khz": 1e3}
_ANGLES = {"deg": math.pi / 180.0, "°": math.pi / 180.0, "degrees": math.pi / 180.0, "rad": 1.0}
_RATES = {"m/s/n": 1.0, "m/(ns)": 1.0, "m/ns": 1.0, "s/kg": 1.0, "(m/s)/n": 1.0, "mm/s/n": 1e-3, "(mm/s)/n": 1e-3}
_TURNS = {"rad/s/n": 1.0, "1/(ns)": 1.0, "rad/(ns)": 1.0}
_ROCKS = {"rad/s/(nm)": 1.0, "1/(nms)": 1.0, "rad/(nms)": 1.0, "rad/s/nm": 1.0}


@dataclass(frozen=True, eq=False)
class Mobility:
    """A driving-point mobility matrix, measured.

    frequency_hz  (n,) rising, > 0
    components    {(i, j): (n,) complex} of i ≤ j, 1 normal, 2 lateral, 3 rocking; e^(+iωt), SI units
    ignored       names of columns that are no mobility
    """

    frequency_hz: NDArray[np.float64]
    components: dict[Component, NDArray[np.complex128]]
    ignored: tuple[str, ...] = ()

    @property
    def axes(self) -> tuple[int, ...]:
        """Which of 1, 2, 3 are measured."""
        return tuple(sorted({axis for pair in self.components for axis in pair}))

    def within(self, low_hz: float, high_hz: float) -> Mobility:
        """Of the rows within a band. Raises ValueError where they are too few."""
        rows = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        if np.count_nonzero(rows) < LEAST_ROWS:
            raise ValueError(
                f"a band from {low_hz:g} to {high_hz:g} Hz must hold at least {LEAST_ROWS} rows, got "
                f"{np.count_nonzero(rows)} of {rows.size} from {self.frequency_hz[0]:g} to {self.frequency_hz[-1]:g} Hz"
            )
        return Mobility(self.frequency_hz[rows], {pair: y[rows] for pair, y in self.components.items()}, self.ignored)


def read_mobility(path: str | Path) -> Mobility:
    """A table of text: a header that names the columns and their units, then rows of numbers, parted by commas, semicolons
    or tabs; lines of # are passed over.

    frequency [Hz], y11 re [m/s/N], y11 im [m/s/N], y12 re …, or y11_db, y11_phase_deg, or y11 abs; underscores for blanks
    and brackets. Without a unit real and imaginary parts and magnitudes are m/s/N (rocking: rad/s/N, rad/s/(N m)), dB
    those of 1 m/s/N. Raises OSError, and ValueError that names file, row and column.
    """
    return parse_mobility(read_bytes(path, MOST_BYTES, "table of mobilities"), path)


def parse_mobility(data: bytes, path: str | Path) -> Mobility:
    """`read_mobility` of a file's bytes; `path` names it in messages. Raises ValueError."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = data[: error.start].count(b"\n") + 1
        raise ValueError(f"{path}: row {row} is no text in UTF-8; export the measurement as CSV") from None
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip(" \t,;")]
    lines = [(number, line) for number, line in lines if not line.lstrip().startswith("#")]
    if not lines:
        raise ValueError(f"{path}: is empty; give a header and rows of frequency and mobility")
    header = lines[0][1]
    delimiter = next((mark for mark in (";", "\t", ",") if mark in header), None)
    names = [name.strip().strip('"').strip() for name in header.split(delimiter)]
    columns, ignored = _columns(path, lines[0][0], names)
    numbers = _numbers(path, lines[1:], names, columns, delimiter)
    return _mobility(path, lines, names, columns, numbers, ignored)


#: what a column is: (component or None for the frequency, part, factor to SI)
_Meaning = tuple[Component | None, str, float]


def _columns(path: str | Path, row: int, names: list[str]) -> tuple[dict[int, _Meaning], tuple[str, ...]]:
    found: dict[int, _Meaning] = {}
    ignored = []
    for number, name in enumerate(names):
        where = f"{path}: row {row}, column {number + 1} ({name})"
        word = name.lower()
        meaning = _meaning(where, word)
        if meaning is None:
            if re.match(r"(re|im|abs)?[\s_(]*y[\s_]*\d", word):
                raise ValueError(f"{where} must be named like 'y11_re', 'y12 im [m/s/N]', 'y22_db' or 'y11_phase_deg'")
            ignored.append(name)
            continue
        if any(meaning[:2] == other[:2] for other in found.values()):
            raise ValueError(f"{where} is there twice; leave one out (Y21 is Y12)")
        found[number] = meaning
    kinds = {meaning[:2] for meaning in found.values()}
    if (None, "frequency") not in kinds:
        raise ValueError(
            f"{path}: row {row} must name a column 'frequency_hz' (or 'frequency [Hz]'), got {', '.join(names)}"
        )
    pairs = sorted({pair for pair, _ in kinds if pair is not None})
    if (1, 1) not in pairs:
        raise ValueError(
            f"{path}: row {row} must name columns of y11, such as 'y11_re' and 'y11_im', got {', '.join(names)}"
        )
    for pair in pairs:
        parts = {part for other, part in kinds if other == pair}
        if parts not in ({"re", "im"}, {"abs", "phase"}, {"db", "phase"}):
            name = f"y{pair[0]}{pair[1]}"
            raise ValueError(
                f"{path}: row {row} must name {name}_re and {name}_im, or {name}_db (or {name}_abs) and {name}_phase_deg, "
                f"got {', '.join(sorted(parts))} of {name}"
            )
    for axis in {axis for pair in pairs for axis in pair} - {1}:
        if (1, axis) not in pairs:
            raise ValueError(
                f"{path}: row {row} must name y1{axis} too, which tells the sign of the shapes; measure it or leave out "
                f"y{axis}{axis}"
            )
    return found, tuple(ignored)


def _meaning(where: str, word: str) -> _Meaning | None:
    match = _FREQUENCY.fullmatch(word)
    if match is not None:
        return None, "frequency", _factor(where, match["unit"], _HERTZ, None)
    match = _COLUMN.fullmatch(word) or _TURNED.fullmatch(word)
    if match is None:
        return None
    i, j = sorted((int(match["i"]), int(match["j"])))
    if not 1 <= i <= j <= 3:
        raise ValueError(f"{where} must be of axes 1 (normal), 2 (lateral) and 3 (rocking)")
    part = _WORDS.get(match["part"], match["part"])
    if part == "phase":
        return (i, j), part, _factor(where, match["unit"], _ANGLES, None)
    if part == "db":
        return (i, j), part, _factor(where, match["unit"], {}, 1.0)
    units = _RATES if j < 3 else _TURNS if i < 3 else _ROCKS
    return (i, j), part, _factor(where, match["unit"], units, 1.0)


def _factor(where: str, unit: str, known: dict[str, float], default: float | None) -> float:
    unit = re.sub(r"[\s_·*]", "", unit).lower()
    if unit == "" and default is not None:
        return default
    for name, factor in known.items():
        if re.sub(r"[()]", "", unit) == re.sub(r"[()]", "", name):
            return factor
    words = " or ".join(list(known)[:4]) or "no unit: it is that of 1 m/s/N"
    raise ValueError(
        f"{where} must have the unit {words}, got {unit!r}" if known else f"{where} must have {words}, got {unit!r}"
    )


def _numbers(
    path: str | Path, lines: list[tuple[int, str]], names: list[str], columns: dict[int, _Meaning], delimiter: str | None
) -> NDArray[np.float64]:
    """(rows, columns that matter)."""
    order = sorted(columns)
    rows = []
    for number, line in lines:
        cells = line.split(delimiter)
        if len(cells) != len(names) and not (len(cells) == len(names) + 1 and not cells[-1].strip()):
            raise ValueError(f"{path}: row {number} must have {len(names)} columns as the header, got {len(cells)}")
        rows.append([cells[i] for i in order])
    try:
        values = np.array(rows, dtype=np.float64).reshape(len(rows), len(order))
    except ValueError:
        values = np.array([])
    if values.size and np.all(np.isfinite(values)):
        return values
    for (number, _), cells in zip(lines, rows, strict=True):
        for column, cell in zip(order, cells, strict=True):
            try:
                fine = math.isfinite(float(cell))
            except ValueError:
                fine = False
            if not fine:
                comma = "; write decimals with a point" if delimiter == ";" and "," in cell else ""
                where = f"{path}: row {number}, column {column + 1} ({names[column]})"
                raise ValueError(f"{where} must be a finite number, got {cell.strip()!r}{comma}")
    return values


def _mobility(
    path: str | Path,
    lines: list[tuple[int, str]],
    names: list[str],
    columns: dict[int, _Meaning],
    numbers: NDArray[np.float64],
    ignored: tuple[str, ...],
) -> Mobility:
    if len(numbers) < LEAST_ROWS:
        raise ValueError(f"{path}: must hold at least {LEAST_ROWS} rows, got {len(numbers)}; give the whole measurement")
    place = {columns[column][:2]: index for index, column in enumerate(sorted(columns))}
    factor = {meaning[:2]: meaning[2] for meaning in columns.values()}

    def column(pair: Component | None, part: str) -> NDArray[np.float64]:
        return numbers[:, place[pair, part]] * factor[pair, part]

    frequency = column(None, "frequency")
    wrong = np.flatnonzero(np.diff(frequency) <= 0.0)
    if frequency[0] < 0.0 or wrong.size:
        at = 0 if frequency[0] < 0.0 else int(wrong[0]) + 1
        own = next(column for column, meaning in columns.items() if meaning[0] is None)
        raise ValueError(
            f"{path}: row {lines[1 + at][0]}, column {own + 1} ({names[own]}): frequencies must rise from 0 Hz or above, "
            f"got {frequency[at]:g} Hz"
            + (f" after {frequency[at - 1]:g} Hz" if at else "")
            + "; sort the rows and leave each frequency once"
        )
    heard = frequency[frequency > 0.0]
    if heard[0] < LOWEST_HZ or heard[-1] > HIGHEST_HZ:
        raise ValueError(
            f"{path}: frequencies must lie between {LOWEST_HZ:g} and {HIGHEST_HZ:g} Hz (0 is left out), got {heard[0]:g} to "
            f"{heard[-1]:g} Hz; check the unit"
        )
    components = {}
    for pair in sorted({pair for pair, _ in place if pair is not None}):
        if (pair, "re") in place:
            y = column(pair, "re") + 1j * column(pair, "im")
        else:
            size = column(pair, "abs") if (pair, "abs") in place else 10.0 ** np.minimum(column(pair, "db") / 20.0, 300.0)
            y = size * np.exp(1j * column(pair, "phase"))
        _check_size(path, lines, pair, y)
        components[pair] = y[frequency > 0.0]
    return Mobility(frequency[frequency > 0.0], components, ignored)


def _check_size(path: str | Path, lines: list[tuple[int, str]], pair: Component, y: NDArray[np.complex128]) -> None:
    name, size = f"y{pair[0]}{pair[1]}", np.abs(y)
    if size.max() > LOUDEST:
        raise ValueError(
            f"{path}: row {lines[1 + int(np.argmax(size))][0]}: {name} must be at most {LOUDEST:g} m/s/N, got "
            f"{size.max():.3g}; check the unit"
        )
    if pair[0] == pair[1] and size.max() < SILENT:
        raise ValueError(f"{path}: {name} is silent, at most {size.max():.3g} m/s/N; check cable, sensor and unit")
