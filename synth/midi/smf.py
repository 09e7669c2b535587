"""Standard MIDI Files: bytes → tracks of timed messages, still in ticks.

Source: MIDI 1.0 Detailed Specification, "Standard MIDI Files 1.0" (RP-001). The reader is its own, and not
mido's, for three
reasons: SMPTE divisions (negative numbers) and unknown chunks have to be right, a broken file has to be
refused with the byte where it breaks, and a file of half a million messages has to open in well under a
second. mido is the oracle of its tests.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from synth.files.sources import read_bytes

#: largest file that is read [bytes]
MOST_BYTES = 1 << 28
SMPTE_FRAMES_PER_SECOND = {24: 24.0, 25: 25.0, 29: 30000.0 / 1001.0, 30: 30.0}

#: A meta event (sequencer-specific) that this program's takes begin with: simultaneous events are in their order.
TAKE_MARK = b"\xff\x7f\x04\x7dJW\x03"
#: the same of takes of sessions in which programs chose by the whole table of General MIDI; behind it the headroom of their
#: song in tenths of a decibel
GM_TAKE_MARK = b"\xff\x7f\x05\x7dJW\x04"
#: behind either in takes of sessions in which keys and controllers switched no articulations of what programs chose
UNSWITCHED_MARK = b"\xff\x7f\x04\x7dJW\x05"

# System common messages have no place in a file, but some hold them: skipped with their data.
_SYSTEM_DATA_BYTES = {0xF1: 1, 0xF2: 2, 0xF3: 1}


class MidiError(ValueError):
    """A MIDI file that cannot be read; the message is one line: file, what is wrong, remedy."""


@dataclass
class Track:
    """One track, its channel messages in file order as parallel lists.

    ticks: time since the track's start; status: status byte (0x80…0xEF); data1, data2: data bytes (data2 is 0
    where the message has one). tempos: (tick, microseconds per quarter note). sysex: (place, tick, body without F0 and
    F7), `place` being how many channel messages come before; one sent in several packets has the tick of the last.
    end_tick: time of the track's end. take: whether this program recorded it, and simultaneous events are in their order;
    gm, headroom_db: whether, if so, programs chose by the whole table of General MIDI, and what its song was lowered by;
    unswitched: whether keys and controllers switched no articulations of what programs chose.
    """

    ticks: list[int] = field(default_factory=list)
    status: list[int] = field(default_factory=list)
    data1: list[int] = field(default_factory=list)
    data2: list[int] = field(default_factory=list)
    tempos: list[tuple[int, int]] = field(default_factory=list)
    sysex: list[tuple[int, int, bytes]] = field(default_factory=list)
    end_tick: int = 0
    take: bool = False
    gm: bool = False
    headroom_db: float = 0.0
    unswitched: bool = False


@dataclass(frozen=True)
class MidiFile:
    """A whole file. One of ticks_per_quarter (musical time) and ticks_per_second (SMPTE time) is set, the
    other is None.
    """

    format: int
    ticks_per_quarter: int | None
    ticks_per_second: float | None
    tracks: list[Track]
    warnings: list[str]


def read_file(path: str | Path) -> MidiFile:
    """Reads a Standard MIDI File (also one wrapped in RIFF, as .rmi files are).

    Raises MidiError for a file that is missing, empty, cut off, broken or no MIDI file.
    """
    try:
        data = read_bytes(path, MOST_BYTES, "MIDI file")
    except FileNotFoundError:
        raise MidiError(f"{path}: no such file; check the name") from None
    except IsADirectoryError:
        raise MidiError(f"{path}: is a directory; name a MIDI file") from None
    except OSError as error:
        raise MidiError(f"{path}: cannot be read ({error.strerror}); check its permissions") from None
    try:
        return parse(data)
    except MidiError as error:
        raise MidiError(f"{path}: {error}") from None


def parse(data: bytes) -> MidiFile:
    """Parses the bytes of a Standard MIDI File. Raises MidiError (its message without the file's name)."""
    if not data:
        raise MidiError("the file is empty; export or copy it again")
    if data[:4] == b"RIFF":
        data = _unwrap_riff(data)
    if data[:4] != b"MThd":
        if len(data) < 4 and b"MThd".startswith(data):
            raise _cut_off("its header", len(data))
        raise MidiError("not a MIDI file (it does not begin with MThd); give a Standard MIDI File (.mid)")
    if len(data) < 14:
        raise _cut_off("its header", len(data))
    header_length = _u32(data, 4)
    if header_length < 6:
        raise MidiError(f"broken header (length {header_length}, at least 6 is needed); export the file again")
    form, promised, division = _u16(data, 8), _u16(data, 10), _u16(data, 12)
    if form > 2:
        raise MidiError(f"MIDI file format {form} is not supported (0, 1 and 2 are); export the file as format 1")
    per_quarter, per_second = _division(division)

    warnings: list[str] = []
    tracks: list[Track] = []
    position = 8 + header_length
    while len(tracks) < promised:
        where = f"track {len(tracks) + 1} of {promised}"
        if position + 8 > len(data):
            raise _cut_off(f"before {where}", len(data))
        kind, length = data[position : position + 4], _u32(data, position + 4)
        start, end = position + 8, position + 8 + length
        if end > len(data):
            raise _cut_off(f"inside {where}" if kind == b"MTrk" else f"before {where}", len(data))
        if kind == b"MTrk":
            tracks.append(_parse_track(data[start:end], start, where))
        elif not kind.isascii():
            raise MidiError(f"broken at byte {position}: no chunk begins there; export the file again")
        position = end
    if data[position : position + 4] == b"MTrk":
        warnings.append(
            f"the header promises {promised} track{'' if promised == 1 else 's'}, but more follow: they are ignored"
        )
    return MidiFile(form, per_quarter, per_second, tracks, warnings)


def _u16(data: bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 2], "big")


