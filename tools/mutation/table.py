"""What is mutated, what tests it, and which survivors are known: tests/mutants.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Known:
    """A survivor that stays. `was`, `now`: the changed lines without and with the change, blanks folded."""

    module: str
    was: str
    now: str
    reason: str


@dataclass(frozen=True)
class Table:
    """`groups`: the test files of each module, by group; paths are relative to the repository."""

    groups: Mapping[str, Mapping[str, tuple[str, ...]]]
    known: tuple[Known, ...]

    def reason(self, module: str, was: str, now: str) -> str | None:
        """Why this survivor stays; None: it is not known."""
        for entry in self.known:
            if (entry.module, folded(entry.was), folded(entry.now)) == (module, was, now):
                return entry.reason
        return None


def folded(text: str) -> str:
    """Every run of blanks one blank."""
    return " ".join(text.split())


def read_table(path: Path) -> Table:
    """Raises OSError, tomllib.TOMLDecodeError, KeyError and TypeError where the file is not as above."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    groups = {
        group: {module: tuple(tests) for module, tests in modules.items()} for group, modules in data["groups"].items()
    }
    return Table(groups, tuple(Known(**entry) for entry in data.get("known", [])))
