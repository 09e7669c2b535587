"""N modes of a stiff, lossy string over one rigid point, with no time step: an event-driven reference.

    μ(q̈_j + 2σ_j q̇_j + ω_j² q_j) = φ_j λ,   0 ≤ φ·q + Rλ − η ⊥ λ ≥ 0

R = 0, a rigid point under N modes, needs an impact law and gets restitution 0; R > 0, the static compliance of the modes
left out, is a spring in between and needs none. Pieces that are each exact to rounding (the model: Issanchou et al., JASA
143(5), 2018, II; event-driven schemes: V. Acary and B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, 2008):

flight     λ = 0: each mode by its exact propagator
landing    g = φ·q − η = 0, ġ < 0. R = 0: v⁺ = v − φ(φ·v)/(φ·φ), the impulse −μ(φ·v)/(φ·φ); μ is every mode's mass
contact    R = 0: φ·q = η, φ·v = 0, λ = μ φ·(ω²q + 2σv)/(φ·φ), a linear motion whose frequencies without loss are the
           roots of Σ φ_j²/(ω_j² − Ω²) = 0; R > 0: λ = (η − φ·q)/R, linear too. Advanced by its Taylor series: the matrix
           is a diagonal and one dyad, so that a term costs as little as a free step, overdamped modes included
release    λ has returned to 0

No event is missed. Time is cut into pieces h with (ω_j + 2σ_j)h ≤ 1 for every mode, and for R's spring; over one of them the
gap in flight and the force in contact are their Taylor polynomials of degree 24 (what is left out is below 1/23! of the
modal amplitudes). A polynomial lies in the convex hull of its Bernstein coefficients: where these are all positive there is
no root, where they change sign once there is one (Descartes), and else the piece is halved (de Casteljau), the earlier
half first. A touch, however grazing and short, is found unless it is less deep than the rounding of g itself, some 1e-14 of
Σ|φ_j q_j|. Modes are finite in number, so that with R = 0 one contact of a string is many: what the landing starts in the
highest modes opens and closes it again within their periods. With R > 0 and many modes the point bounces on R's spring, at
about the highest mode's frequency, all through a contact: that is this model's exact motion, and steps that do not resolve
it damp it away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from synth.solver.laws import EXACT_HOLD, coefficients, step_coefficients

_DEGREE = 24
_DEPTH = 50  # halvings of a piece before a double root is taken as it stands
_MOST_EVENTS = 1000  # in one piece: beyond it contacts accumulate
# places in the counters
_LANDINGS, _RELEASES, _PIECES, _STUCK = 0, 1, 2, 3


@dataclass(frozen=True)
class Events:
    """What `run` gives; n rows, P outputs. SI units."""

    u: np.ndarray  # (n, P) weights·q
    contact_u: np.ndarray  # (n,) φ·q + Rλ
    energy: np.ndarray  # (n,) ½μΣ(v² + ω²q²) [J]
    spring_energy: np.ndarray  # (n,) ½Rλ² [J]
    q: np.ndarray  # (N,) at the end
    v: np.ndarray  # (N,)
    contact_force: np.ndarray  # (n,) mean since the row before, impulses included; row 0: as it starts
    contact_energy: np.ndarray  # (n,) lost at landings so far [J]
    contact_time: np.ndarray  # (n,) spent in contact so far [s]
    landings: int
    releases: int
    piece_s: float  # h
    unsolved: int  # pieces given up at the largest number of events
    last_contact_s: float  # −1: none


class _Scene(NamedTuple):
    """What `run` is given of the string, the point and the outputs."""

    omega: np.ndarray
    sigma: np.ndarray
    mu: float
    shape: np.ndarray
    eta: float
    residual: float
    weights: np.ndarray


class _Made(NamedTuple):
    """What the kernel fills: outputs, the columns of `_record`, events, time of the last contact (1,)."""

    u: np.ndarray
    sums: np.ndarray
    counts: np.ndarray
    times: np.ndarray


def run(
    omega: np.ndarray,
    sigma: np.ndarray,
    mu: float,
    shape: np.ndarray,
    eta: float,
    q: np.ndarray,
    v: np.ndarray,
    row_s: float,
    rows: int,
    weights: np.ndarray,
    residual: float = 0.0,
) -> Events:
    """From q, v (N,) over `rows` rows, row_s apart, row 0 the start; shape φ (N,) at the point, eta its height [m].

    weights : (P, N), outputs wanted as sums over q. residual : R ≥ 0 [m/N]. With R > 0 a start under the point is one
    that its spring holds, with R = 0 it is refused.
    Raises ValueError where the start lies under a rigid point or no mode moves the point.
    """
    if not residual >= 0.0:
        raise ValueError(f"residual must be ≥ 0 m/N, got {residual:g}; 0 is a rigid point")
    omega, sigma, shape = (np.ascontiguousarray(a, dtype=np.float64) for a in (omega, sigma, shape))
    norm = float(shape @ shape)
    if norm <= 1e-24 * omega.size * (1.0 + np.abs(shape).max(initial=0.0) ** 2):
        raise ValueError("the point must be moved by some mode, got a node of all of them; move it")
    depth = eta - float(shape @ q)
    if residual == 0.0 and depth > 1e-12 * (np.abs(shape) @ np.abs(q) + abs(eta)):
        raise ValueError(f"the string must start on or over the point, got {depth:.3g} m under it; lower the point")
    spring = norm / (mu * residual) if residual > 0.0 else 0.0
    pieces = max(1, math.ceil(row_s * math.sqrt(float(np.max(omega + 2.0 * sigma)) ** 2 + spring)))
    h = row_s / pieces
    q, v = np.array(q, dtype=np.float64), np.array(v, dtype=np.float64)
    weights = np.ascontiguousarray(weights, dtype=np.float64)
    scene = _Scene(omega, sigma, mu, shape, float(eta), float(residual), weights)
    made = _Made(np.zeros((rows, weights.shape[0])), np.zeros((rows, 5)), np.zeros(4, np.int64), np.array([-1.0]))
    _run(scene, q, v, h, pieces, coefficients(EXACT_HOLD, omega, sigma, mu, h), _pascal(), made)
    u, sums, counts, times = made
    force = sums[:, 0].copy()
    force[1:] /= row_s
    gap = sums[:, 4]
    pressed = np.maximum(0.0, -gap) if residual > 0.0 else np.zeros(rows)
    return Events(
        u=u,
        contact_u=eta + gap + pressed,
        energy=sums[:, 3],
        spring_energy=0.5 * pressed**2 / residual if residual > 0.0 else pressed,
        q=q,
        v=v,
        contact_force=force,
        contact_energy=sums[:, 1],
        contact_time=sums[:, 2],
        landings=int(counts[_LANDINGS]),
        releases=int(counts[_RELEASES]),
        piece_s=h,
        unsolved=int(counts[_STUCK]),
        last_contact_s=float(times[0]),
    )


def constrained_frequencies(omega: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Ω (N − 1,) [rad/s] of lossless modes ω (N,) increasing, held at a point with φ (N,) none zero.

    The roots of Σ φ_j²/(ω_j² − Ω²) = 0, one between each two neighbours, as the eigenvalues of ω² projected off φ.
    """
    projector = np.eye(omega.size) - np.outer(shape, shape) / float(shape @ shape)
    squares = np.linalg.eigvalsh(projector @ np.diag(omega**2) @ projector)
    return np.sqrt(squares[1:])


