"""What is wrong with a study's pictures, as far as its tables say it before a row is computed."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from synth.spelling import perhaps
from synth.study.design import Design, spread
from synth.study.studyfile import PlotTable, Study

#: families of curves that are told apart by colour and marker, at most
MOST_CURVES = 40
#: endings of pictures' files
ENDINGS = (".png", ".svg", ".pdf")
#: columns that every table of a study has, beside its parameters and measures
_OTHERS = ("not_measured", "failure", "failed_at", "reference", "key", "row_wall_s", "row_cpu_s", "began", "worker")
#: rows whose parameters are read for this
_MOST_ROWS = 20_000


def plot_faults(study: Study, design: Design) -> list[str]:
    """A line for each fault, which names its key."""
    if not study.plot:
        return []
    rows = [design.row(number) for number in spread(len(design), _MOST_ROWS)]
    return [f"plot.{number}.{fault}" for number, plot in enumerate(study.plot) for fault in _faults(plot, study, rows)]


def ending_fault(name: str) -> str | None:
    """What is wrong with the name of a picture's file."""
    if Path(name).suffix.lower() in ENDINGS:
        return None
    return f"file: must end in .png, .svg or .pdf, got {os.fspath(name)!r}"


def too_many(curves: int, what: str) -> str:
    """Why so many curves are not drawn. what: what they differ in."""
    return (
        f"{what}: {curves} curves cannot be told apart, at most {MOST_CURVES} can; choose rows with where, or colour by a "
        "column of numbers"
    )


def _faults(plot: PlotTable, study: Study, rows: list[dict[str, Any]]) -> Iterator[str]:
    if plot.file is not None and (fault := ending_fault(plot.file)) is not None:
        yield fault
    columns = _columns(study)
    parameters = set(study.parameters)
    for key in ("x", "y", "colour", "marker"):
        name = getattr(plot, key)
        if name is None:
            continue
        if columns is not None and name not in columns:
            yield f"{key}: the table will have no {name!r}{perhaps(name, columns)}; it has {', '.join(columns)}"
        elif key in ("x", "y") and name in parameters and not _are_numbers([row.get(name) for row in rows]):
            yield f"{key}: {name!r} does not hold numbers; choose another column"
    for name in plot.where:
        if columns is not None and name not in columns:
            yield f"where.{name}: the table will have no such column{perhaps(name, columns)}"
    if all(name in parameters for name in plot.where):
        kept = [row for row in rows if all(row.get(name) == value for name, value in plot.where.items())]
        yield from _unlike(plot, parameters, kept)


def _unlike(plot: PlotTable, parameters: set[str], rows: list[dict[str, Any]]) -> Iterator[str]:
    """More curves than are told apart; a colour of numbers becomes a scale where there are too many."""
    colour = plot.colour if plot.colour in parameters else None
    if colour is not None and _are_numbers([row.get(colour) for row in rows]):
        colour = None
    names = [name for name in dict.fromkeys((colour, plot.marker)) if name is not None and name in parameters]
    curves = len({tuple(repr(row.get(name)) for name in names) for row in rows}) if names else 0
    if curves > MOST_CURVES:
        yield too_many(curves, "colour" if colour is not None else "marker")


def _columns(study: Study) -> list[str] | None:
    """Names of the finished table's columns; None where functions of the study give theirs only when they run."""
    measured = study.measured()
    if study.base.call is not None or any(":" in each["name"] for each in measured):
        return None
    return [*study.parameters, *(each["as"] for each in measured), *study.times, *_OTHERS]


def _are_numbers(values: list[Any]) -> bool:
    return all(value is None or (isinstance(value, int | float) and not isinstance(value, bool)) for value in values)
