"""Messages mean to the native library what they mean to the program."""

from __future__ import annotations

import numpy as np

from synth.midi import sysex
from synth.midi.events import EVENT
from synth.midi.stream import MidiStream


def by_program(message: bytes) -> np.ndarray:
    """Events of a message as the program reads them."""
    rows: list[tuple] = []

    def sink(kind: int, channel: int, a: int, b: int, value: float, _time_ns: int) -> bool:
        rows.append((0, kind, channel, a, b, value))
        return True

    MidiStream(sink).feed(message, 0)
    return np.array(rows, EVENT)


def check(library, message: bytes) -> int:
    """How many events a message stands for, the same ones here and there."""
    wanted, got = by_program(message), library.read_midi(message)
    assert wanted.tobytes() == got.tobytes(), (message.hex(), wanted, got)
    return len(wanted)


def test_short_messages(library):
    rng = np.random.default_rng(1)
    for status in range(0x80, 0x100):
        for _ in range(12):
            size = 1 if status >= 0xF4 else 2 if status & 0xE0 == 0xC0 or status in (0xF1, 0xF3) else 3
            if status in (0xF0, 0xF7):
                continue
            message = bytes([status, *rng.integers(0, 128, size - 1).tolist()])
            assert check(library, message) == (1 if status < 0xF0 else 0)
    assert check(library, bytes([0x93, 60, 0])) == 1


def test_what_is_no_message_is_nothing(library):
    for data in (
        b"",
        b"\x00",
        b"\x40\x40\x40",
        b"\x90",
        b"\x90\x40",
        b"\x90\x40\x80",
        b"\x90\x80\x40",
        b"\xb0\x07",
        b"\xf0",
        b"\xf7",
    ):
        assert len(library.read_midi(data)) == 0, data
    assert library.midi(None, 3, 0, None, 0) == 0


def test_hosts_that_hand_over_three_bytes_of_two(library):
    for status in (0xC3, 0xD3):
        assert library.read_midi(bytes([status, 5, 0])).tobytes() == by_program(bytes([status, 5])).tobytes()


def exclusive(rng: np.random.Generator) -> bytes:
    """The body of a message that means something, or nearly."""
    seven = lambda count: rng.integers(0, 128, count).tolist()  # noqa: E731
    at_once = int(rng.choice([0x7E, 0x7F]))
    kind = int(rng.integers(8))
    if kind == 0:
        return sysex.of_parameter(
            int(rng.integers(1 << 14)), int(rng.integers(128)), float(rng.normal() * 10.0 ** rng.integers(-300, 300))
        )
    if kind == 1:
        value = float(rng.choice([np.nan, np.inf, rng.uniform(0, 128), int(rng.integers(0, 128)) + 0.5]))
        return sysex.of_tuning(int(rng.integers(128)), value, bool(rng.integers(2)))
    if kind == 2:
        body = bytes([0x7E, *seven(1), 8, 1, *seven(1), *seven(16), *seven(3 * 128)])
        return body + bytes([sysex._checksum(body)])
    if kind == 3:
        count = int(rng.integers(0, 12))
        return bytes([at_once, *seven(1), 8, 2, *seven(1), count, *seven(4 * count)])
    if kind == 4:
        count = int(rng.integers(0, 12))
        return bytes([at_once, *seven(1), 8, 7, *seven(2), count, *seven(4 * count)])
    if kind == 5:
        return bytes([at_once, *seven(1), 8, 8, *seven(3), *seven(12)])
    if kind == 6:
        return bytes([at_once, *seven(1), 8, 9, *seven(3), *seven(24)])
    return bytes([at_once, *seven(1), 8, 2, *seven(1), 1, *seven(1), 0x7F, 0x7F, 0x7F])


def test_system_exclusive_messages(library):
    """Whole ones, and with a byte more, less or another in the place of one."""
    rng = np.random.default_rng(2)
    events = 0
    for _ in range(600):
        body = exclusive(rng)
        events += check(library, b"\xf0" + body + b"\xf7")
        changed = bytearray(body)
        change = int(rng.integers(3))
        at = int(rng.integers(len(body)))
        if change == 0:
            changed[at] = int(rng.integers(128))
        elif change == 1:
            del changed[at:]
        else:
            changed.insert(at, int(rng.integers(128)))
        check(library, b"\xf0" + bytes(changed) + b"\xf7")
    assert events > 5000


def test_an_exclusive_message_that_is_cut_off_or_holds_a_status_is_nothing(library):
    body = sysex.of_tuning(60, 60.5, True)
    assert len(library.read_midi(b"\xf0" + body + b"\xf7")) == 1
    assert len(library.read_midi(b"\xf0" + body)) == 0
    assert len(library.read_midi(b"\xf0" + body[:-1] + b"\x90\xf7")) == 0


def test_no_more_is_written_than_there_is_room_for(library):
    rng = np.random.default_rng(3)
    body = bytes([0x7F, 0, 8, 8, 3, 0, 0, *rng.integers(0, 128, 12).tolist()])
    message = b"\xf0" + body + b"\xf7"
    assert len(library.read_midi(message)) == 128
    events = np.full(10, 7, np.int64).repeat(4)
    assert library.midi(message, len(message), 5, events.ctypes.data, 9) == 9
    assert (events[36:] == 7).all() and (events.view(EVENT)["frame"][:9] == 5).all()
