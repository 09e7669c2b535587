"""All runs of one call of the tool, in order, and the rows that tables and pictures are made of."""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from documentation.machine import here

from speed_error.grid import AS_DEFAULT, DEFAULT, LONGEST_S, Run, reference, runs
from speed_error.measure import cpu_s, decimation_cpu_s, displacement, errors, ledger, longest
from speed_error.store import Store

_TIMED_CPU_S = 0.3  # of one run in one round
_LEDGER_S = 0.02


class Session:
    """`rows` after `run`: one dict per run; `references` by case."""

    def __init__(self, out: Path, cases: list[str], schemes: list[str], short: bool, budget_s: float, rounds: int) -> None:
        self.out, self.cases, self.schemes, self.short = out, cases, schemes, short
        self.budget_s, self.rounds = budget_s, rounds
        self.store = Store(out / "runs")
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
        """References, a first timing, displacements, ledgers, then the rounds of timing over all of them."""
        wanted = [run for case in self.cases for run in runs(case, self.short) if run.scheme in self.schemes]
        for case in self.cases:
            self._reference(case)
        speed: dict[Run, float] = {}
        for run in wanted:
            try:
                speed[run] = self._first_speed(run)
                self._measure(run, speed[run])
            except ValueError as error:
                self._skip(run, str(error))
        self._time([row["run"] for row in self.rows], speed)
        self._decimate()

    def _skip(self, run: Run, why: str) -> None:
        self.skipped.append((run, why))
        self._say(f"left out: {name(run)}: {why}")

    def _reference(self, case: str) -> None:
        (_, finest), *checks = reference(case, self.short)
        self._say(f"reference: {name(finest)}")
        values, signals = displacement(self.store, finest, LONGEST_S[case])
        stands = {what: errors(displacement(self.store, run, LONGEST_S[case])[1], signals) for what, run in checks}
        self.references[case] = {"run": finest, "values": values, "signals": signals, "stands": stands}
        for what, found in stands.items():
            self._say(f"  {what} differs from it by {spans(found)}")

    def _first_speed(self, run: Run) -> float:
        """CPU seconds per second of sound, from a first short stretch (compiled before)."""
        spec = {"what": "first speed", "machine": self.machine, **run.spec}
        found = self.store.load(spec)
        if found is None:
            stretch = max(0.002, 64 / run.rate_hz)
            cpu_s(run, stretch)
            spent = cpu_s(run, stretch)
            self.store.save(spec, {"cpu_per_s": spent / stretch})
            return spent / stretch
        return float(found[0]["cpu_per_s"])

    def _measure(self, run: Run, cpu_per_s: float) -> None:
        duration = longest(run, cpu_per_s, self.budget_s)
        if duration is None:
            self._skip(run, f"0.1 s would take {0.1 * cpu_per_s:.0f} s, more than --budget; timed alone")
            self.timed.append({"run": run, "cpu_per_s": cpu_per_s, "times_real_time": 1.0 / cpu_per_s})
            return
        values, signals = displacement(self.store, run, duration)
        if "refused" in values:
            self._skip(run, values["refused"])
            return
        row: dict[str, Any] = {"run": run, **values}
        ref = self.references[run.case]["signals"]
        if values["finite"]:
            row.update(errors(signals, ref))
            self.signals[run] = signals
        else:
            row.update({f"{e}_{s:g}s": math.inf for e in ("e", "e_band") for s in (0.1, 0.4, 3.0) if s <= duration})
        if 3.0 * _LEDGER_S * cpu_per_s <= self.budget_s:
            weighed = ledger(self.store, run, _LEDGER_S)
            row["energy_rise"] = weighed.get("energy_rise", math.nan)
            row["energy_growth"] = weighed.get("energy_growth", math.nan)
            row["penetration_m"] = max(row["penetration_m"], weighed.get("penetration_m", 0.0))
        row["mode_steps_per_s"] = run.rate_hz * run.modes
        self.rows.append(row)
        self._say(f"{name(run)}: {spans(row)}")

    def _time(self, wanted: list[Run], speed: dict[Run, float]) -> None:
        """Rounds over everything: what a busy machine does to one scheme it does to all."""
        times: dict[Run, list[float]] = {run: [] for run in wanted}
        for number in range(self.rounds):
            self._say(f"timing, round {number + 1} of {self.rounds}")
            for run in wanted:
                stretch = min(1.0, LONGEST_S[run.case], max(64 / run.rate_hz, _TIMED_CPU_S / speed[run]))
                spec = {"what": "time", "round": number, "machine": self.machine, "stretch_s": round(stretch, 6), **run.spec}
                # the stretch depends on the first speed, which is kept too
                found = self.store.load(spec)
                if found is None:
                    values = {"cpu_per_s": cpu_s(run, stretch) / stretch}
                    self.store.save(spec, values)
                    found = values, {}
                times[run].append(float(found[0]["cpu_per_s"]))
        for row in self.rows:
            series = times[row["run"]]
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
