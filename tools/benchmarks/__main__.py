"""What the program costs on this machine: tables, JSON, a picture.

    tools/bench --short             # three minutes with kernels compiled before
    tools/bench                     # everything, a quarter of an hour
    tools/bench --only peak         # what has the word in its name
    tools/bench --only against --against COMMIT     # notes, songs, coupled strings, in turn with a commit's
    tools/bench --only cold --against COMMIT        # starts with nothing compiled, likewise
    tools/bench --only bass_note --record           # into the history of runs by machine, tools/benchmarks/history.jsonl
    tools/bench --publish           # everything, into the history, and the history into docs/speed.md and README.md
    tools/bench --only page --publish               # the same of what these pages show, some minutes
    tools/bench --pages             # the history into these pages; nothing is measured

One core, pinned where the system can; everything that is compared is measured in one run, round by round in turn. Kernels
against the machine's own peak of multiply-adds, the targets, notes of every preset, blocks, start-up, memory, modes in
float32; of every figure it is said with vectors of how many numbers, in which precision. Into out/bench (out/bench-short,
out/bench-WORD): results.json, tables.md, growth.png.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
os.environ.setdefault("MPLBACKEND", "Agg")

import pytest
from documentation import machine
from same_sound import trees

from benchmarks import REPOSITORY, history, pages, report
from synth.files.targets import write_text

#: mark of the benchmarks whose figures the pages show
PAGE = "page"


def pin() -> None:
    """This process on one core, the last it may use; where the system cannot, it stays as it is."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="tools/bench", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--short", action="store_true", help="fewer rounds, settings and notes")
    parser.add_argument("--only", metavar="WORD", help="benchmarks with the word in their name (as pytest's -k)")
    parser.add_argument("--against", metavar="COMMIT", help="also measure that commit, in turn with this tree")
    parser.add_argument("--record", action="store_true", help="also append the figures to tools/benchmarks/history.jsonl")
    parser.add_argument(
        "--publish",
        action="store_true",
        help="--record, then --pages",
    )
    parser.add_argument("--pages", action="store_true", help="only write the tables of both pages, from the history")
    parser.add_argument("--out", type=Path, metavar="DIR", help="default out/bench")
    options = parser.parse_args()
    if options.publish and (options.short or options.only not in (None, PAGE)):
        parser.error(
            f"--publish needs a whole run: leave out --short and --only, or take --only {PAGE}, or --record, then --pages"
        )
    if options.record and options.short:
        parser.error("--record needs all rounds: leave out --short")
    if options.pages and (options.publish or options.record or options.short or options.only or options.against):
        parser.error("--pages measures nothing: leave out the other options")
    try:
        return measured(options)
    except (ValueError, OSError, trees.WrongUse, subprocess.CalledProcessError) as error:
        print(f"tools/bench: error: {error}", file=sys.stderr)
        return 2


def measured(options: argparse.Namespace) -> int:
    """What is asked for: the exit code. Raises ValueError for a history that cannot be read, before anything is measured."""
    runs = history.read()
    if options.pages:
        pages.publish(runs)
        return 0
    here = machine.here()  # before this process has but one core
    suffix = "-short" * options.short + (f"-{'-'.join(options.only.split())}" if options.only else "")
    out = options.out or REPOSITORY / "out" / f"bench{suffix}"
    out.mkdir(parents=True, exist_ok=True)
    recorded = out / "pytest-benchmark.json"
    recorded.unlink(missing_ok=True)
    if options.against:
        trees.commit_of(options.against)  # before anything is measured
    pin()
    arguments = [str(Path(__file__).parent), "-q", "--no-header", "--benchmark-quiet", "--benchmark-disable-gc"]
    arguments += ["--benchmark-timer=time.process_time", f"--benchmark-json={recorded}"]
    arguments += ["--short"] * options.short + (["-k", options.only] if options.only else [])
    arguments += [f"--against={options.against}"] if options.against else []
    failed = int(pytest.main(arguments))
    if not recorded.exists() or not recorded.stat().st_size:
        print("tools/bench: nothing was measured", file=sys.stderr)
        return failed or 1
    found = report.figures(json.loads(recorded.read_text(encoding="utf-8")))
    recorded.unlink()
    results = {"machine": here._asdict(), "short": options.short, "only": options.only, "figures": found}
    write_text(out / "results.json", json.dumps(results, indent=1))
    text = report.markdown(found, here.words, whole=options.only is None)
    write_text(out / "tables.md", text)
    print(text)
    from benchmarks import plots

    drawn = plots.growth(found, out / "growth.png")
    if (options.record or options.publish) and not failed:
        runs = history.with_runs(history.read(), history.runs_of(pages.figures_of(found), here))
        history.write(runs)
    if options.publish and not failed:
        pages.publish(runs)
    print(f"{out}: results.json, tables.md" + (", growth.png" if drawn else ""))
    return failed


if __name__ == "__main__":
    sys.exit(main())
