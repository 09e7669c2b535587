"""What a string over frets sounds like for an action and a stroke: the forward model of the frets' fit.

It is the engine itself on a preset of that one string: both directions of its motion, its tension, pickup and body count as
the preset has them. What is taken out are effects, other articulations, and what varies from stroke to stroke.

The action is the height of the open string over the twelfth fret (the last one of a shorter neck). A preset with
`action_12th_mm` has it as a number of its own, and nut and relief stay; one with `heights_mm` is raised at the saddle, so
that each fret gets further from the string in proportion to its distance from the nut. With [setup] it is that of one
string, and the actions on both sides change by as much as it does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.engine.engine import Engine
from synth.engine.parameters import INDEX_OF
from synth.instrument.compile import obstacle_of, open_string, speaking_string
from synth.instrument.neck import alone, obstacle_under
from synth.instrument.planfile import MeasuredPlan
from synth.instrument.preset import FretsObstacle, Preset, PresetError, at_note, fret_count
from synth.midi.events import NOTE_ON, PARAMETER, make_events
from synth.physics.obstacle import fret_positions
from synth.physics.string import String

Real = NDArray[np.float64]
#: of what the model plays [Hz]
RATE_HZ = 44100
#: fret at which the action is told
TWELFTH = 12
#: the pluck of the preset that is played [mm]: amounts of it, up to twice, make all strokes
_FULL_MM = 20.0
_BLOCK = 16384
#: the action of what touches nothing, and how far its frets lie below the string [mm]
FREE_MM = math.inf
_OUT_OF_REACH_MM = 150.0


@dataclass(frozen=True)
class FretHand:
    """What of strokes is their own or in the way: place of plucking from the saddle as a share of the open length; seconds
    in which the string slides off the finger and in which it is drawn aside; factor of the losses."""

    position: float
    slip_s: float
    draw_s: float
    losses: float = 1.0


def measured_fret(obstacle: FretsObstacle) -> int:
    """The fret at which the action counts."""
    return min(TWELFTH, obstacle.count)


def action_mm(preset: Preset, index: int = 0) -> float:
    """The preset's action [mm], with [setup] that of string `index`. Raises ValueError where it has no frets."""
    shape = _frets(preset)
    if preset.setup is not None:
        table = preset.string[index]
        lying = obstacle_under(preset, table, table.notes[0])
        assert isinstance(lying, FretsObstacle)
        shape = lying
    if shape.action_12th_mm is not None:
        return shape.action_12th_mm
    return -shape.heights_mm[measured_fret(shape) - 1]


def action_settings(preset: Preset, action: float, index: int = 0) -> list[tuple[str, Any]]:
    """[(path, value)] of the preset that give its frets an action [mm], with [setup] under string `index`."""
    changed = with_action(preset, action, index)
    if changed.setup is not None and changed.setup.shapes_the_neck:
        actions = (("action_bass_mm", changed.setup.action_bass_mm), ("action_treble_mm", changed.setup.action_treble_mm))
        return [(f"setup.{key}", round(value, 4)) for key, value in actions if value is not None]
    shape = _frets(changed)
    if shape.action_12th_mm is not None:
        return [("obstacle.action_12th_mm", round(action, 4))]
    return [("obstacle.heights_mm", [round(each, 4) for each in shape.heights_mm])]


def with_action(preset: Preset, action: float, index: int = 0) -> Preset:
    """The preset with an action [mm], with [setup] under string `index`. Raises ValueError where another string would then
    lie on its frets."""
    shape = _frets(preset)
    if preset.setup is not None and preset.setup.shapes_the_neck:
        return preset.model_copy(update={"setup": preset.setup.raised(action - action_mm(preset, index))})
    if shape.action_12th_mm is not None:
        changed: dict[str, Any] = {"action_12th_mm": action}
    else:
        changed = {"heights_mm": raised(shape, action)}
    return preset.model_copy(update={"obstacle": shape.model_copy(update=changed)})


