"""How far a study is: a line that overwrites itself on a terminal, a line now and then elsewhere, and what a folder says."""

from __future__ import annotations

import math
import time
from collections import deque
from pathlib import Path
from typing import Any, TextIO

from synth.study.conducting import Counts

#: between two lines where there is no terminal, on one [s]
HEARTBEAT_S, REFRESH_S = 30.0, 0.2
#: rate and time left are those of the last so many seconds
_WINDOW_S = 60.0
_BAR = 24


class Progress:
    """Is told `Counts`; writes to a stream, nothing where it is None."""

    def __init__(self, stream: TextIO | None, heartbeat_s: float = HEARTBEAT_S) -> None:
        self._stream = stream
        self._terminal = stream is not None and stream.isatty()
        self._every = REFRESH_S if self._terminal else heartbeat_s
        self._shown = time.monotonic() - (self._every if self._terminal else max(0.0, self._every - 2.0))
        self._seen: deque[tuple[float, int]] = deque()
        self._width = 0

    def __call__(self, counts: Counts) -> None:
        now = time.monotonic()
        if not self._seen or now - self._seen[-1][0] > 0.5:
            self._seen.append((now, counts.computed))
            while now - self._seen[0][0] > _WINDOW_S:
                self._seen.popleft()
        if self._stream is None or now - self._shown < self._every:
            return
        self._shown = now
        text = self.line(counts)
        if self._terminal:
            self._stream.write("\r" + text.ljust(self._width))
            self._width = len(text)
        else:
            self._stream.write(f"synth: {text}\n")
        self._stream.flush()

    def line(self, counts: Counts) -> str:
        """Bar, rows, rate, time left, failures, workers."""
        share = counts.done / counts.total if counts.total else 1.0
        full = int(share * _BAR)
        parts = [f"{counts.done} of {counts.total} rows"]
        if self._terminal:
            parts = [f"[{'=' * full}{' ' * (_BAR - full)}] {100.0 * share:3.0f} %", *parts]
        rate = self._rate()
        if rate > 0.0:
            parts += [f"{rate:.3g} rows/s", f"{duration((counts.total - counts.done) / rate)} left"]
        if counts.failed:
            parts.append(f"{counts.failed} failed")
        parts.append(
            f"{counts.workers} worker{'' if counts.workers == 1 else 's'}" if counts.workers else "waiting for workers"
        )
        return ", ".join(parts)

    def _rate(self) -> float:
        """Rows a second over the last minute."""
        if len(self._seen) < 2 or self._seen[-1][0] - self._seen[0][0] < 1.0:
            return 0.0
        (since, before), (now, here) = self._seen[0], self._seen[-1]
        return (here - before) / (now - since)

    def close(self) -> None:
        """Takes the line away."""
        if self._terminal and self._width and self._stream is not None:
            self._stream.write("\r" + " " * self._width + "\r")
            self._stream.flush()


def duration(seconds: float) -> str:
    """ "45 s", "12 min", "3 h 20 min", "2 d 4 h"."""
    if not math.isfinite(seconds):
        return "?"
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    if minutes < 90:
        return f"{minutes} min"
    if minutes < 48 * 60:
        return f"{minutes // 60} h {minutes % 60} min"
    return f"{minutes // 1440} d {minutes % 1440 // 60} h"


def standing(folder: Path) -> dict[str, Any]:
    """What a study's folder says of it. Raises OSError or ValueError where it is none."""
    from synth.study.keeping import Folder, is_locked, journalled, said

    about = said(folder)
    running = is_locked(folder)
    state = about.get("state", "stopped")
    if state == "running" and not running:
        state = "killed"
    stored = 0
    for each in Folder(folder).tables(["key"]):
        stored += each.num_rows
    return {
        **{name: about.get(name) for name in ("name", "rows", "done", "failed", "computed", "workers", "seconds", "at")},
        "state": state, "stored": stored + journalled(folder), "parts": len(Folder(folder).parts),
        "table": (folder / "table.parquet").is_file(),
    }  # fmt: skip


def standing_text(found: dict[str, Any]) -> str:
    """`standing` in words."""
    left, rate = (found["rows"] or 0) - (found["done"] or 0), (found["computed"] or 0) / max(found["seconds"] or 0.0, 1e-9)
    text = f"{found['name']}: {found['state']}, {found['done']} of {found['rows']} rows, {found['failed']} failed"
    if found["state"] == "running":
        text += f", {rate:.3g} rows/s, {duration(left / rate) if rate else '?'} left, {found['workers']} workers"
    elif found["state"] in ("stopped", "killed"):
        text += "; the same command goes on"
    more = "finished table" if found["table"] and found["state"] == "finished" else "no finished table"
    return f"{text}\n{found['stored']} rows stored in {found['parts']} parts, {more}; as of {found['at']}"
