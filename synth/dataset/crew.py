"""Workers, each a process with engines of its own, and who gives them items: a process knows no other's interpreter lock.

An item goes out with others of its engine; a worker that has died is replaced, and what it was at is tried again item by
item: the one that kills a second worker is a row with an error like others. Workers speak by pipes and listen to nobody
else; where the process that asks them has ended, however it did, they end at once.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from synth.dataset.items import Item, Items
from synth.dataset.recipefile import Written

#: items that a worker is given at a time
CHUNK = 8
#: workers that may end before they have begun
MOST_STILLBORN = 3
#: chunks that a worker has at most, and how long they take it, so that it neither waits for the next nor has much left
#: when the others have ended [s]
_AHEAD, _AHEAD_S = 8, 0.3


@dataclass(frozen=True)
class MadeItem:
    """An item as a worker gives it: its row, FLAC (empty: there is an error) and labels."""

    key: str
    row: dict[str, Any]
    flac: bytes
    labels: dict[str, Any]


@dataclass(frozen=True)
class Chunk:
    """Items of one engine, and the notes that it will be asked for."""

    keys: tuple[str, ...]
    notes: frozenset[int]


class Maker:
    """Makes items in this process."""

    def __init__(self, written: Written, items: Items | None = None) -> None:
        from synth.dataset.setfolder import code
        from synth.dataset.soloist import Soloist

        self._written = written
        self._items = Items(written) if items is None else items
        self._soloist = Soloist(written, self._items.presets)
        self._code = code()

    def make(self, key: str, notes: Iterable[int] = ()) -> MadeItem:
        """One item; what is wrong with it stands in its row."""
        from synth._version import __version__
        from synth.dataset.itemrows import row_of
        from synth.dataset.packing import pack

        item, recipe = self._items.by_key(key), self._written.recipe
        try:
            sung = self._soloist.play(item, notes)
            packed = pack(sung.samples, recipe.sound, recipe.level, item.seed)
        except Exception as error:  # whatever it is, it is this item's
            said = " ".join(str(error).split())
            known = isinstance(error, ValueError | RuntimeError | OSError) and said
            said = said if known else f"{type(error).__name__}: {said}"
            return MadeItem(key, row_of(item, recipe, None, None, said, __version__, self._code), b"", {})
        return MadeItem(key, row_of(item, recipe, sung, packed, "", __version__, self._code), packed.flac, sung.labels)

    def close(self) -> None:
        """Ends its engines."""
        self._soloist.close()


def chunks(items: Sequence[Item], notes: dict[Any, set[int]]) -> list[Chunk]:
    """Items in portions of one engine each; notes: by engine, those that it is to be prepared for, else those at hand."""
    order = sorted(items, key=lambda item: (item.engine, item.file, item.beats[0].note if item.beats else 0, item.key))
    found: list[Chunk] = []
    mine: list[Item] = []
    for item in [*order, None]:
        if mine and (item is None or item.engine != mine[0].engine or len(mine) == CHUNK):
            asked = notes.get(mine[0].engine) or {beat.note for each in mine for beat in each.beats if 0 <= beat.note <= 127}
            found.append(Chunk(tuple(each.key for each in mine), frozenset(asked)))
            mine = []
        if item is not None:
            mine.append(item)
    return found


def _work(connection: Connection, written: Written) -> None:
    """A worker's life: chunks in, items out, until nobody asks any more."""
    from threadpoolctl import threadpool_limits

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever asks is interrupted, and ends us
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with threadpool_limits(1):
        maker = Maker(written)
        with suppress(BrokenPipeError):
            connection.send(None)  # ready
        while True:
            try:
                chunk = connection.recv()
                if chunk is None:
                    break
                for key in chunk.keys:
                    connection.send(maker.make(key, chunk.notes))
            except (EOFError, BrokenPipeError, ConnectionResetError):
                break
        maker.close()


