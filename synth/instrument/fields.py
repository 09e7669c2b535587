"""What fields of a preset's file may hold: notes, numbers, numbers at anchor notes, within bounds."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any

from annotated_types import Ge, Le
from pydantic import AfterValidator, BeforeValidator

from synth.units import note_to_midi


def _note(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise ValueError("a note is a name such as C3 or F#2, or a MIDI number")
    number = note_to_midi(value) if isinstance(value, str) and not value.strip().isdigit() else int(value)
    if not 0 <= number <= 127:
        raise ValueError(f"a note lies between 0 and 127, got {number}")
    return number


Note = Annotated[int, BeforeValidator(_note), Ge(0), Le(127)]


def _note_range(value: Any) -> tuple[int, int]:
    if isinstance(value, list | tuple) and len(value) == 2:
        return _note(value[0]), _note(value[1])
    text = "" if isinstance(value, bool) or not isinstance(value, str | int) else str(value).strip()
    ends = re.fullmatch(r"([A-Ga-g][#b♯♭]*-?\d+|\d+)(?:\s*-\s*([A-Ga-g][#b♯♭]*-?\d+|\d+))?", text)
    if ends is None:
        raise ValueError(f"must be one note (G2) or a range (E1-C7), got {value!r}")
    low = _note(ends[1])
    return low, _note(ends[2]) if ends[2] else low


#: lowest and highest note
NoteRange = Annotated[tuple[int, int], BeforeValidator(_note_range)]


def _number(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"must be {what}, got {value!r}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"must be finite, got {number}")
    return number


def anchors(value: Any) -> Any:
    if isinstance(value, Mapping):
        if not value:
            raise ValueError("anchors need at least one note")
        return {_note(key): _number(number, "a number at every note") for key, number in value.items()}
    return _number(value, "a number, or numbers at notes such as { C2 = 1.0, C4 = 0.5 }")


#: a number, or numbers at anchor notes
Scaled = Annotated[float | dict[int, float], BeforeValidator(anchors)]


def at_note(value: float | dict[int, float], note: float) -> float:
    """The value of an anchored number at a MIDI note."""
    if not isinstance(value, dict):
        return value
    points = sorted(value.items())
    if note <= points[0][0]:
        return points[0][1]
    for (n0, v0), (n1, v1) in pairwise(points):
        if note <= n1:
            s = (note - n0) / (n1 - n0)
            if v0 > 0.0 and v1 > 0.0:
                return v0 * (v1 / v0) ** s
            return v0 + s * (v1 - v0)
    return points[-1][1]


def scaled(value: float | dict[int, float], factor: float) -> float | dict[int, float]:
    """A number, or numbers at anchor notes, times a factor."""
    return {note: each * factor for note, each in value.items()} if isinstance(value, dict) else value * factor


@dataclass(frozen=True)
class Between:
    """A plain or anchored number lies in [low, high]."""

    low: float
    high: float

    def __call__(self, value: float | dict[int, float]) -> float | dict[int, float]:
        for number in value.values() if isinstance(value, dict) else (value,):
            if not self.low <= number <= self.high:
                raise ValueError(f"must lie between {self.low:g} and {self.high:g}, got {number:g}")
        return value


def within(low: float, high: float) -> AfterValidator:
    return AfterValidator(Between(low, high))


@dataclass(frozen=True)
class EachBetween:
    """All numbers of a list lie in [low, high]."""

    low: float
    high: float

    def __call__(self, values: tuple[float, ...]) -> tuple[float, ...]:
        for number, value in enumerate(values, start=1):
            if not self.low <= value <= self.high:
                raise ValueError(f"number {number} must lie between {self.low:g} and {self.high:g}, got {value:g}")
        return values


def each_within(low: float, high: float) -> AfterValidator:
    return AfterValidator(EachBetween(low, high))
