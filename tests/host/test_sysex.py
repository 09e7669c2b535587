"""Tunings and parameters as system exclusive messages."""

import math
import struct
from functools import reduce
from operator import xor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from synth.midi.events import PARAMETER, TUNING
from synth.midi.sysex import events_of, of_parameter, of_tuning


def hexed(text: str) -> bytes:
    return bytes.fromhex(text)


def bulk(pitches: list[bytes]) -> bytes:
    """A bulk dump reply with its checksum."""
    body = hexed("7E 00 08 01 05") + b"Just for a test ".ljust(16) + b"".join(pitches)
    return body + bytes((reduce(xor, body) & 0x7F,))


def test_single_note_change_of_the_specification() -> None:
    # the examples of the MIDI Tuning Standard: 60 00 → 261.6256 Hz = key 60; 3C 00 01: one step of 0.0061 cents above it
    two = hexed("7F 00 08 02 03 02 3C 3C 00 00 45 45 40 00")
    assert events_of(two) == [(TUNING, 0, 60, 1, 60.0), (TUNING, 0, 69, 1, 69.5)]
    assert events_of(hexed("7F 7F 08 02 00 01 3C 3C 00 01")) == [(TUNING, 0, 60, 1, 60.0 + 1.0 / 16384)]


def test_single_note_change_with_bank_in_both_times() -> None:
    assert events_of(hexed("7F 7F 08 07 01 02 01 3C 3D 00 00")) == [(TUNING, 0, 60, 1, 61.0)]
    assert events_of(hexed("7E 7F 08 07 01 02 01 3C 3D 00 00")) == [(TUNING, 0, 60, 0, 61.0)]
    # without a bank it exists in real time only
    assert events_of(hexed("7E 7F 08 02 00 01 3C 3D 00 00")) == []


def test_7f_7f_7f_changes_nothing() -> None:
    assert events_of(hexed("7F 7F 08 02 00 02 3C 7F 7F 7F 3D 3C 00 00")) == [(TUNING, 0, 61, 1, 60.0)]


def test_bulk_dump() -> None:
    pitches = [bytes((key, 0x20, 0)) for key in range(128)]
    pitches[5] = b"\x7f\x7f\x7f"
    rows = events_of(bulk(pitches))
    assert rows == [(TUNING, 0, key, 0, key + 0.25) for key in range(128) if key != 5]


@pytest.mark.parametrize("at", [4, 8, 30, 404, 405])
def test_bulk_dump_with_a_wrong_byte_is_refused(at: int) -> None:
    data = bytearray(bulk([bytes((key, 0, 0)) for key in range(128)]))
    data[at] ^= 0x01
    assert events_of(bytes(data)) == []


def test_scale_octave_tuning() -> None:
    # C 64 cents flat, C♯ 63 sharp, the others as they are
    one = hexed("7E 7F 08 08 03 7F 7F 00 7F") + bytes([0x40] * 10)
    rows = events_of(one)
    assert len(rows) == 128
    assert rows[60] == (TUNING, 0, 60, 0, 60 - 0.64)
    assert rows[61] == (TUNING, 0, 61, 0, 61 + 0.63)
    assert rows[71] == (TUNING, 0, 71, 0, 71.0)
    two = hexed("7F 7F 08 09 03 7F 7F 00 00 7F 7F") + bytes([0x40, 0x00] * 10)
    rows = events_of(two)
    assert rows[48] == (TUNING, 0, 48, 1, 47.0)
    assert rows[49] == (TUNING, 0, 49, 1, 49 + 8191 / 8192)
    assert rows[50] == (TUNING, 0, 50, 1, 50.0)
    assert events_of(hexed("7E 7F 08 08 00 00 00") + bytes([0x40] * 12)) == []  # for no channel


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x7f",
        hexed("7E 7F 09 01"),  # General MIDI on
        hexed("7F 7F 04 01 00 7F"),  # master volume
        hexed("41 10 42 12 40 00 7F 00 41"),
        hexed("7D 00 00 01 00 00 00"),  # another user of 7D
        hexed("7F 7F 08 02 00 02 3C 3C 00 00"),  # promises two changes
        hexed("7F 7F 08 02 00 01 3C 3C 00 00 00"),
        hexed("7F 7F 08 02 00 01 3C 3C 80 00"),  # a status byte inside
        hexed("7F 7F 08 02 00"),
        hexed("7F 7F 08 08 03 7F 7F 40"),
    ],
)
def test_what_is_unknown_or_malformed_says_nothing(data: bytes) -> None:
    assert events_of(data) == []


