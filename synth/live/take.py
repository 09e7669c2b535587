"""What was played, as a Standard MIDI File that is whole at any time.

One tick is one frame: rate/4 ticks (or another such part) per quarter note at a tempo that makes it so. The file is written
as it grows: the messages and their times are mido's, the file is not. mido writes a file at once, from a song of objects; an
hour of controllers would fill the memory, and what was not yet saved would be lost. Here, after every `append`, the track
has its end and its length, so that a program that is killed leaves a take that can be read.
"""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import mido
import numpy as np
from mido.midifiles.meta import encode_variable_int

from synth.files.targets import Whole, check_target, naming
from synth.midi.controllers import ALL_NOTES_OFF
from synth.midi.events import (
    BEND,
    CONTROL,
    KEY_PRESSURE,
    NOTE_OFF,
    NOTE_ON,
    PARAMETER,
    PRESSURE,
    PROGRAM,
    TUNING,
)
from synth.midi.smf import GM_TAKE_MARK, TAKE_MARK, UNSWITCHED_MARK
from synth.midi.sysex import of_parameter, of_tuning

_END_OF_TRACK = b"\0" + mido.MetaMessage("end_of_track").bin()
_EMPTY_TEXT = mido.MetaMessage("text").bin()
_LONGEST_DELTA = (1 << 28) - 1
_LENGTH_AT, _TRACK_AT = 18, 22
# A chunk's length has 32 bits.
_MOST_BYTES = (1 << 32) - (1 << 20)
_MOST_ENDS = 256


def division_of(rate_hz: int) -> tuple[int, int]:
    """(ticks per quarter note, microseconds per quarter note) that make a tick one frame. Raises ValueError."""
    for part in (4, 5, 8, 2, 1, 10, 16, 20, 25, 32):
        if rate_hz % part == 0 and rate_hz // part < 1 << 15:
            return rate_hz // part, 1_000_000 // part
    raise ValueError(
        f"a take cannot be recorded at {rate_hz} Hz: no MIDI tick has the length of a frame; use 44100 or 48000 Hz"
    )


