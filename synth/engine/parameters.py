"""Live parameters of parts: what PARAMETER events set, and which controllers set them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from synth.engine import layout
from synth.engine.expression import CONTROL_S
from synth.instrument.preset import BridgeObstacle, Preset

GAIN_SMOOTHING_S = 0.015
#: controllers that keep their meaning: bank select, data entry, pedal, parameter numbers, channel modes
NOT_TO_BE_BOUND = frozenset({0, 32, 6, 38, 64, *range(96, 102), *range(120, 128)})

#: (part or None, id, value at 0, value at 127); None for an end of the parameter's range
Binding = tuple[int | None, str, float | None, float | None]
Bindings = Mapping[int, str | Sequence[Binding]]


@dataclass(frozen=True)
class Parameter:
    """A live parameter of a part, one of `Engine.parameters`: what a PARAMETER event sets.

    Attributes
    ----------
    part : int
        Its part, the event's `channel`.
    index : int
        The event's `a`.
    id, name, unit : str
        Such as "pluck.position", and words and unit for people.
    minimum, maximum, default : float
        Range, to which values of events are brought, and value to begin with, in the unit.
    smoothing_s : float
        Time in which it follows a change [s]; 0: from the next pluck on.

    Examples
    --------
    >>> import synth
    >>> engine = synth.Engine(["tanpura"])
    >>> [parameter.id for parameter in engine.parameters][:2]
    ['output.gain', 'pluck.position']
    """

    part: int
    index: int
    id: str
    name: str
    unit: str
    minimum: float
    maximum: float
    default: float
    smoothing_s: float


#: index of every parameter by its id
INDEX_OF = {
    "output.gain": layout.GAIN,
    "pluck.position": layout.PLUCK_POSITION,
    "pluck.amount": layout.PLUCK_AMOUNT,
    "pluck.width": layout.PLUCK_WIDTH,
    "damping.release": layout.RELEASE,
    "obstacle.height": layout.HEIGHT,
    "hand.variation": layout.VARIATION,
}


def parameters_of(part: int, preset: Preset) -> list[Parameter]:
    """The live parameters of part number `part`."""
    pluck = preset.pluck
    rows: list[tuple[str, str, str, float, float]] = [
        ("output.gain", "Level", "×", 1.0, GAIN_SMOOTHING_S),
        ("pluck.position", "Pluck position from the saddle", "of L", pluck.position, 0.0),
        ("pluck.amount", "Pluck displacement", "×", 1.0, 0.0),
        ("pluck.width", "Finger width", "mm", pluck.width_mm, 0.0),
        ("damping.release", "Damping time", "×", 1.0, 0.0),
    ]
    if isinstance(preset.obstacle, BridgeObstacle):
        name = "Bridge raised against the thread" if preset.obstacle.has_thread else "Bridge raised (jawari)"
        rows.append(("obstacle.height", name, "µm", 0.0, CONTROL_S))
    if preset.hand.varies:
        rows.append(("hand.variation", "Variation from stroke to stroke", "×", 1.0, 0.0))
    out = []
    for identity, name, unit, default, smoothing in rows:
        index = INDEX_OF[identity]
        low, high = layout.PARAMETER_RANGES[index]
        out.append(Parameter(part, index, identity, name, unit, low, high, default, smoothing))
    return out


def check_binding(controller: int, identity: str, low: float | None, high: float | None) -> tuple[float, float]:
    """(value at 0, value at 127) of a binding. Raises ValueError for a controller, id or range that cannot be."""
    if not 0 <= controller < 128:
        raise ValueError(f"a controller must lie between 0 and 127, got {controller}")
    if controller in NOT_TO_BE_BOUND:
        raise ValueError(
            f"controller {controller} cannot be bound: 0, 6, 32, 38, 64, 96-101 and 120-127 keep their standard meaning"
        )
    if identity not in INDEX_OF:
        raise ValueError(f"no live parameter {identity!r}; there are {', '.join(INDEX_OF)}")
    lowest, highest = layout.PARAMETER_RANGES[INDEX_OF[identity]]
    ends = lowest if low is None else float(low), highest if high is None else float(high)
    for end in ends:
        if not (math.isfinite(end) and lowest <= end <= highest):
            raise ValueError(f"{identity} must lie between {lowest:g} and {highest:g}, got {end:g}")
    return ends


def bound_rows(bindings: Bindings, parts: Sequence[Preset]) -> list[tuple[int, int, int, float, float]]:
    """Rows (controller, part, index, value at 0, value at 127). Raises ValueError for what no part has."""
    out = []
    for controller, bound in bindings.items():
        rows: Sequence[Binding] = [(None, bound, None, None)] if isinstance(bound, str) else bound
        for part, identity, low, high in rows:
            ends = check_binding(controller, identity, low, high)
            if part is not None and not 0 <= part < len(parts):
                raise ValueError(f"controller {controller} is bound to part {part}, but parts go from 0 to {len(parts) - 1}")
            index = INDEX_OF[identity]
            those = [
                p
                for p in (range(len(parts)) if part is None else (part,))
                if any(parameter.index == index for parameter in parameters_of(p, parts[p]))
            ]
            if not those:
                names = ", ".join(sorted({preset.name for preset in parts}))
                raise ValueError(f"controller {controller} is bound to {identity}, which no part has ({names})")
            out += [(controller, p, index, *ends) for p in those]
    return out
