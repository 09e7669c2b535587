"""The bytes that come in through one MIDI port → events.

The backends hand over whole messages as a rule; what they are handed is not always one. So this is a parser of the byte
stream of the wire (MIDI 1.0 Detailed Specification): running status, real-time bytes anywhere, SysEx in pieces, messages
that are cut off. Whatever comes, it finds back at the next status byte, and it keeps no more than MOST_SYSEX_BYTES.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON, decode
from synth.midi.sysex import events_of

#: sink(kind, channel, a, b, value, time_ns) -> whether the event was taken
Sink = Callable[[int, int, int, int, float, int], bool]

#: a longer SysEx message is dropped; the longest that means something here, a bulk tuning dump, has 406 bytes
MOST_SYSEX_BYTES = 8192
# Controllers that hold notes: sustain, sostenuto.
_PEDALS = (64, 66)
# Data bytes of a channel message by its upper half, and of F1, F2, F3.
_DATA_BYTES = {0x8: 2, 0x9: 2, 0xA: 2, 0xB: 2, 0xC: 1, 0xD: 1, 0xE: 2}
_COMMON_DATA_BYTES = {0xF1: 1, 0xF2: 2, 0xF3: 1}


class MidiStream:
    """Feed it bytes; it gives events to `sink`.

    channel: listen to this MIDI channel only (1…16); None: to all. SysEx belongs to no channel and always counts.
    messages: how many came, clock and the like included.  ignored: those among them that play nothing, and fragments.
    lost: events that the sink did not take.
    """

    def __init__(self, sink: Sink, channel: int | None = None) -> None:
        if channel is not None and not 1 <= channel <= 16:
            raise ValueError(f"the MIDI channel must lie between 1 and 16, got {channel}")
        self.messages = 0
        self.ignored = 0
        self.lost = 0
        self._sink = sink
        self._channel = None if channel is None else channel - 1
        self._notes: set[tuple[int, int]] = set()
        self._pedals: set[tuple[int, int]] = set()
        self._status = 0
        self._data: list[int] = []
        self._wanted = 0
        self._sysex: bytearray | None = None
        self._too_long = False

    def feed(self, data: Sequence[int], time_ns: int) -> None:
        """Takes bytes that arrived at `time_ns` (time.monotonic_ns)."""
        if len(data) == 3 and self._sysex is None:
            status, first, second = data
            if 0x80 <= status < 0xF0 and not 0xC0 <= status < 0xE0 and first < 0x80 and second < 0x80:
                # The common case, at once.
                if self._data:
                    self._data.clear()
                    self.ignored += 1
                self._status, self._wanted = status, 2
                self._play(status, first, second, time_ns)
                return
        for byte in data:
            self._take(byte, time_ns)

    def _take(self, byte: int, time_ns: int) -> None:
        if byte >= 0xF8:
            self.messages += 1
            self.ignored += 1
        elif byte >= 0x80:
            self._take_status(byte, time_ns)
        elif self._sysex is not None:
            if len(self._sysex) < MOST_SYSEX_BYTES:
                self._sysex.append(byte)
            else:
                self._too_long = True
        elif self._status:
            self._data.append(byte)
            if len(self._data) == self._wanted:
                first, second = (*self._data, 0)[:2]
                self._data.clear()
                if self._status < 0xF0:
                    self._play(self._status, first, second, time_ns)
                else:
                    self._status = 0
                    self.messages += 1
                    self.ignored += 1
        else:
            self.ignored += 1

    def _take_status(self, byte: int, time_ns: int) -> None:
        if self._sysex is not None:
            # Any status byte ends a SysEx message, but only F7 completes it.
            body, self._sysex = bytes(self._sysex), None
            self.messages += 1
            if byte == 0xF7 and not self._too_long:
                self._play_sysex(body, time_ns)
            else:
                self.ignored += 1
            if byte == 0xF7:
                return
        elif self._data:
            self._data.clear()
            self.ignored += 1
        self._status = 0
        if byte == 0xF0:
            self._sysex, self._too_long = bytearray(), False
        elif byte < 0xF0:
            self._status, self._wanted = byte, _DATA_BYTES[byte >> 4]
        elif byte in _COMMON_DATA_BYTES:
            self._status, self._wanted = byte, _COMMON_DATA_BYTES[byte]
        else:
            self.messages += 1
            self.ignored += 1

    def _play(self, status: int, first: int, second: int, time_ns: int) -> None:
        self.messages += 1
        kind, channel, a, b = decode(status, first, second)
        if kind == 0 or (self._channel is not None and channel != self._channel):
            self.ignored += 1
            return
        if not self._sink(kind, channel, a, b, 0.0, time_ns):
            self.lost += 1
            return
        if kind == NOTE_ON:
            self._notes.add((channel, a))
        elif kind == NOTE_OFF:
            self._notes.discard((channel, a))
        elif kind == CONTROL and a in _PEDALS:
            (self._pedals.add if b >= 64 else self._pedals.discard)((channel, a))

    def _play_sysex(self, body: bytes, time_ns: int) -> None:
        rows = events_of(body)
        if not rows:
            self.ignored += 1
        for kind, channel, a, b, value in rows:
            if not self._sink(kind, channel, a, b, value, time_ns):
                self.lost += 1

    @property
    def held(self) -> int:
        """Notes and pedals that are down."""
        return len(self._notes) + len(self._pedals)

    def release(self, time_ns: int) -> None:
        """Lets go of all notes and pedals held through this port, and forgets what was cut off."""
        for channel, note in sorted(self._notes):
            self.lost += not self._sink(NOTE_OFF, channel, note, 64, 0.0, time_ns)
        for channel, pedal in sorted(self._pedals):
            self.lost += not self._sink(CONTROL, channel, pedal, 0, 0.0, time_ns)
        self._notes.clear()
        self._pedals.clear()
        self._data.clear()
        self._status, self._sysex = 0, None


class ArrivalClock:
    """When messages arrived, on this computer's clock, from the times between them that a backend gives.

    A message is fetched a little after it arrived; the time from message to message is exact. So each time is that of the
    message before and the gap; where that would lie in the future, the first one was fetched too late, and all that
    follows is as much earlier. The times so come within the shortest delay there was. A gap that was lost shows as a delay
    of more than LONGEST_DELAY_S: then it begins anew.
    """

    LONGEST_DELAY_S = 0.1

    def __init__(self) -> None:
        self._at_ns: int | None = None

    def time_ns(self, gap_s: float, now_ns: int) -> int:
        """Arrival of a message that came `gap_s` after the one before and is fetched now (time.monotonic_ns)."""
        at = now_ns if self._at_ns is None else self._at_ns + round(1e9 * gap_s)
        if at > now_ns or now_ns - at > 1e9 * self.LONGEST_DELAY_S:
            at = now_ns
        self._at_ns = at
        return at
