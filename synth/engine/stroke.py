"""The law of a pluck: where the finger takes hold, how wide it is, how far it draws the string. Plain Python that the core
compiles as it stands, and views use as it is.

Distances count from the saddle [m]. `strength` is velocity/127.
"""

from __future__ import annotations

#: a finger takes hold between these parts of the speaking length; beyond the middle is the same from the other side
NEAREST, FARTHEST = 0.02, 0.5
#: widest finger, as a part of its distance from the saddle
WIDEST = 1.5


def finger_distance(share: float, open_length: float, length: float) -> float:
    """Distance of the finger at a share of the open length, on a string that speaks over `length`."""
    return min(max(share * open_length, NEAREST * length), FARTHEST * length)


def finger_width(soft: float, ratio: float, strength: float, distance: float, by_ratios: bool) -> float:
    """Width of the finger: `soft` at velocity 0, `ratio` times that at velocity 127, by equal ratios or by equal steps."""
    wider = ratio**strength if by_ratios else 1.0 + strength * (ratio - 1.0)
    return min(soft * wider, WIDEST * distance)


def pluck_force(full: float, strength: float, exponent: float) -> float:
    """Force of a pluck [N], `full` at velocity 127."""
    return full * strength**exponent


def draws_at(distance: float, length: float, tension: float) -> float:
    """Stiffness [N/m] of the ideal string of this tension [N] where a finger draws it [m]."""
    return tension * length / (distance * (length - distance))


def drawn_by(force: float, distance: float, length: float, tension: float) -> float:
    """How far a force [N] draws the ideal string of this tension [N] where it acts [m]."""
    return force * distance * (length - distance) / (tension * length)


def met(share: float, arrival: float) -> float:
    """How far, as a part of the whole way, a hand has gone that meets the string at `arrival` times its mean speed and comes
    to rest at the end of its way, at a share of its time."""
    return share * share * (3.0 - 2.0 * share) + arrival * share * (1.0 - share) * (1.0 - share)


def between(soft: float, hard: float, strength: float) -> float:
    """A number of the pluck at a strength, `soft` at velocity 0 and `hard` at 127: in ratios where neither is 0."""
    if soft > 0.0 and hard > 0.0:
        return soft * (hard / soft) ** strength
    return soft + strength * (hard - soft)
