"""Which articulations keys and controllers ask for at a place of a song, and what tells an engine again that has forgotten.

The same rules as `engine.voices.switching` has: a key switches for a channel or its zone until another does, a controller
rules its channel while it stands in a range; another part, a reset and a new zone forget both.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np

from synth.instrument.ways import switch_keys
from synth.midi import zones
from synth.midi.controllers import RESET_CONTROLLERS
from synth.midi.events import CONTROL, NOTE_ON, PROGRAM
from synth.midi.song import Zones

if TYPE_CHECKING:
    from synth.instrument.articulations import Controller
    from synth.instrument.preset import Preset

#: (frame, kind, channel, a, b, value) of EVENT
Row = tuple[int, int, int, int, int, float]


class Switched:
    """What a song's events leave of it.

    presets: as the parts play them.  program_map: (16, 128) channel, program → part or −1.  mpe: it begins with a zone of
    all channels.  bound: controllers that set live parameters and do nothing else.
    """

    def __init__(
        self, presets: Sequence[Preset], program_map: np.ndarray, mpe: bool = False, bound: Collection[int] = ()
    ) -> None:
        self._map = program_map.copy()
        self._keys = [frozenset(switch_keys(preset)) for preset in presets]
        self._ranges = [_ranges(preset) for preset in presets]
        self._numbers = {controller.number for ranges in self._ranges for _, controller in ranges} - set(bound)
        self._bound = frozenset(bound)
        self._programs = (program_map >= 0).argmax(axis=1).tolist()
        self._zones = Zones(mpe)
        self._key: dict[int, Row] = {}  # of a channel that no other leads: the key that switched last
        self._ruled: dict[int, tuple[str, Row]] = {}  # of a channel: articulation, and what a controller said

    def heed(self, row: Row) -> None:
        """The song's next event."""
        _, kind, c, a, b, _ = row
        if kind == NOTE_ON and b > 0:
            leader = self._zones.master(c)
            p = self._part(leader)
            if p >= 0 and a in self._keys[p]:
                self._key[leader] = row
        elif kind == PROGRAM:
            leader = self._zones.master(c)
            part = self._part(leader)
            self._programs[c] = a
            if self._part(leader) != part:
                self._forget(c)
        elif kind == CONTROL and a not in self._bound:
            if a in self._numbers:
                self._rule(row)
            before = self._masters()
            if self._zones.control(c, a, b):
                after = self._masters()
                self._begin_anew([k for k in range(zones.CHANNELS) if before[k] != after[k] or after[k] == c])
            if a == RESET_CONTROLLERS:
                self._forget(c)

    def again(self, leader: int, frame: int) -> list[Row]:
        """What asks once more for what is asked for on a channel and in the zone that it leads."""
        said = [self._key[leader]] if leader in self._key else []
        said += [row for c, (_, row) in sorted(self._ruled.items()) if self._zones.master(c) == leader]
        return [(frame, *row[1:]) for row in said]

    def _part(self, channel: int) -> int:
        return int(self._map[channel, self._programs[channel]])

    def _masters(self) -> list[int]:
        return [self._zones.master(c) for c in range(zones.CHANNELS)]

    def _rule(self, row: Row) -> None:
        _, _, c, number, value, _ = row
        p = self._part(self._zones.master(c))
        mine = [(name, each) for name, each in (self._ranges[p] if p >= 0 else ()) if each.number == number]
        for name, each in mine:
            if c in self._ruled and self._ruled[c][0] == name and not each.low <= value <= each.high:
                del self._ruled[c]
        for name, each in mine:
            if each.low <= value <= each.high:
                self._ruled[c] = name, row

    def _forget(self, c: int) -> None:
        self._begin_anew([k for k in range(zones.CHANNELS) if c in (k, self._zones.master(k))])

    def _begin_anew(self, channels: Sequence[int]) -> None:
        for c in channels:
            self._key.pop(c, None)
            self._ruled.pop(c, None)


def _ranges(preset: Preset) -> list[tuple[str, Controller]]:
    return [(name, each.controller) for name, each in preset.articulations.items() if each.controller is not None]
