"""For how long no node of a wall can be reached by the freely moving string.

A mode's energy does not grow, so that |q_j| ≤ E_j and |q̇_j| ≤ ω_j E_j with E_j = √(q_j² + v_j²/ω_j²), and node c moves
in the time τ by no more than Σ |φ_j(x_c)| E_j min(2, ω_j τ) (`certify`), forwards as well as backwards: a node whose gap
is larger is clear for τ before and after, though not before the instant at which E_j, larger then, was taken. Until some
looks have passed since the last impulse, √(2/L) stands for every |φ_j(x_c)|; then the sums are taken node by node, once
for all strides. With them goes the certificate that the string flies free for ever: the decaying amplitudes A_j of
`certificates.amplitudes` leave Σ |φ_j(x_c)| A_j below every gap at rest.

A rigid wall may strike while the gap is still ½Δt|w|, w the node's velocity: there ½Δt Σ |φ_j| ω_j E_j is added.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from synth.solver.certificates import FOR_EVER, MARGIN, amplitudes, extents
from synth.solver.vectors import FAST, INNER, dot

# places in Clearance.counts
_KNOWN, _NODEWISE, _QUIET, _LEVEL, FREE = 0, 1, 2, 3, 4
_COUNTS = 5


class Clearance(NamedTuple):
    """N modes, C nodes from number `first` of the grid on, K levels: none and the strides of `flights`."""

    omega: np.ndarray  # (N,)
    sigma: np.ndarray  # (N,)
    half: np.ndarray  # (N + 1,) sin(πk/(N + 1))
    eta: np.ndarray  # (C,)
    steps: np.ndarray  # (K,) int64
    dt: float
    scale: float  # √(2/L)
    first: int
    early: float  # seconds before contact in which a node may strike: ½Δt where rigid
    margin: float
    extent: np.ndarray  # (N,) E_j
    moved: np.ndarray  # (K + 1, N) work space
    shape: np.ndarray  # (N,) work space
    anywhere: np.ndarray  # (K,) what a gap must exceed, whatever the node
    at: np.ndarray  # (K + 1, C) what the nodes' gaps must exceed; last the certificate
    counts: np.ndarray  # int64


def make_clearance(omega, sigma, half, eta, strides, dt: float, scale: float, first: int, rigid: bool) -> Clearance:
    """Nothing known yet; arrays as in `Clearance`, strides (K − 1,)."""
    levels, modes, nodes = strides.size + 1, omega.size, eta.size
    return Clearance(
        omega,
        sigma,
        half,
        eta,
        np.concatenate([[0], strides]),
        dt,
        scale,
        first,
        0.5 * dt if rigid else 0.0,
        MARGIN,
        np.zeros(modes),
        np.zeros((levels + 1, modes)),
        np.zeros(modes),
        np.zeros(levels),
        np.zeros((levels + 1, nodes)),
        np.zeros(_COUNTS, np.int64),
    )


@njit(fastmath=FAST, **INNER)
def _moved(omega, extent, time: float, factor: float, early: float, out) -> float:
    """Fill out (N,) with how far each mode moves in `time`, and `early` before contact; returns their sum."""
    total = 0.0
    for j in range(extent.size):
        out[j] = factor * extent[j] * (min(2.0, omega[j] * time) + omega[j] * early)
        total += out[j]
    return total


@njit(cache=True, nogil=True)
def forget(of: Clearance) -> None:
    """To be called after an impulse."""
    of.counts[:] = 0


@njit(**INNER)
def _renew(of: Clearance, q, v) -> None:
    """The bounds node by node, and the certificate."""
    levels, modes = of.steps.size, q.size
    for k in range(levels):
        _moved(of.omega, of.extent, of.steps[k] * of.dt, of.margin * of.scale, of.early, of.moved[k])
    amplitude = of.moved[levels]
    amplitudes(of.omega, of.sigma, q, v, amplitude)
    for j in range(modes):
        amplitude[j] = of.margin * of.scale * (amplitude[j] + of.early * of.omega[j] * of.extent[j])
    free = True
    for c in range(of.eta.size):
        node, at = of.first + c + 1, 0
        for j in range(modes):  # |sin(π node (j + 1)/n)| has the period n
            at += node
            if at > modes:
                at -= modes + 1
            of.shape[j] = of.half[at]
        for k in range(levels + 1):
            of.at[k, c] = dot(of.shape, of.moved[k])
        free = free and of.at[levels, c] < -of.eta[c]
    of.counts[FREE] = 1 if free else 0
    of.counts[_NODEWISE] = 1
    of.counts[_QUIET] = 0


@njit(cache=True, nogil=True)
def attend(of: Clearance, q, v) -> None:
    """Take note of the string's state where it has been looked at; from time to time bounds are renewed from it."""
    modes = q.size
    of.counts[_QUIET] += 1
    if of.counts[_KNOWN] == 0:
        extents(of.omega, q, v, of.extent)
    elif of.counts[_QUIET] > (2 * modes if of.counts[_NODEWISE] else modes // 4):  # what it costs, against what it gains
        extents(of.omega, q, v, of.extent)
        _renew(of, q, v)


@njit(cache=True, nogil=True)
def _all_above(gap, at) -> bool:
    below = 0
    for c in range(gap.size):
        below += gap[c] <= at[c]
    return below == 0


@njit(cache=True, nogil=True)
def clear_for(of: Clearance, gap, least: float) -> int:
    """Steps before and after in which nothing is touched where the gaps are these (C,); −1: it may be now."""
    if of.counts[FREE]:
        return FOR_EVER
    levels, level = of.steps.size, of.counts[_LEVEL]
    if of.counts[_NODEWISE]:
        while level < levels and _all_above(gap, of.at[level]):
            level += 1
        while level > 0 and not _all_above(gap, of.at[level - 1]):
            level -= 1
        of.counts[_LEVEL] = max(0, level - 1)
    else:
        level = 0
        while level < levels:
            if level == of.counts[_KNOWN]:
                time = of.steps[level] * of.dt
                of.anywhere[level] = _moved(of.omega, of.extent, time, of.margin * of.scale, of.early, of.shape)
                of.counts[_KNOWN] += 1
            if least <= of.anywhere[level]:
                break
            level += 1
    return -1 if level == 0 else of.steps[level - 1]
