"""Rigid points under a string: bridge edges, jiva threads, frets.

Positions count from the string's end x = 0 (the nut). Heights count from the *string at rest*, the straight
line from the nut slot to the saddle, upwards: a fret 1 mm below the string has height −0.001 m, a bridge edge
that just touches has 0.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Obstacle:
    """A set of contact points.

    positions_m  (C,) distances from x = 0 [m], increasing, each > 0
    heights_m    (C,) heights over the string at rest [m], usually ≤ 0

    Lists and arrays are taken. Raises ValueError for lengths that differ, numbers that are not finite,
    positions that are not increasing. `check` adds what depends on the string's length.
    """

    positions_m: tuple[float, ...] = ()
    heights_m: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("positions_m", "heights_m"):
            values = tuple(float(value) for value in getattr(self, name))
            for point, value in enumerate(values, start=1):
                if not math.isfinite(value):
                    raise ValueError(f"{name} of point {point} must be finite, got {value}")
            object.__setattr__(self, name, values)
        if len(self.positions_m) != len(self.heights_m):
            raise ValueError(
                "positions_m and heights_m must be equally long, "
                f"got {len(self.positions_m)} and {len(self.heights_m)}; give each point both"
            )
        before = 0.0
        for point, position in enumerate(self.positions_m, start=1):
            if position <= before:
                raise ValueError(
                    f"position of point {point} must be more than {before:g} m, got {position:g} m; "
                    "sort the points from the nut and leave no two in one place"
                )
            before = position

    def __len__(self) -> int:
        return len(self.positions_m)

    def check(self, length_m: float) -> None:
        """Raises ValueError unless every point lies inside a string of this length."""
        for point, position in enumerate(self.positions_m, start=1):
            if position >= length_m:
                raise ValueError(
                    f"position of point {point} must be less than the string's length {length_m:g} m, "
                    f"got {position:g} m; remove the point or lengthen the string"
                )


def fret_positions(scale_length_m: float, count: int) -> np.ndarray:
    """x_n = L(1 − 2^(−n/12)), n = 1 … count (count,) [m]: frets of twelve-tone equal temperament."""
    if not (scale_length_m > 0.0 and math.isfinite(scale_length_m)):
        raise ValueError(f"scale_length_m must be > 0 m, got {scale_length_m}")
    if count != int(count) or count < 1:
        raise ValueError(f"fret count must be a whole number >= 1, got {count}")
    return -scale_length_m * np.expm1(-np.arange(1, int(count) + 1) * (math.log(2.0) / 12.0))


def frets(
    scale_length_m: float,
    count: int,
    action_12th_m: float,
    relief_m: float = 0.0,
    nut_height_m: float = 0.0004,
    *,
    backbow: bool = False,
    fall_away_m: float = 0.0,
    fall_away_fret: int = 12,
    crowns_m: Sequence[float] = (),
) -> Obstacle:
    """Frets of a neck from what a luthier measures on it, the string open and at rest.

    scale_length_m  nut to saddle [m]
    count           number of frets, 12 or more
    action_12th_m   clearance between the top of fret 12 and the string [m]
    nut_height_m    clearance between the top of fret 1 and the string [m]: the nut's height, measured where
                    luthiers measure it
    relief_m        hollow of the neck [m]: the gap under a straightedge laid on the first and the last fret,
                    half way between them; with `backbow` it may be negative, of a neck bent backwards
    fall_away_m     how far the last fret has fallen below the line of the others [m], which they follow up to
                    fret `fall_away_fret`
    crowns_m        height of each fret over the board [m], of which only the differences count; none: all alike

    The fret tops follow a straight line plus a parabola, 0 at the first and the last fret and −relief_m half
    way, plus a straight fall from the fret f on, plus the crowns c:

        η(x) = −(a + bx + d(x)),   d = relief·4s(1−s) + fall_away·max(0, (x − x_f)/(x_count − x_f)) − c,
        s = (x − x_1)/(x_count − x_1)

    with a and b such that frets 1 and 12, as high as they are, have the two clearances. Raises ValueError for
    impossible numbers.
    """
    x = fret_positions(scale_length_m, count)
    if count < 12:
        raise ValueError(
            f"fret count must be >= 12 so that there is an action at fret 12, got {count}; "
            "give explicit heights for a shorter neck"
        )
    for name, value in (("action_12th_m", action_12th_m), ("nut_height_m", nut_height_m)):
        if not (value > 0.0 and math.isfinite(value)):
            raise ValueError(f"{name} must be > 0 m, got {value}; the fret would lift the string, raise the string")
    if not ((relief_m >= 0.0 or backbow) and math.isfinite(relief_m)):
        raise ValueError(f"relief_m must be >= 0 m, got {relief_m}; give explicit heights for a neck bent backwards")
    s = (x - x[0]) / (x[-1] - x[0])
    down = relief_m * 4.0 * s * (1.0 - s)
    if fall_away_m != 0.0:
        down = down + _fallen(x, fall_away_m, fall_away_fret)
    if len(crowns_m):
        if len(crowns_m) != count:
            raise ValueError(
                f"crowns_m must have a height for each of {count} frets, got {len(crowns_m)}; measure all frets"
            )
        down = down - np.asarray(crowns_m, dtype=np.float64)
        down = down - down[0]
    slope = (action_12th_m - down[11] - nut_height_m) / (x[11] - x[0])
    heights = -(nut_height_m + slope * (x - x[0]) + down)
    return Obstacle(tuple(x.tolist()), tuple(heights.tolist()))


def _fallen(x: np.ndarray, fall_away_m: float, fret: int) -> np.ndarray:
    """How far frets at x have fallen away, which begins beyond a fret and is all of it at the last."""
    if not (fall_away_m > 0.0 and math.isfinite(fall_away_m)):
        raise ValueError(f"fall_away_m must be >= 0 m, got {fall_away_m}; leave it out for a straight neck")
    if not 1 <= fret < len(x):
        raise ValueError(f"fall_away_fret must lie between 1 and {len(x) - 1}, before the last fret, got {fret}; lower it")
    return fall_away_m * np.maximum(0.0, (x - x[fret - 1]) / (x[-1] - x[fret - 1]))


def sagitta(radius_m: float | None, place_m: np.ndarray | float, outer_m: np.ndarray | float) -> np.ndarray:
    """√(R² − y²) − √(R² − y_o²) [m]: how much higher a cylinder of radius R is at y from its middle than at ±y_o; no
    radius: flat. |y| and |y_o| must not exceed R."""
    y, outer = np.asarray(place_m, dtype=np.float64), np.asarray(outer_m, dtype=np.float64)
    if radius_m is None:
        return np.zeros(np.broadcast_shapes(y.shape, outer.shape))
    # the difference of the roots, without its cancellation
    both = np.sqrt(radius_m**2 - y**2) + np.sqrt(radius_m**2 - outer**2)
    return np.asarray((outer**2 - y**2) / np.where(both > 0.0, both, 1.0))


def arched(
    shares: np.ndarray, across: float, spreads_m: tuple[float, float], radii_m: tuple[float | None, float | None]
) -> np.ndarray:
    """How much more clearance an inner string has at shares (C,) of its length, from the nut, than a string has whose
    clearances lie in proportion between those of the outer strings (C,) [m].

    across     its place between the middle (0) and the outer strings (±1)
    spreads_m  distance of the outer strings at nut and saddle
    radii_m    of the board, which frets and nut slots follow, and of the saddle's top; None: flat

    The string goes straight from slot to saddle, s·sag(R_saddle) + (1 − s)·sag(R_board) of their places; the crown
    under it has sag(R_board) of the place at s. Outer strings have 0.
    """
    s = np.asarray(shares, dtype=np.float64)
    nut, saddle = 0.5 * spreads_m[0], 0.5 * spreads_m[1]
    board, top = radii_m
    outer = (1.0 - s) * nut + s * saddle
    string = s * sagitta(top, across * saddle, saddle) + (1.0 - s) * sagitta(board, across * nut, nut)
    return np.asarray(string - sagitta(board, across * outer, outer))


def wall_positions(
    length_m: float, from_m: float, to_m: float, *, intervals: int | None = None, nodes: int | None = None,
    spacing_m: float | None = None,
) -> np.ndarray:  # fmt: skip
    """Where a wall along from_m ≤ x ≤ to_m is looked at (C,) [m]; one of

    intervals   the points i·L/intervals, 0 < i < intervals, inside the stretch: the modal grid of intervals − 1 modes
    nodes       so many points, the first and the last at the ends of the stretch (one: at its end)
    spacing_m   points so far apart, the last one at to_m

    The ends of the string are never among them. Raises ValueError for a stretch that is empty or leaves the string.
    """
    if not 0.0 <= from_m < to_m <= length_m:
        raise ValueError(f"a wall must have 0 <= from_m < to_m <= {length_m:g} m, got {from_m:g} and {to_m:g} m")
    if nodes is not None:
        x = np.linspace(from_m, to_m, nodes + (from_m == 0.0))[-nodes:] if nodes > 1 else np.array([to_m])
    elif spacing_m is not None:
        x = to_m - spacing_m * np.arange(math.floor((to_m - from_m) / spacing_m + 1e-9), -1.0, -1.0)
    elif intervals is not None:
        i = np.arange(1, intervals)
        x = i * (length_m / intervals)
        x = x[(x >= from_m - 1e-9 * length_m) & (x <= to_m + 1e-9 * length_m)]
    else:
        raise ValueError("give intervals, nodes or spacing_m")
    x = x[(x > 1e-9 * length_m) & (x < length_m * (1.0 - 1e-9))]
    if x.size == 0:
        raise ValueError(f"no node lies on the wall from {from_m:g} to {to_m:g} m; take more nodes, or more modes")
    return x


def parabola_height(positions_m: np.ndarray, top_m: float, height_m: float, radius_m: float) -> np.ndarray:
    """A curved bridge η(x) = height − (x − top)²/(2·radius) [m], radius of curvature > 0 at its top."""
    return height_m - (np.asarray(positions_m, dtype=np.float64) - top_m) ** 2 / (2.0 * radius_m)


def beyond_fret(obstacle: Obstacle, fret_index: int, length_m: float) -> tuple[float, np.ndarray, np.ndarray]:
    """What a string of open length length_m has beyond the fret n = fret_index that it is stopped at; n = 0: open.

    Returns the speaking length L − x_n [m] and, of the frets k > n, positions from fret n and heights over the string's new
    line at rest, (x_n, η_n) to the saddle (L, 0):

        x'_k = x_k − x_n,   η'_k = η_k − η_n (L − x_k)/(L − x_n)

    A fret of a height ≥ 0 presses the string. Raises ValueError for a fret that does not exist.
    """
    obstacle.check(length_m)
    if fret_index != int(fret_index) or not 0 <= fret_index <= len(obstacle):
        raise ValueError(f"fret must be a whole number from 0 (open) to {len(obstacle)}, got {fret_index}")
    n = int(fret_index)
    x_n, eta_n = (obstacle.positions_m[n - 1], obstacle.heights_m[n - 1]) if n else (0.0, 0.0)
    speaking_m = length_m - x_n
    x, eta = np.array(obstacle.positions_m[n:]), np.array(obstacle.heights_m[n:])
    return speaking_m, x - x_n, eta - eta_n * (length_m - x) / speaking_m


def fretted(obstacle: Obstacle, fret_index: int, length_m: float) -> tuple[float, Obstacle]:
    """The scene of a note at fret n of a string of open length length_m: speaking length [m] and `beyond_fret`.

    Raises ValueError for a fret that does not exist, and where a fret k would touch the line at rest: it would sound
    instead.
    """
    speaking_m, positions, heights = beyond_fret(obstacle, fret_index, length_m)
    n = int(fret_index)
    for k, height in enumerate(heights, start=n + 1):
        if height >= 0.0:
            stopped = f"stopped at fret {n}" if n else "open"
            remedy = f"lower fret {k} or raise fret {n}" if n else "lower the fret or raise the nut"
            raise ValueError(f"fret {k} must lie below the string at rest, {stopped}, got {height * 1e3:+.2f} mm; {remedy}")
    return speaking_m, Obstacle(tuple(positions.tolist()), tuple(heights.tolist()))


def bass_neck_height(positions_m: Iterable[float] | np.ndarray | float) -> np.ndarray:
    """Smooth neck of the paper's bass [m]: −(0.203 + 0.0036 x + 0.649·4s(1−s)) mm, x in mm, s = x/591.

    A fit to BASS_FRETS, 29 µm rms from it; for frets between or beyond the measured ones' exact places.
    """
    x_mm = 1e3 * np.asarray(positions_m, dtype=np.float64)
    s = x_mm / 591.0
    return -1e-3 * (0.203 + 0.0036 * x_mm + 0.649 * 4.0 * s * (1.0 - s))


_BASS_FRETS_MM = (
    (48, -0.63), (94, -0.88), (137, -1.13), (178, -1.33), (216, -1.58),
    (253, -1.73), (287, -1.88), (319, -1.98), (350, -2.13), (379, -2.18),
    (406, -2.23), (432, -2.33), (456, -2.33), (479, -2.33), (501, -2.33),
    (521, -2.33), (540, -2.33), (558, -2.335), (576, -2.335), (591, -2.335),
)  # fmt: skip

BASS_FRETS = Obstacle(tuple(x / 1e3 for x, _ in _BASS_FRETS_MM), tuple(h / 1e3 for _, h in _BASS_FRETS_MM))
"""The 20 frets of the bass guitar measured for IA2018 (figure 6), under a G string of 0.863 m."""
