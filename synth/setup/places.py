"""The notes of an instrument, string by string and fret by fret, and what lies below each."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from synth.instrument.boards import fingerboard_of
from synth.instrument.compile import (
    CompiledString,
    Position,
    compile_string,
    obstacle_of,
    open_string,
    stopped,
    string_notes,
    string_places,
    with_sawari,
)
from synth.instrument.neck import obstacle_under
from synth.instrument.preset import (
    BoardObstacle,
    BridgeObstacle,
    FretsObstacle,
    NoObstacle,
    Preset,
    PresetError,
    StringTable,
)
from synth.physics.obstacle import beyond_fret
from synth.physics.string import String
from synth.spelling import perhaps
from synth.units import midi_to_note

#: places along the speaking string at which a board's height counts
BOARD_PLACES = 256
#: how far below a string frets lie that it never reaches [mm]
OUT_OF_REACH_MM = 150.0


@dataclass(frozen=True)
class FretPlace:
    """A string of a preset at a fret; 0: open.

    index   of its table in the preset
    opened  MIDI note of the open string
    string  its name, or its open note's
    """

    index: int
    opened: int
    fret: int
    string: str

    @property
    def note(self) -> int:
        """MIDI note of the key."""
        return self.opened + self.fret

    def table(self, preset: Preset) -> StringTable:
        """Its string's table."""
        return preset.string[self.index]


@dataclass(frozen=True)
class Below:
    """What lies below a note.

    heights_m    (C,) over the string at rest, stopped where it is
    distances_m  (C,) from the saddle
    names        (C,) what each contact is called: "fret 5"
    preset       which they are of
    """

    heights_m: np.ndarray
    distances_m: np.ndarray
    names: tuple[str, ...]
    preset: Preset

    def clearance_m(self, speaking_m: float, finger_m: float = 0.0, displacement_m: float = 0.0) -> np.ndarray:
        """(C,) clearance under a string of a speaking length that a finger holds still, its distance from the saddle
        `finger_m`, drawn to a displacement from the board (towards it: negative): two straight lines from the finger to the
        ends, as a string without stiffness lies. Without a finger that of the string at rest."""
        if displacement_m == 0.0:
            return -self.heights_m
        shape = np.where(
            self.distances_m <= finger_m,
            self.distances_m / finger_m,
            (speaking_m - self.distances_m) / (speaking_m - finger_m),
        )
        return displacement_m * shape - self.heights_m


def check_touches(preset: Preset) -> None:
    """Raises PresetError where strings of a preset touch nothing."""
    if isinstance(preset.obstacle, NoObstacle):
        raise PresetError(
            f"{preset.name}: obstacle.kind is none, so that nothing can buzz; take a preset with frets, a bridge or a board"
        )


def places_of(preset: Preset, strings: Sequence[str] | None = None, frets: Collection[int] | None = None) -> list[FretPlace]:
    """Every note of a preset's strings that a key plays, string after string.

    strings: names of those that are wanted, as the table or the open note has them. frets: the wanted ones. Raises
    PresetError for a name or a fret that none has.
    """
    found = [
        FretPlace(index, note, fret, table.name or midi_to_note(note))
        for index, table in enumerate(preset.string)
        if not table.sympathetic
        for note in string_notes(table)
        for fret in range(string_places(preset, table, note))
    ]
    if strings is not None:
        names = _names(found)
        for wanted in strings:
            if wanted not in names:
                raise PresetError(
                    f"{preset.name}: no string is called {wanted!r}{perhaps(wanted, names)}; its strings are "
                    f"{', '.join(dict.fromkeys(each.string for each in found))}"
                )
        found = [each for each in found if each.string in strings or midi_to_note(each.opened) in strings]
    if frets is not None:
        found = [each for each in found if each.fret in frets]
        if not found:
            raise PresetError(f"{preset.name}: no string has one of the frets {min(frets)} to {max(frets)}; take lower ones")
    return found


def string_names(preset: Preset) -> list[str]:
    """What the strings that keys play may be called: their names, and their open notes."""
    return _names(places_of(preset))


def _names(places: Sequence[FretPlace]) -> list[str]:
    return list(dict.fromkeys(name for each in places for name in (each.string, midi_to_note(each.opened))))


def compiled(preset: Preset, place: FretPlace, quality: str, rate_hz: float = 44100.0) -> tuple[CompiledString, Position]:
    """A place's string and its model, on ends at rest. Where a fret presses the string, its frets are compiled out of its
    reach. Raises PresetError."""
    alone = preset.on_rigid_ends
    table = place.table(alone)

    def made(of: Preset) -> CompiledString:
        return compile_string(of, table, place.opened, quality=quality, rate_hz=rate_hz, only_notes={place.note})

    try:
        string = made(alone)
    except PresetError:
        if not isinstance(alone.obstacle, FretsObstacle):
            raise
        setup = None if alone.setup is None else alone.setup.model_copy(update={"action_bass_mm": None})
        string = made(alone.model_copy(update={"obstacle": _out_of_reach(alone.obstacle), "setup": setup}))
    return string, string.positions[0]


def _out_of_reach(shape: FretsObstacle) -> FretsObstacle:
    heights = (-OUT_OF_REACH_MM,) * shape.count
    changed = {"heights_mm": heights, "action_12th_mm": None, "relief_mm": 0.0, "nut_height_mm": 0.4}
    return shape.model_copy(update=changed)


def opened_string(preset: Preset, place: FretPlace) -> String:
    """The open string of a place, on ends at rest."""
    alone = preset.on_rigid_ends
    return open_string(alone, place.table(alone), place.opened)[0]


def below(preset: Preset, place: FretPlace, opened: String, speaking_m: float) -> Below:
    """What lies below the string of a place, `opened` its open string [m] and `speaking_m` its length there. A height ≥ 0
    presses the string. Raises PresetError where the geometry is none."""
    table = place.table(preset)
    shape = obstacle_under(preset, table, place.opened)
    if isinstance(shape, BoardObstacle):
        board = fingerboard_of(shape, opened.length_m)
        rows = board.heights(opened.length_m, speaking_m, BOARD_PLACES)
        names = tuple(f"board at {1e3 * x:.0f} mm" for x, _ in rows)
        distances = opened.length_m - np.array([x for x, _ in rows])
        return Below(np.array([height for _, height in rows]), distances, names, preset)
    try:
        whole = obstacle_of(preset, table, place.opened, opened.length_m)
        if isinstance(shape, FretsObstacle):
            speaking, x, heights = beyond_fret(whole, place.fret, opened.length_m)
            names = tuple(f"fret {place.fret + 1 + i}" for i in range(heights.size))
            if not place.fret:
                left = with_sawari(preset, place.opened, whole)
                names = (*["sawari"] * (len(left) - heights.size), *names)
                x, heights = np.array(left.positions_m), np.array(left.heights_m)
            return Below(heights, speaking - x, names, preset)
        speaking, left, _ = stopped(preset, place.fret, opened, whole)
    except ValueError as error:
        raise PresetError(f"{preset.name}: string {place.string}: {error}") from None
    count = len(left)
    if isinstance(shape, BridgeObstacle):
        names = ("bridge",) if count == 1 else tuple(f"bridge point {count - i}" for i in range(count))
    else:
        names = tuple(f"point {i + 1}" for i in range(count))
    return Below(np.array(left.heights_m), speaking - np.array(left.positions_m), names, preset)
