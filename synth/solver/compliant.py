"""Compliant contact by Newton–Raphson: the force of a step is the discrete gradient of the contact potential.

Issanchou, Bilbao, Le Carrou, Touzé, Doaré, J. Sound Vib. 393 (2017): with g the depth and r = g⁺ − g⁻ its change over
two steps,

    f = (V(g⁻ + r) − V(g⁻))/r + Q r/(2Δt),   r + A f = b = g⁺_free − g⁻,

A the contacts' response at the end of the step to a unit force. The first term keeps the energy; the second, with
Q = loss · K [gⁿ]₊^α, is Hunt and Crossley's loss as Bilbao, Torin, Chatziioannou, Acta Acust. united Acust. 101 (2015)
discretise it, and never brings energy. V is convex, so there is one r.
"""

from __future__ import annotations

from numba import njit

from synth.solver.penalty import discrete_gradient, discrete_gradient_slope, solve_stiffened

#: weight of a contact out of reach in the scale of the tolerance: its motion is no larger than that of the others
_FAR = 1e-3


@njit(cache=True, nogil=True)
def newton_one(stiffness, exponent, compliance, drag, before, b, guess, tolerance, most):
    """(r [m], f [N], iterations) of one contact; iterations = −1 where `most` of them were not enough.

    drag = Q/(2Δt) [N/m], guess a force to start from [N]. Newton's steps are kept within a bracket, which is halved
    where they leave it. Ends where a step is below tolerance · (|g⁻| + |r|).
    """
    lossy = 1.0 + compliance * drag
    high = b / lossy
    quotient = discrete_gradient(stiffness, exponent, before, before + high)
    if quotient == 0.0:
        return high, drag * high, 0
    low = high - compliance * quotient / lossy
    r = min(high, max(low, high - compliance * guess / lossy))
    f = 0.0
    for iteration in range(1, most + 1):
        quotient = discrete_gradient(stiffness, exponent, before, before + r)
        k = discrete_gradient_slope(stiffness, exponent, before, before + r, quotient) + drag
        residual = lossy * r - b + compliance * quotient
        if residual > 0.0:
            high = r
        else:
            low = r
        step = -residual / (1.0 + compliance * k)
        small = tolerance * (abs(before) + abs(r))
        # the force goes along with the step, so that r + A f = b to rounding however stiff the contact is
        f = quotient + drag * r + k * step
        r += step
        if abs(step) <= small or high - low <= small:
            return r, f, iteration
        if not low <= r <= high:
            r = 0.5 * (low + high)
    return r, f, -1


@njit(cache=True, nogil=True)
def _residual(stiffness, exponent, compliance, drag, before, b, r, f, h) -> float:
    """f (C,) from r and h = r − b + A f; returns max |h|."""
    worst = 0.0
    for c in range(r.size):
        f[c] = discrete_gradient(stiffness, exponent, before[c], before[c] + r[c])
    for c in range(r.size):
        total = r[c] - b[c]
        for d in range(r.size):
            total += compliance[c, d] * (f[d] + drag[d] * r[d])
        h[c] = total
        worst = max(worst, abs(total))
    return worst


@njit(cache=True, nogil=True)
def newton(stiffness, exponent, compliance, drag, before, b, f, r, tolerance, most, work, matrix) -> int:
    """r (C,) and f (C,; in: a guess) of several contacts; returns the iterations, −1 where `most` were not enough.

    Damped Newton: a step is halved until the residual falls. work (5, C) and matrix (C, C) work space.
    """
    n = b.size
    if n == 1:
        r[0], f[0], done = newton_one(stiffness, exponent, compliance[0, 0], drag[0], before[0], b[0], f[0], tolerance, most)
        return done
    h, k, step, trial, quotient = work[0], work[1], work[2], work[3], work[4]
    for c in range(n):
        r[c] = b[c]
        for d in range(n):
            r[c] -= compliance[c, d] * f[d]
    worst = _residual(stiffness, exponent, compliance, drag, before, b, r, quotient, h)
    for iteration in range(1, most + 1):
        scale = 0.0
        for c in range(n):
            k[c] = drag[c]
            scale = max(scale, _FAR * abs(b[c]))
            if quotient[c] > 0.0:
                k[c] += discrete_gradient_slope(stiffness, exponent, before[c], before[c] + r[c], quotient[c])
                scale = max(scale, abs(before[c]) + abs(r[c]))
        solve_stiffened(compliance, k, h, step, matrix)
        longest = 0.0
        for c in range(n):
            longest = max(longest, abs(step[c]))
        if longest <= tolerance * scale or worst == 0.0:
            # the forces go along with the step, so that r + A f = b to rounding however stiff the contacts are
            for c in range(n):
                f[c] = quotient[c] + drag[c] * r[c] - k[c] * step[c]
                r[c] -= step[c]
            return iteration
        part = 1.0
        while True:
            for c in range(n):
                trial[c] = r[c] - part * step[c]
            now = _residual(stiffness, exponent, compliance, drag, before, b, trial, quotient, h)
            if now <= (1.0 - 1e-4 * part) * worst or part < 1e-9:
                break
            part *= 0.5
        for c in range(n):
            r[c] = trial[c]
        worst = now
    for c in range(n):
        f[c] = quotient[c] + drag[c] * r[c]
    return -1
