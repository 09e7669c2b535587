"""Text on a terminal: no word is broken, whatever its width."""

from __future__ import annotations

import os
import shutil
import textwrap
from typing import TextIO

#: a space at which no line is broken
TIE = "\N{NO-BREAK SPACE}"
#: narrower than this nothing is folded any more
NARROWEST = 20
_INDENT = "  "


def columns(stream: TextIO) -> int:
    """Characters of a line of the terminal that `stream` is; where it is none or does not say, of the program's."""
    try:
        found = os.get_terminal_size(stream.fileno()).columns
    except (OSError, ValueError, AttributeError):
        found = 0
    return found or shutil.get_terminal_size().columns


def folded(text: str, width: int, *, first: str = "") -> str:
    """The text in lines of at most `width` characters, broken at spaces but not at TIE; only a word that is wider is not
    kept to it. All but a line's first piece are indented, and `first` stands before it all.
    """
    lines = []
    for line in text.split("\n"):
        indent = line[: len(line) - len(line.lstrip(" "))]
        lines += textwrap.wrap(
            line,
            max(width, NARROWEST),
            initial_indent=first,
            subsequent_indent=indent + _INDENT,
            break_long_words=False,
            break_on_hyphens=False,
            drop_whitespace=True,
        ) or [first]
        first = ""
    return untied("\n".join(lines))


def untied(text: str) -> str:
    """The text with plain spaces."""
    return text.replace(TIE, " ")


def fitting(text: str, stream: TextIO) -> str:
    """The text, folded to the terminal's width where `stream` is one."""
    try:
        shows = stream.isatty()
    except ValueError:  # closed
        shows = False
    return folded(text, columns(stream) - 1) if shows else untied(text)
