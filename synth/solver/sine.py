"""Sine transforms of modes to nodes of the modal grid and back: y_i = Σ_j a_j sin(π i j/n), i, j = 1 … n − 1.

The nodes x_i = iL/n and the n − 1 modes of a string are each other's transform. Two rows are transformed at once, by one
complex FFT of length n where n is a power of two of 128 and more, and otherwise by a matrix, which up to there is faster
(`tools/wall-study transform`). Compiled and free of allocation, so that a contact law can call it in every step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from synth.solver.vectors import FAST

_FFT_FROM = 128


class Sine(NamedTuple):
    """Tables and work space of a transform of n − 1 points."""

    half: np.ndarray  # (n,) sin(πk/n)
    cosine: np.ndarray  # (n/2,) twiddle factors e^{−2πik/n}; empty: no power of two, `matrix` is used
    sine: np.ndarray
    matrix: np.ndarray  # (n − 1, n − 1), or (0, 0)
    work: np.ndarray  # (4, n)


def make_sine(n: int, dense: bool | None = None) -> Sine:
    """The transform for n intervals of the grid, n ≥ 2; `dense` forces the matrix, or the FFT where n allows."""
    if n < 2:
        raise ValueError(f"intervals of the modal grid must be >= 2, got {n}")
    k = np.arange(n)
    half = np.sin(np.pi * k / n)
    if dense is None:
        dense = n < _FFT_FROM
    if dense or n & (n - 1):
        inner = np.arange(1, n)
        matrix = np.sin(np.pi / n * (np.outer(inner, inner) % (2 * n)))
        return Sine(half, np.zeros(0), np.zeros(0), matrix, np.zeros((4, n)))
    angle = 2.0 * np.pi * np.arange(n // 2) / n
    return Sine(half, np.cos(angle), -np.sin(angle), np.zeros((0, 0)), np.zeros((4, n)))


@njit(cache=True, nogil=True, fastmath=FAST)
def _fft(ar, ai, br, bi, cosine, sine) -> bool:
    """Radix-2 Stockham FFT of ar + i·ai, in natural order; True where the result is in br, bi."""
    swapped = False
    groups, length = cosine.size, 1
    while groups >= 1:
        for j in range(groups):
            c, s = cosine[j * length], sine[j * length]
            first, second, to = j * length, (j + groups) * length, 2 * j * length
            for k in range(length):
                ur, ui, vr, vi = ar[first + k], ai[first + k], ar[second + k], ai[second + k]
                br[to + k] = ur + vr
                bi[to + k] = ui + vi
                dr, di = ur - vr, ui - vi
                br[to + length + k] = c * dr - s * di
                bi[to + length + k] = c * di + s * dr
        ar, br = br, ar
        ai, bi = bi, ai
        swapped = not swapped
        groups //= 2
        length *= 2
    return swapped


@njit(cache=True, nogil=True, fastmath=FAST)
def transform(tables: Sine, a, b, out_a, out_b) -> None:
    """Sine transforms of a and b (n − 1,) into out_a and out_b, which may not be a or b."""
    n = tables.half.size
    if tables.cosine.size == 0:
        for i in range(n - 1):
            x, y = 0.0, 0.0
            for j in range(n - 1):
                x += tables.matrix[i, j] * a[j]
                y += tables.matrix[i, j] * b[j]
            out_a[i] = x
            out_b[i] = y
        return
    re, im = tables.work[0], tables.work[1]
    re[0] = 0.0
    im[0] = 0.0
    for j in range(1, n):
        s = tables.half[j]
        re[j] = s * (a[j - 1] + a[n - j - 1]) + 0.5 * (a[j - 1] - a[n - j - 1])
        im[j] = s * (b[j - 1] + b[n - j - 1]) + 0.5 * (b[j - 1] - b[n - j - 1])
    if _fft(re, im, tables.work[2], tables.work[3], tables.cosine, tables.sine):
        re, im = tables.work[2], tables.work[3]
    # even outputs are −Im of the row's own spectrum, odd ones the running sum of its Re
    x, y = 0.5 * re[0], 0.5 * im[0]
    out_a[0] = x
    out_b[0] = y
    for k in range(1, n // 2):
        out_a[2 * k - 1] = -0.5 * (im[k] - im[n - k])
        out_b[2 * k - 1] = 0.5 * (re[k] - re[n - k])
        x += 0.5 * (re[k] + re[n - k])
        y += 0.5 * (im[k] + im[n - k])
        out_a[2 * k] = x
        out_b[2 * k] = y
