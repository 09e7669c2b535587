"""A board without frets under a string: its surface, and how far below the string it lies wherever a finger stops that.

Places x count from the nut of the open string [m], heights from its line at rest, upwards [m]; the string ends at (L, 0). A
finger at x_f presses the string down to (x_f, y_f), from where its line at rest goes to the saddle; places ξ on the speaking
length ℓ = L − x_f count from the finger. The functions are of single numbers, and `njit` compiles them as they stand.
"""

from __future__ import annotations

from dataclasses import dataclass

#: nearer to the nut a finger does not get the string all the way down [m]
NEAR_NUT_M = 0.02
#: places along a speaking length at which a board is looked at when a preset is checked
_LOOKED_AT = 256


def board_height(x: float, nut: float, slope: float, relief: float, end: float) -> float:
    """Height of the surface at x: −(nut + slope x + 4 relief s(1 − s)), s = x/end."""
    s = x / end
    return -(nut + slope * x + 4.0 * relief * s * (1.0 - s))


def pressed_share(x: float) -> float:
    """How much of the way to the surface a finger at x gets the string: all, but for the last centimetres before the nut."""
    return min(1.0, x / NEAR_NUT_M)


def over_line(xi: float, speaking: float, surface: float, stop: float) -> float:
    """Height of the `surface` at ξ over the line at rest of a string stopped at the height `stop`."""
    return surface - stop * (1.0 - xi / speaking)


@dataclass(frozen=True)
class Fingerboard:
    """A board from the nut to `end_m` [m], its surface as `board_height` has it; elastic: k [N/m²], restitution."""

    end_m: float
    nut_height_m: float
    slope: float
    relief_m: float
    stiffness_n_m2: float
    restitution: float

    @property
    def profile(self) -> tuple[float, float, float, float]:
        """What `board_height` takes: nut, slope, relief, end."""
        return self.nut_height_m, self.slope, self.relief_m, self.end_m

    def stop(self, x_m: float) -> float:
        """Height y_f of a finger at x; 0 at the nut."""
        return pressed_share(x_m) * board_height(x_m, *self.profile)

    def heights(self, length_m: float, speaking_m: float, count: int = _LOOKED_AT) -> list[tuple[float, float]]:
        """(x, height of the surface over the line at rest) at `count` places along the speaking length, as far as the board
        goes."""
        x_f = length_m - speaking_m
        places = [speaking_m * (i + 1) / (count + 1) for i in range(count)]
        return [
            (x_f + xi, over_line(xi, speaking_m, board_height(x_f + xi, *self.profile), self.stop(x_f)))
            for xi in places
            if x_f + xi <= self.end_m
        ]

    def check(self, length_m: float, speaking_m: float) -> None:
        """Raises ValueError where the board touches a string of `length_m` at rest that is stopped to `speaking_m`."""
        for x, height in self.heights(length_m, speaking_m):
            if height >= 0.0:
                where = f"stopped {1e3 * (length_m - speaking_m):.0f} mm from the nut" if speaking_m < length_m else "open"
                raise ValueError(
                    f"board must lie below the string at rest, {where}, got {1e3 * height:+.3f} mm at {1e3 * x:.0f} mm; "
                    "raise the string or take less relief"
                )


def fingerboard(
    length_m: float, end_m: float, action_12th_m: float, relief_m: float, nut_height_m: float, stiffness_n_m2: float,
    restitution: float,
) -> Fingerboard:  # fmt: skip
    """A board from what a luthier measures on it, the string of `length_m` open and at rest.

    end_m         where it ends, from the nut
    action_12th   clearance half way along the string
    relief_m      hollow under a straightedge laid on both of its ends, half way
    nut_height_m  clearance at the nut

    Raises ValueError for a board that does not reach half way, or leaves the string.
    """
    half = 0.5 * length_m
    if not half < end_m < length_m:
        raise ValueError(
            f"board must end between half way and the saddle, {1e3 * half:g} and {1e3 * length_m:g} mm from the nut, got "
            f"{1e3 * end_m:g} mm"
        )
    slope = (action_12th_m + board_height(half, nut_height_m, 0.0, relief_m, end_m)) / half
    return Fingerboard(end_m, nut_height_m, slope, relief_m, stiffness_n_m2, restitution)
