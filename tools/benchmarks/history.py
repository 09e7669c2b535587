"""What was measured on which machine: `history.jsonl`, a line of JSON a run, kept with the repository.

A run is one machine, one commit, one precision and one width of vectors; what is measured of it again, also in pieces, takes
the place of what its line has. Nothing is known of a machine but `documentation.machine`.
"""

from __future__ import annotations

import json
import math
import re
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from documentation.machine import Machine

from benchmarks import REPOSITORY
from synth import __version__
from synth.files.targets import write_text

HISTORY = Path(__file__).with_name("history.jsonl")
#: what a figure of the engine depends on, but for the libraries
_SOUNDING = ("synth", "presets")
#: of a double and of a float [bits]
BITS = {"float64": 64, "float32": 32}
#: what a figure may say: median and best of the rounds, worst block, least and most of several
VALUES = frozenset({"median", "best", "worst", "least", "most"})


@dataclass(frozen=True)
class Run:
    """A line of the history.

    date       of the last figure, ISO; "" where nobody wrote it down
    commit     the last that changed what sounds, with a + where the tree differed from it; "" where unknown
    version    of the program
    lanes      numbers of `precision` in a vector
    note       what a reader has to know, such as where figures come from that were entered by hand
    figures    name → what was measured (`VALUES`)
    """

    date: str
    commit: str
    version: str
    machine: Machine
    lanes: int
    precision: str
    note: str = ""
    figures: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def same(self) -> tuple[Any, ...]:
        """Runs that agree in this are one."""
        return self.machine.same, self.commit or self.version, self.precision, self.lanes

    @property
    def column(self) -> str:
        """How tables call it."""
        return f"{self.machine.short}, {self.lanes} × {self.precision}"

    def line(self) -> str:
        """As JSON."""
        return json.dumps(
            {
                "date": self.date, "commit": self.commit, "version": self.version, **self.machine._asdict(),
                "lanes": self.lanes, "precision": self.precision, "note": self.note, "figures": self.figures,
            },
            ensure_ascii=False,
        )  # fmt: skip


def read(path: Path = HISTORY) -> list[Run]:
    """All runs, in the order of their lines; none where there is no file. Raises ValueError, which names file and line."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return []
    except UnicodeDecodeError as error:
        raise ValueError(
            f"{path}: must be UTF-8, got a byte {error.object[error.start]:#x}; take it from git again"
        ) from None
    runs = []
    for number, line in enumerate(text.splitlines(), start=1):
        try:
            runs.append(_run(line))
        except ValueError as error:
            raise ValueError(f"{path}, line {number}: {error}; correct the line, or restore it from git") from None
    return runs


def _run(line: str) -> Run:
    try:
        given = json.loads(line)
    except json.JSONDecodeError as error:
        raise ValueError(f"must be JSON, {error.msg} at column {error.colno}") from None
    kinds = {
        "date": str, "commit": str, "version": str, "processor": str, "mhz": int, "cores": int, "caches": dict,
        "lanes": int, "precision": str, "note": str, "figures": dict,
    }  # fmt: skip
    if not isinstance(given, dict) or set(given) != set(kinds):
        apart = sorted(set(given) ^ set(kinds)) if isinstance(given, dict) else [type(given).__name__]
        raise ValueError(f"must have the fields {', '.join(kinds)}, and differs in {', '.join(apart)}")
    for name, kind in kinds.items():
        if not isinstance(given[name], kind):
            raise ValueError(f"{name} must be of type {kind.__name__}, got {given[name]!r}")
    if given["precision"] not in BITS:
        raise ValueError(f"precision must be {' or '.join(BITS)}, got {given['precision']!r}")
    if not re.fullmatch(r"(\d{4}-\d\d-\d\d)?", given["date"]):
        raise ValueError(f"date must be YYYY-MM-DD or empty, got {given['date']!r}")
    for name, figure in given["figures"].items():
        good = isinstance(figure, dict) and figure and VALUES.issuperset(figure)
        if not good or not all(isinstance(value, int | float) and math.isfinite(value) for value in figure.values()):
            raise ValueError(f"figure {name} must have numbers of {', '.join(sorted(VALUES))}, got {figure!r}")
    machine = Machine(*(given.pop(name) for name in Machine._fields))
    return Run(machine=machine, **given)


def with_runs(runs: Sequence[Run], new: Iterable[Run]) -> list[Run]:
    """The runs and the new ones: at the end, or in the place of the same run, whose other figures stay."""
    found = {run.same: run for run in runs}
    for run in new:
        before = found.get(run.same)
        figures = {**(before.figures if before else {}), **run.figures}
        note = run.note or (before.note if before else "")
        found[run.same] = replace(run, note=note, figures=figures)
    return list(found.values())


def write(runs: Sequence[Run], path: Path = HISTORY) -> None:
    """All runs, whole or not at all. Raises OSError."""
    write_text(path, "".join(run.line() + "\n" for run in runs))


def today() -> str:
    """The date, UTC."""
    return datetime.now(UTC).date().isoformat()


def commit_here() -> str:
    """The last commit that changed what sounds, with a + where the working tree differs from it; "" outside of git."""
    done = [
        subprocess.run(["git", *words, "--", *_SOUNDING], cwd=REPOSITORY, capture_output=True, text=True)
        for words in (("log", "-1", "--format=%h", "--abbrev=10"), ("status", "--porcelain"))
    ]
    if any(one.returncode for one in done):
        return ""
    return done[0].stdout.strip() + "+" * bool(done[1].stdout.strip())


def runs_of(figures: Mapping[tuple[str, int], Mapping[str, Mapping[str, float]]], machine: Machine) -> list[Run]:
    """Runs of today and of this tree, of figures by precision and lanes."""
    made = today(), commit_here(), __version__, machine
    return [Run(*made, lanes, precision, "", named) for (precision, lanes), named in figures.items() if named]
