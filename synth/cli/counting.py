"""Lines that count: items of a data set, rows of a study; how fast, and how long it will take."""

from __future__ import annotations

import sys
import time
from collections import deque
from typing import TYPE_CHECKING

from synth.cli.common import ProgressLine
from synth.units import duration

if TYPE_CHECKING:
    from synth.study.conducting import Counts

#: between two lines where there is no terminal [s], and from the beginning to the first of them
HEARTBEAT_S, _FIRST_S = 30.0, 2.0
#: a rate is that of the last so many seconds, and of so many at least
_WINDOW_S, _LEAST_S = 60.0, 0.5
_BAR = 24


class Pace:
    """How many a second were done over the last minute."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, int]] = deque()

    def tell(self, done: int) -> None:
        """So many are done now."""
        now = time.monotonic()
        if not self._seen or now - self._seen[-1][0] > _LEAST_S:
            self._seen.append((now, done))
            while now - self._seen[0][0] > _WINDOW_S:
                self._seen.popleft()

    @property
    def per_s(self) -> float:
        """0 while that is not known."""
        if len(self._seen) < 2:
            return 0.0
        (since, before), (now, here) = self._seen[0], self._seen[-1]
        return (here - before) / (now - since)


class ItemsLine(ProgressLine):
    """How many items are done, how fast, and how long it will take."""

    def __init__(self, on: bool) -> None:
        super().__init__(on)
        self._pace = Pace()

    def __enter__(self) -> ItemsLine:
        return self

    def items(self, done: int, total: int) -> None:
        """Shows that so many of all are done."""
        self._pace.tell(done)
        if not self._due(time.monotonic()) and done != total:
            return
        text = f"{100.0 * done / max(1, total):3.0f} %  {done} of {total} items"
        if rate := self._pace.per_s:
            text += f"  {rate:.1f} a second, {duration((total - done) / rate)} left"
        if self._on:
            self._write(text)


class RowsLine(ProgressLine):
    """Is told a study's `Counts`: a line that overwrites itself on a terminal, elsewhere one every `heartbeat_s`."""

    def __init__(self, on: bool, heartbeat_s: float = HEARTBEAT_S) -> None:
        terminal = sys.stderr.isatty()
        super().__init__(on and terminal)
        self._beats = on and not terminal
        self._heartbeat_s = heartbeat_s
        self._beat = time.monotonic() - max(0.0, heartbeat_s - _FIRST_S)
        self._pace = Pace()

    def __enter__(self) -> RowsLine:
        return self

    def rows(self, counts: Counts) -> None:
        """Shows how far a study is."""
        self._pace.tell(counts.computed)
        now = time.monotonic()
        if self._beats and now - self._beat >= self._heartbeat_s:
            self._beat = now
            print(f"synth: {self.line(counts)}", file=sys.stderr, flush=True)
        elif self._due(now):
            share = counts.done / counts.total if counts.total else 1.0
            full = int(share * _BAR)
            self._write(f"[{'=' * full}{' ' * (_BAR - full)}] {100.0 * share:3.0f} %, {self.line(counts)}")

    def line(self, counts: Counts) -> str:
        """Rows, rate, time left, failures, workers."""
        parts = [f"{counts.done} of {counts.total} rows"]
        if rate := self._pace.per_s:
            parts += [f"{rate:.3g} rows/s", f"{duration((counts.total - counts.done) / rate)} left"]
        if counts.failed:
            parts.append(f"{counts.failed} failed")
        parts.append(
            f"{counts.workers} worker{'' if counts.workers == 1 else 's'}" if counts.workers else "waiting for workers"
        )
        return ", ".join(parts)