def _end_with_parent() -> None:
    """Waits until the process that began this one has ended, then ends this one, whatever it is at: a pipe would tell it
    only once its item is made."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


class _Worker:
    def __init__(self, written: Written) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.process = context.Process(target=_work, args=(theirs, written), daemon=True)
        self.process.start()
        theirs.close()
        self.ready = False
        self.chunks: deque[tuple[Chunk, set[str]]] = deque()  # given, with the keys that have not come back
        self._item_s, self._since = _AHEAD_S, time.monotonic()  # what one takes, smoothed

    def give(self, chunk: Chunk) -> None:
        self.chunks.append((chunk, set(chunk.keys)))
        with suppress(BrokenPipeError, ConnectionResetError):  # it is found dead when it is listened to
            self.connection.send(chunk)

    @property
    def hungry(self) -> bool:
        """Whether it should have another chunk."""
        left = sum(len(keys) for _, keys in self.chunks)
        return len(self.chunks) < _AHEAD and (left <= 1 or left * self._item_s < _AHEAD_S)

    def take(self, key: str) -> None:
        now = time.monotonic()
        self._item_s += 0.2 * (now - self._since - self._item_s)
        self._since = now
        self.chunks[0][1].discard(key)
        if not self.chunks[0][1]:
            self.chunks.popleft()

    def end(self) -> None:
        self.connection.close()
        self.process.terminate()
        self.process.join()


class WorkerPool:
    """Makes chunks of items by `workers` processes; of one worker in this process. A context manager, which ends them."""

    def __init__(self, written: Written, items: Items, workers: int) -> None:
        self._written, self._items, self._count = written, items, workers
        self._workers: list[_Worker] = []
        self._maker: Maker | None = None
        self._stillborn = 0
        self._killed: set[str] = set()  # keys that a worker was at when it died

    def __enter__(self) -> WorkerPool:
        if self._count == 1:
            self._maker = Maker(self._written, self._items)
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._workers:
            worker.end()
        self._workers = []
        if self._maker is not None:
            self._maker.close()

    def make(self, wanted: Iterator[Chunk]) -> Iterator[MadeItem]:
        """All items of the chunks, in the order in which they are done; `wanted` is asked no earlier than needed."""
        if self._maker is not None:
            for chunk in wanted:
                for key in chunk.keys:
                    yield self._maker.make(key, chunk.notes)
            return
        again: deque[Chunk] = deque()
        while True:
            for number in range(self._count):
                while number >= len(self._workers) or self._workers[number].hungry:
                    given = again.popleft() if again else next(wanted, None)
                    if given is None:
                        break
                    if number >= len(self._workers):
                        self._workers.append(_Worker(self._written))
                    self._workers[number].give(given)
            busy = [worker for worker in self._workers if worker.chunks]
            if not busy and not again:
                return
            for ready in wait([worker.connection for worker in busy]):
                number = next(n for n, worker in enumerate(self._workers) if worker.connection is ready)
                worker = self._workers[number]
                try:
                    made = worker.connection.recv()
                except (EOFError, OSError):
                    yield from self._replace(number, again)
                    continue
                if made is None:
                    worker.ready = True
                    continue
                worker.take(made.key)
                yield made

    def _replace(self, number: int, again: deque[Chunk]) -> Iterator[MadeItem]:
        """A worker has died: another one, and its items one by one; one that has killed two workers has an error."""
        from synth._version import __version__
        from synth.dataset.itemrows import row_of
        from synth.dataset.setfolder import code

        dead = self._workers[number]
        dead.end()
        if not dead.ready:
            self._stillborn += 1
            if self._stillborn > MOST_STILLBORN:
                raise ChildProcessError(
                    f"workers end at once (exit code {dead.process.exitcode}); in a program of your own make data "
                    "sets under if __name__ == '__main__'"
                )
        self._workers[number] = _Worker(self._written)
        for place, (lost, left) in enumerate(dead.chunks):
            keys = [key for key in lost.keys if key in left]
            if place == 0 and keys and dead.ready:
                first = keys[0]
                if first in self._killed:
                    keys.remove(first)
                    said = f"its worker died twice (exit code {dead.process.exitcode}); out of memory, or killed"
                    row = row_of(self._items.by_key(first), self._written.recipe, None, None, said, __version__, code())
                    yield MadeItem(first, row, b"", {})
                self._killed.add(first)
            again.extend(Chunk((key,), lost.notes) for key in keys)
