"""What is played to hear a preset: always the same events for the same preset, note and velocity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from synth.author.figures import figure_of, key_of
from synth.instrument.compile import string_notes
from synth.instrument.preset import Preset, playable_notes
from synth.midi.events import NOTE_OFF, NOTE_ON, make_events
from synth.units import midi_to_note

NAMES = ("note", "drone", "riff", "scale")
#: how long a note is held; what lies between a drone's strings, a figure's beats and the scale's steps
NOTE_S, DRONE_S, BEAT_S, STEP_S = 2.0, 1.0, 0.5, 0.35
#: what is heard behind the last event: of strings that are damped, and of those that ring on [s]
TAIL_S, RING_S = 1.0, 6.0
#: share of its time that a figure's note is held
HELD = 0.8
#: semitones above the note: of a drone where the strings do not say, and a major scale up and down
DRONE = (7, 12, 12, 0)
SCALE = (0, 2, 4, 5, 7, 9, 11, 12, 11, 9, 7, 5, 4, 2, 0)


@dataclass(frozen=True)
class Phrase:
    """events: EVENT, ascending; notes: all that occur; length_s: to the end of what is to be heard."""

    events: np.ndarray
    notes: frozenset[int]
    length_s: float


def phrase(name: str, preset: Preset, note: int, velocity: int, rate_hz: float) -> Phrase:
    """A phrase on a preset around a MIDI note. Raises ValueError."""
    if name not in NAMES:
        raise ValueError(f"phrase: must be one of {', '.join(NAMES)}, got {name!r}")
    if not 1 <= velocity <= 127:
        raise ValueError(f"velocity: must lie between 1 and 127, got {velocity}")
    there = playable_notes(preset)
    if note not in there:
        if not 0 <= note <= 127:
            raise ValueError(f"note: must lie between 0 and 127, got {note}")
        raise ValueError(
            f"note: no string of {preset.name} plays {midi_to_note(note)}; its notes lie in "
            f"{midi_to_note(there[0])}-{midi_to_note(there[-1])}"
        )
    steps = _STEPS[name](preset, note, there)
    rows: list[tuple[int, int, int, int, int]] = []
    for begin_s, held_s, key in steps:
        begin = round(begin_s * rate_hz)
        rows.append((begin, NOTE_ON, 0, key, velocity))
        rows.append((begin + round(held_s * rate_hz), NOTE_OFF, 0, key, 64))
    rows.sort(key=lambda row: (row[0], row[1] == NOTE_ON))
    end_s = max(begin_s + held_s for begin_s, held_s, _ in steps)
    tail_s = RING_S if preset.damping.ring_on else TAIL_S
    return Phrase(make_events(rows), frozenset(key for *_, key in steps), end_s + tail_s)


Steps = list[tuple[float, float, int]]  # begin [s], held for [s], key


def _note(_: Preset, note: int, __: Sequence[int]) -> Steps:
    return [(0.0, NOTE_S, note)]


def _drone(preset: Preset, note: int, there: Sequence[int]) -> Steps:
    """Two cycles of the open strings in the order of the file, where there are at most eight; else of notes like them."""
    opens = [key for table in preset.string if not table.sympathetic for key in string_notes(table)]
    keys = opens if len(opens) <= 8 else [_near(note + step, there) for step in DRONE]
    return [(number * DRONE_S, DRONE_S * min(len(keys), 3), key) for number, key in enumerate(2 * keys)]


def _riff(preset: Preset, note: int, there: Sequence[int]) -> Steps:
    """The figure of the preset's family; a tanpura's is its strings in turn."""
    if preset.family == "tanpura":
        return _drone(preset, note, there)
    figure = figure_of(preset)
    there = _as_written(preset, there)
    key = key_of(figure, note, there)
    steps: Steps = []
    begin_s = 0.0
    for beats, step in figure:
        steps.append((begin_s, HELD * beats * BEAT_S, min(there, key=lambda each: (abs(each - key - step), each))))
        begin_s += beats * BEAT_S
    return steps


def _as_written(preset: Preset, there: Sequence[int]) -> Sequence[int]:
    """The notes that sound where their keys lie: without the strings whose key stands for another pitch."""
    moved = {key for table in preset.string if table.sounds is not None for key in string_notes(table)}
    return [key for key in there if key not in moved] or there


def _scale(_: Preset, note: int, there: Sequence[int]) -> Steps:
    keys = [note + step for step in SCALE]
    if not set(keys) <= set(there):
        few = list(there) if len(there) <= len(SCALE) else [_near(key, there) for key in keys]
        keys = few + few[-2::-1] if len(there) <= len(SCALE) else few
    return [(number * STEP_S, 0.95 * STEP_S, key) for number, key in enumerate(keys)]


def _near(key: int, there: Sequence[int]) -> int:
    """A key that can be played: this, one an octave or more away, or else the nearest."""
    octaves = [each for each in there if (each - key) % 12 == 0]
    return min(octaves or there, key=lambda each: (abs(each - key), each))


_STEPS: dict[str, Callable[[Preset, int, Sequence[int]], Steps]] = {
    "note": _note,
    "drone": _drone,
    "riff": _riff,
    "scale": _scale,
}
