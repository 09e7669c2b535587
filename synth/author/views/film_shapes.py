"""What films of strings have in common: the places that are shown, what a model's modes are there, numbers for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from synth.instrument.place import Speaking

#: places along the speaking string; near a bridge, from its saddle, in shares of the bridge's distance
EVEN = 96
NEAR_A_BRIDGE = (0.1, 0.25, 0.4, 0.55, 0.7, 0.85, 1.2, 1.5, 2.0, 2.7, 3.6)


def places_along(scene: Speaking) -> np.ndarray:
    """(M,) from the nut end of the speaking string [m], rising."""
    length = scene.string.length_m
    contacts = np.asarray(scene.reached.positions_m, dtype=float)
    places = [np.linspace(0.0, length, EVEN + 1), contacts]
    if contacts.size == 1:
        distance = min(contacts[0], length - contacts[0])
        near = distance * np.array(NEAR_A_BRIDGE)
        places.append(length - near if contacts[0] > 0.5 * length else near)
    x = np.unique(np.round(np.concatenate(places), 7))
    return x[(x >= 0.0) & (x <= length)]


def line_at_finger(rest: np.ndarray, x: np.ndarray, drawing: dict[str, Any], nut: float) -> float:
    """Height of the rest line where the finger is [mm]."""
    return 1e3 * float(np.interp(drawing["pluck"]["x"] - nut, x, rest))


def rounded(array: np.ndarray, digits: int) -> list[Any]:
    return np.round(array, digits).tolist()


def mostly_zero(array: np.ndarray, digits: int) -> list[list[float]]:
    """Rows of numbers, zeros as short as they can be: of many points few are touched."""
    return [[value or 0 for value in row] for row in np.round(array, digits).tolist()]
