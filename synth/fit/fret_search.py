"""The action that a stroke which touches the frets tells: a search over it and over the hand's slip and draw.

The sound changes with the action by more than with anything else, and within some hundredths of a millimetre: so it is
searched as a whole, a dictionary within the bracket that the strokes leave and evolution from the best of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from synth.fit.contact_search import evolve, sobol, starts_of
from synth.fit.contact_space import Unknown
from synth.fit.fret_features import BandTransfer, FretComparison, Heard, compare
from synth.fit.fret_linear import powers
from synth.fit.fret_model import FretHand, FretModel
from synth.instrument.preset import PresetError

Real = NDArray[np.float64]
#: notes of the dictionary, starts of the evolution and notes of each, and of the last one
_DICTIONARY, _STARTS, _NOTES, _LAST = 384, 5, 90, 120
#: what counts as near the best: the losses of a profile
PROFILE_RATIO, PROFILE_LOSS = 1.25, 0.004
#: loss of a string that cannot sound
_LIES_ON_IT = 100.0


@dataclass(frozen=True)
class Minimum:
    """Where a stroke's loss is least: action [mm], hand, loss; low and high of what lies near the best [mm]; compared."""

    action_mm: float
    hand: FretHand
    loss: float
    low_mm: float
    high_mm: float
    compared: FretComparison


@dataclass(frozen=True)
class Touching:
    """A stroke that touches: what is heard of it, its amplitude [mm], and between which actions it is looked for."""

    heard: Heard
    amplitude_mm: float
    low_mm: float
    high_mm: float


def unknowns_of(stroke: Touching, hand: FretHand) -> tuple[Unknown, ...]:
    """What is looked for of a stroke, when a soft one has this hand."""
    return (
        Unknown("action", stroke.low_mm, stroke.high_mm),
        Unknown("slip", min(2e-4, 0.5 * hand.slip_s), max(4e-3, 1.4 * hand.slip_s), True),
        Unknown("draw", 0.75 * hand.draw_s, 1.33 * hand.draw_s, True),
    )


def minima(
    model: FretModel, stroke: Touching, hand: FretHand, between: BandTransfer, pulse: Callable[[float], None]
) -> list[Minimum]:
    """The least losses of a stroke, best first. pulse: told how much is done; it may raise."""
    unknowns = unknowns_of(stroke, hand)

    def parts(point: Real) -> tuple[float, FretHand]:
        value = {u.name: u.at(float(x)) for u, x in zip(unknowns, np.clip(point, 0.0, 1.0), strict=True)}
        return value["action"], replace(hand, slip_s=value["slip"], draw_s=value["draw"])

    def compared(point: Real) -> FretComparison:
        action, mine = parts(point)
        heard = powers(model, stroke.heard, action, stroke.amplitude_mm, mine, "standard")
        return compare(stroke.heard, heard, between)

    def loss(point: Real) -> float:
        try:
            return compared(point).loss
        except PresetError:  # the string lies on a fret
            return _LIES_ON_IT

    points = sobol(len(unknowns), 2 ** (_DICTIONARY - 1).bit_length())[:_DICTIONARY]  # of a power of two they lie evenly
    losses = []
    for i, point in enumerate(points):
        if i % 8 == 0:
            pulse(0.4 * i / len(points))
        losses.append(loss(point))
    trails = []
    for i, start in enumerate(starts_of(points, np.array(losses), _STARTS, apart=0.08)):
        trails.append(evolve(loss, start, step=0.05, most=_NOTES, seed=i + 1))
        pulse(0.4 + 0.45 * (i + 1) / _STARTS)
    trails.sort(key=lambda each: each.best[1])
    trails.append(evolve(loss, trails[0].best[0], step=0.012, most=_LAST, seed=51))
    trails.sort(key=lambda each: each.best[1])
    pulse(1.0)
    visited = np.concatenate([np.array(each.points) for each in trails])
    values = np.concatenate([np.array(each.losses) for each in trails])
    actions = np.array([unknowns[0].at(float(x)) for x in visited[:, 0]])
    found: list[Minimum] = []
    for trail in trails:
        point, least = trail.best
        action, mine = parts(point)
        near = values <= PROFILE_RATIO * least + PROFILE_LOSS
        found.append(Minimum(
            action, mine, least, float(actions[near].min()), float(actions[near].max()), compared(point)
        ))  # fmt: skip
    return found
