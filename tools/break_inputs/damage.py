"""Ways to break a file: of its bytes, and of the text of a TOML or Scala file."""

from __future__ import annotations

import re

import numpy as np

NUMBER = re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\w.])")
#: what stands for a number that was there
INSTEAD = tuple(
    b'nan inf -inf 1e308 -1e308 1e-308 0 -0.0 -1 1e12 9223372036854775808 true "x" [] [1,2] {} 1979-05-27 0.5 2 100'.split()
)
ODD = (
    b"\x00",
    b"\xff\xfe",
    b"\xc3",
    b"\r",
    b"\n\n",
    b"=",
    b"[",
    b"]",
    b'"',
    b'"""',
    b"#",
    b"{",
    b",",
    "é".encode(),
    b"\xef\xbb\xbf",
)


def bytes_broken(data: bytes, rng: np.random.Generator) -> bytes:
    """One damage or a few: bits, bytes, runs of bytes, pieces cut, doubled, moved or filled; the end cut off."""
    broken = bytearray(data)
    for _ in range(min(8, rng.geometric(0.6))):
        size = len(broken)
        if not size:
            return bytes(rng.integers(0, 256, rng.integers(0, 64), dtype=np.uint8))
        at = int(rng.integers(size))
        if rng.random() < 0.5:  # where headers are
            at %= min(size, 128)
        length = int(min(size - at, 2 ** rng.integers(0, 9)))
        match rng.integers(9):
            case 0:
                broken[at] ^= 1 << int(rng.integers(8))
            case 1:
                broken[at] = int(rng.integers(256))
            case 2:
                broken[at : at + length] = rng.integers(0, 256, length, dtype=np.uint8).tobytes()
            case 3:
                del broken[at : at + length]
            case 4:
                broken[at:at] = broken[at : at + length]
            case 5:
                to = int(rng.integers(size))
                broken[to:to] = broken[at : at + length]
            case 6:
                broken[at : at + length] = bytes([int(rng.choice([0, 0x7F, 0x80, 0xFF]))]) * length
            case 7:
                field = int(rng.choice([1, 2, 4, 8]))
                value = int(rng.choice([0, 1, 0x7F, 0x80, 0xFF, 2 ** (8 * field - 1), 2 ** (8 * field) - 1])) % 256**field
                broken[at : at + field] = value.to_bytes(field, str(rng.choice(["big", "little"])))  # type: ignore[arg-type]
            case _:
                if rng.random() < 0.3:
                    del broken[at:]
    return bytes(broken)


def text_broken(data: bytes, rng: np.random.Generator) -> bytes:
    """One damage or a few that leave most of a text readable: numbers, names, lines, quotes; now and then plain bytes."""
    for _ in range(min(4, rng.geometric(0.6))):
        lines = data.split(b"\n")
        at = int(rng.integers(len(lines)))
        numbers = list(NUMBER.finditer(data))
        match rng.integers(8):
            case 0 | 1 | 2 if numbers:
                found = numbers[int(rng.integers(len(numbers)))]
                data = data[: found.start()] + INSTEAD[int(rng.integers(len(INSTEAD)))] + data[found.end() :]
            case 3 if numbers:
                found = numbers[int(rng.integers(len(numbers)))]
                scaled = float(found.group()) * 10.0 ** rng.uniform(-4.0, 4.0) * float(rng.choice([-1.0, 1.0]))
                data = data[: found.start()] + f"{scaled:.6g}".encode() + data[found.end() :]
            case 4:
                data = b"\n".join(lines[:at] + lines[at + 1 :])
            case 5:
                to = int(rng.integers(len(lines)))
                data = b"\n".join([*lines[:to], lines[at], *lines[to:]])
            case 6:
                to = int(rng.integers(len(data) + 1))
                data = data[:to] + ODD[int(rng.integers(len(ODD)))] + data[to:]
            case 7:
                data = bytes_broken(data, rng)
    return data
