"""What somebody may have meant who wrote a name that there is not."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

#: how alike two names must be (`difflib.SequenceMatcher.ratio`)
ALIKE = 0.6
#: letters of a part of a name that stand for the whole of it
LEAST_PART = 3


def perhaps(word: str, known: Iterable[str]) -> str:
    """' (perhaps tanpura?)' for 'tampura'; nothing where no known name is alike. Letters' case does not matter."""
    names = {name.lower(): name for name in known}
    word = word.lower()
    found = difflib.get_close_matches(word, names, n=1, cutoff=ALIKE)
    if not found and len(word) >= LEAST_PART:
        found = [name for name in names if word in name]
    return f" (perhaps {names[found[0]]}?)" if found else ""
