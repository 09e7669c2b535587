"""Vector operations that the kernels share."""

from __future__ import annotations

from typing import Any

from numba import njit

#: an inner kernel, called by kernels only: without the wrapper for Python, up to a second for what takes many arrays; and
#: without counting references to arrays, of which it makes none: a call for each one, and for each part of one
INNER: dict[str, Any] = {"cache": True, "nogil": True, "no_cpython_wrapper": True, "_nrt": False}
#: sums may be reordered and contracted (vectorised, FMA); NaN and infinity keep their meaning.
FAST = {"reassoc", "contract", "nsz"}


@njit(cache=True, nogil=True, fastmath=FAST)
def dot(a, b) -> float:
    """Σ a_j b_j over b's length."""
    total = 0.0
    for j in range(b.size):
        total += a[j] * b[j]
    return total


@njit(fastmath=FAST, **INNER)
def squares(a, b) -> tuple[float, float]:
    """Σ a_j² and Σ b_j² over b's length."""
    first, second = 0.0, 0.0
    for j in range(b.size):
        first += a[j] * a[j]
        second += b[j] * b[j]
    return first, second


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
