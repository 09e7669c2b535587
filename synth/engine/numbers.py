"""Numbers that are given from outside, checked: each error names the number, what it must be and what it is."""

from __future__ import annotations

import math
import operator
from typing import Any


def a_number(name: str, value: Any, low: float, high: float, unit: str = "") -> float:
    """A finite number from low to high. Raises TypeError or ValueError that names it."""
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise TypeError(f"{name} must be a number, got {value!r}") from None
    except OverflowError:
        number = math.inf
    if isinstance(value, str | bytes):
        raise TypeError(f"{name} must be a number, got {value!r}")
    if not low <= number <= high:
        raise ValueError(f"{name} must lie between {low:g} and {high:g}{unit}, got {number:g}")
    return number


def a_count(name: str, value: Any, least: int, most: int) -> int:
    """A whole number from least to most. Raises TypeError or ValueError that names it."""
    try:
        count = operator.index(value)
    except TypeError:
        raise TypeError(f"{name} must be a whole number, got {value!r}") from None
    if isinstance(value, bool):
        raise TypeError(f"{name} must be a whole number, got {value!r}")
    if count < least:
        raise ValueError(f"{name} must be at least {least}, got {count}")
    if count > most:
        raise ValueError(f"{name} must be at most {most}, got {count}")
    return count
