"""What a study costs beside its rows: time for each row, memory, and what many workers would ask of one scheduler."""

from __future__ import annotations

import os
import pickle
import resource
import time
from pathlib import Path
from typing import Any

from sweep_check import kills
from sweep_check.rows import nap
from sweep_check.wires import moved


def _sweep(folder: Path, grid: dict[str, Any], function: str, fixed: dict[str, Any], workers: int, told: Any = None) -> list:
    """Runs a study of one of the tool's functions; times at which rows were counted: (clock, rows)."""
    from synth.study.sweeping import sweep

    seen: list[tuple[float, int]] = []

    def hear(counts: Any) -> None:
        if not seen or counts.computed > seen[-1][1]:
            seen.append((time.perf_counter(), counts.computed))
        if told is not None:
            told(counts)

    base = {"call": f"sweep_check.rows:{function}", "set": fixed}
    sweep({"base": base, "grid": grid}, folder, workers=workers, told=hear)
    return seen


def asleep(folder: Path, rows: int) -> dict[str, Any]:
    """The same of rows that sleep 0.2 s, so that other programs count little: what one worker waits for between rows."""
    began = time.perf_counter()
    for x in range(20):
        nap({"x": x, "seconds": 0.2})
    loop = (time.perf_counter() - began) / 20
    seen = _sweep(folder, {"x": {"from": 0, "to": rows - 1, "step": 1}}, "nap", {"seconds": 0.2}, 1)
    first = next(k for k, (_, done) in enumerate(seen) if done >= 4)
    row = (seen[-1][0] - seen[first][0]) / (seen[-1][1] - seen[first][1])
    return {"rows": rows, "plain loop": loop, "study": row, "more": row / loop - 1.0}


def _resident_mb() -> float:
    text = Path("/proc/self/status").read_text()
    return int(text.partition("VmRSS:")[2].split()[0]) / 1024.0


def memory(folder: Path, rows: int) -> dict[str, Any]:
    """Resident memory of the conducting process, every tenth of so many empty rows."""
    found: list[tuple[int, float]] = []

    def hear(counts: Any) -> None:
        if counts.computed >= (len(found) + 1) * rows // 10 and len(found) < 10:
            found.append((counts.computed, _resident_mb()))

    _sweep(folder, {"x": {"from": 0, "to": rows - 1, "step": 1}}, "nap", {"seconds": 0.0}, 2, hear)
    return {"rows, MB": [(done, round(mb, 1)) for done, mb in found]}


def scale(folder: Path, threads: int, seconds: float, rows: int) -> dict[str, Any]:
    """One scheduler and sleeping workers, `threads` at once in four processes: rows a second against what they could do, and
    what the conducting process, the scheduler and the wires have to do with it, from 10 or 15 to 85 or 90 % of the rows."""
    from synth.study.sweeping import open_study, sweep
    from synth.study.work.running import run_batch

    port = kills.free_port()
    study = {"base": {"call": "sweep_check.rows:nap", "set": {"seconds": seconds}},
             "grid": {"x": {"from": 0, "to": rows - 1, "step": 1}}}  # fmt: skip
    opened = open_study(study)
    some = [opened.design.row(number) for number in range(100)]
    jobs = [(opened.addressed(row)[0], row, opened.addresses.source(row)) for row in some]
    row_out = len(pickle.dumps(jobs)) / 100.0
    row_back = (
        len(pickle.dumps(run_batch(opened.addresses.head, None, [(k, s | {"seconds": 0}, o) for k, s, o in jobs]))) / 100.0
    )
    seen: list[tuple[float, int, float, float]] = []
    wires: list[tuple[int, dict[str, int]]] = []
    with kills.cluster(port, 4, folder, threads // 4) as begun:
        scheduler = begun[0].pid

        def hear(counts: Any) -> None:
            if counts.workers >= threads and (not seen or counts.computed > seen[-1][1]):
                used = resource.getrusage(resource.RUSAGE_SELF)
                seen.append((time.perf_counter(), counts.computed, used.ru_utime + used.ru_stime, _cpu_s(scheduler)))
                if counts.computed > (0.1, 0.9, 2.0)[len(wires)] * rows:
                    wires.append((counts.computed, moved(scheduler, os.getpid())))

        time.sleep(8.0)
        sweep(study, folder / f"scale-{threads}-{seconds}", scheduler=f"tcp://127.0.0.1:{port}", told=hear)
    steady = [each for each in seen if 0.15 * rows <= each[1] <= 0.85 * rows]
    (t0, n0, c0, s0), (t1, n1, c1, s1) = steady[0], steady[-1]
    rate = (n1 - n0) / (t1 - t0)
    (w0, before), (w1, after) = wires
    return {
        "at once": threads, "row_s": seconds, "rows/s": rate, "of what they could do": rate * seconds / threads,
        "client CPU, ms a row": 1e3 * (c1 - c0) / (n1 - n0), "scheduler CPU, ms a row": 1e3 * (s1 - s0) / (n1 - n0),
        "client busy": (c1 - c0) / (t1 - t0), "scheduler busy": (s1 - s0) / (t1 - t0),
        "pickled, bytes a row there": row_out, "pickled, bytes a row back": row_back,
        **{f"on the wire, bytes a row {way}": (after[way] - before[way]) / (w1 - w0) for way in before},
    }  # fmt: skip


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
