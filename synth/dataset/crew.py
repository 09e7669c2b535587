"""Who makes the items of a data set: workers, each with engines of its own, or this process.

An item goes out with others of its engine. What a worker was at when it died is tried again: the item that kills a second
worker is a row with an error like others.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from synth._version import __version__
from synth.dataset.itemrows import row_of
from synth.dataset.items import Item, Items
from synth.dataset.packing import pack
from synth.dataset.recipefile import Recipe, Written
from synth.dataset.setfolder import code
from synth.dataset.soloist import Soloist
from synth.workers import Here, Killed, WorkerPool

#: items that a worker is given at a time
CHUNK = 8


@dataclass(frozen=True)
class MadeItem:
    """An item as a worker gives it: its row, FLAC (empty: there is an error) and labels."""

    key: str
    row: dict[str, Any]
    flac: bytes
    labels: dict[str, Any]


class Maker:
    """Makes items in this process."""

    def __init__(self, written: Written, items: Items | None = None) -> None:
        self._written = written
        self._items = Items(written) if items is None else items
        self._soloist = Soloist(written, self._items.presets)

    def __call__(self, key: str, notes: Iterable[int]) -> MadeItem:
        return self.make(key, notes)

    def make(self, key: str, notes: Iterable[int] = ()) -> MadeItem:
        """One item; what is wrong with it stands in its row."""
        item, recipe = self._items.by_key(key), self._written.recipe
        try:
            sung = self._soloist.play(item, notes)
            packed = pack(sung.samples, recipe.sound, recipe.level, item.seed)
        except Exception as error:  # whatever it is, it is this item's
            said = " ".join(str(error).split())
            known = isinstance(error, ValueError | RuntimeError | OSError) and said
            return _failed(item, recipe, said if known else f"{type(error).__name__}: {said}")
        return MadeItem(key, row_of(item, recipe, sung, packed, "", __version__, code()), packed.flac, sung.labels)

    def close(self) -> None:
        """Ends its engines."""
        self._soloist.close()


def _failed(item: Item, recipe: Recipe, said: str) -> MadeItem:
    return MadeItem(item.key, row_of(item, recipe, None, None, said, __version__, code()), b"", {})


#: an item's key, and the notes that its engine will be asked for
Job = tuple[str, frozenset[int]]


def chunks(items: Sequence[Item], notes: dict[Any, set[int]]) -> list[list[Job]]:
    """Items in portions of one engine each; notes: by engine, those that it is to be prepared for, else those at hand."""
    order = sorted(items, key=lambda item: (item.engine, item.file, item.beats[0].note if item.beats else 0, item.key))
    found: list[list[Job]] = []
    for engine, group in groupby(order, key=lambda item: item.engine):
        same = list(group)
        for begin in range(0, len(same), CHUNK):
            mine = same[begin : begin + CHUNK]
            asked = notes.get(engine) or {beat.note for each in mine for beat in each.beats if 0 <= beat.note <= 127}
            found.append([(each.key, frozenset(asked)) for each in mine])
    return found


def made_by(workers: int, written: Written, items: Items, wanted: Iterator[list[Job]]) -> Generator[MadeItem]:
    """All items of the chunks by so many processes (1: this one), in the order in which they are done; `wanted` is asked no
    earlier than needed."""
    with closing(Here(Maker, written, items) if workers == 1 else WorkerPool(workers, Maker, written)) as crew:
        asked: dict[int, Job] = {}
        killed: set[str] = set()  # keys that a worker was at when it died

        def ask(jobs: Sequence[Job]) -> None:
            asked.update(zip(crew.submit_together(jobs), jobs, strict=True))

        while True:
            while len(asked) < 2 * CHUNK * workers and (chunk := next(wanted, None)) is not None:
                ask(chunk)
            if not asked:
                return
            for ticket, found in crew.wait():
                key, notes = asked.pop(ticket)
                if not isinstance(found, Killed):
                    yield found
                elif key in killed:
                    said = f"its worker died twice (exit code {found.code}); out of memory, or killed"
                    yield _failed(items.by_key(key), written.recipe, said)
                else:
                    killed.add(key)
                    ask([(key, notes)])
