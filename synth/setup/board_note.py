"""A note over a board without frets: the engine plays it, since a board is in contact all along."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from synth.engine.engine import Engine
from synth.engine.parameters import INDEX_OF
from synth.engine.stroke import drawn_by
from synth.fit.fret_model import RATE_HZ, engine_for, stroke_sound
from synth.instrument.compile import CompiledString, Position, full_pluck_force, open_string
from synth.instrument.neck import alone, obstacle_under
from synth.instrument.planfile import MeasuredPlan
from synth.instrument.preset import BoardObstacle, Preset
from synth.midi.events import NOTE_ON, PARAMETER
from synth.physics.modes import mode_shapes
from synth.setup.audible import WINDOW_S, band_energies, buzz_db, fade
from synth.setup.note import SetupNote, StrokeContacts
from synth.setup.places import Below, FretPlace
from synth.setup.plucking import Stroke

#: the pluck that is played is so large [mm], and strokes are amounts of it
_FULL_MM = 20.0
#: the stroke over nothing, in parts of the one that just touches
_FREE = 0.5


class BoardNote(SetupNote):
    """A SetupNote over a board. Until it touches, the string swings freely as over frets; what follows the engine has."""

    def __init__(
        self,
        preset: Preset,
        place: FretPlace,
        string: CompiledString,
        position: Position,
        stroke: Stroke,
        quality: str,
        under: Below,
    ) -> None:
        self._preset, self._place, self._string, self._quality = preset, place, string, quality
        self._engines: dict[BoardObstacle, Engine] = {}
        super().__init__(
            position, stroke, speed=preset.output.kind in ("pickup", "velocity"),
            shapes=mode_shapes(position.length_m, position.length_m - under.distances_m, position.omega.size),
        )  # fmt: skip

    @cached_property
    def _amount(self) -> float:
        """Amount of the pluck of `_FULL_MM` per metre of displacement at this note."""
        table, opened = self._place.table(self._preset), self._place.opened
        full = full_pluck_force(
            self._played(_board(self._preset, self._place)), table, open_string(self._preset, table, opened)[0], opened
        )
        here = self.position
        return 1.0 / drawn_by(full, self.stroke.distance_m, here.length_m, here.tension_n)

    def _played(self, board: BoardObstacle) -> Preset:
        """The preset of this string alone, whose pluck is the stroke's, over a board."""
        place, stroke = self._place, self.stroke
        preset = alone(self._preset, place.table(self._preset), place.opened)
        (table,) = preset.string
        share = stroke.distance_m / self._string.open_length_m
        pluck = preset.pluck.model_copy(update={
            "displacement_mm": _FULL_MM, "velocity_exponent": 1.0, "position": share, "position_hard": None,
            "width_mm": 1e3 * stroke.width_m, "width_hard_mm": None, "draw_ms": 1e3 * stroke.draw_s,
            "slip_ms": 1e3 * stroke.slip_s, "slip_hard_ms": None, "roughness_um": 0.0,
        })  # fmt: skip
        kind = {"pickup": "velocity", "flux": "displacement"}.get(preset.output.kind, preset.output.kind)
        changed: dict[str, Any] = {
            "string": (table.model_copy(update={"notes": (place.opened, place.opened), "pluck_position": None}),),
            "pluck": pluck, "obstacle": board, "articulations": {}, "effect": (), "body": type(preset.body)(),
            "hand": preset.hand.varied(0.0).model_copy(update={"release": None}),
            "output": preset.output.model_copy(update={"kind": kind, "gain_db": 0.0}),
        }  # fmt: skip
        return preset.model_copy(update=changed).with_measured(MeasuredPlan())

    def _sound(self, displacement_m: float, board: BoardObstacle) -> np.ndarray:
        engine = self._engines.get(board)
        if engine is None:
            if len(self._engines) >= 2:
                self._engines.pop(next(iter(self._engines)))
            engine = self._engines[board] = engine_for(self._played(board), self._place.note, self._quality)
        events = [
            (0, PARAMETER, 0, INDEX_OF["pluck.amount"], 0, displacement_m * self._amount),
            (0, NOTE_ON, 0, self._place.note, 127),
        ]
        return stroke_sound(engine, events, 0.0, self.stroke.seconds + WINDOW_S)

    def _energies(self, displacement_m: float, board: BoardObstacle) -> tuple[np.ndarray, float]:
        y = self._sound(displacement_m, board)
        y = y * fade(y.size, round(self.stroke.seconds * RATE_HZ))
        return band_energies(y, float(RATE_HZ), self.pitch_hz, speed=False)

    def play(self, displacement_m: float, below: Below) -> StrokeContacts:
        """The stroke over the board of `below`. Impulses are not known."""
        board = _board(below.preset, self._place)
        gentle = _FREE * float(self.reach_m(below).min(initial=displacement_m))
        energies, _ = self._energies(displacement_m, board)
        free, whole = self._energies(gentle, board)
        square = (displacement_m / gentle) ** 2
        return StrokeContacts(buzz_db(energies, square * free, square * whole), np.zeros(below.heights_m.size))


def _board(preset: Preset, place: FretPlace) -> BoardObstacle:
    shape = obstacle_under(preset, place.table(preset), place.opened)
    assert isinstance(shape, BoardObstacle)
    return shape
