"""All runs of one call of the tool, in order, and the rows that tables and pictures are made of."""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from documentation.machine import here
from kept_rows import rows_of, study_of

from speed_error.grid import AS_DEFAULT, DEFAULT, LONGEST_S, Run, reference, runs
from speed_error.jobs import PARAMETERS, SOURCES, row_of
from speed_error.measure import decimation_cpu_s, longest
from synth.study.keeping import Folder
from synth.study.sweeping import read_arrays

_TIMED_CPU_S = 0.3  # of one run in one round
_LEDGER_S = 0.02
#: of a row of a study, what is no result of the run
_NOT_MEASURED = {*PARAMETERS, "ledger_s", "weighed", "reference", "key", "worker", "began", "row_wall_s", "row_cpu_s"}


class Session:
    """`rows` after `run`: one dict per run; `references` by case."""

    def __init__(
        self, out: Path, cases: list[str], schemes: list[str], short: bool, budget_s: float, rounds: int,
        workers: int | None = None,
    ) -> None:  # fmt: skip
        self.out, self.cases, self.schemes, self.short = out, cases, schemes, short
        self.budget_s, self.rounds = budget_s, rounds
        self.workers = workers
        self.machine = here().words
        self.rows: list[dict[str, Any]] = []
        self.timed: list[dict[str, Any]] = []  # too slow for anything but a first timing
        self.skipped: list[tuple[Run, str]] = []
        self.signals: dict[Run, dict[str, np.ndarray]] = {}
        self.references: dict[str, dict[str, Any]] = {}
        self._started = time.perf_counter()

    def _say(self, text: str) -> None:
        print(f"{time.perf_counter() - self._started:6.0f} s  {text}", file=sys.stderr, flush=True)

    def run(self) -> None:
        """First timings, displacements with errors and ledgers, then the rounds of timing over all of them."""
        wanted = [run for case in self.cases for run in runs(case, self.short) if run.scheme in self.schemes]
        speed = self._first_speeds(wanted)
        for case in self.cases:
            self._compare(case, [run for run in wanted if run.case == case and run in speed], speed)
        self._time([row["run"] for row in self.rows], speed)
        self._decimate()

    def _rows(self, call: str, named: list[dict[str, Any]], workers: int | None, **more: Any) -> list[dict[str, Any]]:
        """Rows of one of the tool's studies, in order."""
        if not named:
            return []
        folder = self.out / "studies" / more.pop("folder", call)
        block = {"zip": {name: [each[name] for each in named] for name in named[0]}}
        return rows_of(study_of(f"speed_error.jobs:{call}", [block], SOURCES, **more), folder, workers)

    def _skip(self, run: Run, why: str) -> None:
        self.skipped.append((run, why))
        self._say(f"left out: {name(run)}: {why}")

    def _first_speeds(self, wanted: list[Run]) -> dict[Run, float]:
        """CPU seconds per second of sound of the runs that there are."""
        named = [{"machine": self.machine, **row_of(run)} for run in wanted]
        speed = {}
        for run, found in zip(wanted, self._rows("first_speed", named, 0, times=["cpu_per_s"]), strict=True):
            if found["refused"]:
                self._skip(run, found["refused"])
            else:
                speed[run] = found["cpu_per_s"]
        return speed

    def _compare(self, case: str, wanted: list[Run], speed: dict[Run, float]) -> None:
        """Displacements of a case against its reference, which comes first and is compared with its checks."""
        (_, finest), *checks = reference(case, self.short)
        self._say(f"reference: {name(finest)}")
        named = [{**row_of(run), "duration_s": LONGEST_S[case], "ledger_s": 0.0} for _, run in checks]
        taken = []
        for run in wanted:
            duration = longest(run, speed[run], self.budget_s)
            if duration is None:
                self._skip(run, f"0.1 s would take {0.1 * speed[run]:.0f} s, more than --budget; timed alone")
                self.timed.append({"run": run, "cpu_per_s": speed[run], "times_real_time": 1.0 / speed[run]})
                continue
            weighed = _LEDGER_S if 3.0 * _LEDGER_S * speed[run] <= self.budget_s else 0.0
            named.append({**row_of(run), "duration_s": duration, "ledger_s": weighed})
            taken.append(run)
        against = {"set": {**row_of(finest), "duration_s": LONGEST_S[case], "ledger_s": 0.0}, "follows": []}
        found = self._rows("compared", named, self.workers, folder=case, reference=against)
        self._judge(case, finest, dict(zip((what for what, _ in checks), found, strict=False)))
        for run, values in zip(taken, found[len(checks) :], strict=True):
            self._take(case, run, values)

    def _judge(self, case: str, finest: Run, stands: dict[str, dict[str, Any]]) -> None:
        """What a case's runs are compared with, and how far that stands."""
        folder = Folder(self.out / "studies" / case)
        kept = folder.reference(next(iter(stands.values()))["reference"])
        assert kept is not None
        self.references[case] = {"run": finest, "values": kept["values"], "signals": kept["arrays"], "stands": stands}
        for what, found in stands.items():
            self._say(f"  {what} differs from it by {spans(found)}")

    def _take(self, case: str, run: Run, values: dict[str, Any]) -> None:
        if "refused" in values:
            self._skip(run, values["refused"])
            return
        weighed = values.get("weighed")
        row = {key: value for key, value in values.items() if key not in _NOT_MEASURED}
        row = {"run": run, "last_contact_s": None, **row}
        if values["finite"]:
            self.signals[run] = read_arrays(self.out / "studies" / case, values["key"])
        else:
            duration = values["duration_s"]
            row.update({f"{e}_{s:g}s": math.inf for e in ("e", "e_band") for s in (0.1, 0.4, 3.0) if s <= duration})
        if weighed is not None:
            row["energy_rise"] = float(weighed.get("energy_rise", math.nan))
            row["energy_growth"] = float(weighed.get("energy_growth", math.nan))
            row["penetration_m"] = float(max(row["penetration_m"], weighed.get("penetration_m", 0.0)))
        row["mode_steps_per_s"] = run.rate_hz * run.modes
        self.rows.append(row)
        self._say(f"{name(run)}: {spans(row)}")

    def _time(self, wanted: list[Run], speed: dict[Run, float]) -> None:
        """Rounds over everything, in this process: what a busy machine does to one scheme it does to all."""
        stretches = [min(1.0, LONGEST_S[run.case], max(64 / run.rate_hz, _TIMED_CPU_S / speed[run])) for run in wanted]
        named = [
            {"machine": self.machine, "round": number, "stretch_s": stretch, **row_of(run)}
            for number in range(self.rounds)
            for run, stretch in zip(wanted, stretches, strict=True)
        ]
        self._say(f"timing, {self.rounds} rounds")
        spent = [each["cpu_per_s"] for each in self._rows("timed", named, 0, times=["cpu_per_s"])]
        for number, row in enumerate(self.rows):
            series = spent[number :: len(wanted)]
            row["cpu_per_s"], row["cpu_per_s_median"] = min(series), float(np.median(series))
            row["times_real_time"] = 1.0 / row["cpu_per_s"]

    def _decimate(self) -> None:
        cost: dict[int, float] = {}
        for row in self.rows:
            factor = row["run"].factor
            if factor not in cost:
                decimation_cpu_s(factor, 0.01)
                cost[factor] = min(decimation_cpu_s(factor) for _ in range(3)) / 0.5
            row["times_real_time_decimated"] = 1.0 / (row["cpu_per_s"] + cost[factor])

    def default_rows(self, case: str) -> list[dict[str, Any]]:
        """The rows of the program's default scheme with the modes a plan gives it."""
        runs = [(row["run"], row) for row in self.rows]
        return [row for run, row in runs if run.case == case and (run.scheme, run.table) == (DEFAULT, AS_DEFAULT)]

    def substepped_rows(self, case: str) -> list[dict[str, Any]]:
        """The rows of the default scheme whose contact takes sub-steps."""
        return [row for row in self.rows if row["run"].case == case and "substeps" in dict(row["run"].table)]


def name(run: Run) -> str:
    """A run in one line."""
    nodes = f", {run.nodes} nodes" if run.nodes else ""
    return f"{run.case}: {run.label}, {run.rate_hz / 1e3:.1f} kHz, {run.modes} modes{nodes}"


def spans(values: dict[str, Any]) -> str:
    """The errors that are there."""
    return ", ".join(f"e({s} s) = {values[f'e_{s}s']:.2g}" for s in ("0.1", "0.4", "3") if f"e_{s}s" in values)