def raised(shape: FretsObstacle, action: float) -> tuple[float, ...]:
    """Heights [mm] of frets that were measured one by one, the saddle raised to an action [mm]."""
    at = measured_fret(shape) - 1
    x = fret_positions(1.0, shape.count)
    return tuple(
        float(h - (action + shape.heights_mm[at]) * each / x[at]) for h, each in zip(shape.heights_mm, x, strict=True)
    )


def _frets(preset: Preset) -> FretsObstacle:
    shape = preset.obstacle
    if not isinstance(shape, FretsObstacle):
        raise ValueError(f"obstacle of {preset.name} must be frets, got {shape.kind}; name a preset that has them")
    return shape


def engine_for(preset: Preset, note: int, quality: str) -> Engine:
    """An engine that plays a note of a preset at RATE_HZ, as open or at the fret at which the preset's string has it."""
    engine = Engine([preset], quality=quality, limiter=False, only_notes=[{note}], every_fret=False, warn=lambda text: None)
    engine.prepare(RATE_HZ, _BLOCK)
    return engine


def stroke_sound(engine: Engine, events: Sequence[tuple[Any, ...]], draw_s: float, seconds: float) -> Real:
    """(n,) left channel of a stroke that begins from silence with its events, from the moment that the finger, having drawn
    for draw_s, lets go."""
    engine.reset()
    due = make_events(list(events))
    first = engine.latency_samples + round(draw_s * RATE_HZ)
    out = np.empty((first + math.ceil(seconds * RATE_HZ), 2))
    for at in range(0, len(out), _BLOCK):
        engine.process(due, out[at : at + _BLOCK])
        due = due[:0]
    return np.asarray(out[first:, 0])


