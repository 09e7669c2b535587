"""Vector operations that the kernels share."""

from __future__ import annotations

from numba import njit

#: sums may be reordered and contracted (vectorised, FMA); NaN and infinity keep their meaning.
FAST = {"reassoc", "contract", "nsz"}


@njit(cache=True, nogil=True, fastmath=FAST)
def dot(a, b) -> float:
    """Σ a_j b_j over b's length."""
    total = 0.0
    for j in range(b.size):
        total += a[j] * b[j]
    return total


@njit(cache=True, nogil=True)
def put(into, x) -> None:
    """into = x over x's length. (To assign to a slice is to compile what words the refusal of another length, too: 4 s.)"""
    for i in range(x.size):
        into[i] = x[i]


@njit(cache=True, nogil=True, fastmath=FAST)
def add(factor: float, x, y) -> None:
    """y += factor·x over x's length."""
    for i in range(x.size):
        y[i] += factor * x[i]
