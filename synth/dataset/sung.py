"""What an item is to its engine, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from synth.dataset.items import Item
from synth.engine.parameters import INDEX_OF
from synth.host.alone import events_of


@dataclass(frozen=True)
class Sung:
    """(frames, 2) float64 of an item, and what only its making tells.

    string      label of the string that was struck, and `fret`: of several, joined by "+"
    f0_hz       pitch of a single note as it is tuned
    unplayed    notes of a MIDI file that found no string
    labels      arrays by name, see `labelled`; `facts`: numbers beside them
    """

    samples: np.ndarray
    string: str = ""
    fret: str = ""
    f0_hz: float | None = None
    unplayed: int = 0
    labels: dict[str, np.ndarray] = field(default_factory=dict)
    facts: dict[str, float] = field(default_factory=dict)


def events_of_item(item: Item, rate_hz: int) -> np.ndarray:
    """EVENT array of what is played and set."""
    live = [(INDEX_OF[name], value) for name, value in item.live]
    return events_of([(beat.at_s, beat) for beat in item.beats], item.controllers, rate_hz, live)
