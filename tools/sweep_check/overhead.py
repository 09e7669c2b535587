"""What a study's machinery costs beside its rows: a plain loop and a study of the same rows, in turn, under the same
conditions.

A loop is a process of its own that is spawned as a worker is, with the same environment, and runs the rows one after the
other as a user would write it, with as many loops as the study has workers. Both are warm: kernels are loaded, first rows
not counted. Of a study counted is the time from when a worker begins a row until it begins the next, from its first to its
last; what starting and ending take is said beside it. Page faults of both are shown: where they differ, memory is had
differently, and the ratio says nothing of the study.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import resource
import shutil
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from sweep_check import kills
from sweep_check.rows import page_faults, simulated, work

#: the string's time that takes some 0.2 s to compute, and loops of `work` that a second has, about
CASE_S = 0.87
#: rows of each worker that are not counted
_FIRST = 2


def settings_of(kind: str, x: int, times: int) -> dict[str, Any]:
    """Parameters of a row."""
    return {"initial.displacement_m": 1e-3 + 1e-6 * x} if kind == "case" else {"x": x, "times": times}


def study_of(kind: str, rows: int, times: int, arrays: bool) -> dict[str, Any]:
    """The study of so many of these rows."""
    if kind == "case":
        base = {"case": "tanpura", "path": [str(kills.TOOLS)], "set": {"duration_s": CASE_S, "output_rate_hz": 44100}}
        grid = {"initial.displacement_m": [settings_of(kind, x, times)["initial.displacement_m"] for x in range(rows)]}
        return {"base": base, "grid": grid, "measures": ["peak", "sweep_check.rows:faults"], "times": ["faults"],
                "arrays": ["u"] if arrays else []}  # fmt: skip
    base = {"call": "sweep_check.rows:counted", "path": [str(kills.TOOLS)], "set": {"times": times}}
    return {"base": base, "grid": {"x": {"from": 0, "to": rows - 1, "step": 1}}, "times": ["faults"]}


def _loop(connection: Any, kind: str) -> None:
    """A process that runs the rows it is asked for; says what each took (wall, CPU, page faults)."""
    while (asked := connection.recv()) is not None:
        first, rows, times = asked
        found = []
        for x in range(first, first + rows):
            began, cpu, faults = time.perf_counter(), time.process_time(), page_faults()
            settings = settings_of(kind, x, times)
            simulated(settings, CASE_S) if kind == "case" else work(settings)
            found.append((time.perf_counter() - began, time.process_time() - cpu, page_faults() - faults))
        connection.send(found)


class Loops:
    """So many plain loops, each a process."""

    def __init__(self, kind: str, count: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._ends, self._processes = [], []
        for _ in range(count):
            mine, theirs = context.Pipe()
            self._processes.append(context.Process(target=_loop, args=(theirs, kind), daemon=True))
            self._processes[-1].start()
            self._ends.append(mine)

    def run(self, rows: int, times: int) -> list[tuple[float, float, int]]:
        """(wall, CPU, page faults) of rows of all of them, at the same time; each `rows` and the first that do not count."""
        for number, end in enumerate(self._ends):
            end.send((number * (rows + _FIRST), rows + _FIRST, times))
        return [each for end in self._ends for each in end.recv()[_FIRST:]]

    def close(self) -> None:
        for end, process in zip(self._ends, self._processes, strict=True):
            end.send(None)
            process.join()


def _times(kind: str) -> int:
    """How many times `work` repeats itself in 0.2 s."""
    if kind == "case":
        return 0
    work({"x": 0, "times": 200})
    began = time.perf_counter()
    work({"x": 0, "times": 4000})
    return max(1, round(4000 * 0.2 / (time.perf_counter() - began)))


@contextlib.contextmanager
def _counting(spent: Counter[str]) -> Iterator[None]:
    """CPU time of the conducting process by what it does; handing out has what is left."""
    from synth.study import compacting, conducting, sweeping
    from synth.study.keeping import Folder

    kept: list[tuple[Any, str, Any]] = []

    def counted(owner: Any, name: str, what: str) -> None:
        real: Callable[..., Any] = getattr(owner, name)

        def measured(*arguments: Any, **named: Any) -> Any:
            began = time.thread_time()
            try:
                return real(*arguments, **named)
            finally:
                spent[what] += time.thread_time() - began

        kept.append((owner, name, real))
        setattr(owner, name, measured)

    try:
        counted(conducting, "address", "addressing")
        counted(sweeping, "address", "addressing")
        for name in ("add", "tick", "say"):
            counted(Folder, name, "keeping")
        counted(compacting, "finish", "table at the end")
        yield
    finally:
        for owner, name, real in reversed(kept):
            setattr(owner, name, real)


def _study(folder: Path, study: dict[str, Any], workers: int, spent: Counter[str]) -> dict[str, Any]:
    """Runs it: how long a row takes, what rows say of it, and CPU time of the process with scheduler and conductor."""
    from synth.study.sweeping import sweep

    usage, began = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    with _counting(spent):
        table = sweep(study, folder, workers=workers)
    whole, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_SELF)
    if "failure" in table and table["failure"].notna().any():
        raise SystemExit(f"rows failed: {table['failure'].dropna().iloc[0]}")
    by_worker: dict[str, list[Any]] = defaultdict(list)
    for row in table.sort_values("began").to_dict("records"):
        by_worker[row["worker"]].append(row)
    periods, rows_s, cpu_s, faults, steady = [], [], [], [], 0.0
    for rows in by_worker.values():
        mine = rows[_FIRST:]
        if len(mine) < 2:
            continue
        periods.append((len(mine) - 1, (mine[-1]["began"] - mine[0]["began"]) / (len(mine) - 1)))
        steady = max(steady, mine[-1]["began"] - mine[0]["began"])
        rows_s += [row["row_wall_s"] for row in mine]
        cpu_s += [row["row_cpu_s"] for row in mine]
        faults += [b["faults"] - a["faults"] for a, b in pairwise(mine)]
    shutil.rmtree(folder)
    count = sum(rows for rows, _ in periods)
    return {
        "period": sum(rows * each for rows, each in periods) / count, "inside": sum(rows_s) / len(rows_s),
        "cpu": sum(cpu_s) / len(cpu_s), "faults": median(faults), "edges": whole - steady,
        "conductor": after.ru_utime + after.ru_stime - usage.ru_utime - usage.ru_stime,
    }  # fmt: skip


def overhead(folder: Path, kind: str, rows: int, workers: int, rounds: int, arrays: bool = False) -> dict[str, Any]:
    """Ratio of the time a row takes in a study to that in a plain loop, less 1: of `rounds` rounds, each the loops and the
    study with `rows` rows a worker in turn, and what of it goes where. kind: "case", a simulation, or "call", a function."""
    times = _times(kind)
    study = study_of(kind, (rows + _FIRST) * workers, times, arrays)
    loops = Loops(kind, workers)
    spent: Counter[str] = Counter()
    found: list[tuple[float, dict[str, Any]]] = []
    loop_cpu, loop_faults = [], []
    try:
        loops.run(1, times)
        _study(folder, study, workers, Counter())
        for number in range(rounds):
            ran: dict[str, Any] = {}
            for what in ("loop", "study") if number % 2 == 0 else ("study", "loop"):
                if what == "loop":
                    alone = loops.run(rows, times)
                else:
                    ran = _study(folder, study, workers, spent)
            loop_cpu += [cpu for _, cpu, _ in alone]
            loop_faults += [faults for _, _, faults in alone]
            found.append((sum(wall for wall, _, _ in alone) / len(alone), ran))
            print(f"    loop {1e3 * found[-1][0]:.2f} ms, study {1e3 * ran['period']:.2f} ms a row", flush=True)
    finally:
        loops.close()
    more = sorted(ran["period"] / loop - 1.0 for loop, ran in found)
    ms = rounds * (rows + _FIRST) * workers / 1e3
    conductor = sum(ran["conductor"] for _, ran in found)
    return {
        "rows": f"{kind}{', with arrays' if arrays else ''}: {rounds} rounds of {rows} a worker, {workers} workers",
        "plain loop, s a row": median(loop for loop, _ in found),
        "study, s a row": median(ran["period"] for _, ran in found),
        "more": median(more), "more, least and most": f"{more[0]:.4f} to {more[-1]:.4f}",
        "between rows, ms": 1e3 * median(ran["period"] - ran["inside"] for _, ran in found),
        "in a row, ms more than in the loop": 1e3 * median(ran["inside"] - loop for loop, ran in found),
        "CPU of a row, ms: loop": 1e3 * sum(loop_cpu) / len(loop_cpu),
        "CPU of a row, ms: worker": 1e3 * median(ran["cpu"] for _, ran in found),
        "page faults of a row: loop": median(loop_faults),
        "page faults of a row: worker": median(ran["faults"] for _, ran in found),
        "CPU of scheduler and conductor, ms a row, with start and end": conductor / ms,
        **{f"    of it {name}": each / ms for name, each in spent.most_common()},
        "start and end, s": median(ran["edges"] for _, ran in found),
    }  # fmt: skip
