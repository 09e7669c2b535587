"""Two answers to one scene, array by array and bit by bit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

EQUAL, DIFFERS, MISSING, NEW = "equal", "differs", "missing", "new"
#: arrays that are sound, (frames, channels): a render writes them as float32
SOUND = ("out", "stem")


@dataclass(frozen=True)
class Finding:
    """What came of one array. `verdict`: EQUAL, DIFFERS, MISSING (the working tree has it no more) or NEW (BASE has it not).

    largest     absolute difference; infinite where only one of the two is finite
    ulps        the largest in units in the last place of the array's own type; None: not a floating-point array
    written     (samples, ulps) that differ once they are rounded to float32; None: not a sound of float64
    first       index of the first difference, in the order of the first axis
    count, size elements that differ, and that there are
    nans        NaN on both sides, at the same places: those are equal
    shapes      said where they differ; the rest is then of the common beginning
    """

    array: str
    verdict: str
    largest: float = 0.0
    ulps: int | None = None
    written: tuple[int, int] | None = None
    first: tuple[int, ...] = ()
    count: int = 0
    size: int = 0
    nans: int = 0
    shapes: str = ""

    def line(self) -> str:
        """In words."""
        if self.verdict == MISSING:
            return f"{self.array} is missing in the working tree"
        if self.verdict == NEW:
            return f"{self.array} does not exist in BASE"
        nans = f"; NaN at the same {self.nans} places" if self.nans else ""
        if self.verdict == EQUAL:
            return f"{self.array} equal{nans}"
        parts = [self.shapes] if self.shapes else []
        if self.count:
            amount = f"largest difference {self.largest:.3g}"
            if self.ulps is not None:
                amount += f", {self.ulps} ulp"
            if self.largest == 0.0:
                amount = "only the signs of zeros differ"
            parts.append(amount)
            if self.written is not None:
                parts.append(
                    "as float32 {} differ, by {} ulp".format(*self.written) if self.written[0] else "as float32 equal"
                )
            if self.first:
                parts.append(f"first at {_place(self.array, self.first)}")
            parts.append(f"{self.count} of {self.size}")
        elif self.size:
            parts.append(f"equal as far as both go ({self.size})")
        return f"{self.array}: {'; '.join(parts)}{nans}"


def compared(base: Mapping[str, np.ndarray], here: Mapping[str, np.ndarray]) -> list[Finding]:
    """A finding for every array of the two."""
    found = [compare(name, base[name], here[name]) for name in base if name in here]
    found += [Finding(name, MISSING) for name in base if name not in here]
    return found + [Finding(name, NEW) for name in here if name not in base]


def compare(array: str, base: np.ndarray, here: np.ndarray) -> Finding:
    """Bit by bit, but that every NaN equals a NaN; −0.0 is not 0.0."""
    base, here = np.asarray(base), np.asarray(here)
    if base.dtype != here.dtype:
        return Finding(array, DIFFERS, shapes=f"was {base.dtype}, is {here.dtype}")
    if base.shape == here.shape:
        return _values(array, base, here, "")
    shapes = f"shape was {base.shape}, is {here.shape}"
    if base.ndim != here.ndim or base.shape[1:] != here.shape[1:]:
        return Finding(array, DIFFERS, shapes=shapes)
    common = min(len(base), len(here))
    return _values(array, base[:common], here[:common], shapes)


def ulps_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Steps from one float to the other, (n,) uint64: from −0.0 to 0.0 there is none. NaN must not be among them."""
    a, b = _ordered(a), _ordered(b)
    return np.maximum(a, b).view(np.uint64) - np.minimum(a, b).view(np.uint64)  # wraps to what it is


def _ordered(a: np.ndarray) -> np.ndarray:
    """Integers in the order of the floats, the next float being the next integer."""
    size = a.dtype.itemsize
    bits = np.ascontiguousarray(a).view(f"i{size}").astype(np.int64)
    return np.where(bits < 0, -(2 ** (8 * size - 1)) - bits, bits)


def _values(array: str, base: np.ndarray, here: np.ndarray, shapes: str) -> Finding:
    if base.dtype.kind != "f":
        differs = base != here
        return _finding(array, shapes, base, here, differs, 0, None, None)
    nan_base, nan_here = np.isnan(base), np.isnan(here)
    both = nan_base & nan_here
    bits = f"u{base.dtype.itemsize}"
    differs = (np.ascontiguousarray(base).view(bits) != np.ascontiguousarray(here).view(bits)).reshape(base.shape) & ~both
    numbers = differs & ~(nan_base | nan_here)
    ulps = _most(ulps_between(base[numbers], here[numbers]))
    written = None
    if base.dtype == np.float64 and array.startswith(SOUND):
        with np.errstate(over="ignore"):
            a, b = base[numbers].astype(np.float32), here[numbers].astype(np.float32)
        apart = ulps_between(a, b)
        written = int(np.count_nonzero(apart)) + int(np.count_nonzero(differs & ~numbers)), _most(apart)
    return _finding(array, shapes, base, here, differs, int(np.count_nonzero(both)), ulps, written)


def _finding(
    array: str, shapes: str, base: np.ndarray, here: np.ndarray, differs: np.ndarray, nans: int,
    ulps: int | None, written: tuple[int, int] | None,
) -> Finding:  # fmt: skip
    count = int(np.count_nonzero(differs))
    verdict = DIFFERS if count or shapes else EQUAL
    if not count:
        return Finding(array, verdict, size=base.size, nans=nans, shapes=shapes)
    largest = math.inf
    if base.dtype.kind in "fiub":
        with np.errstate(invalid="ignore", over="ignore"):
            apart = np.abs(base[differs].astype(np.float64) - here[differs].astype(np.float64))
        largest = math.inf if np.isnan(apart).any() else float(apart.max())
    first = tuple(int(i) for i in np.argwhere(differs)[0])
    return Finding(array, verdict, largest, ulps, written, first, count, base.size, nans, shapes)


def _most(values: np.ndarray) -> int:
    return int(values.max()) if values.size else 0


def _place(array: str, index: Sequence[int]) -> str:
    axes = ("frame", "channel") if array.startswith(SOUND) else ("row", "column")
    return ", ".join(f"{axes[min(i, 1)]} {at}" for i, at in enumerate(index))