def _u32(data: bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 4], "big")


def _cut_off(where: str, length: int) -> MidiError:
    return MidiError(f"the file is cut off {where} (after {length} bytes); get a complete copy of it")


def _unwrap_riff(data: bytes) -> bytes:
    """The MIDI file inside a RIFF RMID file; chunks are padded to even lengths and little-endian."""
    if data[8:12] != b"RMID":
        raise MidiError("a RIFF file without MIDI in it (perhaps a WAV); give a Standard MIDI File (.mid)")
    position = 12
    while position + 8 <= len(data):
        length = int.from_bytes(data[position + 4 : position + 8], "little")
        if data[position : position + 4] == b"data":
            return data[position + 8 : position + 8 + length]
        position += 8 + length + length % 2
    raise _cut_off("before its MIDI data", len(data))


def _division(division: int) -> tuple[int | None, float | None]:
    """(ticks per quarter note, None) or (None, ticks per second) of the header's division word."""
    if division < 0x8000:
        if division == 0:
            raise MidiError("broken header (0 ticks per quarter note); export the file again")
        return division, None
    frames, ticks_per_frame = 256 - (division >> 8), division & 0xFF
    if frames not in SMPTE_FRAMES_PER_SECOND or ticks_per_frame == 0:
        raise MidiError(
            f"broken header (SMPTE time with {frames} frames per second, {ticks_per_frame} ticks per frame; "
            "it must be 24, 25, 29 or 30 frames and at least 1 tick); export the file again"
        )
    return None, SMPTE_FRAMES_PER_SECOND[frames] * ticks_per_frame


def _parse_track(body: bytes, offset: int, where: str) -> Track:
    """Parses one track's bytes; `offset` is their place in the file and `where` their name, for messages."""
    track = Track()
    ticks, statuses, data1, data2 = track.ticks, track.status, track.data1, track.data2
    tick = at = 0
    running = 0
    packets: bytearray | None = None  # of a system exclusive message that has not ended
    length = len(body)
    event_at = 0
    try:
        while at < length:
            event_at = at
            byte = body[at]
            at += 1
            if byte < 0x80:
                tick += byte
            else:
                delta, at = _variable_length(body, at - 1)
                tick += delta
            status = body[at]
            if status < 0x80:
                # Strictly a meta event or SysEx ends running status; files that go on after one are common
                # and unambiguous.
                status = running
                if not status:
                    raise _Broken("a data byte without a status before it")
            else:
                at += 1
            if status < 0xF0:
                running = status
                first = body[at]
                if 0xC0 <= status < 0xE0:
                    second = 0
                    at += 1
                else:
                    second = body[at + 1]
                    at += 2
                if first > 0x7F or second > 0x7F:
                    raise _Broken("a data byte above 127")
                ticks.append(tick)
                statuses.append(status)
                data1.append(first)
                data2.append(second)
            elif status == 0xFF:
                kind = body[at]
                size, at = _variable_length(body, at + 1)
                payload = body[at : at + size]
                if len(payload) < size:
                    raise IndexError
                at += size
                if kind == 0x2F:
                    break
                if kind == 0x51 and size >= 3:
                    track.tempos.append((tick, int.from_bytes(payload[:3], "big")))
                if kind == TAKE_MARK[1] and payload == TAKE_MARK[3:]:
                    track.take = True
                if kind == GM_TAKE_MARK[1] and size == GM_TAKE_MARK[2] and payload[:-1] == GM_TAKE_MARK[3:]:
                    track.take, track.gm, track.headroom_db = True, True, payload[-1] / 10.0
                if kind == UNSWITCHED_MARK[1] and payload == UNSWITCHED_MARK[3:]:
                    track.unswitched = True
            elif status in (0xF0, 0xF7):
                size, at = _variable_length(body, at)
                packet = body[at : at + size]
                at += size
                if at > length:
                    raise IndexError
                # A message may come in packets: the first behind F0, the others behind F7. F7 without a message that
                # waits is an escape, whose bytes are no system exclusive.
                if status == 0xF0:
                    packets = bytearray(packet)
                elif packets is not None:
                    packets += packet
                if packets is not None and packets.endswith(b"\xf7"):
                    track.sysex.append((len(ticks), tick, bytes(packets[:-1])))
                    packets = None
            else:
                at += _SYSTEM_DATA_BYTES.get(status, 0)
                if at > length:
                    raise IndexError
    except IndexError:
        raise MidiError(
            f"broken in {where}: the message at byte {offset + event_at} runs over the track's end; export the file again"
        ) from None
    except _Broken as problem:
        raise MidiError(
            f"broken in {where}: {problem} in the message at byte {offset + event_at}; export the file again"
        ) from None
    track.end_tick = tick
    return track


class _Broken(Exception):
    pass


def _variable_length(body: bytes, at: int) -> tuple[int, int]:
    """(value, next position) of the variable-length quantity at `at`: seven bits a byte, four bytes at
    most.
    """
    value = 0
    for _ in range(4):
        byte = body[at]
        at += 1
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, at
    raise _Broken("a length of more than four bytes")
