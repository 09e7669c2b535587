"""Music that is known beforehand, played live: its events are given to the deck a little before their time."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from synth.midi.events import EVENT
from synth.midi.eventsource import EventSource

#: how far ahead of the stream events are given to the deck [s]
AHEAD_S = 2.0


class Schedule(Protocol):
    """What a player needs of a deck."""

    @property
    def frame(self) -> int: ...

    def schedule(self, events: np.ndarray) -> int: ...

    def drop_scheduled(self) -> int: ...

    def dropped_at(self, asking: int) -> int | None: ...


class Player:
    """Plays a source of events into a deck.

    end: frame of the stream at which the music ends; None: it goes on until it is stopped.
    ahead_s: how far ahead the source is asked, so how late it may still change its mind [s].
    """

    def __init__(self, source: EventSource, end: int | None, rate_hz: float, *, ahead_s: float = AHEAD_S) -> None:
        self._source = source
        self._ahead = round(ahead_s * rate_hz)
        self._waiting = np.zeros(0, EVENT)
        self._asked = 0
        self.end = end

    def feed(self, deck: Schedule) -> None:
        """Gives the deck what is due soon; to be called several times in AHEAD_S."""
        until = deck.frame + self._ahead
        if until > self._asked:
            self._asked = until
            fresh = self._source(until)
            self._waiting = np.concatenate((self._waiting, fresh)) if len(self._waiting) else fresh
        if len(self._waiting):
            self._waiting = self._waiting[deck.schedule(self._waiting) :]

    def over(self, deck: Schedule) -> bool:
        """Whether the end is past and all has been given."""
        return self.end is not None and not len(self._waiting) and self._asked > self.end and deck.frame >= self.end
