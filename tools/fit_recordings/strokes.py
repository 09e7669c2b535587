"""The forward model: strokes of one note of a fretted preset at any level, through the engine, as a musician plays it.

A stroke's strength is told by its level: so many decibels below the loudest of those that are fitted. How loud the preset's
hardest stroke would be beside that one is unknown (`top_db`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.engine.parameters import INDEX_OF
from synth.fit.contact_space import Unknown
from synth.fit.fret_features import SECONDS
from synth.fit.fret_model import FretModel, engine_for, stroke_sound, with_action, with_losses
from synth.instrument.preset import Preset, at_note
from synth.midi.events import NOTE_ON, PARAMETER

Real = NDArray[np.float64]
#: at least that soft, and `pluck.amount` goes no further than twice the hardest stroke
_SOFTEST, _MOST_AMOUNT = 1.0, 2.0
#: how much louder the preset's hardest stroke is than the loudest that is fitted [dB]
TOP = Unknown("top_db", -6.0, 18.0)


@dataclass(frozen=True)
class Sounded:
    """A preset of one string and its note, ready to be changed. unknowns: what a fit searches for, without `top_db`."""

    preset: Preset
    note: int
    model: FretModel

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Place, slip and width of soft strokes and how much less of them hard ones have, draw, losses and action."""
        draw = at_note(self.preset.pluck.draw_ms, self.note)
        action = self.model.action_mm
        return (
            Unknown("position", 0.04, 0.5),
            Unknown("slip_ms", 0.1, 12.0, True),
            Unknown("slip_hard_ratio", 0.05, 1.0, True),
            Unknown("width_mm", 3.0, 40.0, True),
            Unknown("width_hard_ratio", 0.2, 1.0, True),
            Unknown("draw_ms", draw / 2.5, draw * 2.5, True),
            Unknown("losses", 0.5, 2.0, True),
            Unknown("action_mm", 0.3 * action, 3.0 * action, True),
        )

    def values(self) -> dict[str, float]:
        """What the preset has."""
        pluck, note = self.preset.pluck, self.note
        slip = at_note(pluck.slip_ms, note)
        return {
            "position": pluck.position,
            "slip_ms": slip,
            "slip_hard_ratio": at_note(pluck.hardest_slip_ms, note) / slip if slip > 0.0 else 1.0,
            "width_mm": pluck.width_mm,
            "width_hard_ratio": pluck.hardest_width_mm / pluck.width_mm,
            "draw_ms": at_note(pluck.draw_ms, note),
            "losses": 1.0,
            "action_mm": self.model.action_mm,
        }

    def changed(self, values: dict[str, float]) -> Preset:
        """The preset with other values. Raises PresetError, ValueError for what cannot be played."""
        own = dict(values)
        losses, action = own.pop("losses"), own.pop("action_mm")
        own["slip_hard_ms"] = own["slip_ms"] * own.pop("slip_hard_ratio")
        own["width_hard_mm"] = own["width_mm"] * own.pop("width_hard_ratio")
        pluck = self.preset.pluck.model_copy(update={**own, "position_hard": None})
        preset = with_action(self.preset, action) if action != self.model.action_mm else self.preset
        changed: dict[str, Any] = {"pluck": pluck, **with_losses(preset, losses)}
        return preset.model_copy(update=changed)


def sounded(preset: Preset, note: int, hz: float) -> Sounded:
    """The note of a preset on its highest string that has it, tuned to hz. Raises ValueError where no string reaches it."""
    strings = [i for i, table in enumerate(preset.string) if table.notes[0] <= note and not table.sympathetic]
    if not strings:
        raise ValueError(f"no open string of {preset.name} is as low as note {note}; tune them lower with --open")
    index = max(strings, key=lambda i: preset.string[i].notes[0])
    fret = note - preset.string[index].notes[0]
    plain = FretModel(preset, index, fret)
    beside = 1200.0 * math.log2(hz / plain.string.fundamental_hz)
    model = FretModel(preset, index, fret, beside)
    return Sounded(model.preset, model.note, model)


class Player:
    """A changed preset, ready to play strokes by their level."""

    def __init__(self, sounded: Sounded, values: dict[str, float] | None) -> None:
        preset = sounded.preset if values is None else sounded.changed(values)
        self._note, self._exponent = sounded.note, preset.pluck.velocity_exponent
        self._draw_s = 1e-3 * at_note(preset.pluck.draw_ms, sounded.note)
        self._engine = engine_for(preset, sounded.note, "standard")

    def stroke(self, level_db: float, seconds: float = SECONDS + 0.05) -> Real:
        """(n,) of a stroke so far beside the hardest, from the moment that the finger lets go."""
        amplitude = 10.0 ** (level_db / 20.0)
        strength = amplitude ** (1.0 / self._exponent) if self._exponent > 0.0 else 1.0
        velocity = min(127.0, max(_SOFTEST, round(127.0 * strength)))
        amount = min(_MOST_AMOUNT, amplitude / (velocity / 127.0) ** self._exponent)
        return stroke_sound(self._engine, [
            (0, PARAMETER, 0, INDEX_OF["pluck.amount"], 0, amount), (0, NOTE_ON, 0, self._note, int(velocity))
        ], self._draw_s, seconds)  # fmt: skip
