"""Mutants tried in a copy of the tree, one at a time, by cosmic-ray."""

from __future__ import annotations

import fcntl
import os
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.work_item import TestOutcome

from mutation.sample import Mutant
from mutation.table import folded

CAUGHT, TIMED_OUT, SURVIVED = "caught", "timed out", "survived"
#: a mutant may take this many times what the tests take without it, and so many seconds more
PATIENCE, MORE_S = 4.0, 30.0


class WrongUse(Exception):
    """What the user has to put right."""


@dataclass(frozen=True)
class Trial:
    """What became of a mutant. `was`, `now`: the changed lines without and with the change, blanks folded."""

    mutant: Mutant
    verdict: str
    was: str
    now: str

    def told(self) -> str:
        return f"{self.mutant.module}:{self.mutant.place[0][0]}\n  - {self.was}\n  + {self.now}"


@contextmanager
def private_copy(root: Path) -> Iterator[Path]:
    """The tree in the user's cache, with the files of this one as they are. Raises WrongUse while another run has it."""
    tree = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").resolve() / "jawari" / "mutants"
    tree.mkdir(mode=0o700, parents=True, exist_ok=True)
    with open(tree.with_suffix(".lock"), "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise WrongUse(f"another run is using {tree}; wait until it ends") from None
        command = ["git", "-C", str(root), "ls-files", "-co", "--exclude-standard"]
        named = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
        copied(root, tree, [name for name in named if (root / name).is_file()])
        yield tree


def copied(root: Path, tree: Path, files: Iterable[str]) -> None:
    """Makes `tree` hold these files of `root` and no others. Times are kept: compiled kernels go by them."""
    wanted = set(files)
    for there in [path for path in tree.rglob("*") if path.is_file() and "__pycache__" not in path.parts]:
        if str(there.relative_to(tree)) not in wanted:
            there.unlink()
    for name in sorted(wanted):
        here, there = root / name, tree / name
        if not there.is_file() or there.stat().st_mtime_ns != here.stat().st_mtime_ns:
            there.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(here, there)


class Bench:
    """Runs tests in a copy of the tree. How long they take without a mutant is measured once, on the second of two runs:
    the first may compile kernels."""

    def __init__(self, tree: Path) -> None:
        self._tree = tree
        self._limits_s: dict[tuple[str, ...], float] = {}

    def tried(self, mutant: Mutant, tests: Sequence[str]) -> Trial:
        """Raises WrongUse where the tests fail without the mutant."""
        # cosmic-ray starts its command in the directory and with the environment that it has itself
        os.chdir(self._tree)
        os.environ["PYTHONPATH"] = str(self._tree)
        options = ["-x", "-q", "-p", "no:cacheprovider", "-m", "not slow"]
        command = [sys.executable, "-m", "pytest", *options, *tests]
        if tuple(tests) not in self._limits_s:
            self._limits_s[tuple(tests)] = _limit_s(command)
        result = mutate_and_test([mutant.spec(self._tree)], shlex.join(command), self._limits_s[tuple(tests)])
        lines = (result.diff or "").splitlines()[3:]
        was, now = (folded(" ".join(line[1:] for line in lines if line.startswith(sign))) for sign in "-+")
        if result.test_outcome == TestOutcome.SURVIVED:
            return Trial(mutant, SURVIVED, was, now)
        if result.test_outcome != TestOutcome.KILLED:
            raise RuntimeError(result.output)
        return Trial(mutant, TIMED_OUT if result.output == "timeout" else CAUGHT, was, now)


def _limit_s(command: list[str]) -> float:
    for _ in range(2):
        begun = time.monotonic()
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise WrongUse(f"the tests must pass without a mutant: {shlex.join(command)}\n{done.stdout}{done.stderr}")
    return MORE_S + PATIENCE * (time.monotonic() - begun)
