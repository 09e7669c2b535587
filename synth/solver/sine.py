"""Sine transforms of modes to nodes of the modal grid and back: y_i = Σ_j a_j sin(π i j/n), i, j = 1 … n − 1.

The nodes x_i = iL/n and the n − 1 modes of a string are each other's transform. Two rows are transformed at once, by one
complex FFT of length n where n is a power of two of 64 and more, and otherwise by a matrix, which up to there is faster
(`tools/wall-study transform`). Compiled and free of allocation, so that a contact law can call it in every step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils

from synth.native.interpreted import intrinsic
from synth.native.simd import INT, Code
from synth.solver.vectors import FAST, INNER

_FFT_FROM = 64
#: of what Python calls, too, without counting references to arrays
_CALLED: dict[str, Any] = {"cache": True, "nogil": True, "_nrt": False}


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


@njit(fastmath=FAST, **INNER)
def _first_pass(ar, ai, br, bi, w) -> None:
    """The pass of stride 1, in a loop that the compiler turns into vectors."""
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


def _plain_pass(ar, ai, br, bi, w, stride: int) -> None:
    """One pass of any stride."""
    quarter = w.shape[1]
    for k in range(0, quarter, stride):
        for q in range(k, k + stride):
            others = _butterfly(*(each[q + p * quarter] for p in range(4) for each in (ar, ai)))
            to = q + 3 * k
            br[to], bi[to] = others[:2]
            for p in range(1, 4):
                to += stride
                x, y, c, s = others[2 * p], others[2 * p + 1], w[2 * p - 2, k], w[2 * p - 1, k]
                br[to], bi[to] = c * x - s * y, c * y + s * x


@intrinsic(plain=_plain_pass)
def _pass(typingctx, ar, ai, br, bi, w, stride):
    """One pass of a stride that is a multiple of 4, in vectors of four."""

    def emit(context, builder, signature, args):
        code, b = Code(context, builder, signature, args, doubles=4), builder
        at_r, at_i, to_r, to_i, at_w = (code.data(i) for i in range(5))
        quarter, four = code.row_length(4), ir.Constant(INT, 4)
        with cgutils.for_range_slice(b, ir.Constant(INT, 0), quarter, args[5], INT) as (k, _):
            turns = [code.splat(b.load(b.gep(row, [k]))) for row in code.rows(at_w, quarter, range(6))]
            with cgutils.for_range_slice(b, ir.Constant(INT, 0), args[5], four, INT) as (q, _):
                at, here = b.add(k, q), []
                for _p in range(4):
                    here.append((code.load(at_r, at), code.load(at_i, at)))
                    at = b.add(at, quarter)
                (x0, y0), (x1, y1), (x2, y2), (x3, y3) = here
                er, ei, fr, fi = b.fadd(x0, x2), b.fadd(y0, y2), b.fsub(x0, x2), b.fsub(y0, y2)
                gr, gi, hr, hi = b.fadd(x1, x3), b.fadd(y1, y3), b.fsub(x1, x3), b.fsub(y1, y3)
                to = b.add(b.mul(k, four), q)
                code.store(b.fadd(er, gr), to_r, to)
                code.store(b.fadd(ei, gi), to_i, to)
                others = (
                    (b.fadd(fr, hi), b.fsub(fi, hr)), (b.fsub(er, gr), b.fsub(ei, gi)), (b.fsub(fr, hi), b.fadd(fi, hr)),
                )  # fmt: skip
                for p, (x, y) in enumerate(others):
                    c, s = turns[2 * p], turns[2 * p + 1]
                    to = b.add(to, args[5])
                    code.store(code.fma(c, x, b.fneg(code.times(s, y))), to_r, to)
                    code.store(code.fma(c, y, code.times(s, x)), to_i, to)
        return context.get_dummy_value()

    return types.void(ar, ai, br, bi, w, stride), emit


@njit(fastmath=FAST, **INNER)
def _last_pass(ar, ai, br, bi) -> None:
    """Radix 2, where n is no power of four."""
    m = ar.size // 2
    for q in range(m):
        br[q] = ar[q] + ar[m + q]
        bi[q] = ai[q] + ai[m + q]
    for q in range(m):
        br[m + q] = ar[q] - ar[m + q]
        bi[m + q] = ai[q] - ai[m + q]


@njit(fastmath=FAST, **INNER)
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
            _pass(ar, ai, br, bi, w, stride)
        stride *= 4
    return swapped


@njit(fastmath=FAST, **_CALLED)
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
