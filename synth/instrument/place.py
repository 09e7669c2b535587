"""Where a preset plays a note: string and fret, chosen as the engine does on a silent instrument."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from synth.instrument.boards import on_board
from synth.instrument.compile import (
    Position,
    make_string,
    note_frequency,
    obstacle_of,
    stopped,
    string_frequency,
    with_sawari,
)
from synth.instrument.neck import single_strings
from synth.instrument.preset import (
    BoardObstacle,
    Preset,
    PresetError,
    StringTable,
    fret_count,
    playable_range,
)
from synth.physics.modes import mode_shapes
from synth.physics.obstacle import Obstacle
from synth.physics.string import String
from synth.physics.tail import lumped_tail
from synth.physics.tuning import tuned
from synth.units import midi_to_note


@dataclass(frozen=True)
class NotePlace:
    """A note on a string. `preset` has that string only, whose table had number `index` and is now the first."""

    preset: Preset
    index: int
    opened: int
    fret: int

    @property
    def note(self) -> int:
        return self.opened + self.fret

    @property
    def table(self) -> StringTable:
        return self.preset.string[0]

    @property
    def label(self) -> str:
        """The string's name, or its open note's."""
        return self.table.name or midi_to_note(self.opened)

    @property
    def sounding_hz(self) -> float:
        """The pitch that the note should be heard at [Hz]."""
        return note_frequency(self.preset, self.table, self.note, None)

    def model_hz(self, fret: int) -> float:
        """The first mode that the string is tuned to at a fret [Hz]: the pitch less the contact's calibrated shift."""
        return string_frequency(self.preset, self.table, self.opened + fret)


@dataclass(frozen=True)
class Speaking:
    """The strings of a place. `below`: what lies under the open one, `reached` under the speaking one, each from its own
    nut end and line at rest."""

    opened: String
    string: String
    below: Obstacle
    reached: Obstacle


def open_string(place: NotePlace) -> tuple[String, Obstacle]:
    """The open string of a place and what lies below it. Raises ValueError for a string that cannot be tuned."""
    opened = make_string(place.preset, place.table, place.opened, place.model_hz(0))
    return opened, obstacle_of(place.preset, place.table, place.opened, opened.length_m)


def speaking(place: NotePlace) -> Speaking:
    """The speaking string of a place, as the engine's model of it. Raises ValueError where it cannot sound."""
    opened, below = open_string(place)
    below.check(opened.length_m)
    shape = place.preset.obstacle
    if isinstance(shape, BoardObstacle):
        return Speaking(opened, on_board(shape, opened, place.fret, place.model_hz(place.fret))[0], below, below)
    length, reached, _ = stopped(place.preset, place.fret, opened, below)
    if not place.fret:
        reached = with_sawari(place.preset, place.opened, reached)
    string = tuned(opened.with_length(length), place.model_hz(place.fret)) if place.fret else opened
    return Speaking(opened, string, below, reached)


def first_note(preset: Preset) -> int:
    """The note of a preset that is shown first: of the strings that sound what their key says and have most frets, the open
    one nearest to the middle, of two equally near the lower."""
    played = [table for table in preset.string if not table.sympathetic]
    own = [table for table in played if table.sounds is None] or played
    most = max(fret_count(preset, table) for table in own)
    opened = {
        note for table in own if fret_count(preset, table) == most for note in range(table.notes[0], table.notes[1] + 1)
    }
    middle = (min(opened) + max(opened)) / 2
    return min(opened, key=lambda note: (abs(note - middle), note))


def find(preset: Preset, note: int) -> NotePlace:
    """The place that the engine takes for the note on a silent instrument: the lowest fret, among equals the first string.

    An open string counts as the first fret. Raises PresetError where no string plays it.
    """
    frets = fret_count(preset)
    best: NotePlace | None = None
    for index, opened, alone in single_strings(preset, {note}):
        place = NotePlace(alone, index, opened, note - opened)
        if best is None or (frets and max(1, place.fret) < max(1, best.fret)):
            best = place
    if best is None:
        low, high = playable_range(preset)
        raise PresetError(
            f"{preset.name}: no string plays {midi_to_note(note)}; its notes lie in {midi_to_note(low)}-{midi_to_note(high)}"
        )
    return best


def shapes_at(scene: Speaking, position: Position, x: np.ndarray) -> np.ndarray:
    """(M, N) what each mode of the position, the lumped ones too, is at places x."""
    own = position.own
    if position.omega.size == own:
        return mode_shapes(position.length_m, x, own)
    tail = lumped_tail(scene.string, scene.reached.positions_m, own, position.plan.rate_hz)
    shapes = mode_shapes(position.length_m, x, tail.modes)
    return np.hstack([shapes[:, :own], tail.weights(shapes)])
