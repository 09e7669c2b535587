"""A preset's board without frets: its strings stopped anywhere on it, and what an engine needs to slide fingers there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from synth.dsp.rates import MAXIMUM_FACTOR
from synth.instrument.plan import FREE, StringPlan, choose_factor, plan_wall
from synth.instrument.preset import BoardObstacle, Preset, PresetError
from synth.physics.fingerboard import Fingerboard, fingerboard
from synth.physics.modes import model_frequencies
from synth.physics.obstacle import Obstacle
from synth.physics.string import NutResonance, String

#: Q of the fingertip's resonance: so little of it moves that spring and dashpot alone count in the audible band; and the
#: least that a resonance may have [kg]
_TIP_Q, _LEAST_KG = 0.5, 1e-9
#: a finger is put down as near to the pitch as this (relative)
_IN_TUNE = 1e-12
#: how a string is heard: as its force, or at a point
BY_FORCE, BY_POINT = range(2)


@dataclass(frozen=True)
class StringBoard:
    """What a string's models over a board have in common. Lengths [m]."""

    fingerboard: Fingerboard
    length_m: float
    tension_n: float
    bending_stiffness_n_m2: float
    linear: bool  # the stiffness law
    heard: int
    distance_m: float  # where, from the saddle
    aperture_m: float
    gains: tuple[float, float]  # on displacement and velocity
    slide_s: float


def fingerboard_of(shape: BoardObstacle, length_m: float) -> Fingerboard:
    """The board under a string of `length_m`. Raises ValueError where it does not fit under it."""
    assert shape.action_12th_mm is not None
    return fingerboard(
        length_m,
        1e-3 * shape.length_mm,
        1e-3 * shape.action_12th_mm,
        1e-3 * shape.relief_mm,
        1e-3 * shape.nut_height_mm,
        1e6 * shape.stiffness_n_mm2,
        shape.rebound,
    )


def on_board(shape: BoardObstacle, opened: String, semitones: int, wanted_hz: float) -> tuple[String, Obstacle, float]:
    """The string stopped so many semitones above the open one, where its first mode is at `wanted_hz`: the string, no points
    below it, the height of the finger [m].

    The tension stays that of the open string; a fingertip gives way at the end. Raises ValueError where no place on the
    board gives the pitch, or the board is in the string's way.
    """
    board, none = fingerboard_of(shape, opened.length_m), Obstacle((), ())
    if not semitones:
        board.check(opened.length_m, opened.length_m)
        return opened, none, 0.0
    stiffness = 1e3 * shape.tip_stiffness_n_mm
    mass = max(_LEAST_KG, (_TIP_Q * shape.tip_loss_n_s_m) ** 2 / stiffness)
    quality = math.sqrt(stiffness * mass) / shape.tip_loss_n_s_m
    tip = NutResonance(math.sqrt(stiffness / mass) / (2.0 * math.pi), quality, mass)
    string = replace(opened, nut=(*opened.nut, tip))
    length = opened.length_m
    for _ in range(100):
        string = string.with_length(length)
        ratio = float(model_frequencies(string, 1)[0]) / (2.0 * math.pi * wanted_hz)
        if abs(ratio - 1.0) < _IN_TUNE:
            break
        length *= ratio
        if not 0.0 < opened.length_m - length:
            raise ValueError(
                f"board cannot stop the string at {wanted_hz:g} Hz: the fingertip at the nut already sounds higher; "
                "tune the note higher"
            )
    place = opened.length_m - length
    if place > board.end_m:
        raise ValueError(
            f"board must reach to {1e3 * place:.0f} mm from the nut for {semitones} semitones, got "
            f"{1e3 * board.end_m:g} mm; take fewer semitones or a longer board"
        )
    board.check(opened.length_m, length)
    return string, none, board.stop(place)


def board_plan(
    preset: Preset,
    opened: String,
    speaking_m: float,
    quality: str,
    rate_hz: float,
    scheme: str,
    internal_rate_hz: float | None,
) -> StringPlan:
    """The plan of a string stopped to a speaking length: of one rate wherever it is, of fewer modes where it is shorter.

    Raises PresetError for another scheme than exact-hold's, ValueError for a quality or rate there is not.
    """
    shape = preset.obstacle
    assert isinstance(shape, BoardObstacle)
    if scheme != "exact-hold":
        raise PresetError(
            f"{preset.name}: a board has a contact law of its own, got scheme {scheme}; leave the scheme out, or "
            "take another obstacle"
        )
    plan = plan_wall(opened.with_length(speaking_m), 1e6 * shape.stiffness_n_mm2, quality=quality, rate_hz=rate_hz)
    factor, error = plan.factor, plan.error
    if internal_rate_hz is not None:
        factor, error = choose_factor(opened.fundamental_hz, FREE, quality, rate_hz, internal_rate_hz)
    elif factor > MAXIMUM_FACTOR:
        factor, error = MAXIMUM_FACTOR, f"{error} (limited to {MAXIMUM_FACTOR} × output)"
    spacing = speaking_m / (plan.modes + 1)
    nodes = min(plan.modes, max(0, int((1e-3 * shape.length_mm - opened.length_m + speaking_m) / spacing)))
    return replace(plan, scheme=scheme, factor=factor, rate_hz=factor * rate_hz, contacts=nodes, error=error)


def string_board(preset: Preset, shape: BoardObstacle, opened: String, gain: float) -> StringBoard:
    """What its models have in common, `shape` being the board under it; `gain` of its output, linear."""
    output = preset.output
    gains = {
        "force": (gain, 0.0),
        "displacement": (gain, 0.0),
        "velocity": (0.0, gain),
        "pickup": (1.0, gain),
        "flux": (gain, 0.0),
    }
    return StringBoard(
        fingerboard_of(shape, opened.length_m),
        opened.length_m,
        opened.tension_n,
        opened.bending_stiffness_n_m2,
        opened.stiffness_law == "linear",
        BY_FORCE if output.kind == "force" else BY_POINT,
        output.position * opened.length_m,
        1e-3 * output.aperture_mm if output.magnetic else 0.0,
        gains[output.kind],
        1e-3 * shape.slide_ms,
    )
