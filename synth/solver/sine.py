"""Sine transforms of modes to nodes of the modal grid and back: y_i = Σ_j a_j sin(π i j/n), i, j = 1 … n − 1.

The nodes x_i = iL/n and the n − 1 modes of a string are each other's transform. Two rows are transformed at once, by one
complex FFT of length n where n is a power of two of 64 and more, and otherwise by a matrix, which up to there is faster
(`tools/wall-study transform`). Compiled and free of allocation, so that a contact law can call it in every step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from synth.solver.vectors import FAST

_FFT_FROM = 64


class Sine(NamedTuple):
    """Tables and work space of a transform of n − 1 points."""

    half: np.ndarray  # (n,) sin(πk/n)
    twiddles: np.ndarray  # (6, n/4) Re and Im of e^{−2πipk/n}, p = 1, 2, 3; (6, 0): no power of two, `matrix` is used
    matrix: np.ndarray  # (n − 1, n − 1), or (0, 0)
    work: np.ndarray  # (4, n)


def make_sine(n: int, dense: bool | None = None) -> Sine:
    """The transform for n intervals of the grid, n ≥ 2; `dense` forces the matrix, or the FFT where n allows."""
    if n < 2:
        raise ValueError(f"the modal grid must have at least 2 intervals, got {n}")
    k = np.arange(n)
    half = np.sin(np.pi * k / n)
    if dense is None:
        dense = n < _FFT_FROM
    if dense or n & (n - 1) or n < 4:
        inner = np.arange(1, n)
        matrix = np.sin(np.pi / n * (np.outer(inner, inner) % (2 * n)))
        return Sine(half, np.zeros((6, 0)), matrix, np.zeros((4, n)))
    angle = 2.0 * np.pi * np.outer([1, 2, 3], np.arange(n // 4)) / n
    twiddles = np.stack([np.cos(angle), -np.sin(angle)], axis=1).reshape(6, n // 4)
    return Sine(half, twiddles, np.zeros((0, 0)), np.zeros((4, n)))


@njit(inline="always")
def _butterfly(x0, y0, x1, y1, x2, y2, x3, y3):
    """The discrete Fourier transform of four numbers x + iy."""
    er, ei, fr, fi = x0 + x2, y0 + y2, x0 - x2, y0 - y2
    gr, gi, hr, hi = x1 + x3, y1 + y3, x1 - x3, y1 - y3
    return er + gr, ei + gi, fr + hi, fi - hr, er - gr, ei - gi, fr - hi, fi + hr


@njit(cache=True, nogil=True, fastmath=FAST)
def _first_pass(ar, ai, br, bi, w) -> None:
    """`_pass` of stride 1, the loop over what a stride holds turned inside out."""
    quarter = w.shape[1]
    ar0, ar1, ar2, ar3 = ar[:quarter], ar[quarter : 2 * quarter], ar[2 * quarter : 3 * quarter], ar[3 * quarter :]
    ai0, ai1, ai2, ai3 = ai[:quarter], ai[quarter : 2 * quarter], ai[2 * quarter : 3 * quarter], ai[3 * quarter :]
    c1, s1, c2, s2, c3, s3 = w[0], w[1], w[2], w[3], w[4], w[5]
    for p in range(quarter):
        r0, i0, r1, i1, r2, i2, r3, i3 = _butterfly(ar0[p], ai0[p], ar1[p], ai1[p], ar2[p], ai2[p], ar3[p], ai3[p])
        br[4 * p] = r0
        bi[4 * p] = i0
        br[4 * p + 1] = c1[p] * r1 - s1[p] * i1
        bi[4 * p + 1] = c1[p] * i1 + s1[p] * r1
        br[4 * p + 2] = c2[p] * r2 - s2[p] * i2
        bi[4 * p + 2] = c2[p] * i2 + s2[p] * r2
        br[4 * p + 3] = c3[p] * r3 - s3[p] * i3
        bi[4 * p + 3] = c3[p] * i3 + s3[p] * r3


@njit(inline="always")
def _pass(ar, ai, br, bi, w, stride):
    quarter = ar.size // 4
    for p in range(quarter // stride):
        k = p * stride
        c1, s1, c2, s2, c3, s3 = w[0, k], w[1, k], w[2, k], w[3, k], w[4, k], w[5, k]
        to = 4 * k
        for q in range(stride):
            r0, i0, r1, i1, r2, i2, r3, i3 = _butterfly(
                ar[k + q], ai[k + q], ar[k + quarter + q], ai[k + quarter + q],
                ar[k + 2 * quarter + q], ai[k + 2 * quarter + q], ar[k + 3 * quarter + q], ai[k + 3 * quarter + q],
            )  # fmt: skip
            br[to + q] = r0
            bi[to + q] = i0
            br[to + stride + q] = c1 * r1 - s1 * i1
            bi[to + stride + q] = c1 * i1 + s1 * r1
            br[to + 2 * stride + q] = c2 * r2 - s2 * i2
            bi[to + 2 * stride + q] = c2 * i2 + s2 * r2
            br[to + 3 * stride + q] = c3 * r3 - s3 * i3
            bi[to + 3 * stride + q] = c3 * i3 + s3 * r3


@njit(cache=True, nogil=True, fastmath=FAST)
def _pass_by(ar, ai, br, bi, w, stride) -> None:
    """One pass; strides are numbers the compiler knows, so that it turns the inner loop into vectors."""
    if stride == 4:
        _pass(ar, ai, br, bi, w, 4)
    elif stride == 16:
        _pass(ar, ai, br, bi, w, 16)
    elif stride == 64:
        _pass(ar, ai, br, bi, w, 64)
    elif stride == 256:
        _pass(ar, ai, br, bi, w, 256)
    else:
        _pass(ar, ai, br, bi, w, stride)


@njit(cache=True, nogil=True, fastmath=FAST)
def _last_pass(ar, ai, br, bi) -> None:
    """Radix 2, where n is no power of four."""
    m = ar.size // 2
    for q in range(m):
        br[q] = ar[q] + ar[m + q]
        bi[q] = ai[q] + ai[m + q]
    for q in range(m):
        br[m + q] = ar[q] - ar[m + q]
        bi[m + q] = ai[q] - ai[m + q]


@njit(cache=True, nogil=True, fastmath=FAST)
def _fft(ar, ai, br, bi, w) -> bool:
    """Radix-4 Stockham FFT of ar + i·ai, in natural order; True where the result is in br, bi."""
    _first_pass(ar, ai, br, bi, w)
    swapped, stride = True, 4
    while 2 * stride <= ar.size:
        ar, br = br, ar
        ai, bi = bi, ai
        swapped = not swapped
        if 2 * stride == ar.size:
            _last_pass(ar, ai, br, bi)
        else:
            _pass_by(ar, ai, br, bi, w, stride)
        stride *= 4
    return swapped


@njit(cache=True, nogil=True, fastmath=FAST)
def transform(tables: Sine, a, b, out_a, out_b) -> None:
    """Sine transforms of a and b (n − 1,) into out_a and out_b, which may not be a or b."""
    n = tables.half.size
    if tables.twiddles.size == 0:
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
    if _fft(re, im, tables.work[2], tables.work[3], tables.twiddles):
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
