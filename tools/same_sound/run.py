"""From a commit and the scenes to a line about each of them."""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from same_sound import trees
from same_sound.compare import DIFFERS, EQUAL, MISSING, NEW, Finding, compared
from same_sound.scenes import scenes
from same_sound.session import DONE, UNKNOWN, Answer, answers
from same_sound.trees import Base, Side, WrongUse

#: most arrays of a scene that are told
MOST_TOLD = 6


def chosen(patterns: Sequence[str]) -> list[dict[str, Any]]:
    """The scenes whose names match one of the patterns; all for none. Raises WrongUse where a pattern matches nothing."""
    every = scenes()
    for pattern in patterns:
        if not any(fnmatchcase(scene["name"], pattern) for scene in every):
            raise WrongUse(f"--only {pattern!r} matches no scene; --list names them")
    return [scene for scene in every if not patterns or any(fnmatchcase(scene["name"], each) for each in patterns)]


def list_scenes(patterns: Sequence[str]) -> int:
    """Print the names."""
    for scene in chosen(patterns):
        print(scene["name"])
    return 0


def run(base_name: str, patterns: Sequence[str], jobs: int, keep: Path | None) -> int:
    """Compare, print, and give the exit code. Raises WrongUse."""
    from synth.jit.kernel_cache import cache_folder

    wanted = chosen(patterns)
    base = trees.base_at(base_name, cache_folder().parent / "same-sound")
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
    changed = trees.changes()
    state = f" and {changed} changed file{'' if changed == 1 else 's'}" if changed else ""
    print(f"BASE {base.commit[:10]} against the working tree ({trees.commit_of('HEAD')[:10]}{state}), {len(wanted)} scenes")
    for dependency in trees.other_dependencies(base):
        print(f"note: BASE asks for {dependency}; both run with what is installed here")
    began = time.perf_counter()
    then = _base_answers(base, wanted, jobs)
    tally = dict.fromkeys((EQUAL, DIFFERS, NEW), 0)
    unknown: set[str] = set()
    with tempfile.TemporaryDirectory() as folder:
        here = Side("working tree", trees.ROOT)
        files = [(scene, Path(folder) / f"{number}.npz") for number, scene in enumerate(wanted)]
        progress = Progress(here.name, len(files))
        for now in answers(here, files, jobs):
            name = now.scene["name"]
            verdict = judged(then[name], now)
            tally[verdict.what] += 1
            unknown |= {array.split(".", 1)[1] if array[0].isdecimal() else array for array in verdict.new}  # of all runs
            progress.clear()
            print(f"{verdict.what:<8} {name}{': ' if verdict.why else ''}{verdict.why}", flush=True)
            if keep is not None and verdict.what == DIFFERS:
                for side, answer in (("base", then[name]), ("here", now)):
                    if answer.came == DONE:
                        shutil.copyfile(answer.path, keep / f"{name.replace('/', '-')}.{side}.npz")
            progress.next(now)
            now.path.unlink(missing_ok=True)
        progress.clear()
    if unknown:
        print(f"note: arrays that BASE does not have: {', '.join(sorted(unknown))}")
    counts = f"{tally[EQUAL]} equal, {tally[DIFFERS]} different"
    new = f", {tally[NEW]} that BASE does not have" if tally[NEW] else ""
    print(f"{counts}{new}, {time.perf_counter() - began:.0f} s")
    return 1 if tally[DIFFERS] else 0


class Verdict(NamedTuple):
    """EQUAL, DIFFERS or NEW (BASE does not know the scene), why, and the arrays that BASE does not know."""

    what: str
    why: str = ""
    new: tuple[str, ...] = ()


def judged(then: Answer, now: Answer) -> Verdict:
    """What came of a scene."""
    if now.came == DONE and then.came == DONE:
        with np.load(then.path) as base, np.load(now.path) as here:
            return verdict_of(compared(base, here))
    if now.came == DONE and then.came == UNKNOWN:
        return Verdict(NEW, f"BASE does not have it: {then.words}")
    if now.came == then.came and now.words == then.words:
        return Verdict(DIFFERS, f"{now.came} on both sides, so nothing is compared: {now.words}")
    sides = (("BASE", then), ("working tree", now))
    said = [f"{side}: {answer.came}{': ' if answer.words else ''}{answer.words}" for side, answer in sides]
    return Verdict(DIFFERS, "; ".join(said))


def verdict_of(findings: Sequence[Finding]) -> Verdict:
    """What came of a scene by its arrays."""
    if all(each.verdict == NEW for each in findings):
        return Verdict(DIFFERS, "no array exists on both sides, so nothing is compared")
    differ = [each for each in findings if each.verdict in (DIFFERS, MISSING)]
    words = [each.line() for each in differ[:MOST_TOLD]]
    if len(differ) > MOST_TOLD:
        words.append(f"and {len(differ) - MOST_TOLD} more arrays")
    if nans := [f"{each.array} ({each.nans})" for each in findings if each.verdict == EQUAL and each.nans]:
        words.append(f"NaN at the same places: {', '.join(nans)}")
    new = tuple(each.array for each in findings if each.verdict == NEW)
    return Verdict(DIFFERS if differ else EQUAL, "; ".join(words), new)


def _base_answers(base: Base, wanted: Sequence[dict[str, Any]], jobs: int) -> dict[str, Answer]:
    """BASE's answers by scene: those that are kept, and the others made now."""
    found, missing = {}, []
    for scene in wanted:
        path = base.kept(scene)
        if path.is_file():
            found[scene["name"]] = Answer(scene, DONE, "", 0.0, path)
        else:
            missing.append((scene, path))
    progress = Progress(base.side.name, len(missing))
    for answer in answers(base.side, missing, jobs):
        found[answer.scene["name"]] = answer
        progress.next(answer)
    progress.clear()
    return found


class Progress:
    """How far a side is, on standard error: a line that overwrites itself, elsewhere one every ten seconds."""

    EVERY_S = 10.0

    def __init__(self, side: str, total: int) -> None:
        self._side, self._total, self._done = side, total, 0
        self._width, self._told = 0, time.monotonic()
        self._line = sys.stderr.isatty()
        if total:
            self._show("starting", now=True)

    def next(self, answer: Answer) -> None:
        """One scene more."""
        self._done += 1
        self._show(f"{answer.scene['name']} ({answer.took_s:.1f} s)")

    def clear(self) -> None:
        """Make room for other lines."""
        if self._line and self._width:
            sys.stderr.write("\r" + " " * self._width + "\r")
            sys.stderr.flush()
            self._width = 0

    def _show(self, what: str, now: bool = False) -> None:
        text = f"{self._side}: {self._done} of {self._total}, {what}"
        if self._line:
            sys.stderr.write("\r" + text.ljust(self._width))
            sys.stderr.flush()
            self._width = len(text)
        elif now or time.monotonic() - self._told >= self.EVERY_S:
            print(text, file=sys.stderr, flush=True)
            self._told = time.monotonic()
