"""Random notes: a preset with frets, how it is set up, a string at a fret, a stroke."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from synth.instrument.preset import FretsObstacle, Preset, at_note, load_preset, preset_folder
from synth.setup.places import FretPlace, places_of

#: what luthiers set these up to [mm]: action at fret 12, relief, clearance over fret 1
_BASS = ((1.4, 3.0), (0.0, 0.5), (0.3, 0.9))
_ELECTRIC = ((1.0, 2.2), (0.0, 0.35), (0.25, 0.7))
_STEEL = ((1.5, 2.9), (0.05, 0.35), (0.3, 0.8))
SETUPS = {
    "fretted-bass": _BASS,
    "low-action-bass": _BASS,
    "picked-bass": _BASS,
    "roundwound-bass": _BASS,
    "electric-guitar": _ELECTRIC,
    "electric-guitar-neck": _ELECTRIC,
    "jazz-guitar": _ELECTRIC,
    "steel-guitar": _STEEL,
    "steel-guitar-picked": _STEEL,
    "nylon-guitar": ((2.4, 4.2), (0.05, 0.4), (0.5, 1.0)),
    "banjo": ((1.6, 3.2), (0.0, 0.25), (0.3, 0.8)),
    "ukulele": ((1.6, 3.0), (0.0, 0.2), (0.3, 0.8)),
}
#: how far below the string at rest every fret lies that it may meet [m]
CLEAR_M = 5e-5
#: MIDI velocities, and how often and where a stroke has a place of its own, as a share of the speaking length
VELOCITIES, OWN_PLACE, PLACES = (30, 127), 0.4, (0.06, 0.45)


@dataclass(frozen=True)
class Drawn:
    """A note to be looked at.

    setup_mm    action at fret 12, relief, clearance over fret 1; None: the preset's own heights
    place_m     of the stroke, from the saddle [m]; None: the preset's
    """

    preset: str
    index: int
    opened: int
    fret: int
    setup_mm: tuple[float, float, float] | None
    velocity: int
    place_m: float | None

    def loaded(self) -> Preset:
        """The preset, set up so, its strings even, as those of `simulate` are."""
        preset = load_preset(str(preset_folder() / f"{self.preset}.toml"))
        even = tuple(table.model_copy(update={"unevenness_cents": 0.0}) for table in preset.string)
        preset = preset.model_copy(update={"string": even})
        shape = preset.obstacle
        assert isinstance(shape, FretsObstacle)
        if self.setup_mm is None:
            return preset
        action, relief, nut = self.setup_mm
        changed = {"action_12th_mm": action, "relief_mm": relief, "nut_height_mm": nut, "heights_mm": ()}
        return preset.model_copy(update={"obstacle": shape.model_copy(update=changed)})

    def place(self, preset: Preset) -> FretPlace:
        """The map's place of it."""
        return next(
            each
            for each in places_of(preset)
            if (each.index, each.opened, each.fret) == (self.index, self.opened, self.fret)
        )

    @property
    def words(self) -> tuple[str, str]:
        """The setup and the stroke, as a row has them."""
        setup = "as it is" if self.setup_mm is None else "/".join(f"{each:.2f}" for each in self.setup_mm)
        where = "" if self.place_m is None else f" at {1e3 * self.place_m:.0f} mm"
        return setup, f"{self.velocity}{where}"


def frets_beyond(preset: Preset, fret: int, length_m: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Speaking length of an open length stopped at a fret, places of the frets beyond it from there, and heights over the
    string at rest [m]: a straight neck through the clearances at frets 1 and 12, hollowed by a parabola."""
    shape = preset.obstacle
    assert isinstance(shape, FretsObstacle)
    x = np.array([length_m - length_m / 2.0 ** (n / 12.0) for n in range(1, shape.count + 1)])
    if shape.heights_mm:
        below = -1e-3 * np.array(shape.heights_mm)
    else:
        assert shape.action_12th_mm is not None
        middle, half = 0.5 * (x[0] + x[-1]), 0.5 * (x[-1] - x[0])
        hollow = shape.relief_mm * (1.0 - ((x - middle) / half) ** 2)
        first, twelfth = shape.nut_height_mm - hollow[0], shape.action_12th_mm - hollow[11]
        below = 1e-3 * (first + (twelfth - first) * (x - x[0]) / (x[11] - x[0]) + hollow)
    if not fret:
        return length_m, x, -below
    behind, depth = x[fret - 1], below[fret - 1]
    left = length_m - behind
    line = depth * (length_m - x[fret:]) / left
    return left, x[fret:] - behind, line - below[fret:]


def drawn(seed: int, number: int) -> Drawn:
    """Case `number` of a seed."""
    random = np.random.default_rng([seed, number])
    while True:
        name = str(random.choice(list(SETUPS)))
        ranges = SETUPS[name]
        own = random.random() < 0.2
        setup = None if own else (_within(random, ranges[0]), _within(random, ranges[1]), _within(random, ranges[2]))
        velocity = int(random.integers(VELOCITIES[0], VELOCITIES[1] + 1))
        preset = load_preset(str(preset_folder() / f"{name}.toml"))
        assert isinstance(preset.obstacle, FretsObstacle)
        there = [each for each in places_of(preset) if each.fret < preset.obstacle.count]
        place = there[int(random.integers(len(there)))]
        share = float(random.uniform(*PLACES)) if random.random() < OWN_PLACE else None
        found = Drawn(name, place.index, place.opened, place.fret, setup, velocity, None)
        length = at_note(place.table(preset).length_m, place.opened)
        speaking, _, heights = frets_beyond(found.loaded(), place.fret, length)
        if heights.max() < -CLEAR_M:
            where = None if share is None else round(share * speaking, 4)
            return Drawn(name, place.index, place.opened, place.fret, setup, velocity, where)


def _within(random: np.random.Generator, ends: tuple[float, float]) -> float:
    return round(float(random.uniform(*ends)), 2)
