"""Makes a data set, from where it was left: shards that are whole are not computed again."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from synth.dataset.crew import Job, MadeItem, chunks, made_by
from synth.dataset.datacard import write_card
from synth.dataset.itemrows import as_json, join_rows, label_columns, write_rows
from synth.dataset.items import Item, Items
from synth.dataset.labelstore import labels_name, write_labels
from synth.dataset.recipefile import SPLITS, Written
from synth.dataset.setfolder import INDEX, PARTS, SetFolder, versions
from synth.dataset.shardfile import shard_name, write_shard
from synth.dataset.soloist import keys_of
from synth.dataset.splits import group_of, number_of, split_groups
from synth.instrument.preset import PresetError

#: an engine is prepared for all of its notes where there are no more than so many engines, else for those at hand
_WHOLE_ENGINES = 24

#: told how many items are done (those of earlier runs included), and how many there are
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Shard:
    """Items of one split, in the order in which they lie in the file."""

    split: str
    number: int
    keys: tuple[str, ...]


@dataclass
class Layout:
    """Where every item goes. groups: key → its group; empty: splits without an item that were to have some; notes: by
    engine those that it will be asked for, where all engines are kept, else nothing."""

    shards: list[Shard]
    groups: dict[str, str]
    splits: dict[str, int] = field(default_factory=dict)
    empty: tuple[str, ...] = ()
    notes: dict[Any, set[int]] = field(default_factory=dict)


@dataclass(frozen=True)
class Filled:
    """What a run has done: items in all, of this run, with an error; seconds of sound; wall clock [s]."""

    items: int
    made: int
    errors: int
    seconds: float
    wall_s: float


def layout(written: Written, items: Items) -> Layout:
    """Groups, splits and shards of all items: from the recipe alone. Each item is drawn once."""
    recipe = written.recipe
    strings = _Strings(items)
    groups: dict[str, str] = {}
    notes: dict[Any, set[int]] = {}
    for item in items:
        groups[item.key] = group_of(item, recipe.split.group_by, strings)
        if item.kind != "midi" and len(notes) <= _WHOLE_ENGINES:
            mine = notes.setdefault(item.engine, set())
            with suppress(ValueError):  # its row will say so
                mine |= keys_of(item)
    sizes: dict[str, int] = {}
    for group in groups.values():
        sizes[group] = sizes.get(group, 0) + 1
    split_of = split_groups(sizes, recipe.split.shares, recipe.seed, recipe.split.exact)
    members: list[list[str]] = [[] for _ in SPLITS]
    for key, group in groups.items():
        members[split_of[group]].append(key)
    shards = []
    for name, keys in zip(SPLITS, members, strict=True):
        if recipe.shards.shuffled:
            keys.sort(key=lambda key: (number_of(key, recipe.seed), key))
        size = recipe.shards.items
        for number, begin in enumerate(range(0, len(keys), size)):
            shards.append(Shard(name, number, tuple(keys[begin : begin + size])))
    empty = tuple(name for name, keys, part in zip(SPLITS, members, recipe.split.shares, strict=True) if part and not keys)
    sizes = {name: len(keys) for name, keys in zip(SPLITS, members, strict=True)}
    return Layout(shards, groups, sizes, empty, notes if len(notes) <= _WHOLE_ENGINES else {})


class _Strings:
    """The string that a single note is played on, as on a silent instrument; each is looked for once."""

    def __init__(self, items: Items) -> None:
        self._items = items
        self._found: dict[tuple[str, int], str] = {}

    def __call__(self, item: Item) -> str:
        if item.note is None:
            return ""
        if (item.preset, item.note) not in self._found:
            from synth.instrument.place import find

            try:
                place = find(self._items.presets(item.preset), item.note)
                self._found[item.preset, item.note] = f"{place.index} {place.label}"
            except PresetError:
                self._found[item.preset, item.note] = ""
        return self._found[item.preset, item.note]


def fill(
    written: Written,
    path: Path,
    *,
    workers: int = 1,
    progress: Progress = lambda done, total: None,
    items: Items | None = None,
) -> Filled:
    """Makes the data set of a recipe in a folder, or goes on with it. workers: processes that compute.

    Raises ValueError where the folder is of another recipe or code or another run writes to it; OSError where it cannot be
    written to: what is whole stays, and the next run goes on from there.
    """
    began = time.perf_counter()
    items = Items(written) if items is None else items
    folder = SetFolder(path)
    folder.make()
    with folder.locked():
        folder.begin(written, items)
        if folder.whole:
            write_card(folder, written, began_s=None)
            return _told(folder, items.size, 0, began)
        plan = layout(written, items)
        about = {"jawari.recipe": written.fingerprint, **{f"jawari.{name}": said for name, said in versions().items()}}
        made = _fill(folder, written, items, plan, workers, progress, about)
        parts = [folder.part(shard.split, shard.number) for shard in plan.shards]
        join_rows(folder / INDEX, parts, written.recipe, about)
        write_card(folder, written, began_s=time.perf_counter() - began if made == items.size else None)
        folder.finish()
        return _told(folder, items.size, made, began)


def _told(folder: SetFolder, total: int, made: int, began: float) -> Filled:
    from synth.dataset.itemrows import read_rows

    rows = read_rows(folder / INDEX, ["error", "seconds"])
    errors = sum(bool(row["error"]) for row in rows)
    return Filled(total, made, errors, sum(row["seconds"] or 0.0 for row in rows), time.perf_counter() - began)


class _Open:
    """A shard that is being made."""

    def __init__(self, shard: Shard) -> None:
        self.shard = shard
        self.made: dict[str, MadeItem] = {}


def _fill(
    folder: SetFolder, written: Written, items: Items, plan: Layout, workers: int, progress: Progress, about: dict[str, str]
) -> int:
    """Makes what is missing; how many items that were."""
    (folder / PARTS).mkdir(exist_ok=True)
    missing = deque(shard for shard in plan.shards if not folder.part(shard.split, shard.number).is_file())
    left = sum(len(shard.keys) for shard in missing)
    done = items.size - left
    progress(done, items.size)
    opened: dict[str, _Open] = {}

    def wanted() -> Iterator[list[Job]]:
        while missing:
            shard = _Open(missing.popleft())
            opened.update(dict.fromkeys(shard.shard.keys, shard))
            yield from chunks([items.by_key(key) for key in shard.shard.keys], plan.notes)

    writing: Future[None] | None = None  # shards are written while others are made, one after the other
    with closing(made_by(workers, written, items, wanted())) as coming, ThreadPoolExecutor(1) as writer:
        for made in coming:
            shard = opened.pop(made.key)
            shard.made[made.key] = made
            if len(shard.made) == len(shard.shard.keys):
                if writing is not None:
                    writing.result()
                writing = writer.submit(_close, folder, written, plan, shard, about)
            done += 1
            progress(done, items.size)
        if writing is not None:
            writing.result()
    return left


def _close(folder: SetFolder, written: Written, plan: Layout, opened: _Open, about: dict[str, str]) -> None:
    """Writes a shard, its labels, and last the part of the index that says that it is whole."""
    shard = opened.shard
    name = shard_name(shard.split, shard.number)
    inside = [opened.made[key] for key in shard.keys]
    sounds = [made for made in inside if made.flac]
    labelled = bool(label_columns(written.recipe))
    where: dict[str, dict[str, Any]] = {}
    if labelled:
        target = labels_name(shard.split, shard.number)
        (folder / target).parent.mkdir(parents=True, exist_ok=True)
        places = write_labels(folder / target, [made.labels for made in sounds], about)
        where = {made.key: {"labels": target, **place} for made, place in zip(sounds, places, strict=True)}
    members = []
    for made in sounds:
        members += [(f"{made.key}.flac", made.flac), (f"{made.key}.json", as_json(made.row | where.get(made.key, {})))]
    (folder / shard.split).mkdir(exist_ok=True)
    offsets = write_shard(folder / name, members)
    rows = []
    for made in inside:
        row = made.row | {"split": shard.split, "group": plan.groups[made.key]} | where.get(made.key, {})
        if made.flac:
            sound, said = offsets[f"{made.key}.flac"], offsets[f"{made.key}.json"]
            row |= {"shard": name, "offset": sound.offset, "size": sound.size}
            row |= {"json_offset": said.offset, "json_size": said.size}
        rows.append(row)
    write_rows(folder.part(shard.split, shard.number), rows, written.recipe, about)
