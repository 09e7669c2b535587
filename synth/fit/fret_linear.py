"""Strokes that touch no fret: hand, losses, and what lies between string and recording.

The softest recording must be one. Place of plucking, slip, draw and losses that explain its bands are searched as a whole;
of others the slip and the draw that are their own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from synth.fit.contact_features import PARTIALS, huber
from synth.fit.contact_search import evolve, sobol, starts_of
from synth.fit.contact_space import Unknown
from synth.fit.fret_features import (
    LEAST_WINDOWS,
    SECONDS,
    BandTransfer,
    FretComparison,
    Heard,
    compare,
    db,
    first_seen,
    smooth,
)
from synth.fit.fret_model import FREE_MM, RATE_HZ, FretHand, FretModel
from synth.physics.modes import modal_frequencies

Real = NDArray[np.float64]
POSITION = Unknown("position", 0.05, 0.5)
SLIP = Unknown("slip", 1e-4, 8e-3, True)
#: the time in which the string is drawn aside lies within so many times the preset's
MOST_DRAW = 2.5
LOSSES = Unknown("losses", 0.55, 1.8, True)
#: combs that go on, draws that are tried of each, notes of its evolution
_STARTS, _DRAWS, _NOTES = 28, 12, 40
#: levels of a comb count so much [dB], and its notches to that depth
_COMB_DB, _DEEPEST_DB = 4.0, 15.0
#: how far apart slips count, beside places
_SLIPS = 0.25
#: the best of them that go on, and notes of each
_FINALISTS, _FINAL = 5, 110


@dataclass(frozen=True)
class Linear:
    """A stroke that touches nothing as it is heard: hand, what is compared, between."""

    hand: FretHand
    compared: FretComparison
    between: BandTransfer


def powers(model: FretModel, heard: Heard, action: float, amplitude_mm: float, hand: FretHand, quality: str) -> Real:
    """(W, B) of a stroke."""
    sound = model.sound(action, amplitude_mm, hand, SECONDS + 0.05, quality)
    return heard.bands.powers(sound, RATE_HZ, SECONDS)


def _hand(unknowns: tuple[Unknown, ...], point: Real, held: FretHand) -> FretHand:
    values = {u.name: u.at(float(x)) for u, x in zip(unknowns, point, strict=True)}
    names = {"position": "position", "slip": "slip_s", "draw": "draw_s", "losses": "losses"}
    return replace(held, **{names[name]: value for name, value in values.items()})


def first_linear(
    model: FretModel, heard: Heard, amplitude_mm: float, position: float | None, pulse: Callable[[float], None]
) -> Linear:
    """The hand of the softest stroke. position: of the pluck, where it is known. pulse: told how much is done."""
    usual = model.stroke.draw_s
    draw = Unknown("draw", usual / MOST_DRAW, usual * MOST_DRAW, True)
    unknowns = tuple(u for u in (POSITION, SLIP, draw, LOSSES) if u is not POSITION or position is None)
    held = model.stroke if position is None else replace(model.stroke, position=position)

    thin = heard.thinned()

    def loss(point: Real) -> float:
        hand = _hand(unknowns, np.clip(point, 0.0, 1.0), held)
        return first_seen(thin, powers(model, thin, FREE_MM, amplitude_mm, hand, "draft"))[0].loss

    names = [u.name for u in unknowns]
    best: list[tuple[Real, float]] = []
    starts = _combs(model, heard, amplitude_mm, position)
    for i, (place, slip) in enumerate(starts):
        value = {"position": place, "slip": slip, "draw": usual, "losses": 1.0}
        start = np.array([u.share(value[u.name]) for u in unknowns])
        tried = []
        for share in np.linspace(0.0, 1.0, _DRAWS):
            start = np.array(start)
            start[names.index("draw")] = share
            tried.append((loss(start), share))
        start[names.index("draw")] = min(tried)[1]
        best.append(evolve(loss, np.clip(start, 0.0, 1.0), step=0.03, most=_NOTES, seed=i + 1).best)
        pulse(0.75 * (i + 1) / len(starts))
    best.sort(key=lambda each: each[1])
    ends: list[tuple[Real, float]] = []
    for i, (point, least) in enumerate(best[:_FINALISTS]):
        ends.append(evolve(loss, _others(loss, unknowns, point, least)[0], step=0.02, most=_FINAL, seed=i + 51).best)
        pulse(0.75 + 0.2 * (i + 1) / _FINALISTS)
    point, _ = min(ends, key=lambda each: each[1])
    hand = _hand(unknowns, point, held)
    compared, between = first_seen(heard, powers(model, heard, FREE_MM, amplitude_mm, hand, "standard"))
    pulse(1.0)
    return Linear(hand, compared, between)


def _combs(model: FretModel, heard: Heard, amplitude_mm: float, position: float | None) -> list[tuple[float, float]]:
    """Places and slips [s] whose comb and whose notches the levels of the partials have, best first.

    Partial k of a string that is let go at a place p within a time T has the level of one that is let go near its end at
    once, plus those of sin(kπp), and of a force that fades as half a cosine does, cos(πfT) / (1 − (2fT)²).
    """
    count = min(PARTIALS, heard.noise.size)
    seen = heard.counts[0, :, :count].astype(np.float64)
    end = int(np.flatnonzero(seen.sum(axis=0) >= LEAST_WINDOWS).max(initial=7)) + 1
    seen, count = seen[:, :end], end
    k = np.arange(1, count + 1)
    hz = modal_frequencies(model.string, count) / (2.0 * np.pi)
    length = model.string.length_m / model.open_m
    least = FretHand(max(0.02, 0.02 * length), 1e-4, 0.025)
    level = db(powers(model, heard, FREE_MM, amplitude_mm, least, "draft"))[:, :count]
    weight = np.maximum(seen, 1e-3) / np.maximum(seen, 1e-3).sum(axis=0)
    near = (weight * level).sum(axis=0) - _level(np.sin(k * np.pi * least.position / length))
    recorded = _shape((weight * heard.level_db[0][:, :count]).sum(axis=0))
    places = np.linspace(POSITION.low, min(POSITION.high, 0.5 * length), 181) if position is None else np.array([position])
    points, costs = [], []
    for slip in np.geomspace(SLIP.low, SLIP.high, 64):
        u = 2.0 * hz * slip
        u = np.where(np.abs(u - 1.0) < 1e-6, 1.0 + 1e-6, u)
        faded = near + _level(np.cos(0.5 * np.pi * u) / (1.0 - u * u))
        for place in places:
            shape = _shape(faded + _level(np.sin(k * np.pi * place / length)))
            points.append((POSITION.share(place), _SLIPS * SLIP.share(slip)))
            costs.append(float(huber((shape - recorded) / _COMB_DB).mean()))
    chosen = starts_of(np.array(points), np.array(costs), _STARTS, apart=0.018)
    return [(POSITION.at(float(place)), SLIP.at(float(slip) / _SLIPS)) for place, slip in chosen]


def _level(x: Real) -> Real:
    return np.asarray(20.0 * np.log10(np.maximum(np.abs(x), 1e-3)))


def _shape(level: Real) -> Real:
    """(n,) levels beside their smooth course, no notch deeper than `_DEEPEST_DB`."""
    beside = level - smooth(level, np.ones(level.size, dtype=bool))
    return np.asarray(10.0 * np.log10(10.0 ** (beside / 10.0) + 10.0 ** (-_DEEPEST_DB / 10.0)))


def _others(loss: Callable[[Real], float], unknowns: tuple[Unknown, ...], point: Real, best: float) -> tuple[Real, float]:
    """A point, or the same with another draw or slip: what fits has several of them, periods apart."""
    for name in ("draw", "slip"):
        at = [u.name for u in unknowns].index(name)
        for share in np.linspace(0.0, 1.0, 24):
            other = np.array(point)
            other[at] = share
            found = loss(other)
            if found < best:
                point, best = other, found
    return point, best


def next_linear(model: FretModel, heard: Heard, amplitude_mm: float, first: Linear) -> tuple[FretHand, float]:
    """Another stroke as if it touched nothing: hand, and the loss that it has then."""
    slip, draw = first.hand.slip_s, first.hand.draw_s
    unknowns = (Unknown("slip", 0.3 * slip, 1.8 * slip, True), Unknown("draw", 0.6 * draw, 1.6 * draw, True))

    def loss(point: Real) -> float:
        hand = _hand(unknowns, np.clip(point, 0.0, 1.0), first.hand)
        return compare(heard, powers(model, heard, FREE_MM, amplitude_mm, hand, "draft"), first.between).loss

    points = sobol(2, 32)
    losses = np.array([loss(point) for point in points])
    trails = [evolve(loss, start, most=60, seed=i + 1) for i, start in enumerate(starts_of(points, losses, 2))]
    point, least = min((trail.best for trail in trails), key=lambda each: each[1])
    return _hand(unknowns, point, first.hand), least
