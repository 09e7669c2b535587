"""How every reference is made, and by what it is checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from benchmarks.collisions.ways import Way, way


class Kicks(NamedTuple):
    """The example's solver, another program altogether: penalty springs, exact flight."""

    factor: int
    modes: int


@dataclass(frozen=True)
class Recipe:
    """A reference; what it is checked against, each by its words: itself, coarser, and other methods."""

    reference: Way
    checks: dict[str, Way]
    independent: dict[str, Way | Kicks]
    exact: bool = False


def _hold(factor: int, modes: int, **more: float) -> Way:
    return way("exact-hold", factor, modes, residual_compliance=False, **more)  # type: ignore[arg-type]


def _filtered(factor: int, modes: int) -> Way:
    return way("moreau-jean-filtered", factor, modes, restitution=0.0)


def _rigid_points(factor: int, modes: int, other: int) -> Recipe:
    """Exact-hold, against half its rate and half its modes; and Moreau–Jean filtered, which imposes speeds, not places.

    What N modes leave out falls as 1/N or faster, so that half of them differ by more than all of them miss."""
    half = (modes + 1) // 2
    return Recipe(
        _hold(factor, modes),
        {"half the rate": _hold(factor // 2, modes), f"{half} modes": _hold(factor, half)},
        {"Moreau–Jean, filtered, e = 0": _filtered(other, modes)},
    )


def _tanpura() -> Recipe:
    """The lumped tail, which says of the modes left out what they would do, and 1001 modes from event to event."""
    plain = _rigid_points(384, 2001, 768)
    tail = way("exact-hold", 96, 1001)
    event = way("event-driven", 16, 1001, duration_s=0.1, residual_compliance=False)
    others: dict[str, Way | Kicks] = {"exact-hold + lumped tail, 1001 modes": tail, "event-driven, 1001 modes": event}
    return Recipe(plain.reference, plain.checks, plain.independent | others)


def _no_contact() -> Recipe:
    """Free flight is exact at every rate: what is left is the modes that are not there."""
    return Recipe(
        _hold(16, 2001),
        {"half the rate": _hold(8, 2001), "1001 modes": _hold(16, 1001)},
        {"exact flight in NumPy (examples/kicks.py), 1001 modes": Kicks(1, 1001)},
    )


RECIPES: dict[str, Recipe] = {
    "no-contact": _no_contact(),
    "tanpura": _tanpura(),
    "bass": _rigid_points(384, 1401, 384),
    "bass-hard": _rigid_points(384, 1401, 384),
    "two-close": _rigid_points(384, 2001, 768),
    "thirds": _rigid_points(384, 2001, 768),
    "pressed": _rigid_points(384, 1401, 384),
    "moving": _rigid_points(384, 2001, 384),
    "sitar": _rigid_points(384, 2001, 384),
    "fretless": Recipe(
        way("wall", 96, 1023, restitution=1.0),
        {
            "half the rate": way("wall", 48, 1023, restitution=1.0),
            "half the points": way("wall", 96, 511, restitution=1.0),
        },
        {"penalty springs (examples/kicks.py)": Kicks(16, 1023)},
    ),
    "forty-modes": Recipe(
        way("event-driven", 16, 40, residual_compliance=False),
        {"a start larger by 1e-9": way("event-driven", 16, 40, nudge=1e-9, residual_compliance=False)},
        {"Moreau–Jean, filtered, e = 0": _filtered(1536, 40)},
        exact=True,
    ),
    "cabannes": Recipe(
        way("cabannes", 16, 10),
        {},
        {"waves on a grid": way("waveguide", 1, 10), "exact-hold, no R, 1500 modes": _hold(192, 1500)},
        exact=True,
    ),
    "ideal-bridge": Recipe(
        way("waveguide", 16, 10),
        {"a fourth of the cells": way("waveguide", 4, 10)},
        {
            "exact-hold + lumped tail, 3000 modes": way("exact-hold", 192, 3000),
            "exact-hold, no R, 6000 modes": _hold(192, 6000),
        },
        exact=True,
    ),
    "flat-wall": Recipe(
        way("flat-wall", 16, 10, nodes=49, restitution=1.0),
        {},
        {
            "wall, one cell a step": way("wall", 1, 255, restitution=1.0),
            "penalty springs (examples/kicks.py)": Kicks(8, 255),
        },
        exact=True,
    ),
}
#: of every blind scene
BLIND = _rigid_points(384, 2001, 768)
#: scenes on modes that others publish; made where their files are, and never kept in the repository
OUTSIDE_RECIPES: dict[str, Recipe] = {
    "tanpura-measured": _rigid_points(384, 1001, 768),
    "bass-measured": _rigid_points(384, 862, 384),
}
