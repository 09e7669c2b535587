"""The benchmark of collisions: score runs of any solver, make this program's entries, make references again.

    tools/collisions list                           # the scenes
    tools/collisions score RUN.npz …                # a table; --json FILE, --markdown FILE, --entry FILE too
    tools/collisions references [SCENE …]           # made again by their recipes; stopped, it goes on where it was
    tools/collisions blind DIR --seed N             # new scenes at random, references kept apart from them
    tools/collisions run [SCENE …]                  # all schemes here into entries/jawari.json, on one core
    tools/collisions siconos                        # runs of Siconos, where JAWARI_REFERENCE has them
    tools/collisions page                           # the tables of docs/collisions.md, of all entries

docs/collisions.md says what a run is and how to send scores. A wrong file: one line, exit code 2, nothing written.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1", NUMBA_NUM_THREADS="1")

from benchmarks import REPOSITORY
from benchmarks.collisions import FOLDER, ContestError, entries, report, runfile, scene
from benchmarks.collisions.score import score
from synth.files.targets import Named, check_apart, check_target, write_text

OUT = REPOSITORY / "out" / "collisions"
OURS = "jawari.json"
#: scenes of one drawing
_MOST_BLIND = 100


def say(text: str) -> None:
    """A line about what goes on."""
    print(text, file=sys.stderr, flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tools/collisions", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    commands.add_parser("list", help="the scenes")
    scoring = commands.add_parser("score", help="score runs: plain .npz files of displacement")
    scoring.add_argument("runs", nargs="+", type=Path, metavar="RUN.npz")
    scoring.add_argument("--scene", metavar="NAME", help="scene of runs that do not name theirs")
    scoring.add_argument("--blind", type=Path, metavar="DIR", help="score runs of the blind scenes in this folder")
    scoring.add_argument("--json", type=Path, metavar="FILE", help="write all figures to this file")
    scoring.add_argument(
        "--markdown", type=Path, metavar="FILE", help="write the tables to this file, too; they are always printed"
    )
    scoring.add_argument(
        "--entry", type=Path, metavar="FILE", help="write a file of scores to submit, described by the options below"
    )
    scoring.add_argument("--name", default="", metavar="WORDS", help="for --entry: name of the solver")
    scoring.add_argument("--made-by", default="", metavar="WORDS", help="for --entry: who ran it")
    scoring.add_argument("--source", default="", metavar="WORDS", help="for --entry: where to find solver and settings")
    scoring.add_argument(
        "--machine", default="", metavar="WORDS", help="for --entry: the processor on which the cost was measured"
    )
    making = commands.add_parser("references", help="make references again")
    making.add_argument("scenes", nargs="*", metavar="SCENE")
    drawing = commands.add_parser("blind", help="draw blind scenes into a new folder: scenes/, references/, manifest.json")
    drawing.add_argument("folder", type=Path, metavar="DIR")
    drawing.add_argument("--seed", type=int, required=True, metavar="N", help="the same seed draws the same scenes")
    drawing.add_argument("--scenes", type=int, default=5, metavar="K", help="how many scenes (default 5)")
    running = commands.add_parser("run", help="run this program's schemes and write their entries")
    running.add_argument("scenes", nargs="*", metavar="SCENE")
    theirs = commands.add_parser("siconos", help="score the runs of Siconos in JAWARI_REFERENCE")
    for each in (running, theirs):
        each.add_argument(
            "--rounds", type=int, default=2, metavar="N", help="number of further timings of every run (default 2)"
        )
        each.add_argument("--budget", type=float, default=10.0, metavar="SEC", help="longest run (default 10 s)")
        each.add_argument("--out", type=Path, default=entries.ENTRIES, metavar="DIR", help="folder of the files of scores")
    commands.add_parser("page", help="write the tables of docs/collisions.md")
    return parser


def scored(options: argparse.Namespace) -> int:
    """Every run, or one line for each that cannot be scored and nothing else."""
    outputs = [
        Named(f"--{key}", path) for key in ("json", "markdown", "entry") if (path := getattr(options, key)) is not None
    ]
    check_apart([Named("RUN", path) for path in options.runs], outputs)
    for target in outputs:
        check_target(target.path)
    folder = options.blind or FOLDER
    if options.blind and options.entry:
        raise ContestError("--entry: the tables have no blind scenes; write the scores with --json")
    found, faults = [], []
    for path in options.runs:
        try:
            data = runfile.read(path)
            name = runfile.scene_of(path, data, options.scene)
            facts, reference = scene.scene(name, folder), scene.reference(name, folder)
            found.append(score(runfile.brought(path, data, facts, reference), facts, reference))
        except ContestError as error:
            text = str(error)
            faults.append(text if str(path) in text else f"{path}: {text}")
    if faults:
        raise ContestError("\n".join(faults))
    if options.entry:
        head = {"name": options.name, "made_by": options.made_by, "source": options.source, "machine": options.machine}
        missing = [f"--{key.replace('_', '-')}" for key, value in head.items() if not value.strip()]
        if missing:
            raise ContestError(f"--entry: an entry needs a description; give {', '.join(missing)}")
        for each in found:
            if "scheme" not in each.run.words:
                raise ContestError(f"{each.run.path}: has no 'scheme', the words of its row in the table; write it")
        entries.write(options.entry, head, [each.record for each in found])
    text = report.of_scores(found)
    if options.json:
        records = [{"file": str(each.run.path), **each.record} for each in found]
        about: dict[str, Any] = {"benchmark": scene.VERSION}
        if options.blind:
            about["manifest"] = scene.digest(folder / scene.MANIFEST.name)
        write_text(options.json, json.dumps(about | {"scores": records}, indent=1, ensure_ascii=False) + "\n")
    if options.markdown:
        write_text(options.markdown, text)
    print(text, end="")
    for each in found:
        for words in each.suspicions:
            say(f"collisions: {each.run.path}: {words}")
    return 0


def _known(given: list[str], known: list[str]) -> list[str]:
    for name in given:
        if name not in known:
            raise ContestError(f"scene {name!r:.60} is not one of {', '.join(known)}")
    return given or known


def _head(machine_words: str) -> dict[str, Any]:
    from synth import __version__

    return {
        "name": "jawari",
        "made_by": "tools/collisions run",
        "source": f"this repository, version {__version__}; cost: CPU seconds of the steps, one core, best of the rounds",
        "machine": machine_words,
    }


def run(options: argparse.Namespace) -> int:
    """Entries of the schemes here; the scenes that are not asked for stay as they were."""
    from documentation import machine

    from benchmarks.__main__ import pin
    from benchmarks.collisions import contest

    names = _known(options.scenes, scene.names())
    here = machine.here()
    pin()
    path = options.out / OURS
    for name in names:
        records = contest.entered(name, scene.scene(name), scene.reference(name), options.rounds, options.budget, say)
        entries.merge(path, _head(here.words), records)
    say(str(path))
    return 0


def siconos(options: argparse.Namespace) -> int:
    """Runs of Siconos, and the schemes here on the same modes."""
    from documentation import machine

    from benchmarks.__main__ import pin
    from benchmarks.collisions import siconos as theirs

    here = machine.here()
    pin()
    scores, ours, records = theirs.scored(options.rounds, options.budget, OUT, say)
    head = {"name": "Siconos 4.4", "made_by": "tools/collisions siconos", "source": theirs.SOURCE}
    entries.write(options.out / "siconos.json", {**head, "machine": "as those files note it", "references": records}, scores)
    entries.write(
        options.out / "jawari-measured.json",
        _head(here.words) | {"name": "jawari, on measured modes", "made_by": head["made_by"]},
        ours,
    )
    return 0


def blind(options: argparse.Namespace) -> int:
    """Blind scenes in a new folder."""
    from benchmarks.collisions import blind as drawing

    if options.seed < 0 or not 1 <= options.scenes <= _MOST_BLIND:
        raise ContestError(f"--seed must be 0 or more and --scenes 1 to {_MOST_BLIND}, got {options.seed}, {options.scenes}")
    folder = options.folder
    drawing.draw(folder, options.seed, options.scenes, OUT, say)
    print(*scene.names(folder), sep="\n")
    say(f"hand out {folder / 'scenes'} and {folder / scene.MANIFEST.name}; keep {folder / 'references'} to score with")
    return 0


def page() -> int:
    """The tables of docs/collisions.md."""
    from documentation import page as pages

    from benchmarks.collisions import pagetables

    pages.put(pagetables.parts(), pages.DOCS / "collisions.md")
    return 0


def main() -> int:
    """The command line."""
    options = _parser().parse_args()
    try:
        if options.command == "list":
            for name in scene.names():
                facts = scene.scene(name)
                print(f"{name:14} {facts.duration_s:g} s at {facts.rate_hz:g} Hz: {facts.title}")
            return 0
        if options.command == "score":
            return scored(options)
        if options.command == "references":
            from benchmarks.collisions import references

            references.make(_known(options.scenes, scene.names()), OUT, say)
            return 0
        if options.command == "page":
            return page()
        if options.command == "blind":
            return blind(options)
        if options.rounds < 0 or not options.budget > 0:
            raise ContestError("--rounds must be 0 or more and --budget more than 0 s")
        return run(options) if options.command == "run" else siconos(options)
    except (ValueError, OSError) as error:
        for line in str(error).splitlines():
            print(f"collisions: error: {line}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        say("stopped; what is finished is kept")
        return 130