def _pascal() -> np.ndarray:
    """(K + 1, K + 1) binomial coefficients C(n, k)."""
    size = _DEGREE + 1
    return np.array([[float(math.comb(n, k)) for k in range(size)] for n in range(size)])


@njit(cache=True, nogil=True)
def _flight_series(omega, sigma, shape, q, v, span: float, series) -> None:
    """Coefficients (K + 1,) of φ·q in τ = s/span: q'' = −2σq' − ω²q term by term."""
    series[:] = 0.0
    for j in range(q.size):
        before, last = q[j], v[j] * span
        x = omega[j] * span
        x *= x
        d = 2.0 * sigma[j] * span
        series[0] += shape[j] * before
        series[1] += shape[j] * last
        for k in range(2, series.size):
            term = -(d * (k - 1) * last + x * before) / (k * (k - 1))
            series[k] += shape[j] * term
            before, last = last, term


@njit(cache=True, nogil=True)
def _contact_series(omega, sigma, mu, shape, norm, eta, residual, q, v, span, terms, series) -> None:
    """Terms (K + 1, N) of q in τ = s/span in contact, coefficients of λ in series (K + 1,), K − 2 of degree."""
    n = q.size
    series[:] = 0.0
    for j in range(n):
        terms[0, j] = q[j]
        terms[1, j] = v[j] * span
    for k in range(2, terms.shape[0]):
        held = 0.0
        for j in range(n):
            x = omega[j] * span
            pull = x * x * terms[k - 2, j] + 2.0 * sigma[j] * span * (k - 1) * terms[k - 1, j]
            terms[k, j] = pull
            held += shape[j] * pull
        if residual > 0.0:
            force = (eta if k == 2 else 0.0) - _dot(shape, terms[k - 2])
            series[k - 2] = force / residual
            held = force / (residual * mu) * span * span
        else:
            held /= norm
            series[k - 2] = mu * held / (span * span)
        for j in range(n):
            terms[k, j] = (shape[j] * held - terms[k, j]) / (k * (k - 1))


