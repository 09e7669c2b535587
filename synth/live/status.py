"""One line on the terminal that says what a live session does."""

from __future__ import annotations

import math
import sys
import threading
import time
from dataclasses import dataclass
from typing import TextIO

from synth.live.paragraph import columns, folded, untied
from synth.units import gain_to_db, midi_to_note

#: shortest time between two looks of the line [s]
PERIOD_S = 0.1
METER_CELLS = 12
METER_LOW_DBFS = -60.0
#: what is said begins with who says it
_WHO = "synth: "


@dataclass(frozen=True)
class Status:
    """What the line shows. Loads are shares of a block's time; peak is linear; note −1: none yet; recorded_s None: no
    recording. spare_db: level below which strings are spared, −inf: none are. events_lost: since the start. unplayed: why no
    string plays the last note. articulation: what the last key has switched to. position: where in a song it is.
    """

    load_median: float
    load_worst: float
    xruns: int
    strings: int
    peak: float
    note: int
    velocity: int
    recorded_s: float | None
    spare_db: float = -math.inf
    events_lost: int = 0
    unplayed: str = ""
    articulation: str = ""
    position: str = ""


def status_text(status: Status, width: int) -> str:
    """The line, of at most `width` characters: what matters least is left out first."""
    dbfs = gain_to_db(status.peak) if status.peak > 1e-10 else -math.inf
    level = f"{max(dbfs, -99.9):5.1f} dB" if dbfs > -99.9 else " silent "
    filled = round(METER_CELLS * min(1.0, max(0.0, 1.0 - dbfs / METER_LOW_DBFS))) if dbfs > METER_LOW_DBFS else 0
    note = f"{midi_to_note(status.note)} v{status.velocity}".ljust(8) if status.note >= 0 else ""
    pieces = [
        f"load {100.0 * status.load_median:3.0f}/{100.0 * status.load_worst:3.0f} %",
        f"{status.xruns} xrun{'' if status.xruns == 1 else 's'}",
        f"{status.strings:2d} string{'' if status.strings == 1 else 's'}",
        level,
        f"[{'=' * filled}{' ' * (METER_CELLS - filled)}]",
        status.unplayed or status.articulation or note,
        f"sparing below {status.spare_db:.0f} dB" if status.spare_db > -math.inf else "",
        "" if status.recorded_s is None else f"REC {clock_text(status.recorded_s)}",
        f"{status.events_lost} lost" if status.events_lost else "",
        status.position,
    ]
    # In the order in which they go where the terminal is narrow: a note that is not heard is told before most else.
    for dispensable in (4, 6, 2, 3, 7, 8, 1, 9, 5) if status.unplayed else (4, 6, 5, 2, 3, 7, 8, 1, 9):
        text = "  ".join(piece for piece in pieces if piece)
        if len(text) <= width:
            return text
        pieces[dispensable] = ""
    return "  ".join(piece for piece in pieces if piece)[: max(width, 0)]


def clock_text(seconds: float) -> str:
    """'1:05' or '1:00:05'."""
    whole = int(seconds)
    hours, minutes = whole // 3600, whole // 60 % 60
    return f"{hours}:{minutes:02d}:{whole % 60:02d}" if hours else f"{minutes}:{whole % 60:02d}"


class StatusLine:
    """The line, and what is said above it. On no terminal there is no line; quiet: nothing is said either.

    stream: None: standard error, whatever that is when something is written.
    """

    def __init__(self, *, quiet: bool = False, stream: TextIO | None = None) -> None:
        self._given = stream
        self._quiet = quiet
        self._on = not quiet and self._stream.isatty()
        self._shown_at = -math.inf
        self._shown = ""
        self._lock = threading.Lock()  # lines are said from several threads

    @property
    def _stream(self) -> TextIO:
        return sys.stderr if self._given is None else self._given

    @property
    def _width(self) -> int:
        # The last column stays free: a character there makes some terminals begin a new line.
        return columns(self._stream) - 1

    def show(self, status: Status) -> None:
        """Shows the status, at most every PERIOD_S."""
        now = time.monotonic()
        if not self._on or now - self._shown_at < PERIOD_S:
            return
        with self._lock:
            self._shown_at = now
            width = self._width
            text = status_text(status, width)
            self._write("\r" + text.ljust(min(len(self._shown), width)))
            self._shown = text

    def say(self, text: str) -> None:
        """A line of its own, above the status; on a terminal as many as it takes."""
        if self._quiet:
            return
        with self._lock:
            self._clear()
            said = folded(text, self._width, first=_WHO) if self._on else _WHO + untied(text)
            self._write(f"{said}\n")

    def clear(self) -> None:
        """Takes the line away."""
        with self._lock:
            self._clear()

    def _clear(self) -> None:
        if self._shown:
            self._write("\r" + " " * min(len(self._shown), self._width) + "\r")
            self._shown = ""

    def _write(self, text: str) -> None:
        try:
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):  # the terminal has gone, or the stream was closed; the music has not
            self._on, self._quiet = False, True
