"""Where events come from, piece by piece: from a song that is known, or from a player who makes them up as he goes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: asked with rising frames, it gives the events before each that it has not yet given: EVENT, ascending, frames of the
#: song or the stream; the array is the asker's
EventSource = Callable[[int], np.ndarray]


def from_events(events: np.ndarray) -> EventSource:
    """The events of an array (EVENT, ascending) as a source."""
    given = 0

    def source(until: int) -> np.ndarray:
        nonlocal given
        first, given = given, int(np.searchsorted(events["frame"], until))
        return events[first:given].copy()

    return source