@njit(cache=True, nogil=True)
def _first_root(series, lead: int, degree: int, pascal, stack, ends) -> float:
    """The first τ in [0, 1] at which Σ_{k≥lead} series_k τ^(k−lead) is no longer > 0; −1 where there is none.

    stack (≥ _DEPTH + 2, K + 1) and ends (≥ _DEPTH + 2, 3) work space: Bernstein coefficients and limits of pieces, the
    earliest on top.
    """
    n = degree - lead
    for i in range(n + 1):
        total = 0.0
        for k in range(i + 1):
            total += pascal[i, k] / pascal[n, k] * series[lead + k]
        stack[0, i] = total
    ends[0, 0], ends[0, 1], ends[0, 2] = 0.0, 1.0, 0.0
    top = 0
    while top >= 0:
        low, high, depth = ends[top, 0], ends[top, 1], ends[top, 2]
        b = stack[top]
        if b[0] <= 0.0:
            return low
        changes, sign = 0, 1.0
        for i in range(1, n + 1):
            if b[i] * sign < 0.0:
                changes += 1
                sign = -sign
        if changes == 0:
            top -= 1
        elif changes == 1 or depth >= _DEPTH:
            if b[n] > 0.0:  # a double root, as far as numbers can tell: it does not go through zero
                top -= 1
                continue
            for _ in range(64):
                middle = 0.5 * (low + high)
                value = 0.0
                for k in range(degree, lead - 1, -1):
                    value = value * middle + series[k]
                if value > 0.0:
                    low = middle
                else:
                    high = middle
            return high
        else:
            # de Casteljau at the middle: the earlier half goes on top
            middle = 0.5 * (low + high)
            early = stack[top + 1]
            early[0] = b[0]
            for r in range(1, n + 1):
                for i in range(n + 1 - r):
                    b[i] = 0.5 * (b[i] + b[i + 1])
                early[r] = b[0]
            ends[top, 0], ends[top, 2] = middle, depth + 1
            ends[top + 1, 0], ends[top + 1, 1], ends[top + 1, 2] = low, middle, depth + 1
            top += 1
    return -1.0


@njit(cache=True, nogil=True)
def _pull(omega, sigma, shape, q, v) -> float:
    """φ·(ω²q + 2σv): the point's acceleration downwards in free flight; λ = μ/(φ·φ) times it in contact."""
    total = 0.0
    for j in range(q.size):
        total += shape[j] * (omega[j] * omega[j] * q[j] + 2.0 * sigma[j] * v[j])
    return total


@njit(cache=True, nogil=True)
def _dot(a, b) -> float:
    total = 0.0
    for j in range(a.size):
        total += a[j] * b[j]
    return total


@njit(cache=True, nogil=True)
def _land(shape, norm: float, eta: float, q, v) -> float:
    """The point set on η and its velocity taken out; returns the velocity that it had."""
    depth = eta - _dot(shape, q)
    speed = _dot(shape, v)
    for j in range(q.size):
        q[j] += shape[j] * depth / norm
        v[j] -= shape[j] * speed / norm
    return speed


@njit(cache=True, nogil=True)
def _fly(coef, q, v) -> None:
    for j in range(q.size):
        moved = coef[0, j] * q[j] + coef[1, j] * v[j]
        v[j] = coef[2, j] * q[j] + coef[3, j] * v[j]
        q[j] = moved


@njit(cache=True, nogil=True)
def _record(row, omega, mu, shape, eta, weights, q, v, u, sums) -> None:
    """Outputs, energy and gap of a row; the other columns of sums are impulse, energy lost and time spent in contact."""
    for p in range(weights.shape[0]):
        u[row, p] = _dot(weights[p], q)
    energy = 0.0
    for j in range(q.size):
        energy += v[j] * v[j] + (omega[j] * q[j]) ** 2
    sums[row, 3] = 0.5 * mu * energy
    sums[row, 4] = _dot(shape, q) - eta


