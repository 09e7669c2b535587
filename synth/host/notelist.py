"""A phrase written as a list of notes: the events of a song, and which preset plays which channel.

Notes follow one another unless they say when they begin. Notes of one preset share its strings, as on the instrument;
another preset, or another articulation of the same, is a part of its own on a channel of its own.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from synth.engine.numbers import a_number
from synth.host.batch import Note, played_as, what_is_wrong
from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON, make_events
from synth.midi.song import PERCUSSION_CHANNEL, Song, song_of

if TYPE_CHECKING:
    from synth.instrument.preset import Preset

#: latest start of a note [s]
LATEST_S = 24 * 3600.0
_OFF_VELOCITY = 64
_CHANNELS = tuple(channel for channel in range(16) if channel != PERCUSSION_CHANNEL)


@dataclass(frozen=True)
class NoteList:
    """events: an EVENT array.  length_s: until the last note's end.  voices: channel 0 … 15 → (preset, articulation)."""

    events: np.ndarray
    length_s: float
    voices: dict[int, tuple[str | os.PathLike[str] | Preset | None, str]]

    def song(self, rate_hz: int, mpe: bool = False) -> Song:
        """The song of its events."""
        return song_of(self.events, rate_hz, self.length_s, mpe)


def is_phrase(source: Any) -> bool:
    """Whether this is a note, or a list of what are meant for notes and not for mido's messages."""
    if isinstance(source, Note):
        return True
    return isinstance(source, list | tuple) and bool(source) and not hasattr(source[0], "bytes")


def phrase_of(notes: Note | Sequence[Any], rate_hz: int) -> NoteList:
    """The phrase of notes: `Note`s or (note, velocity), (note, velocity, seconds), (note, velocity, seconds, start_s).

    A note without a start begins where the one before ends, `seconds` after its own start; its key is let go there, or at
    `off_s`, or where the same key is struck again. Raises TypeError, ValueError, which say of which note.
    """
    timed = _timed([notes] if isinstance(notes, Note) else notes)
    channels: dict[tuple[Any, str], int] = {}
    voices: dict[int, tuple[str | os.PathLike[str] | Preset | None, str]] = {}
    struck: dict[tuple[int, int], list[int]] = {}
    placed = []
    for number, (start_s, note) in enumerate(timed):
        named = os.fspath(note.preset) if isinstance(note.preset, os.PathLike) else note.preset
        voice = named if isinstance(named, str | None) else id(named), note.articulation
        if voice not in channels:
            if len(channels) == len(_CHANNELS):
                raise ValueError(
                    f"notes[{number}]: a phrase has at most {len(_CHANNELS)} presets and articulations; render it in parts"
                )
            channels[voice] = _CHANNELS[len(channels)]
            voices[channels[voice]] = note.preset, note.articulation
        on = round(start_s * rate_hz)
        struck.setdefault((channels[voice], note.note), []).append(on)
        placed.append((on, start_s, note, channels[voice]))
    rows: list[tuple[int, int, tuple[int, ...]]] = []  # by frame, and within one: keys let go, controllers, keys struck
    for on, start_s, note, channel in placed:
        off = round((start_s + (note.seconds if note.off_s is None else note.off_s)) * rate_hz)
        off = min([max(off, on + 1), *(each for each in struck[channel, note.note] if each > on)])
        rows += [(on, 1, (on, CONTROL, channel, *each)) for each in note.controllers]
        rows += [(on, 2, (on, NOTE_ON, channel, note.note, note.velocity))]
        rows += [(off, 0, (off, NOTE_OFF, channel, note.note, _OFF_VELOCITY))]
    rows.sort(key=lambda each: each[:2])
    return NoteList(make_events([row for _, _, row in rows]), max(start_s + note.seconds for start_s, note in timed), voices)


def _timed(notes: Sequence[Any]) -> list[tuple[float, Note]]:
    """(start [s], note) of each."""
    found: list[tuple[float, Note]] = []
    for number, given in enumerate(notes):
        note = _as_note(number, given)
        wrong = what_is_wrong(note)
        if wrong:
            raise ValueError(f"notes[{number}]: {wrong}")
        start_s = found[-1][0] + found[-1][1].seconds if found else 0.0
        if note.start_s is not None:
            start_s = a_number(f"notes[{number}]: start_s", note.start_s, 0.0, LATEST_S, " s")
        elif start_s > LATEST_S:
            raise ValueError(f"notes[{number}] begins after {LATEST_S / 3600.0:g} h; render the phrase in parts")
        found.append((start_s, note))
    return found


def _as_note(number: int, given: Any) -> Note:
    if isinstance(given, Note):
        return given
    if isinstance(given, tuple | list) and 2 <= len(given) <= 4:
        note = Note(*given[:3])
        return note if len(given) < 4 else replace(note, start_s=given[3])
    raise TypeError(
        f"notes[{number}] must be a Note, (note, velocity), (note, velocity, seconds) or "
        f"(note, velocity, seconds, start_s), got {given!r:.60}"
    )


def as_played(preset: Preset, articulation: str) -> Preset:
    """The preset that sounds as this articulation does. Raises ValueError where it has none of that name."""
    found = played_as(preset, articulation, 0)
    if isinstance(found, str):
        raise ValueError(found)
    return found[1]
