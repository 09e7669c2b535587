"""System exclusive messages that change the sound: tunings, and this program's own.

Read are, of the MIDI Tuning Standard (MIDI 1.0 Detailed Specification, and CA-020, CA-021), the bulk tuning dump (sub-IDs
08 01), the single note change (08 02, with bank 08 07), and scale/octave tuning of one and of two bytes (08 08, 08 09).
Tunings are one for all channels and programs: bank and program numbers are not looked at, nor is the device. A real-time
message (7F) retunes what sounds, one that is not (7E) what is plucked from then on.

This program's own messages carry what these cannot, bit for bit: live parameters, and pitches finer than theirs. They
stand under 7D, the manufacturer for non-commercial use: 7D 4A 57, 01 part (2 bytes) index or 02 key at-once, then the
value as ten bytes of 7 bits, the highest first, of an IEEE 754 double.

Everything here is without the F0 before and the F7 behind a message.
"""

from __future__ import annotations

import struct

from synth.midi.events import PARAMETER, TUNING

NON_REAL_TIME, REAL_TIME, NON_COMMERCIAL = 0x7E, 0x7F, 0x7D
ALL_DEVICES = 0x7F
TUNING_STANDARD = 0x08
BULK_DUMP, NOTE_CHANGE, NOTE_CHANGE_IN_BANK, OCTAVE_1, OCTAVE_2 = 0x01, 0x02, 0x07, 0x08, 0x09
_NAME_BYTES = 16
#: "JW": others use 7D too
_OURS = bytes((NON_COMMERCIAL, 0x4A, 0x57))
_PARAMETER, _TUNING = 0x01, 0x02
_VALUE_BYTES = 10
#: steps of a semitone in a note change
_FINE = 1 << 14

Row = tuple[int, int, int, int, float]


def events_of(data: bytes) -> list[Row]:
    """(kind, channel, a, b, value) of each event that a message stands for; none for what is unknown or malformed."""
    data = bytes(data)
    if any(byte > 0x7F for byte in data):
        return []
    if data.startswith(_OURS):
        return _ours(data[len(_OURS) :])
    if len(data) < 4 or data[0] not in (NON_REAL_TIME, REAL_TIME) or data[2] != TUNING_STANDARD:
        return []
    at_once = int(data[0] == REAL_TIME)
    form, body = data[3], data[4:]
    if form == BULK_DUMP and not at_once:
        return _bulk(data)
    if form == NOTE_CHANGE and at_once:
        return _changes(body[1:], at_once)
    if form == NOTE_CHANGE_IN_BANK:
        return _changes(body[2:], at_once)
    if form in (OCTAVE_1, OCTAVE_2):
        return _octave(body, 1 if form == OCTAVE_1 else 2, at_once)
    return []


def of_parameter(part: int, index: int, value: float) -> bytes:
    """The message of a PARAMETER event."""
    if not 0 <= part < 1 << 14 or not 0 <= index < 128:
        raise ValueError(f"a part must lie between 0 and {(1 << 14) - 1}, an index between 0 and 127, got {part}, {index}")
    return _OURS + bytes((_PARAMETER, part >> 7, part & 0x7F, index)) + _value_bytes(value)


def of_tuning(key: int, value: float, at_once: bool) -> bytes:
    """The message of a TUNING event: the standard's single note change where that says it exactly, else our own."""
    if not 0 <= key < 128:
        raise ValueError(f"a key must lie between 0 and 127, got {key}")
    # 7F 7F 7F, the last of all pitches, stands for no change
    if 0.0 <= value < 128.0 - 1.0 / _FINE and (value * _FINE).is_integer():
        pitch = divmod(int(value * _FINE), _FINE)
        change = (1, key, pitch[0], pitch[1] >> 7, pitch[1] & 0x7F)
        if at_once:
            return bytes((REAL_TIME, ALL_DEVICES, TUNING_STANDARD, NOTE_CHANGE, 0, *change))
        return bytes((NON_REAL_TIME, ALL_DEVICES, TUNING_STANDARD, NOTE_CHANGE_IN_BANK, 0, 0, *change))
    return _OURS + bytes((_TUNING, key, int(at_once))) + _value_bytes(value)


def _value_bytes(value: float) -> bytes:
    (bits,) = struct.unpack(">Q", struct.pack(">d", value))
    return bytes(bits >> shift & 0x7F for shift in range(7 * (_VALUE_BYTES - 1), -1, -7))


def _value_of(data: bytes) -> float:
    bits = 0
    for byte in data:
        bits = bits << 7 | byte
    (value,) = struct.unpack(">d", struct.pack(">Q", bits & (1 << 64) - 1))
    return value


def _ours(body: bytes) -> list[Row]:
    if len(body) == 4 + _VALUE_BYTES and body[0] == _PARAMETER:
        return [(PARAMETER, body[1] << 7 | body[2], body[3], 0, _value_of(body[4:]))]
    if len(body) == 3 + _VALUE_BYTES and body[0] == _TUNING and body[2] <= 1:
        return [(TUNING, 0, body[1], body[2], _value_of(body[3:]))]
    return []


def _tuning(key: int, pitch: bytes, at_once: int) -> list[Row]:
    """A key's pitch of three bytes: semitone, and 14 bits of its fraction. 7F 7F 7F changes nothing."""
    if pitch == b"\x7f\x7f\x7f":
        return []
    return [(TUNING, 0, key, at_once, pitch[0] + (pitch[1] << 7 | pitch[2]) / _FINE)]


def _bulk(data: bytes) -> list[Row]:
    pitches = data[5 + _NAME_BYTES : -1]
    if len(pitches) != 3 * 128 or _checksum(data[:-1]) != data[-1]:
        return []
    return [row for key in range(128) for row in _tuning(key, pitches[3 * key : 3 * key + 3], 0)]


def _checksum(data: bytes) -> int:
    total = 0
    for byte in data:
        total ^= byte
    return total & 0x7F


def _changes(body: bytes, at_once: int) -> list[Row]:
    """Count, then key and pitch of each."""
    if not body or len(body) != 1 + 4 * body[0]:
        return []
    changes = (body[at : at + 4] for at in range(1, len(body), 4))
    return [row for change in changes for row in _tuning(change[0], change[1:], at_once)]


def _octave(body: bytes, size: int, at_once: int) -> list[Row]:
    """Three bytes of channels, then how far every C, C♯, … B stands off equal temperament: one byte counts cents from
    −64, two count 1/8192 of 100 cents from −8192."""
    if len(body) != 3 + 12 * size or not any(body[:3]):
        return []
    steps = body[3:]
    if size == 1:
        offsets = [(step - 64) / 100.0 for step in steps]
    else:
        offsets = [((steps[2 * k] << 7 | steps[2 * k + 1]) - 8192) / 8192.0 for k in range(12)]
    return [(TUNING, 0, key, at_once, key + offsets[key % 12]) for key in range(128)]
