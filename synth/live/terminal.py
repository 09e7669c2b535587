"""Keys of a terminal, as they are pressed: no line, no echo."""

from __future__ import annotations

import os
import select
import sys
from typing import Any, Self, TextIO

#: what terminals send for keys that are no characters
SEQUENCES = {
    "\x1b[A": "up", "\x1b[B": "down", "\x1b[C": "right", "\x1b[D": "left",
    "\x1bOA": "up", "\x1bOB": "down", "\x1bOC": "right", "\x1bOD": "left",
}  # fmt: skip


class Terminal:
    """A context in which `keys` gives what has been pressed. Where the stream is no terminal nothing is ever pressed.

    Ctrl-C stays what it is. On leaving, whatever the reason, the terminal is as it was.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stdin if stream is None else stream
        self._before: Any = None
        self._rest = ""

    def __enter__(self) -> Self:
        try:
            import termios
            import tty
        except ImportError:  # no such terminals on this system
            return self
        try:
            self._file = self._stream.fileno()
            if os.isatty(self._file) and _in_front(self._file):
                self._before = termios.tcgetattr(self._file)
                tty.setcbreak(self._file)
        except (AttributeError, OSError, ValueError, termios.error):
            self._before = None  # no stream, or none with a file
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            import termios

            termios.tcsetattr(self._file, termios.TCSADRAIN, self._before)
            self._before = None

    @property
    def is_one(self) -> bool:
        """Whether keys can be pressed."""
        return self._before is not None

    def keys(self) -> list[str]:
        """Characters, and "up", "down", "left", "right", pressed since the last call."""
        if self._before is None or not _in_front(self._file):
            return []
        text = self._rest
        while select.select([self._file], [], [], 0.0)[0]:
            data = os.read(self._file, 256)
            if not data:
                break
            text += data.decode(errors="ignore")
        found, self._rest = keys_of(text)
        return found


def _in_front(file: int) -> bool:
    """Whether the terminal may be touched: a program in the background that does is stopped by the system."""
    try:
        return os.tcgetpgrp(file) == os.getpgrp()
    except OSError:
        return True  # not the terminal that controls us


def keys_of(text: str) -> tuple[list[str], str]:
    """The keys in what a terminal has sent, and the beginning of a sequence at its end. Unknown sequences are left out."""
    found = []
    at = 0
    while at < len(text):
        if text[at] != "\x1b":
            found.append(text[at])
            at += 1
            continue
        if text[at + 1 : at + 2] not in ("[", "O"):
            if at + 1 == len(text):
                return found, ""  # the escape key itself
            at += 1
            continue
        end = at + 2
        while end < len(text) and not "\x40" <= text[end] <= "\x7e":
            end += 1
        if end >= len(text):
            return found, text[at:]
        if (name := SEQUENCES.get(text[at : end + 1])) is not None:
            found.append(name)
        at = end + 1
    return found, ""
