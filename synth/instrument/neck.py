"""What [setup] makes of a preset's neck and strings: the obstacle under one string, and that string's wire.

    shape = obstacle_under(preset, table, note)       # an obstacle as without [setup], of this string
    string = strung(preset, table, note)              # its table, with the named wire's numbers
    single = alone(preset, table, note)               # a preset of this string only, which needs no [setup]

Strings of the neck are those that are played and have frets under them. They stand in the order of their open pitch, the
lowest at the bass side, and as far from each other at the nut, and at the saddle; the others lie as the lowest one does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from synth.instrument.preset import BoardObstacle, FretsObstacle, Obstacle, Preset, StringTable, at_note, fret_count
from synth.instrument.setup_table import Setup
from synth.instrument.wires import Wire, wire
from synth.physics.obstacle import arched, frets

#: core of a wound string, of its diameter, where nothing tells it (an estimate)
CORE_SHARE = 0.4


@dataclass(frozen=True)
class _Lie:
    """Where a string lies over a neck, share: from the bass side (0) to the treble side (1); clearances in mm."""

    setup: Setup
    share: float

    def _between(self, ends: tuple[float, float]) -> float:
        return ends[0] + self.share * (ends[1] - ends[0])

    @property
    def action_mm(self) -> float:
        return self._between(self.setup.actions_mm)

    @property
    def nut_mm(self) -> float:
        return self._between(self.setup.nuts_mm)

    def arch_mm(self, shares: np.ndarray) -> np.ndarray:
        """What board and saddle, which are round, add to the clearances at shares of the length."""
        setup = self.setup
        radii = tuple(None if each is None else 1e-3 * each for each in (setup.board_radius_mm, setup.top_radius_mm))
        spreads = 1e-3 * setup.nut_spread_mm, 1e-3 * setup.saddle_spread_mm
        return 1e3 * arched(shares, 2.0 * self.share - 1.0, spreads, (radii[0], radii[1]))


def obstacle_under(preset: Preset, table: StringTable, note: int) -> Obstacle:
    """The obstacle of a preset as it lies under a table's string at one of its notes: with the numbers of [setup] in the
    keys that it would have without. Raises ValueError for frets that cannot be."""
    setup, shape = preset.setup, preset.obstacle
    if setup is None or not setup.shapes_the_neck:
        return shape
    lie = _Lie(setup, _share(preset, table, note))
    if isinstance(shape, BoardObstacle):
        half = float(lie.arch_mm(np.array([0.5]))[0])
        numbers: dict[str, Any] = {"action_12th_mm": lie.action_mm + half, "nut_height_mm": lie.nut_mm}
        return shape.model_copy(update={**numbers, "relief_mm": setup.relief_mm})
    assert isinstance(shape, FretsObstacle)
    length = at_note(table.length_m, note)
    line = frets(
        length,
        shape.count,
        1e-3 * lie.action_mm,
        1e-3 * setup.relief_mm,
        1e-3 * lie.nut_mm,
        backbow=True,
        fall_away_m=1e-3 * setup.fall_away_mm,
        fall_away_fret=setup.fall_away_fret,
        crowns_m=[1e-3 * each for each in setup.fret_heights_mm],
    )
    heights = 1e3 * np.array(line.heights_m) - lie.arch_mm(np.array(line.positions_m) / length)
    return shape.model_copy(update={"heights_mm": tuple(heights.tolist())})


def strung(preset: Preset, table: StringTable, note: int) -> StringTable:
    """The table of a string at one of its notes with the wire that [setup] names for it, or the table itself.

    A wound string's core keeps its share of the diameter, or has CORE_SHARE of it where the table's string is plain.
    EA goes with the square of the diameter that bears the tension (core or plain string), an inharmonicity with its fourth
    power over the mass. Partials and decays that were measured of the table's string do not count.
    """
    if preset.setup is None or not preset.setup.strings or table.sympathetic:
        return table
    number = _rank(preset, table, note, lambda each: not each.sympathetic)
    named = wire(preset.setup.strings[number])
    diameter = 1e3 * named.diameter_m
    core = _core_mm(named, table, note)
    bearing = at_note(table.diameter_mm if table.core_diameter_mm is None else table.core_diameter_mm, note)
    thicker = (diameter if core is None else core) / bearing
    changed: dict[str, Any] = {
        "diameter_mm": diameter,
        "linear_density_g_m": 1e3 * named.linear_density_kg_m,
        "density_kg_m3": None,
        "core_diameter_mm": core,
        "winding_diameter_mm": None if core is None else 0.5 * (diameter - core),
        "measured_frequencies_hz": (),
        "measured_decay_rates": (),
    }
    if core is not None and table.winding_diameter_mm is not None:
        changed["winding_diameter_mm"] = (
            diameter * at_note(table.winding_diameter_mm, note) / at_note(table.diameter_mm, note)
        )
    if table.axial_stiffness_n is not None:
        changed["axial_stiffness_n"] = at_note(table.axial_stiffness_n, note) * thicker**2
    if table.inharmonicity is not None:
        heavier = named.linear_density_kg_m / linear_density(table, note)
        changed["inharmonicity"] = at_note(table.inharmonicity, note) * thicker**4 / heavier
    return table.model_copy(update=changed)


def linear_density(table: StringTable, note: int) -> float:
    """Mass per length of a table's string at one of its notes [kg/m]."""
    if table.linear_density_g_m is not None:
        return 1e-3 * at_note(table.linear_density_g_m, note)
    assert table.density_kg_m3 is not None
    return at_note(table.density_kg_m3, note) * math.pi * (1e-3 * at_note(table.diameter_mm, note)) ** 2 / 4.0


