"""`synth sweep`: a study, on this machine or on many."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from synth.cli import common
from synth.cli.counting import HEARTBEAT_S, RowsLine
from synth.units import duration

if TYPE_CHECKING:
    from synth.study.conducting import Counts
    from synth.study.remote import Remote
    from synth.study.sweeping import OpenedStudy

#: rows that --check shows
_SHOWN = 5
#: rows that --dry-run computes
_TRIED = 3


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "sweep",
        help="run a study: a case or preset over many parameter values, each once, on one machine or a cluster",
        allow_abbrev=False,
        description="Computes the rows of a study (TOML) that its folder lacks. If it is stopped or killed, the same "
        "command resumes.",
    )
    parser.add_argument(
        "study",
        metavar="STUDY",
        nargs="?",
        help="a .toml file, or one of the program by name (tanpura-jiva); with --status it may be left out",
    )
    parser.add_argument("-o", "--output", metavar="FOLDER", help="folder of the study (default: STUDY.sweep)")
    parser.add_argument(
        "--workers", type=common.number(int, 0, 4096), metavar="N",
        help="number of processes on this machine, one thread each (default: one per processor); 0: a loop in this process",
    )  # fmt: skip
    parser.add_argument("--scheduler", metavar="ADDRESS", help="address of a Dask scheduler whose workers compute, tls://…")
    parser.add_argument(
        "--tls-ca", metavar="FILE", help="for a scheduler tls://…: certificate of the cluster's authority (PEM)"
    )
    parser.add_argument("--tls-cert", metavar="FILE", help="your certificate (PEM)")
    parser.add_argument("--tls-key", metavar="FILE", help="its key (PEM; default: in the file of --tls-cert)")
    parser.add_argument(
        "--insecure", action="store_true", help="take a scheduler on another machine whose traffic is not encrypted"
    )
    parser.add_argument("--check", action="store_true", help="only report the work: rows, the first of them, time")
    parser.add_argument("--dry-run", action="store_true", help="the same, after trying a few rows and discarding them")
    parser.add_argument(
        "--status", metavar="FOLDER", help="report the progress of the study in a folder, even while it runs"
    )
    parser.add_argument("--retry-failed", action="store_true", help="recompute failed rows")
    parser.add_argument(
        "--prune",
        action="store_true",
        help="delete rows from the folder that the study no longer needs or an older program made",
    )
    parser.add_argument("--plot", action="store_true", help="draw the study's [[plot]]s into its folder at the end")
    parser.add_argument("--heartbeat", type=common.number(float, 1, 86400, " s"), default=HEARTBEAT_S, metavar="SEC",
                        help="interval of progress lines without a terminal (default 30)")  # fmt: skip
    parser.add_argument("--json", action="store_true", help="summary as JSON")
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    parser.set_defaults(run=_sweep)


def _sweep(options: argparse.Namespace) -> int:
    if options.status is not None:
        if options.study is not None or options.check or options.dry_run:
            raise ValueError("--status reads a folder; leave out the study")
        return _status(Path(options.status), options.json)
    if options.study is None:
        raise ValueError("the study is missing: give a .toml file or a name, or --status FOLDER")
    if options.scheduler is not None and options.workers is not None:
        raise ValueError("--workers run on this machine, --scheduler has its own workers; give one of them")
    _needed(options.plot)
    scheduler = _scheduler(options)
    from synth.study.sweeping import open_study

    opened = open_study(options.study)
    folder = Path(options.output) if options.output is not None else Path(f"{Path(options.study).stem}.sweep")
    if options.check or options.dry_run:
        return _check(opened, folder, options)
    return _run(opened, folder, options, scheduler)


def _scheduler(options: argparse.Namespace) -> Remote | None:
    """Where the rows go; None: to workers of this machine. ValueError or OSError where they must not."""
    tls = {name: getattr(options, f"tls_{name}") for name in ("ca", "cert", "key")}
    given = [f"--tls-{name}" for name, path in tls.items() if path is not None] + ["--insecure"] * options.insecure
    if options.scheduler is None:
        if given:
            raise ValueError(f"{given[0]} is for a scheduler; give --scheduler ADDRESS too")
        return None
    from synth.study.remote import certificates, remote

    security = None
    if any(path is not None for path in tls.values()):
        if tls["ca"] is None or tls["cert"] is None:
            raise ValueError(f"{given[0]} needs --tls-ca and --tls-cert beside it")
        security = certificates(**tls)
    return remote(options.scheduler, security, options.insecure)


def _needed(plot: bool) -> None:
    """ValueError where the extra is not installed."""
    packages = ("distributed", "psutil", "pyarrow", "pandas", "zarr", "scipy", *(("matplotlib",) if plot else ()))
    common.needed("studies need", packages, "study")


def _status(folder: Path, as_json: bool) -> int:
    _needed(False)
    from synth.study.showing import standing, standing_text

    found = standing(folder)
    print(json.dumps(found, indent=2) if as_json else standing_text(found))
    return 0


def _run(opened: OpenedStudy, folder: Path, options: argparse.Namespace, scheduler: Remote | None) -> int:
    from synth.native.processors import cores
    from synth.study.sweeping import conduct

    warn, last = common.warner(options.quiet), None

    def told(counts: Counts) -> None:
        nonlocal last
        last = counts
        line.rows(counts)

    workers = cores() if options.workers is None else int(options.workers)
    try:
        with RowsLine(not options.quiet and not options.json, options.heartbeat) as line:
            counts = conduct(opened, folder, workers, scheduler, options.retry_failed, options.prune, told, warn)
    except BaseException:
        if last is not None:
            warn(f"{folder}: {last.done} of {last.total} rows are kept; the same command continues")
        raise
    pictures = []
    if options.plot:
        from synth.study.drawing import draw_all

        pictures = [str(path) for path in draw_all(opened.study, folder)]
    if options.json:
        about = {"folder": str(folder), "rows": counts.total, "computed": counts.computed, "kept": counts.kept,
                 "failed": counts.failed, "retried": counts.retried, "pictures": pictures}  # fmt: skip
        print(json.dumps(about, indent=2))
    elif not options.quiet:
        print(f"{folder}/table.parquet: {counts.total} rows, {counts.computed} computed now, {counts.failed} failed")
        for path in pictures:
            print(path)
    return 0


def _check(opened: OpenedStudy, folder: Path, options: argparse.Namespace) -> int:
    from synth.native.processors import cores
    from synth.study.design import spread
    from synth.study.studyfile import StudyError
    from synth.study.sweeping import foreseen, read_rows

    total = len(opened.design)
    first = [opened.design.row(number) for number in range(min(total, _SHOWN))]
    faults = foreseen(opened)
    there, seconds = 0, []
    if (folder / "parts").is_dir():
        for row in read_rows(folder):
            there += 1
            if isinstance(row.get("time.row_wall_s"), float) and row.get("code") == opened.addresses.code:
                seconds.append(row["time.row_wall_s"])
    if options.dry_run and not faults:
        seconds = _tried(opened, spread(total, _TRIED))
    workers = cores() if options.workers is None else max(1, int(options.workers))
    mean = sum(seconds) / len(seconds) if seconds else None
    whole = None if mean is None else mean * total / workers
    if options.json:
        about = {"rows": total, "stored": there, "first": first, "row_s": mean, "workers": workers, "seconds": whole,
                 "faults": faults}  # fmt: skip
        print(json.dumps(about, indent=2))
        return 2 if faults else 0
    print(f"{opened.study.name}: {total} rows; {folder} has {there}")
    for settings in first:
        print("  " + ", ".join(f"{name} {value}" for name, value in settings.items()))
    if total > len(first):
        print(f"  … {total - len(first)} more")
    draws = [block.draw for block in opened.study.blocks if block.draw is not None and block.draw.sampler == "sobol"]
    for draw in draws:
        if draw.count & (draw.count - 1):
            print(f"sobol: {draw.count} is not a power of two, so the samples are less even")
    if whole is None:
        print("time: unknown until some rows have been computed; --dry-run tries a few")
    else:
        print(f"time: about {duration(whole)} on {workers} workers, {mean:.3g} s a row")
    if faults:
        raise StudyError("\n".join(f"{opened.origin}: {fault}" for fault in faults))
    return 0


def _tried(opened: OpenedStudy, numbers: list[int]) -> list[float]:
    """Seconds of a few rows, the first of them twice as it may compile; raises ValueError where one fails."""
    from synth.study.work.running import run_reference, run_row

    head, found = opened.addresses.head, []
    for number in [numbers[0], *numbers]:
        settings = opened.design.row(number)
        asked = opened.design.reference(settings)
        reference = None if asked is None else run_reference(head, asked, opened.addresses.source(asked))
        values, _, spent = run_row(head, reference, settings, opened.addresses.source(settings))
        if "failure" in values:
            raise ValueError(f"row {number}: {values['failure']}")
        found.append(float(spent["row_wall_s"]))
    return found[1:]
