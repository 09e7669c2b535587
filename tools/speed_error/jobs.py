"""Rows of the studies that `tools/speed-error` is made of: a run's displacement and errors, and its cost."""

from __future__ import annotations

from typing import Any

from kept_rows import files

from speed_error.grid import Run
from speed_error.measure import cpu_s, displacement, errors, ledger

#: what a run's numbers depend on, beside the rooms of the package
SOURCES = files("tools/speed_error/grid.py", "tools/speed_error/measure.py", "tools/speed_error/kernels.py")
#: parameters of rows; a run's case is not called `case`, which studies take for the name of a file
_OF_RUN = ("scheme", "factor", "modes", "table", "nodes")
PARAMETERS = ("of", *_OF_RUN)


def row_of(run: Run) -> dict[str, Any]:
    """A run as a row's parameters."""
    return {"of": run.case, **{name: run.spec[name] for name in _OF_RUN}}


def run_of(row: dict[str, Any]) -> Run:
    """The run of a row's parameters."""
    return Run(row["of"], *(row[name] for name in _OF_RUN[:3]), tuple(sorted(row["table"].items())), row["nodes"])


def compared(row: dict[str, Any], reference: dict[str, Any] | None = None) -> dict[str, Any]:
    """Values and signals of a run over `duration_s`, its errors where there is a reference, energies over `ledger_s`."""
    run = run_of(row)
    values, signals = displacement(run, row["duration_s"])
    if reference is not None and signals:
        values |= errors(signals, reference["arrays"])
    if row["ledger_s"] and "refused" not in values:
        values["weighed"] = ledger(run, row["ledger_s"])
    return {**values, **signals}


def first_speed(row: dict[str, Any]) -> dict[str, Any]:
    """CPU seconds per second of sound from a short stretch, compiled before."""
    run = run_of(row)
    stretch = max(0.002, 64 / run.rate_hz)
    try:
        cpu_s(run, stretch)
        return {"refused": "", "cpu_per_s": cpu_s(run, stretch) / stretch}
    except ValueError as error:  # a scheme that does not take the case
        return {"refused": str(error)}


def timed(row: dict[str, Any]) -> dict[str, Any]:
    """CPU seconds per second of sound, once more."""
    return {"cpu_per_s": cpu_s(run_of(row), row["stretch_s"]) / row["stretch_s"]}
