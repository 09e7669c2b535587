"""Colours of words in messages, on terminals only.

None are shown where the environment has NO_COLOR (not empty) or TERM=dumb, nor on a Windows console that does not say of
itself that it knows them (Windows Terminal, ConEmu, ANSICON and the shells of POSIX do).
"""

from __future__ import annotations

import os
import sys
from typing import Any

#: what a word is: right, wrong, not decided, emphasised (the parameters of SGR)
GOOD, FAULT, OPEN, STRONG = "32", "1;31", "33", "1"
_KNOWS_COLOURS = ("WT_SESSION", "ANSICON", "ConEmuANSI", "TERM")


def wanted(stream: Any) -> bool:
    """Whether colours may be written to a stream."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    if sys.platform == "win32" and not any(os.environ.get(name) for name in _KNOWS_COLOURS):
        return False
    try:
        return bool(stream.isatty())
    except (AttributeError, ValueError, OSError):  # closed, or no stream of a terminal's kind
        return False


def shown(text: str, kind: str, stream: Any) -> str:
    """The text in the colour of its kind where the stream takes it, else as it is."""
    return f"\x1b[{kind}m{text}\x1b[0m" if wanted(stream) else text
