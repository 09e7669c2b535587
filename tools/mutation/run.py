"""A run over groups of modules, and what is told of it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from mutation.sample import Mutant, at_line, sample
from mutation.table import Table
from mutation.trial import CAUGHT, SURVIVED, TIMED_OUT, Bench, Trial, WrongUse


def run(tree: Path, table: Table, groups: Sequence[str], count: int, seed: int, places: Sequence[str] = ()) -> int:
    """Tries `count` mutants of each group, or all at these FILE:LINE; the exit code. Raises WrongUse."""
    tests = {module: files for modules in table.groups.values() for module, files in modules.items()}
    made: dict[str, list[Mutant]] = {}
    for place in places:
        module, _, line = place.rpartition(":")
        if module not in tests or not line.isdecimal():
            raise WrongUse(f"--at must be a module of --list and a line, as synth/midi/zones.py:24, got {place!r}")
        made[place] = at_line(tree, module, int(line))
    if not places:
        made = {group: sample(tree, table.groups[group], count, f"{group} {seed}") for group in groups}
    bench = Bench(tree)
    tried: dict[str, list[Trial]] = {}
    for name, mutants in made.items():
        tried[name] = []
        for mutant in mutants:
            tried[name].append(bench.tried(mutant, tests[mutant.module]))
            print(f"{tried[name][-1].verdict}: {tried[name][-1].told()}", file=sys.stderr, flush=True)
    return told(tried, table)


def told(tried: dict[str, list[Trial]], table: Table) -> int:
    """Prints the table and the survivors; 1 if some are not known."""
    print("| group | made | caught | timed out | survived | equivalent | score |\n|---|---|---|---|---|---|---|")
    unknown: list[str] = []
    known: list[str] = []
    counts: list[list[int]] = []
    for group, trials in tried.items():
        reasons = {t: table.reason(t.mutant.module, t.was, t.now) for t in trials if t.verdict == SURVIVED}
        new = [trial.told() for trial, reason in reasons.items() if reason is None]
        unknown += new
        known += [f"{trial.told()}\n    {reason}" for trial, reason in reasons.items() if reason is not None]
        by_verdict = [sum(trial.verdict == verdict for trial in trials) for verdict in (CAUGHT, TIMED_OUT)]
        counts.append([len(trials), *by_verdict, len(new), len(reasons) - len(new)])
        print(_row(group, counts[-1]))
    if len(counts) > 1:
        print(_row("all", [sum(column) for column in zip(*counts, strict=True)]))
    for title, lines in (("survived", unknown), ("equivalent", known)):
        if lines:
            print(f"\n{title}: {len(lines)}", *lines, sep="\n")
    return int(bool(unknown))


def _row(name: str, counts: Sequence[int]) -> str:
    made, caught, timed_out, _, equivalent = counts
    judged = made - equivalent
    score = f"{(caught + timed_out) / judged:.1%}" if judged else "–"
    return "| " + " | ".join([name, *map(str, counts), score]) + " |"
