"""Notes that no string plays, noticed while one plays: a key that stays silent says why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from synth.engine.engine import Unplayed
from synth.instrument.preset import Preset, playable_range
from synth.units import midi_to_note

#: so long it is told [s]
TOLD_S = 3.0


class Unplayable:
    """Compares what an engine has not played with the last look.

    parts: the engine's presets.  silent: keys that a Scala keyboard mapping leaves out.
    """

    def __init__(self, parts: Sequence[Preset], silent: frozenset[int] = frozenset()) -> None:
        self._parts, self._silent = parts, silent
        self._seen: Mapping[tuple[int, int], int] = {}
        self._told = ""
        self._told_at = 0.0

    def look(self, unplayed: Sequence[Unplayed] | None, last_note: int, now: float) -> str:
        """Why the last note is not heard, in a few words; "" where it is, or TOLD_S [s] later.

        unplayed: the engine's count; None: it has not changed.  last_note: MIDI number of the note struck last.
        """
        if unplayed is not None:
            counts = {(each.part, each.note): each.times for each in unplayed}
            fresh = [key for key, times in counts.items() if times > self._seen.get(key, 0)]
            self._seen = counts
            if fresh:
                part, self._note = next((key for key in fresh if key[1] == last_note), fresh[-1])
                self._told = f"{midi_to_note(self._note)} silent: {self._reason(part, self._note)}"
                self._told_at = now
        if self._told and (last_note != self._note or now - self._told_at > TOLD_S):
            self._told = ""
        return self._told

    def _reason(self, part: int, note: int) -> str:
        if part < 0:
            return "no preset (--map)"
        low, high = playable_range(self._parts[part])
        if note < low:
            return f"below {midi_to_note(low)}"
        if note > high:
            return f"above {midi_to_note(high)}"
        return "not in the scale" if note in self._silent else "no string has it"
