"""The unknowns of one note over an obstacle, as numbers in a unit cube.

Of a bridge: height of the thread as a share of that above which the string hardly touches, d·A/((1 − p)L); distance and
place of plucking as shares of the length; and what is in the way, draw time and a factor of all losses. A curved bridge has
an arc of a size of its own: there the amplitude has to be known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.fit.contact_model import ContactStroke
from synth.physics.string import String

Real = NDArray[np.float64]


@dataclass(frozen=True)
class Unknown:
    """What may lie between low and high; by ratios or not."""

    name: str
    low: float
    high: float
    ratios: bool = False

    def at(self, share: float) -> float:
        if self.ratios:
            return self.low * (self.high / self.low) ** share
        return self.low + share * (self.high - self.low)

    def share(self, value: float) -> float:
        if self.ratios:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


#: height over that above which there is hardly contact; distance over the length; place; draw time [s]; losses
HEIGHT = Unknown("height", -0.3, 1.3)
DISTANCE = Unknown("distance", 0.0012, 0.03, True)
POSITION = Unknown("position", 0.02, 0.5)
DRAW = Unknown("draw", 0.003, 0.04, True)
LOSSES = Unknown("losses", 0.6, 1.6, True)
#: the string slides off the finger in the hand's own time, times or over so much
SLIPS = 3.0
#: a second point between edge and end: place as a share of the distance; height over that above which it is hardly touched
INNER = (Unknown("inner_place", 0.15, 0.92), Unknown("inner_height", -0.3, 1.3))
#: what the answer is about; the rest is in its way
ASKED = ("height", "distance", "position")


@dataclass(frozen=True)
class Space:
    """The cube. amplitude_m: what the string is drawn aside by, or what is taken for it; held: values that are known."""

    string: String
    unknowns: tuple[Unknown, ...]
    amplitude_m: float
    held: tuple[tuple[str, float], ...] = ()

    @property
    def size(self) -> int:
        return len(self.unknowns)

    def index(self, name: str) -> int:
        """Raises ValueError for what is not looked for."""
        return [unknown.name for unknown in self.unknowns].index(name)

    def values(self, point: Sequence[float] | Real) -> dict[str, float]:
        """Of all unknowns, and what is held."""
        return {**dict(self.held), **{u.name: u.at(float(x)) for u, x in zip(self.unknowns, point, strict=True)}}

    def stroke(self, point: Sequence[float] | Real) -> ContactStroke:
        value = self.values(point)
        length, place = self.string.length_m, value["position"]
        hand = value["draw"], value["losses"], value.get("slip", 0.0)
        distance = value["distance"] * length
        most = distance * self.amplitude_m / ((1.0 - place) * length)
        inner = None
        if "inner_place" in value:
            inner = value["inner_place"], value["inner_height"] * value["inner_place"] * most
        return ContactStroke(value["height"] * most, distance, place, self.amplitude_m, *hand, inner)

    def point(self, value: dict[str, float]) -> Real:
        """The point at which the unknowns have these values."""
        return np.array([min(1.0, max(0.0, u.share(value[u.name]))) for u in self.unknowns])


def with_inner(space: Space) -> Space:
    """The same unknowns and those of a second point of the bridge behind them."""
    return Space(space.string, (*space.unknowns, *INNER), space.amplitude_m, space.held)


def space_of(
    string: String,
    amplitude_m: float,
    *,
    slip_s: float = 0.0,
    position: float | None = None,
) -> Space:
    """Of a bridge. slip_s: about how long the string slides off the finger, or 0; position: of the pluck, if known."""
    found = [HEIGHT, DISTANCE, POSITION, DRAW, LOSSES]
    if slip_s > 0.0:
        found.append(Unknown("slip", slip_s / SLIPS, slip_s * SLIPS, True))
    held = () if position is None else (("position", position),)
    return Space(string, tuple(u for u in found if u.name not in dict(held)), amplitude_m, held)


@dataclass(frozen=True)
class Estimate:
    """value and 95 % interval, of height (over amplitude), distance and position (over length)."""

    value: float
    low: float
    high: float

    @property
    def half(self) -> float:
        """Half the interval."""
        return 0.5 * (self.high - self.low)


def asked(space: Space, point: Sequence[float] | Real) -> dict[str, float]:
    """What the answer is about: height over amplitude, distance and place over length."""
    stroke, values = space.stroke(point), space.values(point)
    found = {name: values[name] for name in ASKED if name in values and name not in dict(space.held)}
    found["height"] = stroke.height_m / stroke.displacement_m
    return found


def estimates(space: Space, point: Real, covariance: Real, least: dict[str, float]) -> dict[str, Estimate]:
    """Each with an interval of one root of the covariance (d, d) of the unknowns to each side, and no less than `least`."""
    found = {}
    step = np.where(point > 0.99, -1e-3, 1e-3)
    for name, value in asked(space, point).items():
        slope = np.array(
            [(asked(space, point + step[i] * np.eye(space.size)[i])[name] - value) / step[i] for i in range(space.size)]
        )
        half = math.hypot(math.sqrt(max(0.0, float(slope @ covariance @ slope))), least[name])
        found[name] = Estimate(value, value - half, value + half)
    return found
