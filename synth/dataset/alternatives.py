"""What a key of a recipe may hold: one value, a list of values, a range that is divided or drawn from.

    0.3                                          always this
    [0.1, 0.2, 0.3]                              each of these, with each of every other list
    { from = 0.1, to = 0.3, steps = 5 }          the same: five values evenly (scale = "log": in equal ratios)
    { from = 0.1, to = 0.3 }                     drawn for each item, evenly (scale = "log": evenly in ratios)
    { mean = 0.2, spread = 0.02, low = 0.1, high = 0.3 }    drawn from a normal distribution, between low and high
    { one_of = [0.1, 0.2] }                      drawn from a list

What is drawn follows from one number between 0 and 1 that belongs to item and key, and to nothing else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

_TABLES = ({"from", "to"}, {"mean", "spread"}, {"one_of"})
_MAY = {"from": {"steps", "scale", "whole"}, "mean": {"low", "high", "whole"}, "one_of": set()}
SCALES = ("linear", "log")
#: most values of one list
MOST_VALUES = 1_000_000


@dataclass(frozen=True)
class Alternatives:
    """What a key may be. `values`: of a list or of one value; empty: it is drawn, by `draw`."""

    values: tuple[Any, ...] = ()
    low: float = 0.0
    high: float = 1.0
    mean: float | None = None
    spread: float = 0.0
    log: bool = False
    whole: bool = False
    one_of: tuple[Any, ...] = ()

    @property
    def drawn(self) -> bool:
        """Whether each item has a value of its own."""
        return not self.values

    def draw(self, share: float) -> Any:
        """The value that a number from 0 to 1 (excluded) stands for."""
        if self.one_of:
            return self.one_of[min(int(share * len(self.one_of)), len(self.one_of) - 1)]
        if self.values:
            return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
        if self.mean is not None:
            value = self._normal(share)
        elif self.whole:
            return int(self.low) + min(int(share * (self.high - self.low + 1)), int(self.high - self.low))
        elif self.log:
            value = self.low * (self.high / self.low) ** share
        else:
            value = self.low + (self.high - self.low) * share
        return min(max(round(value), math.ceil(self.low)), math.floor(self.high)) if self.whole else value

    def _normal(self, share: float) -> float:
        """Of the part of the distribution between low and high; what lies outside is not heaped at the ends."""
        assert self.mean is not None
        if self.spread == 0.0:
            return min(max(self.mean, self.low), self.high)
        normal = NormalDist(self.mean, self.spread)
        begin = normal.cdf(self.low) if math.isfinite(self.low) else 0.0
        end = normal.cdf(self.high) if math.isfinite(self.high) else 1.0
        at = begin + (end - begin) * share
        if not 0.0 < at < 1.0:
            return min(max(self.mean, self.low), self.high)
        return min(max(normal.inv_cdf(at), self.low), self.high)

    def ends(self) -> tuple[Any, ...]:
        """Values to be looked at before any is used: all of a list, the ends of a range."""
        if self.values or self.one_of:
            return self.values or self.one_of
        return tuple(end for end in (self.low, self.high) if math.isfinite(end)) or (self.mean,)


def alternatives(given: Any, *, whole: bool = False) -> Alternatives:
    """Of what stands in a file; see the module's description. whole: only whole numbers. Raises ValueError."""
    if isinstance(given, list | tuple):
        if not given:
            raise ValueError("must hold at least one value, got an empty list; leave the key out for the default")
        if len(given) > MOST_VALUES:
            raise ValueError(f"must hold at most {MOST_VALUES} values, got {len(given)}")
        return Alternatives(tuple(_plain(each, whole) for each in given))
    if not isinstance(given, dict):
        return Alternatives((_plain(given, whole),))
    kind = next((keys for keys in _TABLES if keys <= set(given)), None)
    if kind is None:
        raise ValueError(f"must have from and to, mean and spread, or one_of, got {', '.join(map(str, given)) or 'none'}")
    first = "from" if "from" in kind else "mean" if "mean" in kind else "one_of"
    unknown = sorted(set(given) - kind - _MAY[first])
    if unknown:
        may = ", ".join(sorted(_MAY[first])) or "nothing"
        raise ValueError(f"has no key {unknown[0]!r} beside {' and '.join(sorted(kind))}; it may have {may}")
    if first == "one_of":
        listed = given["one_of"]
        if not isinstance(listed, list) or not listed:
            raise ValueError(f"one_of must be a list of values, got {listed!r}")
        return Alternatives(one_of=tuple(_plain(each, whole) for each in listed))
    return _range(given, whole) if first == "from" else _spread(given, whole)


def _plain(value: Any, whole: bool) -> Any:
    if isinstance(value, dict):
        raise ValueError("must be a list of values, got a table among them; a range stands alone")
    if whole and (isinstance(value, bool) or not isinstance(value, int)):
        raise ValueError(f"must be a whole number, got {value!r}")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"must be a finite number, got {value!r}")
    return value


def _number(given: dict[str, Any], key: str, default: float | None = None) -> float:
    value = given.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        if value is default and value is not None:
            return float(value)
        raise ValueError(f"{key} must be a finite number, got {value!r}")
    return float(value)


def _range(given: dict[str, Any], whole: bool) -> Alternatives:
    low, high = _number(given, "from"), _number(given, "to")
    scale = given.get("scale", "linear")
    if scale not in SCALES:
        raise ValueError(f"scale must be one of {', '.join(SCALES)}, got {scale!r}")
    if not low <= high:
        raise ValueError(f"from must not lie above to, got {low:g} and {high:g}")
    if scale == "log" and low <= 0.0:
        raise ValueError(f'scale = "log" needs from above 0, got {low:g}')
    whole = _whole(given, whole)
    if whole and (low != int(low) or high != int(high)):
        raise ValueError(f"from and to must be whole numbers, got {low:g} and {high:g}")
    if "steps" not in given:
        return Alternatives(low=low, high=high, log=scale == "log", whole=whole)
    steps = given["steps"]
    if isinstance(steps, bool) or not isinstance(steps, int) or not 1 <= steps <= MOST_VALUES:
        raise ValueError(f"steps must be a whole number from 1 to {MOST_VALUES}, got {steps!r}")
    shares = [k / max(1, steps - 1) for k in range(steps)]
    values = [low * (high / low) ** share if scale == "log" else low + (high - low) * share for share in shares]
    if steps > 1:
        values[-1] = high
    return Alternatives(tuple(dict.fromkeys(round(value) for value in values)) if whole else tuple(values))


def _spread(given: dict[str, Any], whole: bool) -> Alternatives:
    mean, spread = _number(given, "mean"), _number(given, "spread")
    low, high = _number(given, "low", -math.inf), _number(given, "high", math.inf)
    if spread < 0.0:
        raise ValueError(f"spread must not be below 0, got {spread:g}")
    if not low <= mean <= high:
        raise ValueError(f"mean must lie between low and high, got {mean:g} outside {low:g} to {high:g}")
    return Alternatives(low=low, high=high, mean=mean, spread=spread, whole=_whole(given, whole))


def _whole(given: dict[str, Any], whole: bool) -> bool:
    asked = given.get("whole", whole)
    if not isinstance(asked, bool):
        raise ValueError(f"whole must be true or false, got {asked!r}")
    return asked or whole
