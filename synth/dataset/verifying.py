"""Is a data set what its index says, and does the program still make the same of it?"""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from synth.dataset.crew import MadeItem, Maker
from synth.dataset.itemrows import PLACES, read_rows
from synth.dataset.items import Items
from synth.dataset.labelstore import read_labels
from synth.dataset.packing import decode, digest
from synth.dataset.setfolder import INDEX, STATE, SetFolder, code
from synth.dataset.shardfile import read_member


@dataclass(frozen=True)
class Verified:
    """items: that were checked; faults: a line each; other_code: the program is not the one that made it."""

    items: int
    faults: tuple[str, ...]
    other_code: bool


def regenerate(folder: SetFolder, keys: Sequence[str]) -> Iterator[MadeItem]:
    """Items of a data set, made anew from its own recipe. Raises ValueError for a key or a folder that is not there."""
    written = folder.written()
    items = Items(written)
    for key in keys:
        items.by_key(key)
    maker = Maker(written, items)
    try:
        for key in keys:
            yield maker.make(key)
    finally:
        maker.close()


def verify(
    folder: SetFolder, count: int, seed: int | None = None, progress: Callable[[int, int], None] = lambda done, total: None
) -> Verified:
    """Looks at the whole index, and at `count` random items: sound and JSON where and as the index says, and the same to
    the bit when made again, labels too. seed: of the choice; None: another one each time. Raises ValueError where there is
    no whole data set."""
    if not (folder / INDEX).is_file():
        folder.state()
        raise ValueError(f"{folder.path}: is not complete yet ({INDEX} is missing); run synth dataset again to continue")
    rows = read_rows(folder / INDEX)
    faults = list(_of_all(folder, rows))
    chosen = random.Random(seed).sample(rows, min(count, len(rows)))
    chosen.sort(key=lambda row: (row["preset"], row["key"]))
    state = folder.state()
    for done, (row, made) in enumerate(
        zip(chosen, regenerate(folder, [row["key"] for row in chosen]), strict=True), start=1
    ):
        try:
            faults += [f"{row['key']}: {what}" for what in _of_one(folder, row, made)]
        except (OSError, ValueError) as error:
            faults.append(f"{row['key']}: {error}")
        progress(done, len(chosen))
    return Verified(len(chosen), tuple(faults), state["versions"]["code"] != code())


def _of_all(folder: SetFolder, rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """What the index alone shows."""
    state = folder.state()
    if len(rows) != state["items"]:
        yield f"{INDEX}: has {len(rows)} rows, {STATE} says {state['items']}"
    if len({row["key"] for row in rows}) != len(rows):
        yield f"{INDEX}: contains duplicate keys"
    split_of: dict[str, str] = {}
    for row in rows:
        if split_of.setdefault(row["group"], row["split"]) != row["split"]:
            yield f"{row['key']}: its group is in {split_of[row['group']]} and in {row['split']}"
    ends: dict[str, int] = {}
    for row in rows:
        if row["shard"]:
            ends[row["shard"]] = max(
                ends.get(row["shard"], 0), row["offset"] + row["size"], row["json_offset"] + row["json_size"]
            )
    for shard, end in ends.items():
        path = folder / shard
        if not path.is_file():
            yield f"{shard}: is missing"
        elif path.stat().st_size < end:
            yield f"{shard}: ends before byte {end}"


def _of_one(folder: SetFolder, row: dict[str, Any], made: MadeItem) -> Iterator[str]:
    """What is wrong with an item. Raises OSError or ValueError where it cannot be read."""
    if row["error"] != made.row["error"]:
        yield f"has the error {row['error']!r}, and {made.row['error']!r} when made again"
        return
    if row["error"]:
        return
    flac = read_member(folder / row["shard"], row["offset"], row["size"])
    said = json.loads(read_member(folder / row["shard"], row["json_offset"], row["json_size"]))
    pcm, rate_hz = decode(flac)
    again, _ = decode(made.flac)
    if digest(pcm) != row["sha256"]:
        yield "its sound does not match the index (sha256)"
    if len(pcm) != row["frames"] or abs(len(pcm) / rate_hz - row["seconds"]) > 1e-9:
        yield f"has {len(pcm)} frames at {rate_hz} Hz, {row['frames']} are in the index"
    if not np.array_equal(pcm, again):
        yield "has a different sound when made again"
    if {name: value for name, value in row.items() if name not in PLACES and value is not None} != said:
        yield "its JSON does not match the index"
    versions = {"version", "code"}
    for name, value in made.row.items():
        if name not in versions and value != row[name]:
            yield f"{name} is {row[name]!r} in the index, and {value!r} when made again"
    if row.get("labels"):
        kept = read_labels(folder / row["labels"], row)
        if set(kept) != set(made.labels):
            yield "has different labels when made again"
        for name in set(kept) & set(made.labels):
            if not np.array_equal(kept[name], made.labels[name], equal_nan=made.labels[name].dtype.kind == "f"):
                yield f"its labels {name} differ when made again"