@njit(cache=True, nogil=True)
def _run(scene, q, v, h, pieces, whole, pascal, made):
    omega, sigma, mu, shape, eta, residual, weights = scene
    u, sums, counts, times = made
    n = omega.size
    degree = pascal.shape[0] - 1
    norm = _dot(shape, shape)
    size = 0.0
    for j in range(n):
        size += abs(shape[j] * q[j])
    rounding = 4.0 * 2.3e-16 * math.sqrt(n)
    part = np.empty((6, n))
    terms = np.empty((degree + 1, n))
    series = np.empty(degree + 1)
    stack = np.empty((_DEPTH + 2, degree + 1))
    ends = np.empty((_DEPTH + 2, 3))

    gap = _dot(shape, q) - eta
    speed = _dot(shape, v)
    contact, lead = False, 0
    rigid = residual == 0.0
    lost, spent = 0.0, 0.0
    sums[:] = 0.0
    if gap <= rounding * (size + abs(eta)):
        if not rigid:
            contact = gap < 0.0 or speed < 0.0
            lead = 1 if abs(gap) <= rounding * (size + abs(eta)) else 0
            if gap < 0.0:
                sums[0, 0] = -gap / residual
                times[0] = 0.0
        elif speed > 0.0:
            lead = 1
        else:
            if speed < 0.0:
                counts[_LANDINGS] += 1
                lost += 0.5 * mu * speed * speed / norm
            _land(shape, norm, eta, q, v)
            pull = _pull(omega, sigma, shape, q, v)
            contact = pull > 0.0
            lead = 2
            if contact:
                sums[0, 0] = mu * pull / norm
                times[0] = 0.0
    sums[0, 1] = lost
    _record(0, omega, mu, shape, eta, weights, q, v, u, sums)

    safe = 0
    for row in range(1, u.shape[0]):
        impulse = 0.0
        for piece in range(pieces):
            if safe > 0:
                safe -= 1
                _fly(whole, q, v)
                continue
            rest = h
            events = 0
            while True:
                counts[_PIECES] += 1
                end = (row - 1) * pieces * h + (piece + 1) * h
                if not contact:
                    threshold = 0.0
                    if lead == 0:
                        size, fastest = 0.0, 0.0
                        for j in range(n):
                            size += abs(shape[j] * q[j])
                            fastest += abs(shape[j]) * math.sqrt(v[j] * v[j] + (omega[j] * q[j]) ** 2)
                        gap = _dot(shape, q) - eta
                        # speeds of a mode never exceed those of its energy
                        if rest == h and gap > fastest * h * 1.000001:
                            safe = int(min(gap / (fastest * h * 1.000001), 1e9)) - 1 if fastest > 0.0 else 1000
                            _fly(whole, q, v)
                            break
                        threshold = rounding * (size + abs(eta))
                    _flight_series(omega, sigma, shape, q, v, rest, series)
                    series[0] += threshold - eta
                    while lead > 0 and lead < degree and series[lead] == 0.0:
                        lead += 1
                    root = _first_root(series, lead, degree, pascal, stack, ends) if events < _MOST_EVENTS else -1.0
                    if rest == h and root < 0.0:
                        _fly(whole, q, v)
                    else:
                        step_coefficients(EXACT_HOLD, omega, sigma, mu, rest if root < 0.0 else root * rest, part)
                        _fly(part, q, v)
                    lead = 0
                    if root < 0.0:
                        break
                    rest -= root * rest
                    counts[_LANDINGS] += 1
                    times[0] = end - rest
                    if rigid:
                        speed = min(0.0, _land(shape, norm, eta, q, v))
                        impulse -= mu * speed / norm
                        lost += 0.5 * mu * speed * speed / norm
                        contact = _pull(omega, sigma, shape, q, v) > 0.0
                        lead = 2
                    else:
                        contact = True
                        lead = 1
                else:
                    _contact_series(omega, sigma, mu, shape, norm, eta, residual, q, v, rest, terms, series)
                    if rigid:
                        lead = 0
                    root = _first_root(series, lead, degree - 2, pascal, stack, ends) if events < _MOST_EVENTS else -1.0
                    share = 1.0 if root < 0.0 else root
                    for j in range(n):
                        moved, slope = 0.0, 0.0
                        for k in range(degree, 0, -1):
                            slope = slope * share + k * terms[k, j]
                            moved = (moved + terms[k, j]) * share
                        q[j] = terms[0, j] + moved
                        v[j] = slope / rest
                    if rigid:
                        _land(shape, norm, eta, q, v)  # rounding only
                    area = 0.0
                    for k in range(degree - 2, -1, -1):
                        area = (area + series[k] / (k + 1)) * share
                    impulse += area * rest
                    spent += share * rest
                    times[0] = end - rest + share * rest
                    if root < 0.0:
                        break
                    rest -= share * rest
                    contact = False
                    lead = 3 if rigid else 1
                    counts[_RELEASES] += 1
                events += 1
                if events == _MOST_EVENTS:
                    counts[_STUCK] += 1
                if rest <= 1e-15 * h:
                    break
            # from here on the gap's first terms are no longer known to vanish
            lead = 0
        _record(row, omega, mu, shape, eta, weights, q, v, u, sums)
        sums[row, 0], sums[row, 1], sums[row, 2] = impulse, lost, spent
