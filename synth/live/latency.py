"""How long it takes from an event to its sound, measured: notes go in by the way that a keyboard's go, and are looked for in
what the device was given.

Times are told on the clock of the stream, which says for any moment how far the device is in the sound: a note sent at
that moment whose first sample is n frames further on is computed n frames before the device plays it, less what the
device itself adds, and that is as it reports. Where a JACK server runs (or PipeWire, under pw-jack), what it gives its card
is recorded besides: then only what the card adds is as reported.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np

from synth.engine.engine import Engine
from synth.live.deck import Deck
from synth.live.ear import Ear
from synth.midi.controllers import ALL_SOUND_OFF
from synth.midi.events import CONTROL, NOTE_ON, decode
from synth.units import db_to_gain, midi_to_note

PLUCKS = 20
VELOCITY = 100
#: the first sample this large is the first movement [dBFS]; before it the output is silent
THRESHOLD_DBFS = -100.0
#: the pluck's peak is the largest sample until so long after the finger has let go [s]
PEAK_WITHIN_S = 0.02
#: before a pluck the output must have been below the threshold for so long [s]
QUIET_FOR_S = 0.03
#: a note that is not heard in so long is lost; so long a string may take to fall silent [s]
LISTEN_S = 0.3
SILENT_WITHIN_S = 3.0
#: python-rtmidi's numbers of the systems that MidiInputs names
_API_OF = {"CoreMIDI": 1, "ALSA": 2, "JACK": 3, "Windows MM": 4}


class Waits(Protocol):
    """How a measurement is broken off: see session.Stop."""

    def wait(self, seconds: float) -> bool: ...


@dataclass(frozen=True)
class TimeSpread:
    """Median and worst of some times [ms]."""

    median_ms: float
    worst_ms: float

    @staticmethod
    def of(frames: Sequence[float], rate_hz: float) -> TimeSpread:
        ms = 1e3 * np.asarray(frames, float) / rate_hz
        return TimeSpread(float(np.median(ms)), float(ms.max()))

    def later(self, ms: float) -> TimeSpread:
        """The same times with so much more to come after each."""
        return TimeSpread(self.median_ms + ms, self.worst_ms + ms)

    def __str__(self) -> str:
        return f"{self.median_ms:6.2f} ms in the median, {self.worst_ms:6.2f} ms at worst"


@dataclass(frozen=True)
class Latency:
    """path: how the notes went in.  heard: of `plucks`.  draw_ms: of the finger, as compiled.  engine_ms: from an event's
    place in the stream to the string.  placed: from sending a note to that place.  first_movement, peak: from sending a note
    to that sample, computed.  device_ms: what the device reports to come after.
    recorded: from sending a note to the first movement in what a JACK server gives its card; None: it was not to be heard
    there.  card_ms: what the server reports to come after.
    """

    path: str
    note: str
    plucks: int
    heard: int
    block: int
    rate_hz: int
    threshold_dbfs: float
    draw_ms: float
    engine_ms: float
    placed: TimeSpread
    first_movement: TimeSpread
    peak: TimeSpread
    device_ms: float
    recorded: TimeSpread | None
    card_ms: float | None

    @property
    def total(self) -> TimeSpread:
        """From sending a note to its first movement, with what the device adds."""
        return self.first_movement.later(self.device_ms)

    @property
    def total_to_peak(self) -> TimeSpread:
        """From sending a note to its peak, with what the device adds."""
        return self.peak.later(self.device_ms)

    @property
    def heard_ms(self) -> TimeSpread:
        """What was recorded with what the card adds, or else `total`."""
        return self.total if self.recorded is None or self.card_ms is None else self.recorded.later(self.card_ms)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self) | {name: asdict(getattr(self, name)) for name in ("total", "total_to_peak", "heard_ms")}

    def lines(self) -> list[str]:
        """For people."""
        lines = [
            f"{self.heard} of {self.plucks} plucks of {self.note} heard, sent by {self.path}, blocks of {self.block} at "
            f"{self.rate_hz} Hz",
            f"  event → its place in the stream           {self.placed}",
            f"  event → first movement, computed          {self.first_movement}",
            f"  event → peak of the pluck, computed       {self.peak}",
            f"  the device adds, as it reports            {self.device_ms:6.2f} ms",
        ]
        if self.recorded is not None:
            lines += [
                f"  event → first movement, recorded          {self.recorded}",
                f"  the card adds, as the server reports      {self.card_ms:6.2f} ms",
            ]
        return [
            *lines,
            f"  event → first movement, heard             {self.heard_ms}",
            f"  event → peak of the pluck, heard          {self.total_to_peak}",
            f"  (the engine looks ahead {self.engine_ms:.2f} ms, the finger draws for {self.draw_ms:.2f} ms.",
            f"  First movement: the first sample beyond {self.threshold_dbfs:.0f} dBFS; peak: the largest until "
            f"{1e3 * PEAK_WITHIN_S:.0f} ms after the finger has let go. "
            + ("Recorded: at the JACK server's output.)" if self.recorded is not None else "Heard: computed.)"),
        ]


def quickest_note(engine: Engine) -> tuple[int, int, int, float]:
    """(channel, program, MIDI note, draw time [s]) of the note with the shortest draw; of several, the highest."""
    best: tuple[float, int, int] | None = None
    for number, part in enumerate(engine.compiled):
        for string in part.strings:
            for position in string.positions:
                candidate = (float(string.draw_s), -int(position.note), number)
                best = candidate if best is None else min(best, candidate)
    if best is None:
        raise ValueError("no note can be played: choose another preset")
    channel, program = (int(each) for each in np.argwhere(engine.program_map == best[2])[0])
    return channel, program, -best[1], best[0]


def measure(
    deck: Deck,
    engine: Engine,
    output: Any,
    stop: Waits,
    send: Callable[[bytes], None] | None,
    path: str,
    ear: Ear | None = None,
) -> Latency | None:
    """Plucks the quickest note PLUCKS times and looks when it comes; None if it was broken off. The deck records, the output
    runs.

    ear: hears what the server gives its card, if there is one.
    send: takes a MIDI message to where the session listens; None: notes go to the deck itself, as from its thread of MIDI.
    Raises ValueError where nothing is heard.
    """
    rate_hz = engine.rate_hz
    channel, program, note, draw_s = quickest_note(engine)
    threshold = db_to_gain(THRESHOLD_DBFS)
    tape = _Tape(deck)
    placed: list[float] = []
    moved: list[float] = []
    peaked: list[float] = []
    recorded: list[float] = []
    if ear is not None:
        ear.connect()
    if program != int(np.argmax(engine.program_map[channel] >= 0)):
        _give(deck, send, bytes((0xC0 | channel, program)))
    for pluck in range(PLUCKS):
        deck.send(CONTROL, channel, ALL_SOUND_OFF)
        deadline = time.monotonic() + SILENT_WITHIN_S
        while time.monotonic() < deadline and not stop.wait(QUIET_FOR_S):
            if engine.silent and np.abs(tape.drain()).max(initial=0.0) < threshold:
                break
        # Everywhere in a block.
        if stop.wait(0.05 + deck.period / rate_hz * (0.618 * pluck % 1.0)):
            break
        tape.drain()
        deck.drain_events()
        begin = tape.end
        since = 0
        if ear is not None:
            ear.listen()
            since = ear.now()
        sent_ns = time.monotonic_ns()
        _give(deck, send, bytes((0x90 | channel, note, VELOCITY)))
        # Where the device is in the sound at that moment.
        now = deck.at(sent_ns) - deck.delay_frames
        broken_off = stop.wait(LISTEN_S)
        _give(deck, send, bytes((0x80 | channel, note, 64)))
        if broken_off:
            break
        sound = np.abs(tape.drain()).max(axis=1, initial=0.0)
        events = deck.drain_events()
        given = events["frame"][events["kind"] == NOTE_ON]
        if not len(given):
            continue
        plucked = max(int(given[0]) - begin, 0)
        loud = plucked + np.flatnonzero(sound[plucked:] >= threshold)
        if not len(loud):
            continue
        first = int(loud[0])
        released = plucked + engine.latency_samples + round(draw_s * rate_hz)
        peak = first + int(np.argmax(sound[first : released + round(PEAK_WITHIN_S * rate_hz)]))
        placed.append(int(given[0]) - now)
        moved.append(begin + first - now)
        peaked.append(begin + peak - now)
        if ear is not None and (after := ear.first(threshold, since)) is not None:
            recorded.append(after)
    if stop.wait(0.0):
        return None
    if not moved:
        raise ValueError(f"none of {PLUCKS} plucks of {midi_to_note(note)} was heard; check the device with synth devices")
    card_s = ear.latency_s if ear is not None and recorded else None
    return Latency(
        path=path,
        note=midi_to_note(note),
        plucks=PLUCKS,
        heard=len(moved),
        block=deck.period,
        rate_hz=round(rate_hz),
        threshold_dbfs=THRESHOLD_DBFS,
        draw_ms=1e3 * draw_s,
        engine_ms=1e3 * engine.latency_samples / rate_hz,
        placed=TimeSpread.of(placed, rate_hz),
        first_movement=TimeSpread.of(moved, rate_hz),
        peak=TimeSpread.of(peaked, rate_hz),
        device_ms=1e3 * float(output.latency_s),
        recorded=None if card_s is None else TimeSpread.of(recorded, rate_hz),
        card_ms=None if card_s is None else 1e3 * card_s,
    )


def _give(deck: Deck, send: Callable[[bytes], None] | None, message: bytes) -> None:
    if send is not None:
        send(message)
        return
    deck.send(*decode(message[0], message[1], message[2] if len(message) > 2 else 0))


class _Tape:
    """The deck's sound, with the stream's frame at which what was drained ends."""

    def __init__(self, deck: Deck) -> None:
        self._deck = deck
        self._buffer = np.zeros((1 << 16, 2))
        self.end = 0

    def drain(self) -> np.ndarray:
        """All there is, (n, 2)."""
        pieces = []
        while frames := self._deck.drain_audio(self._buffer):
            pieces.append(self._buffer[:frames].copy())
            self.end += frames
        return np.concatenate(pieces) if pieces else np.zeros((0, 2))


def loopback(port: str, system: str) -> Any | None:
    """A MIDI output (python-rtmidi; `send_message`, `delete`) into the port of this program whose name contains `port`, or
    None where the system has none.
    """
    try:
        import rtmidi
    except ImportError:
        return None
    out = None
    with suppress(rtmidi.RtMidiError, SystemError, ValueError):
        out = rtmidi.MidiOut(_API_OF.get(system, rtmidi.API_UNSPECIFIED), "jawari-latency")
        found = [number for number, name in enumerate(out.get_ports()) if port in name]
        if found:
            out.open_port(found[0])
            return out
    if out is not None:
        out.delete()
    return None
