"""The recordings inside a SoundFont: 16-bit samples with the places of their loops (SoundFont 2.04, sections 5 and 7.10)."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

#: of the Debian package fluid-soundfont-gm
FLUID = Path("/usr/share/sounds/sf2/FluidR3_GM.sf2")


@dataclass(frozen=True)
class Sample:
    """Places in samples from the beginning of the file's sample data."""

    name: str
    begin: int
    end: int
    loop: int
    rate_hz: int


class SoundFont:
    """A file, opened for reading."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with path.open("rb") as file:
            file.seek(12)
            chunks = dict(self._chunks(file, path.stat().st_size))
            self._data = chunks["smpl"][0]
            place, size = chunks["shdr"]
            file.seek(place)
            headers = file.read(size)
        self.samples: dict[str, Sample] = {}
        for at in range(0, len(headers) - 46, 46):
            name, begin, end, loop, _, rate = struct.unpack_from("<20sIIIII", headers, at)
            text = name.split(b"\0")[0].decode("latin-1").strip()
            self.samples[text] = Sample(text, begin, end, loop, rate)

    def _chunks(self, file: BinaryIO, end: int):
        while file.tell() < end - 8:
            name, size = struct.unpack("<4sI", file.read(8))
            place = file.tell()
            if name == b"LIST":
                file.seek(4, 1)
                yield from self._chunks(file, place + size)
            else:
                yield name.decode("latin-1"), (place, size)
            file.seek(place + size + size % 2)

    def read(self, sample: Sample) -> np.ndarray:
        """(n,) full scale 1, from its beginning to its loop: what comes then is no recording."""
        with self._path.open("rb") as file:
            file.seek(self._data + 2 * sample.begin)
            return np.frombuffer(file.read(2 * (sample.loop - sample.begin)), "<i2") / 32768.0