def _core_mm(named: Wire, table: StringTable, note: int) -> float | None:
    """The core of a wire that takes the place of a table's string; None of a plain one, and where an inharmonicity stands
    for it."""
    if not named.wound:
        return None
    if table.core_diameter_mm is not None:
        return 1e3 * named.diameter_m * at_note(table.core_diameter_mm, note) / at_note(table.diameter_mm, note)
    return CORE_SHARE * 1e3 * named.diameter_m if table.inharmonicity is None else None


def alone(preset: Preset, table: StringTable, note: int) -> Preset:
    """A preset with a table's string at one of its notes only, which has the wire and the obstacle that it has among the
    others."""
    if preset.setup is None:
        return preset.model_copy(update={"string": (table.model_copy(update={"notes": (note, note)}),)})
    single = strung(preset, table, note).model_copy(update={"notes": (note, note)})
    shape = obstacle_under(preset, table, note)
    return preset.model_copy(update={"string": (single,), "obstacle": shape, "setup": None})


def single_strings(preset: Preset, notes: set[int] | None = None) -> Iterator[tuple[int, int, Preset]]:
    """Every string of a preset that is played, alone: (index of its table, its open note, a preset with only that string).

    notes: only strings that can play one of these; None: all.
    """
    for index, table in enumerate(preset.string):
        if table.sympathetic:
            continue
        frets = fret_count(preset, table)
        for opened in range(table.notes[0], table.notes[1] + 1):
            if notes is None or any(opened <= note <= opened + frets for note in notes):
                yield index, opened, alone(preset, table, opened)


def _share(preset: Preset, table: StringTable, note: int) -> float:
    """The place of a string between the outer ones of the neck, from the bass side (0) to the treble side (1)."""

    def on_the_neck(each: StringTable) -> bool:
        return not each.sympathetic and fret_count(preset, each) > 0

    strings = sum(each.notes[1] - each.notes[0] + 1 for each in preset.string if on_the_neck(each))
    if strings < 2 or not on_the_neck(table):
        return 0.0
    return _rank(preset, table, note, on_the_neck) / (strings - 1)


def _rank(preset: Preset, table: StringTable, note: int, counts: Callable[[StringTable], bool]) -> int:
    """How many of the strings that count have a lower open pitch; of equal ones those that the file has before it."""
    tables = preset.string
    own = next((i for i, each in enumerate(tables) if each is table), None)
    if own is None:
        own = tables.index(table)
    mine = _pitch(table, note), own
    return sum(
        (_pitch(each, other), i) < mine
        for i, each in enumerate(tables)
        if counts(each)
        for other in range(each.notes[0], each.notes[1] + 1)
    )


def _pitch(table: StringTable, note: int) -> float:
    """Of an open string, as a note."""
    return note + (0 if table.sounds is None else table.sounds - table.notes[0]) + table.cents / 100.0
