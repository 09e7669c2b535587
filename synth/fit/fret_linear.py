"""Strokes that touch no fret: hand, losses, and what lies between string and recording.

The softest recording must be one. Place of plucking, slip, draw and losses that explain its bands are searched as a whole;
of others the slip and the draw that are their own, and how strong they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from synth.fit.contact_search import evolve, sobol, starts_of
from synth.fit.contact_space import Unknown
from synth.fit.fret_features import SECONDS, Between, Compared, Heard, compare, first_seen
from synth.fit.fret_model import FREE_MM, FretModel, Hand

Real = NDArray[np.float64]
POSITION = Unknown("position", 0.05, 0.5)
SLIP = Unknown("slip", 1e-4, 8e-3, True)
DRAW = Unknown("draw", 3e-3, 30e-3, True)
LOSSES = Unknown("losses", 0.55, 1.8, True)
#: engines of the first look, places in each, starts of the evolution and its notes
_ENGINES, _PLACES, _STARTS, _NOTES = 224, 10, 6, 140
#: a stroke at rest in a band has this much room to each side of what is known, by ratios
_NEAR = 0.12
#: the least amplitude that is played to hear what touches nothing [mm]
QUIET_MM = 1.0


@dataclass(frozen=True)
class Linear:
    """A stroke that touches nothing as it is heard: hand, what is compared, between."""

    hand: Hand
    compared: Compared
    between: Between


def powers(model: FretModel, heard: Heard, action: float, amplitude_mm: float, hand: Hand, quality: str) -> Real:
    """(W, B) of a stroke."""
    from synth.fit.fret_model import RATE_HZ

    sound = model.sound(action, amplitude_mm, hand, SECONDS + 0.05, quality)
    return heard.bands.powers(sound, RATE_HZ, SECONDS)


def _hand(unknowns: tuple[Unknown, ...], point: Real, held: Hand) -> Hand:
    values = {u.name: u.at(float(x)) for u, x in zip(unknowns, point, strict=True)}
    names = {"position": "position", "slip": "slip_s", "draw": "draw_s", "losses": "losses"}
    return replace(held, **{names[name]: value for name, value in values.items()})


def first_linear(
    model: FretModel, heard: Heard, amplitude_mm: float, position: float | None, pulse: Callable[[float], None]
) -> Linear:
    """The hand of the softest stroke. position: of the pluck, where it is known. pulse: told how much is done."""
    unknowns = tuple(u for u in (POSITION, SLIP, DRAW, LOSSES) if u is not POSITION or position is None)
    held = model.stroke if position is None else replace(model.stroke, position=position)

    def loss(point: Real) -> float:
        hand = _hand(unknowns, np.clip(point, 0.0, 1.0), held)
        return first_seen(heard, powers(model, heard, FREE_MM, amplitude_mm, hand, "draft"))[0].loss

    points, losses = [], []
    places = sobol(1, _PLACES * 2) if position is None else np.zeros((1, 0))
    for i, rest in enumerate(sobol(3, _ENGINES)):
        for place in places[(i % 2)::2] if position is None else places:
            points.append(np.concatenate([place, rest]))
            losses.append(loss(points[-1]))
        if i % 8 == 0:
            pulse(0.5 * i / _ENGINES)
    best: list[tuple[Real, float]] = []
    for i, start in enumerate(starts_of(np.array(points), np.array(losses), _STARTS)):
        trail = evolve(loss, start, most=_NOTES, seed=i + 1)
        best.append(_others(loss, unknowns, *trail.best))
        pulse(0.5 + 0.4 * (i + 1) / _STARTS)
    best.sort(key=lambda each: each[1])
    point, _ = evolve(loss, best[0][0], step=0.015, most=_NOTES, seed=51).best
    hand = _hand(unknowns, point, held)
    compared, between = first_seen(heard, powers(model, heard, FREE_MM, amplitude_mm, hand, "standard"))
    pulse(1.0)
    return Linear(hand, compared, between)


def _others(loss: Callable[[Real], float], unknowns: tuple[Unknown, ...], point: Real, best: float) -> tuple[Real, float]:
    """A point, or the same with another draw or slip: what fits has several of them, periods apart."""
    for name in (DRAW, SLIP):
        at = unknowns.index(name)
        for share in np.linspace(0.0, 1.0, 24):
            other = np.array(point)
            other[at] = share
            found = loss(other)
            if found < best:
                point, best = other, found
    return point, best


def next_linear(
    model: FretModel, heard: Heard, amplitude_mm: float, first: Linear, *, own_gain: bool
) -> tuple[Hand, Compared, float]:
    """Another stroke as if it touched nothing: hand, what is compared, and how much stronger it is than amplitude_mm
    (1 where it has a gain of its own)."""
    slip, draw = first.hand.slip_s, first.hand.draw_s
    unknowns = (Unknown("slip", 0.3 * slip, 1.8 * slip, True), Unknown("draw", 0.6 * draw, 1.6 * draw, True))

    def compared(hand: Hand) -> Compared:
        return compare(heard, powers(model, heard, FREE_MM, amplitude_mm, hand, "draft"), first.between, own_gain=True)

    def loss(point: Real) -> float:
        return compared(_hand(unknowns, np.clip(point, 0.0, 1.0), first.hand)).loss

    points = sobol(2, 32)
    losses = np.array([loss(point) for point in points])
    trails = [evolve(loss, start, most=60, seed=i + 1) for i, start in enumerate(starts_of(points, losses, 2))]
    point, _ = min((trail.best for trail in trails), key=lambda each: each[1])
    hand = _hand(unknowns, point, first.hand)
    found = compared(hand)
    return hand, found, 1.0 if own_gain else float(10.0 ** (found.gain_db / 20.0))
