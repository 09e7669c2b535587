"""What the program costs on this machine: tables, JSON, a picture.

    tools/bench --short             # less than two minutes with kernels compiled before
    tools/bench                     # everything, less than ten
    tools/bench --only peak         # what has the word in its name
    tools/bench --only cold --against v0.5.0        # starts with nothing compiled, in turn with those of a commit

One core, pinned where the system can; everything that is compared is measured in one run, round by round in turn. Kernels
against the machine's own peak of multiply-adds, the targets, notes of every preset, blocks, start-up, memory, modes in
float32. Into out/bench (out/bench-short, out/bench-WORD): results.json, tables.md, growth.png.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
from pathlib import Path

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
os.environ.setdefault("MPLBACKEND", "Agg")

import pytest
from documentation import page
from speed_error.measure import machine

from bench import REPOSITORY, plots, report
from synth.files.targets import write_text
from synth.solver.lanes import LANES


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
    parser.add_argument("--against", metavar="COMMIT", help="take starts with nothing compiled in turn with those of it")
    parser.add_argument("--publish", action="store_true", help="also write docs/growth.png and the tables of docs/speed.md")
    parser.add_argument("--out", type=Path, metavar="DIR", help="default out/bench")
    options = parser.parse_args()
    if options.publish and (options.short or options.only):
        parser.error("--publish is for a whole run: leave out --short and --only")
    suffix = "-short" * options.short + (f"-{'-'.join(options.only.split())}" if options.only else "")
    out = options.out or REPOSITORY / "out" / f"bench{suffix}"
    out.mkdir(parents=True, exist_ok=True)
    recorded = out / "pytest-benchmark.json"
    recorded.unlink(missing_ok=True)
    pin()
    arguments = [str(REPOSITORY / "bench"), "-q", "--no-header", "--benchmark-quiet", "--benchmark-disable-gc"]
    arguments += ["--benchmark-timer=time.process_time", f"--benchmark-json={recorded}"]
    arguments += ["--short"] * options.short + (["-k", options.only] if options.only else [])
    arguments += [f"--against={options.against}"] if options.against else []
    failed = int(pytest.main(arguments))
    if not recorded.exists() or not recorded.stat().st_size:
        print("tools/bench: nothing was measured", file=sys.stderr)
        return failed or 1
    found = report.figures(json.loads(recorded.read_text(encoding="utf-8")))
    recorded.unlink()
    here, lanes = machine(), LANES
    results = {"machine": here, "lanes": lanes, "short": options.short, "only": options.only, "figures": found}
    write_text(out / "results.json", json.dumps(results, indent=1))
    text = report.markdown(found, here, lanes, whole=options.only is None)
    write_text(out / "tables.md", text)
    print(text)
    drawn = plots.growth(found, out / "growth.png")
    if options.publish and drawn and not failed:
        shutil.copyfile(out / "growth.png", page.DOCS / "growth.png")
        page.put(report.parts(found, here, lanes), page.DOCS / "speed.md")
    print(f"{out}: results.json, tables.md" + (", growth.png" if drawn else ""))
    return failed


if __name__ == "__main__":
    sys.exit(main())
