"""A small SoundFont: one click, played by the programs that are asked for."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np

#: where the click lies in the sample, behind the rise of the envelope; the key that plays it at its own speed
CLICK_AT, KEY = 256, 60
_FRAMES = 2048


def _chunk(name: bytes, body: bytes) -> bytes:
    return name + struct.pack("<I", len(body)) + body + bytes(len(body) % 2)


def _list(name: bytes, *chunks: bytes) -> bytes:
    return _chunk(b"LIST", name + b"".join(chunks))


def write_soundfont(path: Path, programs: Sequence[tuple[int, int]], rate_hz: int, level: float = 0.5) -> Path:
    """(bank, program) each play one click of this level; bank 128 has the drums."""
    sample = np.zeros(_FRAMES + 46, "<i2")
    sample[CLICK_AT] = round(level * 32767)
    presets = b""
    for number, (bank, program) in enumerate(sorted(programs)):
        presets += struct.pack("<20sHHHIII", b"click", program, bank, number, 0, 0, 0)
    count = len(programs)
    presets += struct.pack("<20sHHHIII", b"EOP", 0, 0, count, 0, 0, 0)
    instrument, sample_of = 41, 53  # generators
    body = b"sfbk" + b"".join(
        (
            _list(
                b"INFO",
                _chunk(b"ifil", struct.pack("<HH", 2, 1)),
                _chunk(b"isng", b"EMU8000\0"),
                _chunk(b"INAM", b"click\0"),
            ),
            _list(b"sdta", _chunk(b"smpl", sample.tobytes())),
            _list(
                b"pdta",
                _chunk(b"phdr", presets),
                _chunk(b"pbag", b"".join(struct.pack("<HH", n, 0) for n in range(count + 1))),
                _chunk(b"pmod", bytes(10)),
                _chunk(b"pgen", struct.pack("<HH", instrument, 0) * count + bytes(4)),
                _chunk(b"inst", struct.pack("<20sH", b"click", 0) + struct.pack("<20sH", b"EOI", 1)),
                _chunk(b"ibag", struct.pack("<HHHH", 0, 0, 1, 0)),
                _chunk(b"imod", bytes(10)),
                _chunk(b"igen", struct.pack("<HH", sample_of, 0) + bytes(4)),
                _chunk(
                    b"shdr",
                    struct.pack("<20sIIIIIBbHH", b"click", 0, _FRAMES, 0, _FRAMES, rate_hz, KEY, 0, 0, 1)
                    + struct.pack("<20sIIIIIBbHH", b"EOS", 0, 0, 0, 0, 0, 0, 0, 0, 0),
                ),
            ),
        )
    )
    path.write_bytes(_chunk(b"RIFF", body))
    return path