class FretModel:
    """The notes of one string of a preset, open or stopped at a fret.

    preset   of that string alone, without what varies
    fret     at which it is stopped, 0: open
    note     its key
    """

    def __init__(self, preset: Preset, index: int, fret: int = 0, tuned_cents: float = 0.0) -> None:
        shape = _frets(preset)
        if shape.layer is not None:
            raise ValueError(f"frets of {preset.name} must be bare, got a layer on them; take obstacle.layer out")
        table = preset.string[index]
        open_note = table.notes[0]
        if not 0 <= fret <= fret_count(preset, table):
            raise ValueError(f"fret must lie between 0 and {fret_count(preset, table)}, got {fret}")
        self.fret, self.note = fret, open_note + fret
        tuning = preset.tuning.model_copy(update={"offset_cents": preset.tuning.offset_cents + tuned_cents})
        hand = preset.hand.varied(0.0).model_copy(update={"release": None})
        self._whole, self._index = preset, index
        self.preset = alone(preset, table, open_note).model_copy(update={
            "tuning": tuning, "hand": hand, "articulations": {}, "effect": (),
        }).with_measured(MeasuredPlan())  # fmt: skip
        if shape.sawari_um is not None and fret == 0:
            raise ValueError(f"an open string of {preset.name} buzzes on its sawari, not on frets; give a note at a fret")
        opened, below = open_string(self.preset, self.preset.string[0], open_note)
        self.open_m = opened.length_m
        self.string: String
        self.string, _, _ = speaking_string(self.preset, self.preset.string[0], open_note, fret, opened, below)
        self.action_mm = action_mm(preset, index)
        self.evaluations = 0
        self._engines: dict[Any, Engine] = {}

    @property
    def stroke(self) -> FretHand:
        """As the preset's hardest."""
        pluck, note = self.preset.pluck, self.note
        slip, draw = at_note(pluck.hardest_slip_ms, note), at_note(pluck.draw_ms, note)
        return FretHand(pluck.hardest_position, 1e-3 * slip, 1e-3 * draw)

    def _engine(self, action: float, hand: FretHand, quality: str) -> Engine:
        # place and amplitude are live parameters; of the rest the engine is made anew
        key = action, replace(hand, position=0.0), quality
        found = self._engines.get(key)
        if found is None:
            preset = self._free() if action == FREE_MM else self._lying(action)
            pluck = preset.pluck
            pluck = pluck.model_copy(update={
                "displacement_mm": _FULL_MM, "velocity_exponent": 1.0, "position_hard": None, "draw_ms": 1e3 * hand.draw_s,
                "slip_ms": 1e3 * hand.slip_s, "slip_hard_ms": None,
                "width_mm": pluck.hardest_width_mm, "width_hard_mm": None,
            })  # fmt: skip
            preset = preset.model_copy(update={"pluck": pluck, **with_losses(preset, hand.losses)})
            found = engine_for(preset, self.note, quality)
            if len(self._engines) >= 4:
                self._engines.pop(next(iter(self._engines)))
            self._engines[key] = found
        return found

    def _lying(self, action: float) -> Preset:
        """The preset with its string at an action [mm] from the frets."""
        if self._whole.setup is None:
            return with_action(self.preset, action)
        table = self._whole.string[self._index]
        shape = obstacle_under(with_action(self._whole, action, self._index), table, table.notes[0])
        return self.preset.model_copy(update={"obstacle": shape})

    def _free(self) -> Preset:
        """The preset whose string touches nothing beyond the fret that it is stopped at."""
        shape = _frets(self.preset)
        below = obstacle_of(self.preset, self.preset.string[0], self.preset.string[0].notes[0], self.open_m)
        kept = [1e3 * each for each in below.heights_m[: self.fret]]
        # two frets make what the engine takes for a neck, and are the quickest
        heights = (*kept, -_OUT_OF_REACH_MM, -_OUT_OF_REACH_MM)
        changed = {"heights_mm": heights, "count": len(heights), "action_12th_mm": None}
        return self.preset.model_copy(update={"obstacle": shape.model_copy(update=changed)})

    def sound(self, action: float, amplitude_mm: float, hand: FretHand, seconds: float, quality: str = "standard") -> Real:
        """(n,) of a stroke that draws the open string aside by amplitude_mm, as `pluck.displacement_mm` counts it, from the
        moment that the finger lets go. Raises ValueError for an action at which a fret presses."""
        self.evaluations += 1
        return stroke_sound(self._engine(action, hand, quality), [
            (0, PARAMETER, 0, INDEX_OF["pluck.amount"], 0, amplitude_mm / _FULL_MM),
            (0, PARAMETER, 0, INDEX_OF["pluck.position"], 0, hand.position),
            (0, NOTE_ON, 0, self.note, 127),
        ], hand.draw_s, seconds)  # fmt: skip

    def touches(self, action: float, amplitude_mm: float, hand: FretHand) -> bool:
        """Whether the stroke reaches a fret, or the string lies on one."""
        try:
            first = [self.sound(each, amplitude_mm, hand, _FIRST_S, "standard") for each in (action, FREE_MM)]
        except PresetError:
            return True
        return float(np.abs(first[0] - first[1]).max()) > _TOUCHED * float(np.abs(first[1]).max())

    def reached_mm(self, amplitude_mm: float, hand: FretHand, low: float, high: float, within: float = 0.004) -> float:
        """The highest action between two at which a stroke touches, to within some mm."""
        if not self.touches(low, amplitude_mm, hand):
            return low
        while high - low > within:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.touches(middle, amplitude_mm, hand) else (low, middle)
        return 0.5 * (low + high)


#: seconds in which a string that reaches a fret has done so, and what of the sound differs then
_FIRST_S, _TOUCHED = 0.15, 1e-3


def with_losses(preset: Preset, losses: float) -> dict[str, Any]:
    """string and nut of a preset of one string, with so many times the losses in material and neck."""
    if losses == 1.0:
        return {}
    (table,) = preset.string

    def times(value: Any, most: float) -> Any:
        if isinstance(value, dict):
            return {note: min(most, each * losses) for note, each in value.items()}
        return min(most, value * losses)

    changed: dict[str, Any] = {"viscoelastic_loss": times(table.viscoelastic_loss, 0.99)}
    changed["thermoelastic_q_inverse"] = times(table.thermoelastic_q_inverse, 0.99)
    if table.measured_decay_rates:
        changed["measured_decay_rates"] = tuple(each * losses for each in table.measured_decay_rates)
    nut = tuple(mode.model_copy(update={"mass_kg": mode.mass_kg / losses}) for mode in preset.nut)
    return {"string": (table.model_copy(update=changed),), "nut": nut}
