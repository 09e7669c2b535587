"""Bounds on where free flight can bring a string: which contacts it cannot reach, and until when.

A bound, not a guess: no sound depends on whether a contact that cannot be reached is looked at.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK
from synth.solver.stringmodel import CLOCK, scratch_of, string_model, string_state
from synth.solver.vectors import FAST, INNER

#: what bounds on a string's reach are multiplied by, against rounding
MARGIN = 1.001
#: more steps than any run has
FOR_EVER = 2**62
#: contacts from which on it pays to certify that some are out of reach for a while
CERTIFY_FROM = 3
#: steps for which a certificate is sought where there is none for ever, the longer first
HORIZONS = (16 * BLOCK, 4 * BLOCK)
#: steps after which what a contact may move by is worked out anew: it has become less
_RENEWED_AFTER = 256 * BLOCK


@njit(fastmath=FAST, error_model="numpy", **INNER)
def extents(omega, q, v, out) -> None:
    """out (N,) = E_j = √(q_j² + v_j²/ω_j²), which free motion does not enlarge: |q_j| ≤ E_j, |q̇_j| ≤ ω_j E_j. May be q."""
    for j in range(omega.size):
        speed = v[j] / omega[j]
        out[j] = np.sqrt(q[j] * q[j] + speed * speed)


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def amplitudes(omega, sigma, q, v, out) -> None:
    """A_j ≥ |q_j(t)| for all later times of free flight: decaying envelope, or a bound where overdamped."""
    for j in range(q.size):  # both ways are worked out for every mode, in vectors
        d2 = (omega[j] - sigma[j]) * (omega[j] + sigma[j])
        swings = d2 > 1e-6 * omega[j] * omega[j]
        p = v[j] + sigma[j] * q[j]
        swinging = np.sqrt(q[j] * q[j] + p * p / (d2 if swings else 1.0))
        creeping = abs(q[j]) + abs(v[j]) / (1.0 if swings else 2.0 * sigma[j])
        out[j] = swinging if swings else creeping


@njit(cache=True, nogil=True, fastmath=FAST)
def reach(shape, amplitude) -> float:
    """Σ |φ_j| A_j: no free motion with these amplitudes displaces the point further than this."""
    total = 0.0
    for j in range(amplitude.size):
        total += abs(shape[j]) * amplitude[j]
    return total


@njit(fastmath=FAST, **INNER)
def least_reach(shape, q) -> float:
    """Σ |φ_j q_j|, below `reach` of the amplitudes of any free flight that passes q."""
    total = 0.0
    for j in range(q.size):
        total += abs(shape[j] * q[j])
    return total


@njit(cache=True, nogil=True)
def forget(state: int) -> None:
    """No certificate holds any more: the string or the obstacle was changed from outside."""
    s = string_state(state)
    s.counts[CLOCK] = 0
    s.certificates.until[:] = 0
    s.certificates.renewed[:] = -1
    s.certificates.looked[:] = 1


@njit(cache=True, nogil=True, fastmath=FAST)
def certify(model: int, state: int, scratch: int, q, v) -> None:
    """Ask of every contact whose time has come whether free flight can bring the string to it, and until when it cannot.

    q, v (n,): its modes; those behind them are zero.

    A mode's energy does not grow, so |q̇_j| ≤ ω_j E_j and |q_j| ≤ E_j with E_j = √(q_j² + v_j²/ω_j²): a contact never goes
    deeper than Σ |φ_j| E_j, and within τ it moves by no more than Σ |φ_j| E_j min(2, ω_j τ). What was so once is so until a
    force acts. The horizons τ are `HORIZONS` steps.
    """
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    contacts = m.contacts.size
    held = s.certificates
    until, renewed, margin, bounds, eta = held.until, held.renewed, held.margin, held.bounds, s.eta
    now = s.counts[CLOCK]
    due, stale = False, False
    for c in range(contacts):
        if until[c] <= now:
            due = True
            if now - renewed[c] > _RENEWED_AFTER:
                renewed[c] = -1
            stale = stale or renewed[c] < 0
    if not due:
        return
    omega = m.omega[: q.size]
    n = omega.size
    ever, far, close = w.modes.moved[0], w.modes.moved[1], w.modes.moved[2]
    if stale:
        long, short = HORIZONS[0] * m.dt, HORIZONS[1] * m.dt
        extents(omega, q, v, ever)
        for j in range(n):
            extent = MARGIN * ever[j]
            ever[j] = extent
            far[j] = extent * min(2.0, omega[j] * long)
            close[j] = extent * min(2.0, omega[j] * short)
    for c in range(contacts):
        if until[c] > now:
            continue
        shape = m.contacts.shapes[c]
        here = 0.0
        if renewed[c] < 0:
            deepest, by_long, by_short = 0.0, 0.0, 0.0
            for j in range(n):
                size = abs(shape[j])
                here += shape[j] * q[j]
                deepest += size * ever[j]
                by_long += size * far[j]
                by_short += size * close[j]
            bounds[c, 0], bounds[c, 1], bounds[c, 2] = deepest, by_long, by_short
            renewed[c] = now
        else:
            for j in range(n):
                here += shape[j] * q[j]
        gap = here - eta[c]
        s.certificates.looked[c] = 0
        if bounds[c, 0] < -eta[c]:
            until[c] = FOR_EVER
            margin[c] = -eta[c] - bounds[c, 0]
        elif gap > bounds[c, 1]:
            until[c] = now + HORIZONS[0]
            margin[c] = gap - bounds[c, 1]
        else:
            until[c] = now + HORIZONS[1]
            margin[c] = gap - bounds[c, 2]
            if margin[c] <= 0.0:
                s.certificates.looked[c] = 1
