"""Whether every string of a preset can sound at every place it is played at: what validation by fields cannot see.

A preset whose fields are all in their ranges may still ask for a fret above the string, a bridge beyond its end, or a pitch
that no tension gives. All of these are found here, in the words of the file and all at once, without the engine: only
the physics of each place is made.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

import numpy as np

from synth.instrument.compile import (
    compile_position,
    obstacle_of,
    open_string,
    output_weights,
    speaking_string,
    string_kind,
    string_notes,
    string_places,
)
from synth.instrument.neck import strung
from synth.instrument.plan import plan_string
from synth.instrument.preset import (
    BridgeObstacle,
    FretsObstacle,
    PointsObstacle,
    Preset,
    PresetError,
    StringTable,
    at_note,
    in_file_words,
)
from synth.instrument.setup_table import Setup
from synth.physics.modes import decay_rates, modal_frequencies
from synth.physics.obstacle import Obstacle, fretted
from synth.physics.string import String
from synth.units import midi_to_note

#: what a place is tried at; what a string cannot do at one rate it cannot do at another
QUALITY, RATE_HZ = "standard", 44100.0
_NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")


def check(preset: Preset, origin: str, *, everywhere: bool = True) -> Preset:
    """The preset itself. Raises PresetError, with `origin` in front, naming all that cannot sound; see `problems`."""
    found = problems(preset, everywhere=everywhere)
    if found:
        raise PresetError("\n".join(f"{origin}: {path}: {what}" for path, what in found), found)
    return preset


def problems(preset: Preset, *, everywhere: bool = True) -> list[tuple[str, str]]:
    """(path of the key to blame, what is wrong and where) of all that keeps a string from sounding; alike ones are one.

    everywhere: at every note and fret; else at the ends of every string table and neck, and of the frets between whether
    they leave a string room, which takes a few milliseconds.
    """
    first: dict[tuple[str, str], str] = {}
    more: dict[tuple[str, str], int] = {}
    with np.errstate(all="ignore"):
        for path, what, place in _found(preset, everywhere):
            key = path, _NUMBER.sub("#", what)
            if key in first:
                more[key] += 1
            else:
                first[key], more[key] = f"{place}: {what}", 0
    return [(path, text + _others(more[path, kind])) for (path, kind), text in first.items()]


def _others(count: int) -> str:
    return f" (and at {count} other place{'s' if count > 1 else ''})" if count else ""


def _found(preset: Preset, everywhere: bool) -> Iterator[tuple[str, str, str]]:
    """(path, what is wrong, at which string and note) of every place, alike ones too."""
    for number, table in enumerate(preset.string):
        notes = string_notes(table)
        for note in notes if everywhere else sorted({notes[0], notes[-1]}):
            place = f"string {table.name or number} at {midi_to_note(note)}"
            wrong = list(_wrong_numbers(preset, number, table, note))
            if wrong:
                yield from ((path, what, place) for path, what in wrong)
                continue
            frets = range(string_places(preset, table, note))
            looked_at = frets if everywhere else sorted({0, min(1, frets[-1]), frets[-1]})
            try:
                opened, below = open_string(preset, table, note)
            except (ValueError, ArithmeticError) as error:
                yield *_blamed(number, table, error), place
                yield from _in_the_way(preset, number, table, note, looked_at, place)
                continue
            for fret in looked_at:
                where = f"{place}, fret {fret}" if fret else place
                try:
                    string, obstacle, height = speaking_string(preset, table, note, fret, opened, below)
                    _try(preset, table, note, fret, opened, below, string, obstacle, height)
                except (ValueError, ArithmeticError) as error:
                    yield *_blamed(number, table, error, preset), where
            yield from _in_the_way(preset, number, table, note, [fret for fret in frets if fret not in looked_at], place)


def _in_the_way(
    preset: Preset, number: int, table: StringTable, note: int, frets: Iterable[int], place: str
) -> Iterator[tuple[str, str, str]]:
    """As `_found`, of the neck alone: where the string itself cannot be made or is not."""
    if not isinstance(preset.obstacle, FretsObstacle):
        return
    length = at_note(table.length_m, note)
    for fret in frets:
        try:
            fretted(obstacle_of(preset, table, note, length), fret, length)
        except ValueError as error:
            yield *_blamed(number, table, error, preset), f"{place}, fret {fret}" if fret else place


def _wrong_numbers(preset: Preset, number: int, table: StringTable, note: int) -> Iterator[tuple[str, str]]:
    """(path, what is wrong) of what two keys of the file say against each other at a note."""
    table = strung(preset, table, note)
    diameter = at_note(table.diameter_mm, note)
    if table.core_diameter_mm is not None:
        core = at_note(table.core_diameter_mm, note)
        if core >= diameter:
            yield (
                f"string.{number}.core_diameter_mm",
                f"must be less than diameter_mm, the outer one, which is {diameter:g} mm, got {core:g} mm",
            )
    length_mm = 1e3 * at_note(table.length_m, note)
    shape = preset.obstacle
    if isinstance(shape, BridgeObstacle) and shape.distance_mm is not None:
        distance = at_note(shape.distance_mm, note)
        if distance >= length_mm:
            yield (
                "obstacle.distance_mm",
                f"must be less than the string's length of {length_mm:g} mm, got {distance:g} mm; count it from the saddle",
            )
    if isinstance(shape, PointsObstacle) and shape.positions_mm[-1] >= length_mm:
        beyond = next(i for i, x in enumerate(shape.positions_mm, start=1) if x >= length_mm)
        yield (
            "obstacle.positions_mm",
            f"point {beyond} must be less than the string's length of {length_mm:g} mm from the nut, "
            f"got {shape.positions_mm[beyond - 1]:g} mm; remove the point or lengthen the string",
        )


def _blamed(number: int, table: StringTable, error: Exception, preset: Preset | None = None) -> tuple[str, str]:
    """(path, what is wrong) of what the physics refused."""
    if not isinstance(error, ValueError):
        return f"string.{number}", "numbers too large or too small to compute with; check the units"
    text = in_file_words(str(error), table)
    if text.startswith(("pluck.", "output.", "obstacle.")):
        return text.split()[0], text
    if "nut" in text and "mass_kg" in text:
        return "nut", text
    if "bending stiffness" in text:
        return f"string.{number}.{'youngs_modulus_gpa' if table.inharmonicity is None else 'inharmonicity'}", text
    setup = preset.setup if preset is not None else None
    neck_by_setup = setup is not None and setup.shapes_the_neck
    if text.startswith("board"):
        return ("setup.action_bass_mm" if neck_by_setup and "string at rest" in text else "obstacle"), text
    for key in StringTable.model_fields:
        if text.startswith(key):
            return f"string.{number}.{key}", text
    if setup is not None and neck_by_setup and text.startswith("fret"):
        return _of_setup(setup), f"{text}; or change {_NECK_OF_SETUP}"
    if preset is not None and isinstance(preset.obstacle, FretsObstacle) and text.startswith("fret"):
        return ("obstacle.heights_mm" if preset.obstacle.heights_mm else "obstacle.action_12th_mm"), text
    return f"string.{number}", text


#: what a fret's height is made of
_NECK_OF_SETUP = "action, relief or nut of [setup]"


def _of_setup(setup: Setup) -> str:
    """The key to blame for a fret in the way: the heights of single frets, where they are given, else a hump, else the
    action."""
    if setup.fret_heights_mm:
        return "setup.fret_heights_mm"
    return "setup.relief_mm" if setup.relief_mm < 0.0 else "setup.action_bass_mm"


def _try(
    preset: Preset,
    table: StringTable,
    note: int,
    fret: int,
    opened: String,
    below: Obstacle,
    string: String,
    obstacle: Obstacle,
    height: float,
) -> None:
    """Raises ValueError where the modes of a place are none that sound."""
    frequency = opened.fundamental_hz
    kind = string_kind(preset, opened, below)
    plan = plan_string(string, frequency, len(obstacle), kind, quality=QUALITY, rate_hz=RATE_HZ)
    omega, sigma = modal_frequencies(string, plan.modes), decay_rates(string, plan.modes)
    weights = output_weights(preset, string, opened.length_m, plan.modes)
    if not all(np.isfinite(each).all() for each in (omega, sigma, *weights)):
        raise ValueError("frequencies, losses or levels of its modes are not finite; check the units of its numbers")
    if len(obstacle) and max(obstacle.heights_m) > 0.0:
        # contacts that press: their static problem needs the whole model
        compile_position(
            preset,
            string,
            obstacle,
            plan,
            note=note + fret,
            fret=fret,
            open_length_m=opened.length_m,
            rest_height_m=height,
        )