class TakeFile:
    """Writes `path` beside its place; `close` gives it its name.

    events: how many are in it.  left_out: those that MIDI has no message for.  gm: whether programs choose by the whole
    table of General MIDI, and are to do so where it is played again; headroom_db: what its song is then lowered by.
    switching: whether keys and controllers switch articulations of what programs choose.
    Raises OSError where it cannot be made, ValueError for a rate that no tick fits.
    """

    def __init__(
        self, path: str | Path, rate_hz: int, gm: bool = False, headroom_db: float = 0.0, switching: bool = True
    ) -> None:
        self.path = str(path)
        self.events = 0
        self.left_out = 0
        check_target(path)
        self._whole = Whole(path, kept=True)
        division, tempo = division_of(rate_hz)
        self._head = b"MThd\0\0\0\6\0\0\0\1" + division.to_bytes(2, "big") + b"MTrk\0\0\0\0"
        mark = GM_TAKE_MARK + bytes([round(10.0 * headroom_db)]) if gm else TAKE_MARK
        mark += b"" if switching else b"\0" + UNSWITCHED_MARK
        self._start = b"\0" + mido.MetaMessage("set_tempo", tempo=tempo).bin() + b"\0" + mark
        self._file: int | None = None
        self._at = _TRACK_AT  # where the end of track stands
        self._tick = 0
        self._held: Counter[tuple[int, int]] = Counter()
        self._channels: set[int] = set()

    def open(self) -> None:
        """Makes the file. Raises OSError."""
        try:
            self._file = self._whole.open()
            with naming(self.path):
                _write(self._file, self._head, 0)
                self._put(self._start)
        except BaseException:
            self.discard()
            raise

    def append(self, events: np.ndarray) -> None:
        """Adds events (EVENT array, frames absolute and ascending). Raises OSError; the file then ends before them."""
        if not len(events):
            return
        body = bytearray()
        before = self._tick
        rows = zip(*(events[name].tolist() for name in ("frame", "kind", "channel", "a", "b", "value")), strict=True)
        written = left_out = 0
        for frame, kind, channel, a, b, value in rows:
            message = _message(kind, channel, a, b, value)
            if message is None:
                left_out += 1
                continue
            body += self._delta(frame) + message
            written += 1
            if kind == NOTE_ON and b > 0:
                self._held[channel, a] += 1
            elif kind in (NOTE_ON, NOTE_OFF) and self._held[channel, a]:
                self._held[channel, a] -= 1
            if kind not in (PARAMETER, TUNING):
                self._channels.add(channel)
        try:
            self._put(bytes(body))
        except OSError:
            self._tick = before
            raise
        self.events += written
        self.left_out += left_out

    def _delta(self, frame: int) -> bytes:
        """The time up to `frame`, over as many empty texts as it takes."""
        wait = max(frame - self._tick, 0)
        self._tick += wait
        rests = b""
        while wait > _LONGEST_DELTA:
            rests += _variable_length(_LONGEST_DELTA) + _EMPTY_TEXT
            wait -= _LONGEST_DELTA
        return rests + _variable_length(wait)

    def _put(self, body: bytes) -> None:
        """Writes over the end of track, and the end of track behind it."""
        assert self._file is not None, "the take is not open"
        if self._at + len(body) > _MOST_BYTES:
            raise OSError(f"{self.path}: the take exceeds the 4 GB that a MIDI file can hold")
        try:
            _write(self._file, body + _END_OF_TRACK, self._at)
            self._at += len(body)
        except OSError:
            _write(self._file, _END_OF_TRACK, self._at)
            os.ftruncate(self._file, self._at + len(_END_OF_TRACK))
            raise
        length = self._at + len(_END_OF_TRACK) - _TRACK_AT
        _write(self._file, length.to_bytes(4, "big"), _LENGTH_AT)

    def close(self, frames: int) -> None:
        """Ends the take at `frames`, where all notes are let go, and gives the file its name. Raises OSError."""
        if self._file is None:
            return
        try:
            end = max(frames, self._tick)
            body = bytearray()
            for (channel, note), times in sorted(self._held.items()):
                # A note that was struck several times is ended as often, as readers count.
                for _ in range(min(times, _MOST_ENDS)):
                    body += self._delta(end) + mido.Message("note_off", channel=channel, note=note, velocity=64).bin()
            # A reader may take a long rest at the end for an error; this is there, and says nothing new.
            for channel in sorted(self._channels):
                silence = mido.Message("control_change", channel=channel, control=ALL_NOTES_OFF, value=0)
                body += self._delta(end) + silence.bin()
            self._put(bytes(body))
        finally:
            self._file = None
            self._whole.commit()

    def discard(self) -> None:
        """Closes and removes the file."""
        self._file = None
        self._whole.discard()


def _write(file: int, data: bytes, at: int) -> None:
    os.lseek(file, at, os.SEEK_SET)
    while data:
        data = data[os.write(file, data) :]


def _message(kind: int, channel: int, a: int, b: int, value: float) -> bytes | None:
    """An event as it stands in a file; None if MIDI cannot say it."""
    try:
        if kind == PARAMETER or kind == TUNING:
            body = of_parameter(channel, a, value) if kind == PARAMETER else of_tuning(a, value, bool(b))
            return b"\xf0" + _variable_length(len(body) + 1) + body + b"\xf7"  # a file has the length behind the first byte
        name, arguments = _as_mido(kind, a, b)
        return bytes(mido.Message(name, channel=channel, **arguments).bin())
    except (ValueError, KeyError):
        return None


def _as_mido(kind: int, a: int, b: int) -> tuple[str, dict[str, int]]:
    """mido's name of a channel message and its arguments. Raises KeyError for what is none."""
    return {
        NOTE_OFF: ("note_off", {"note": a, "velocity": b}),
        NOTE_ON: ("note_on", {"note": a, "velocity": b}),
        KEY_PRESSURE: ("polytouch", {"note": a, "value": b}),
        CONTROL: ("control_change", {"control": a, "value": b}),
        PROGRAM: ("program_change", {"program": a}),
        PRESSURE: ("aftertouch", {"value": b}),
        BEND: ("pitchwheel", {"pitch": a}),
    }[kind]


def _variable_length(value: int) -> bytes:
    return bytes(encode_variable_int(value))
