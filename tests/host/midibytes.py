"""MIDI files made by hand, byte by byte."""

from __future__ import annotations


def vlq(value: int) -> bytes:
    """A variable-length quantity."""
    out = [value & 0x7F]
    while value := value >> 7:
        out.append(value & 0x7F | 0x80)
    return bytes(reversed(out))


def chunk(kind: bytes, body: bytes) -> bytes:
    return kind + len(body).to_bytes(4, "big") + body


def header(form: int = 0, tracks: int = 1, division: int = 480) -> bytes:
    return chunk(b"MThd", b"".join(number.to_bytes(2, "big") for number in (form, tracks, division)))


def track(*events: tuple[int, bytes], end: int | None = 0) -> bytes:
    """(delta ticks, message bytes) …, then an end of track after `end` ticks (None: none)."""
    body = b"".join(vlq(delta) + message for delta, message in events)
    return chunk(b"MTrk", body + (b"" if end is None else vlq(end) + b"\xff\x2f\x00"))


def tempo(microseconds: int) -> bytes:
    return b"\xff\x51\x03" + microseconds.to_bytes(3, "big")


def on(note: int, velocity: int = 64, channel: int = 0) -> bytes:
    return bytes((0x90 | channel, note, velocity))


def off(note: int, velocity: int = 64, channel: int = 0) -> bytes:
    return bytes((0x80 | channel, note, velocity))
