"""Vector operations that the kernels share."""

from __future__ import annotations

from typing import Any

from numba import njit

#: an inner kernel, called by kernels only: without the wrapper for Python, up to a second for what takes many arrays
INNER: dict[str, Any] = {"cache": True, "nogil": True, "no_cpython_wrapper": True}
#: sums may be reordered and contracted (vectorised, FMA); NaN and infinity keep their meaning.
FAST = {"reassoc", "contract", "nsz"}


@njit(cache=True, nogil=True, fastmath=FAST)
def dot(a, b) -> float:
    """Σ a_j b_j over b's length."""
    total = 0.0
    for j in range(b.size):
        total += a[j] * b[j]
    return total


@njit(**INNER)
def put(into, x) -> None:
    """into = x over x's length. (To assign to a slice is to compile what words the refusal of another length, too: 4 s.)"""
    for i in range(x.size):
        into[i] = x[i]


@njit(cache=True, nogil=True, fastmath=FAST)
def add(factor: float, x, y) -> None:
    """y += factor·x over x's length."""
    for i in range(x.size):
        y[i] += factor * x[i]
