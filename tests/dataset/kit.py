"""Small recipes, written and read."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from synth.dataset.crew import MadeItem, Maker
from synth.dataset.itemrows import read_rows
from synth.dataset.recipefile import Written, read_recipe

HEAD = """\
format = 1
title = "Test"
licence = "CC0-1.0"
seed = 7
[sound]
quality = "draft"
"""
NOTES = """\
[shards]
items = 5
[split]
train = 0.5
validation = 0.25
test = 0.25
[[notes]]
preset = "jawari-harp"
note = ["C3", "E3", "G3", "C4"]
velocity = [60, 110]
hold_s = 0.15
release_s = 0.05
live."pluck.position" = { from = 0.08, to = 0.3 }
set."pluck.width_mm" = [8.0, 12.0]
"""


def written(folder: Path, tables: str = NOTES, head: str = HEAD) -> Written:
    """A recipe of these tables in a folder, read."""
    path = folder / "recipe.toml"
    path.write_text(head + tables, encoding="utf-8")
    return read_recipe(path)


def rows(folder: Path) -> list[dict]:
    """All rows of a data set's index."""
    return read_rows(folder / "index.parquet")


def files(folder: Path) -> dict[str, bytes]:
    """All files below a folder but its lock, by name."""
    found = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != ".lock")
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


class Deadly(Maker):
    """Makes items but for one, at which its process ends."""

    def make(self, key: str, notes: Iterable[int] = ()) -> MadeItem:
        if key == "n0-00000003":
            os._exit(7)
        return super().make(key, notes)