@given(st.binary(max_size=40), st.sampled_from([b"", b"\x7f\x00\x08", b"\x7e\x00\x08", b"\x7d\x4a\x57"]))
def test_nothing_crashes(data: bytes, head: bytes) -> None:
    for kind, _, a, b, _ in events_of(head + data):
        assert kind in (TUNING, PARAMETER) and 0 <= a < 128 and 0 <= b <= 1


@given(st.integers(0, 16383), st.integers(0, 127), st.floats(allow_nan=False))
def test_a_parameter_comes_back_bit_for_bit(part: int, index: int, value: float) -> None:
    data = of_parameter(part, index, value)
    assert max(data) < 128
    ((kind, channel, a, _, back),) = events_of(data)
    assert (kind, channel, a) == (PARAMETER, part, index)
    assert struct.pack("d", back) == struct.pack("d", value)


@given(st.integers(0, 127), st.one_of(st.floats(), st.integers(-16384, 128 * 16384).map(lambda n: n / 16384)), st.booleans())
def test_a_tuning_comes_back_bit_for_bit(key: int, value: float, at_once: bool) -> None:
    data = of_tuning(key, value, at_once)
    assert max(data) < 128
    ((kind, _, a, b, back),) = events_of(data)
    assert (kind, a, b) == (TUNING, key, at_once)
    assert back == value or (math.isnan(back) and math.isnan(value))


def test_tunings_are_the_standards_where_it_can_say_them() -> None:
    assert of_tuning(60, 60.5, True) == hexed("7F 7F 08 02 00 01 3C 3C 40 00")
    assert of_tuning(60, 60.5, False) == hexed("7E 7F 08 07 00 00 01 3C 3C 40 00")
    assert of_tuning(60, 60.1, True)[0] == 0x7D


def test_our_own_messages_byte_by_byte() -> None:
    """Takes hold them, so they stay as they are: 7D 4A 57, what it is, and the double as ten bytes of 7 bits."""
    half = "00 3F 70" + " 00" * 7  # 3FE0 0000 0000 0000
    tenth = "00 3F 5C 66 33 19 4C 66 33 1A"  # 3FB9 9999 9999 999A
    for data, row in (
        (hexed("7D 4A 57 01 01 02 03" + half), (PARAMETER, 130, 3, 0, 0.5)),
        (hexed("7D 4A 57 01 7F 7F 7F" + tenth), (PARAMETER, 16383, 127, 0, 0.1)),
    ):
        assert events_of(data) == [row]
        assert of_parameter(row[1], row[2], row[4]) == data
    for at_once in (0, 1):
        data = hexed(f"7D 4A 57 02 3C 0{at_once}" + tenth)
        assert events_of(data) == [(TUNING, 0, 60, at_once, 0.1)]
        assert of_tuning(60, 0.1, bool(at_once)) == data
    assert events_of(hexed("7D 4A 57 02 3C 02" + half)) == events_of(hexed("7D 4A 57 03 3C 01" + half)) == []
    assert events_of(hexed("7D 4A 57 01 01 02" + half)) == events_of(hexed("7D 4A 57 02 3C 01 00" + half)) == []


def test_the_ends_of_what_the_standard_can_say() -> None:
    step = 1.0 / 16384
    assert of_tuning(0, 0.0, True) == hexed("7F 7F 08 02 00 01 00 00 00 00")
    assert of_tuning(127, 128.0 - 2.0 * step, True) == hexed("7F 7F 08 02 00 01 7F 7F 7F 7E")
    # the last of all pitches means no change, and there are none below key 0 or above it
    assert {of_tuning(127, value, True)[0] for value in (128.0 - step, 128.0, -step)} == {0x7D}


def test_wrong_arguments_are_refused() -> None:
    for part, index in ((1 << 14, 0), (0, 128), (0, -1)):
        with pytest.raises(ValueError, match=f"a part must lie between 0 and 16383, an index .* 127, got {part}, {index}"):
            of_parameter(part, index, 0.0)
    with pytest.raises(ValueError, match="a key must lie between 0 and 127, got -1"):
        of_tuning(-1, 60.0, True)
    with pytest.raises(ValueError, match="a key must lie"):
        of_tuning(128, 60.0, True)
    with pytest.raises(ValueError, match="a part must lie"):
        of_parameter(-1, 0, 0.0)
