"""Recorded notes: folders of audio files, whose names are understood by a collection, and samples of a SoundFont."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from synth.fit.recording import read_recording
from synth.units import note_to_midi


@dataclass(frozen=True)
class Recorded:
    """One recorded note.

    instrument, kind: what is compared with what, `bass` and `finger` say.  group: the set that it belongs to.
    dynamic: pp … ff, "" where there are no layers.  samples: (frames, channels).
    """

    instrument: str
    kind: str
    group: str
    name: str
    note: int
    dynamic: str
    take: int
    samples: NDArray[np.float64]
    rate_hz: float


@dataclass(frozen=True)
class Collection:
    """How the files of a folder are named: a pattern with groups note, dynamic, take; note moves by `transpose`."""

    folder: str
    pattern: str
    instrument: str
    kind: str
    group: str
    transpose: int = 0


_LAYERS = {"pp": "soft", "p": "soft", "mf": "medium", "f": "loud", "ff": "loud"}
#: what stands in the recordings' own README; of `flbass` the long tones called c3 sound C4 (261 Hz)
COLLECTIONS = (
    Collection(
        "fashionbass", r"(?P<note>[a-g]b?\d)_(?P<dynamic>pp|p|mf|f|ff)_rr(?P<take>\d)", "bass", "ring", "fashionbass"
    ),
    Collection("pbf", r"(?P<note>[A-G]#?\d)", "bass", "ring", "pbf"),
    Collection("flbass", r"\d+_(?P<note>c2)_(finger|pick)_long.*", "bass", "ring", "flbass"),
    Collection("flbass", r"\d+_(?P<note>c3)_(finger|pick)_long.*", "bass", "ring", "flbass", 12),
    Collection("flbass", r"\d+_(?P<note>c\d)_palm_mute", "bass", "palm-mute", "flbass"),
    Collection("flbass", r"\d+_(?P<note>c\d)_(finger|pick)_short.*", "bass", "short", "flbass"),
    Collection("flbass", r"14_(?P<note>c4)_harmonic", "bass", "harmonic", "flbass"),
)
#: instruments of a SoundFont by the beginning of their name: instrument, kind, group
FONT_INSTRUMENTS = {
    "Fingered Bass": ("bass", "ring", "FluidR3 finger"),
    "Picked Bass": ("bass", "ring", "FluidR3 pick"),
    "Slap Bass": ("bass", "ring", "FluidR3 slap"),
    "Fretless Bass": ("bass", "ring", "FluidR3 fretless"),
    "Sitar": ("sitar", "ring", "FluidR3 sitar"),
    "Steel String Guitar": ("steel-guitar", "ring", "FluidR3 steel guitar"),
    "Nylon Guitar": ("nylon-guitar", "ring", "FluidR3 nylon guitar"),
    "Harpsichord": ("harpsichord", "ring", "FluidR3 harpsichord"),
    "Clavinet": ("clavinet", "ring", "FluidR3 clavinet"),
    "Shamisen": ("shamisen", "ring", "FluidR3 shamisen"),
    "Koto": ("koto", "ring", "FluidR3 koto"),
}

# A shorter sample is a waveform, not a note.
_WAVEFORM_S = 0.05


def recordings(folder: Path) -> Iterator[Recorded]:
    """Every note of the collections under a folder, of equal recordings the first. Raises ValueError where none is."""
    heard: list[NDArray[np.complex128]] = []
    for collection in COLLECTIONS:
        for path in sorted((folder / collection.folder).glob("*")):
            match = re.fullmatch(collection.pattern, path.stem)
            if match is None or path.suffix.lower() not in (".flac", ".wav"):
                continue
            samples, rate = read_recording(str(path))
            sound = samples[:rate, 0]
            spectrum = np.fft.fft(sound, 2 * sound.size)
            if any(_same(spectrum, other) for other in heard):
                continue
            heard.append(spectrum)
            found = match.groupdict()
            dynamic = found.get("dynamic") or ""
            group = " ".join(filter(None, (collection.group, _LAYERS.get(dynamic))))
            note = note_to_midi(found["note"][0].upper() + found["note"][1:]) + collection.transpose
            name = f"{collection.folder}/{path.name}"
            take = int(found.get("take") or 1)
            yield Recorded(collection.instrument, collection.kind, group, name, note, dynamic, take, samples, rate)
    if not heard:
        folders = ", ".join(sorted({c.folder for c in COLLECTIONS}))
        raise ValueError(f"{folder}: has no known recordings; it must contain a folder {folders}")


def _same(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> bool:
    """Whether two spectra are of one recording but for gain and a shift (takes of a note correlate by up to 0.996)."""
    if a.size != b.size:
        return False
    largest = 0.999 * np.linalg.norm(a) * np.linalg.norm(b)
    return bool(np.abs(a) @ np.abs(b) > largest and np.abs(np.fft.ifft(a * b.conj())).max() * a.size > largest)


def font_samples(path: Path) -> Iterator[Recorded]:
    """Samples of a SoundFont's string instruments at their roots, whole (to the end of their loop). Raises ValueError."""
    from sf2utils.sf2parse import Sf2File

    # it remarks on loops of samples that are not used here
    logging.getLogger().setLevel(logging.ERROR)
    with path.open("rb") as file:
        font = Sf2File(file)
        for instrument in font.instruments:
            if (known := FONT_INSTRUMENTS.get(instrument.name)) is None:
                continue
            done: set[str] = set()
            for bag in instrument.bags:
                sample = bag.sample
                if sample is None or sample.name in done:
                    continue
                if sample.name.endswith("(R)") and f"{sample.name[:-3]}(L)" in done:
                    continue
                done.add(sample.name)
                if sample.duration < _WAVEFORM_S * sample.sample_rate:
                    continue
                note = sample.original_pitch if bag.base_note is None else bag.base_note
                data = np.frombuffer(sample.raw_sample_data, dtype="<i2").astype(float)[:, None] / 32768.0
                yield Recorded(*known, sample.name.strip(), note, "", 1, data, float(sample.sample_rate))
