"""Recordings of one instrument by note, dynamic and take, as their names have them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from synth.fit.contact_features import ContactBands
from synth.fit.fret_features import Heard, hear
from synth.fit.recording import FitRefused, RecordedNote, cut_note, read_recording
from synth.units import note_to_midi

#: soft to loud
DYNAMICS = ("ppp", "pp", "p", "mp", "mf", "f", "ff", "fff")
_NAME = re.compile(rf"(?P<note>[A-Ga-g][#b]?-?\d)_(?P<dynamic>{'|'.join(DYNAMICS)})(_rr(?P<take>\d+))?")
_SUFFIXES = (".flac", ".wav")
#: dynamic, take, file
File = tuple[str, int, Path]


@dataclass(frozen=True)
class Take:
    """One recording: its key, dynamic, number, file and the note cut out of it."""

    key: int
    dynamic: str
    take: int
    path: Path
    note: RecordedNote

    def heard(self, bands: ContactBands) -> Heard:
        """Its features. Raises FitRefused where it is too short."""
        try:
            return hear(self.note, bands)
        except FitRefused as error:
            raise FitRefused(f"{self.path}: {error}") from None


def named(folder: Path) -> dict[int, list[File]]:
    """{key: [(dynamic, take, file)]}, soft to loud. Raises ValueError where there is no such folder or no such file."""
    if not folder.is_dir():
        raise ValueError(f"{folder}: must be a folder of recordings, got none; check the path")
    found: dict[int, list[File]] = {}
    for path in sorted(folder.iterdir()):
        match = _NAME.fullmatch(path.stem)
        if match is None or path.suffix.lower() not in _SUFFIXES:
            continue
        key = note_to_midi(match["note"][0].upper() + match["note"][1:])
        found.setdefault(key, []).append((match["dynamic"], int(match["take"] or 1), path))
    if not found:
        raise ValueError(
            f"{folder}: holds no recording named NOTE_DYNAMIC or NOTE_DYNAMIC_rrTAKE, as d2_mf_rr1.flac; "
            f"dynamics are {', '.join(DYNAMICS)}"
        )
    return {key: sorted(some, key=lambda each: (DYNAMICS.index(each[0]), each[1])) for key, some in sorted(found.items())}


def read(key: int, some: list[File]) -> list[Take]:
    """The takes of a note. Raises ValueError for a file that is none, FitRefused for one without a note, both naming it."""
    takes = []
    for dynamic, number, path in some:
        samples, rate = read_recording(str(path))
        try:
            takes.append(Take(key, dynamic, number, path, cut_note(samples, rate)))
        except FitRefused as error:
            raise FitRefused(f"{path}: {error}") from None
    return takes
