"""Contact schemes, K = `lanes.BLOCK` steps at a time: the fast twins of `kernels`.

Over a block of K steps the string flies free but for its contact forces, so that every contact's motion is its free
projection plus a lower triangular Toeplitz sum over the forces:

    u_k = S q_free,k + Σ_{i ≤ k} h_{k−i} λ_i,    h_0 = G,  h_l = S (Φ^l κ) Sᵀ,

u displacements for exact-hold, velocities for Moreau–Jean. K free projections cost one pass over the modes with
everything in registers (`lanes`); the contact problems of the K steps are then solved one after the other on the C × K
numbers u alone, and the forces enter the modes in a second pass, which is also the free flight to the end of the block.

Exact-hold looks only at contacts that can be touched (`certify`): a certificate, not a guess, so that no sound depends
on it. Moreau–Jean integrates the position of each contact and looks at all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from synth.native.arrays import aligned
from synth.solver.kernels import FOR_EVER, MARGIN, extents
from synth.solver.lanes import (
    ADV11,
    BLOCK,
    KQ,
    KQ_LATE,
    KV,
    KV_LATE,
    MINUS_DET,
    P11,
    P12,
    P21,
    P22,
    ROWS,
    TRACE,
    add_forced,
    add_late,
    any_below,
    coast,
    coast_q,
    coast_qq,
    coast_qv,
    coast_v,
    drive,
    drive_listed,
    padded,
    press_sequence,
    project_q,
    project_qq,
    project_qv,
    project_v,
    project_vv,
)
from synth.solver.laws import EXACT_HOLD, MOREAU_JEAN_FILTERED
from synth.solver.lcp import SOLVED, pivot
from synth.solver.vectors import FAST, INNER, dot

#: contacts from which on it pays to certify that some are out of reach for a while
CERTIFY_FROM = 3
#: steps for which a certificate is sought where there is none for ever, the longer first
HORIZONS = (16 * BLOCK, 4 * BLOCK)
#: steps after which what a contact may move by is worked out anew: it has become less
_RENEWED_AFTER = 256 * BLOCK


class BlockWork(NamedTuple):
    """What a call for up to C contacts works with; the fields from looked to moving go from call to call."""

    spare: np.ndarray  # (3, K)
    u: np.ndarray  # (C + 1, K) of the contacts looked at, free, then with forces; last of a finger
    forces: np.ndarray  # (C + 1, K) of the contacts looked at; last of a finger
    near: np.ndarray  # (C,) int64 which these are
    looked: np.ndarray  # (C,) uint8 whether a contact is among them
    until: np.ndarray  # (C,) int64 step at which that is to be asked again
    margin: np.ndarray  # (C,) by how much a contact not looked at is missed until then, as long as the string flies [m]
    bounds: np.ndarray  # (C, 3) how deep a contact may ever go, how far it may move within each of `HORIZONS` [m]
    renewed: np.ndarray  # (C,) int64 step at which these were taken, −1: they do not hold
    clock: np.ndarray  # (1,) int64 steps since `forget`
    moving: np.ndarray  # (1,) int64 modes that are not all zero, padded: forces move all of them
    matrix: np.ndarray  # (C·C,) contact matrix of those
    b: np.ndarray  # (C,)
    z: np.ndarray  # (C,)
    factor: np.ndarray  # (C, C)
    order: np.ndarray  # (C,) int64
    enabled: np.ndarray  # (C,) uint8
    active: np.ndarray  # (C,) uint8
    moved: np.ndarray  # (3, N)


def padded_rows(rows: np.ndarray, modes: int) -> np.ndarray:
    """An aligned copy of (…, N) arrays with zeros up to `modes`."""
    out = aligned((*rows.shape[:-1], modes))
    out[..., : rows.shape[-1]] = rows
    return out


def make_block_work(contacts: int, modes: int) -> BlockWork:
    """Work arrays for up to `contacts` contacts and `modes` modes."""
    c = max(contacts, 1)
    return BlockWork(
        aligned((3, BLOCK)),
        aligned((c + 1, BLOCK)),
        aligned((c + 1, BLOCK)),
        np.zeros(c, np.int64),
        np.zeros(c, np.uint8),
        np.zeros(c, np.int64),
        np.zeros(c),
        np.zeros((c, 3)),
        np.zeros(c, np.int64),
        np.zeros(1, np.int64),
        np.full(1, padded(modes)),
        np.zeros(c * c),
        np.zeros(c),
        np.zeros(c),
        np.zeros((c, c)),
        np.zeros(c, np.int64),
        np.zeros(c, np.uint8),
        np.zeros(c, np.uint8),
        aligned((3, padded(modes))),
    )


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_rows(rows) -> None:
    """Complete rows (ROWS, n) whose first six are the step coefficients of `laws`; padding is zero there."""
    p11, p12, p21, p22, kq, kv = rows[P11], rows[P12], rows[P21], rows[P22], rows[KQ], rows[KV]
    for j in range(rows.shape[1]):
        a, b, c, d = p11[j], p12[j], p21[j], p22[j]
        trace = a + d
        rows[TRACE, j] = trace
        rows[MINUS_DET, j] = b * c - a * d
        rows[KQ_LATE, j] = b * kv[j] - d * kq[j]
        rows[KV_LATE, j] = c * kq[j] - a * kv[j]
        for _ in range(3):  # Φ → Φ²: three times for 8 steps
            cross = b * c
            a, b, c, d = a * a + cross, b * (a + d), c * (a + d), d * d + cross
        rows[ADV11, j] = a
        rows[ADV11 + 1, j] = b
        rows[ADV11 + 2, j] = c
        rows[ADV11 + 3, j] = d


@njit(fastmath=FAST, **INNER)
def fill_response(velocity: int, rows, q, v, weights, first: int, spare, out) -> None:
    """out (P, 2K) from row `first` on: the sums `weights` (P, n) over a free motion from (q, v) (n,), l steps on, at K + l.

    velocity: whether weights are on velocities. spare (2, K) is work space.
    """
    n, points = rows.shape[1], weights.shape[0]
    for p in range(first, points, 2):
        both = p + 1 < points
        if velocity:
            if both:
                project_vv(n, rows, q, v, weights[p], weights[p + 1], spare[0], spare[1])
            else:
                project_v(n, rows, q, v, weights[p], spare[0])
        elif both:
            project_qq(n, rows, q, v, weights[p], weights[p + 1], spare[0], spare[1])
        else:
            project_q(n, rows, q, v, weights[p], spare[0])
        for i in range(2 if both else 1):
            for k in range(BLOCK):
                out[p + i, k] = 0.0
            out[p + i, BLOCK] = dot(weights[p + i], v if velocity else q)
            for k in range(1, BLOCK):
                out[p + i, BLOCK + k] = spare[i, k - 1]


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_lags(velocity: int, rows, shapes, weights, own, q, v, spare, out) -> None:
    """out (P, C, 2K): what a unit force at each of C shapes (C, n) has done to the sums `weights` (P, n), l steps on.

    Place K + l of the last axis is l steps after the force's own step, the first K are zero.
    velocity: whether weights are on velocities. own (C, C) is l = 0 where weights are the shapes themselves, whose responses
    to each other are mutual; or (0, 0). q, v (n,) and spare (2, K) are work space.
    """
    mutual = own.size > 0
    for c in range(shapes.shape[0]):
        for j in range(rows.shape[1]):
            q[j] = rows[KQ, j] * shapes[c, j]
            v[j] = rows[KV, j] * shapes[c, j]
        fill_response(velocity, rows, q, v, weights, c if mutual else 0, spare, out[:, c])
        if mutual:
            for p in range(c, weights.shape[0]):
                out[p, c, BLOCK] = own[p, c]
                for k in range(2 * BLOCK):
                    out[c, p, k] = out[p, c, k]


def make_rows(coef: np.ndarray) -> np.ndarray:
    """Rows (ROWS, n) of a block from step coefficients (6, N); n = padded(N)."""
    rows = aligned((ROWS, padded(coef.shape[1])))
    rows[:6, : coef.shape[1]] = coef
    fill_rows(rows)
    return rows


def make_lags(velocity: bool, rows: np.ndarray, shapes: np.ndarray, weights: np.ndarray, own=None) -> np.ndarray:
    """`fill_lags` with arrays of its own: (P, C, 2K) for shapes (C, n), weights (P, n)."""
    n = rows.shape[1]
    out = np.zeros((weights.shape[0], shapes.shape[0], 2 * BLOCK))
    given = np.zeros((0, 0)) if own is None else np.ascontiguousarray(own)
    fill_lags(int(velocity), rows, shapes, weights, given, aligned(n), aligned(n), aligned((2, BLOCK)), out)
    return out


class Blocks(NamedTuple):
    """What `advance_blocks` needs of a string, its contacts and P outputs of its displacement; n = padded(N)."""

    dt: float
    rows: np.ndarray  # (ROWS, n)
    shapes: np.ndarray  # (C, n)
    lags: np.ndarray  # (C, C, 2K)
    weights: np.ndarray  # (P, n)
    out_lags: np.ndarray  # (P, C, 2K)


def make_blocks(law: int, dt: float, coef: np.ndarray, shapes: np.ndarray, g: np.ndarray, weights: np.ndarray) -> Blocks:
    """From step coefficients (6, N), contacts (C, N) with their matrix g (C, C) of `laws`, and output weights (P, N)."""
    rows = make_rows(coef)
    n = rows.shape[1]
    shapes, weights = padded_rows(shapes, n), padded_rows(weights, n)
    lags = make_lags(law != EXACT_HOLD, rows, shapes, shapes, g)
    return Blocks(dt, rows, shapes, lags, weights, make_lags(False, rows, shapes, weights))


@njit(**INNER)
def observe(n: int, rows, q, v, weights, on_q: int, out) -> None:
    """out (P, K) = weights (P, n) times the free displacements (the first `on_q` rows) or velocities of the next K steps."""
    p = 0
    points = weights.shape[0]
    while p < points:
        if p + 1 < on_q:
            project_qq(n, rows, q, v, weights[p], weights[p + 1], out[p], out[p + 1])
            p += 2
        elif p < on_q and p + 1 < points:
            project_qv(n, rows, q, v, weights[p], weights[p + 1], out[p], out[p + 1])
            p += 2
        elif p < on_q:
            project_q(n, rows, q, v, weights[p], out[p])
            p += 1
        elif p + 1 < points:
            project_vv(n, rows, q, v, weights[p], weights[p + 1], out[p], out[p + 1])
            p += 2
        else:
            project_v(n, rows, q, v, weights[p], out[p])
            p += 1


@njit(cache=True, nogil=True)
def fly_blocks(blocks: int, n: int, rows, q, v, weights, on_q: int, out) -> None:
    """Free flight. out (P, ≥ blocks·K) gets `weights` (P, n) times the state after each step, see `observe`; P ≤ 2."""
    points = weights.shape[0]
    if blocks == 0:
        return
    if points == 0:
        for _ in range(blocks):
            coast(n, rows, q, v)
        return
    first, last = weights[0], weights[points - 1]
    for t in range(blocks):
        at = t * BLOCK
        if points == 2:
            if t == 0:
                project_qv(n, rows, q, v, first, last, out[0, at:], out[1, at:])
            else:
                coast_qv(n, rows, q, v, first, last, out[0, at:], out[1, at:])
        elif on_q:
            if t == 0:
                project_q(n, rows, q, v, first, out[0, at:])
            else:
                coast_q(n, rows, q, v, first, out[0, at:])
        elif t == 0:
            project_v(n, rows, q, v, first, out[0, at:])
        else:
            coast_v(n, rows, q, v, first, out[0, at:])
    coast(n, rows, q, v)


@njit(cache=True, nogil=True)
def press_blocks(
    blocks: int, n: int, rows, shape, eta: float, lags, q, v, weights, on_q: int, out_lags, out, u, forces, rec_u, rec_force
) -> int:
    """Exact-hold over one contact. Returns the number of blocks that touched; forces (K,) are the last block's.

    rows (ROWS, n); shape (n,); lags (2K,) of the contact; weights (P, n), P ≤ 2, on_q and out as in `fly_blocks`; out_lags
    (P, 1, 2K) of the outputs; u (K,) work space; rec_u, rec_force (blocks·K,) displacement S q + R λ of the contact and
    its force in every step, or empty.
    """
    points = weights.shape[0]
    touched = 0
    if blocks == 0:
        return 0
    flown = True  # whether the modes have been taken through the block before
    for t in range(blocks):
        at = t * BLOCK
        if points == 0:
            if flown:
                project_q(n, rows, q, v, shape, u)
            else:
                coast_q(n, rows, q, v, shape, u)
        elif on_q:
            if flown:
                project_qq(n, rows, q, v, shape, weights[0], u, out[0, at:])
            else:
                coast_qq(n, rows, q, v, shape, weights[0], u, out[0, at:])
        elif flown:
            project_qv(n, rows, q, v, shape, weights[0], u, out[0, at:])
        else:
            coast_qv(n, rows, q, v, shape, weights[0], u, out[0, at:])
        if points > 1:
            project_v(n, rows, q, v, weights[1], out[1, at:])
        flown = any_below(u, eta)
        if flown:
            press_sequence(u, eta, lags, forces)
            for p in range(points):
                add_forced(out[p, at:], out_lags[p, 0], forces)
            drive(n, rows, q, v, shape, forces)
            touched += 1
        if rec_u.size > 0:
            if flown:
                add_forced(u, lags, forces)
            for k in range(BLOCK):
                rec_u[at + k] = u[k]
                rec_force[at + k] = forces[k] if flown else 0.0
    if not flown:
        for k in range(BLOCK):
            forces[k] = 0.0
        coast(n, rows, q, v)
    return touched


@njit(cache=True, nogil=True)
def forget(work: BlockWork) -> None:
    """No certificate holds any more: the state or the obstacle was changed from outside."""
    work.clock[0] = 0
    work.until[:] = 0
    work.renewed[:] = -1
    work.looked[:] = 1


@njit(cache=True, nogil=True, fastmath=FAST)
def certify(dt: float, omega, shapes, eta, q, v, now: int, looked, until, margin, bounds, renewed, moved) -> None:
    """Ask of every contact whose time has come whether free flight can bring the string to it, and until when it cannot.

    A mode's energy does not grow, so |q̇_j| ≤ ω_j E_j and |q_j| ≤ E_j with E_j = √(q_j² + v_j²/ω_j²): a contact never goes
    deeper than Σ |φ_j| E_j, and within τ it moves by no more than Σ |φ_j| E_j min(2, ω_j τ). What was so once is so until a
    force acts.
    omega (N,), shapes (C, ≥N), eta (C,), q, v (≥N,); now: the clock; the others as in `BlockWork`. The horizons τ are
    `HORIZONS` steps dt.
    """
    due, stale = False, False
    for c in range(eta.size):
        if until[c] <= now:
            due = True
            if now - renewed[c] > _RENEWED_AFTER:
                renewed[c] = -1
            stale = stale or renewed[c] < 0
    if not due:
        return
    n = omega.size
    ever, far, close = moved[0], moved[1], moved[2]
    if stale:
        long, short = HORIZONS[0] * dt, HORIZONS[1] * dt
        extents(omega, q, v, ever)
        for j in range(n):
            extent = MARGIN * ever[j]
            ever[j] = extent
            far[j] = extent * min(2.0, omega[j] * long)
            close[j] = extent * min(2.0, omega[j] * short)
    for c in range(eta.size):
        if until[c] > now:
            continue
        shape = shapes[c]
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
        looked[c] = 0
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
                looked[c] = 1


@njit(inline="always")
def gather(looked, near) -> int:
    """Numbers of the contacts that are looked at; returns how many."""
    m = int(np.int64(0))  # a literal would have kernels that are called with m compiled once more
    for c in range(looked.size):
        if looked[c]:
            near[m] = c
            m += 1
    return m


@njit(inline="always")
def look(n: int, rows, shapes, q, v, velocity: int, near, m: int, u) -> None:
    """u[:m] (·, K): free displacements, or velocities, of contacts near[:m] over the next K steps."""
    i = 0
    while i < m:
        shape = shapes[near[i]]
        if i + 1 < m:
            other = shapes[near[i + 1]]
            if velocity:
                project_vv(n, rows, q, v, shape, other, u[i], u[i + 1])
            else:
                project_qq(n, rows, q, v, shape, other, u[i], u[i + 1])
        elif velocity:
            project_v(n, rows, q, v, shape, u[i])
        else:
            project_q(n, rows, q, v, shape, u[i])
        i += 2


@njit(inline="always")
def fill_matrix(lags, near, m: int, matrix) -> None:
    """matrix (m·m,) of contacts near[:m] from their lag responses."""
    for i in range(m):
        for d in range(m):
            matrix[i * m + d] = lags[near[i], near[d], BLOCK]


@njit(inline="always")
def _answer(m: int, k: int, lags, matrix, enabled, active, held: int, work: BlockWork):
    """Solve step k for work.b at contacts near[:m] and let its forces act on their rows u: (status, rows of factor)."""
    near, u, z = work.near, work.u, work.z
    status, _, held = pivot(matrix, work.b[:m], enabled, active, z[:m], work.factor, work.order, held)
    for i in range(m):
        if z[i] > 0.0:
            work.forces[i, k] = z[i]
            for d in range(m):
                add_late(u[d], lags[near[d], near[i]], k, z[i])
    return status, held


@njit(inline="always")
def _hold_sequence(m: int, eta, lags, work: BlockWork) -> int:
    """Exact-hold over K steps at contacts near[:m]: forces from the free u, which become the true ones."""
    near, u, forces, b = work.near, work.u, work.forces, work.b
    fill_matrix(lags, near, m, work.matrix)
    matrix = work.matrix[: m * m].reshape(m, m)
    enabled, active = work.enabled[:m], work.active[:m]
    enabled[:] = 1
    active[:] = 0
    status, held = SOLVED, int(np.int64(0))
    for k in range(BLOCK):
        touching = False
        for i in range(m):
            forces[i, k] = 0.0
            b[i] = u[i, k] - eta[near[i]]
            touching = touching or b[i] < 0.0
        if touching:
            bad, held = _answer(m, k, lags, matrix, enabled, active, held, work)
            if bad != SOLVED:
                status = bad
    return status


@njit(inline="always")
def _others_stay_clear(m: int, lags, work: BlockWork) -> bool:
    """Whether the forces at near[:m] leave every contact that was not looked at out of reach; those that they do not
    are looked at from now on."""
    clear = True
    y = work.spare[0]
    for c in range(work.looked.size):
        if work.looked[c] == 0:
            y[:] = 0.0
            for i in range(m):
                add_forced(y, lags[c, work.near[i]], work.forces[i])
            if any_below(y, -work.margin[c]):
                work.looked[c] = 1
                work.until[c] = work.clock[0] + HORIZONS[1]
                clear = False
    return clear


@njit(inline="always")
def _impact_sequence(
    law: int, m: int, dt: float, restitution: float, eta, lags, u_contact, v_contact, work: BlockWork
) -> int:
    """Moreau–Jean over K steps at all m contacts: impulses from the free velocities u, which become displacements."""
    near, u, forces, b = work.near, work.u, work.forces, work.b
    ahead = 0.5 * dt if law == MOREAU_JEAN_FILTERED else 0.0
    status, held = SOLVED, int(np.int64(0))
    if m == 1:
        here, speed, response = u_contact[0], v_contact[0], lags[0, 0]
        stiffness = 1.0 / response[BLOCK]
        forces[0] = 0.0
        for k in range(BLOCK):
            wanted = -(u[0, k] + restitution * speed) * stiffness
            if wanted > 0.0 and here - eta[0] + ahead * speed <= 0.0:
                forces[0, k] = wanted
                add_late(u[0], response, k, wanted)
            speed = u[0, k]
            here += dt * speed
            u[0, k] = here
        u_contact[0], v_contact[0] = here, speed
        return SOLVED
    fill_matrix(lags, near, m, work.matrix)
    matrix = work.matrix[: m * m].reshape(m, m)
    enabled, active = work.enabled[:m], work.active[:m]
    active[:] = 0
    for k in range(BLOCK):
        touching = False
        for i in range(m):
            forces[i, k] = 0.0
            b[i] = u[i, k] + restitution * v_contact[i]
            enabled[i] = 1 if u_contact[i] - eta[i] + ahead * v_contact[i] <= 0.0 else 0
            touching = touching or (enabled[i] != 0 and b[i] < 0.0)
        if touching:
            bad, held = _answer(m, k, lags, matrix, enabled, active, held, work)
            if bad != SOLVED:
                status = bad
        for i in range(m):
            v_contact[i] = u[i, k]
            u_contact[i] += dt * v_contact[i]
            u[i, k] = u_contact[i]
    return status


@njit(cache=True, nogil=True)
def advance_blocks(
    blocks: int, law: int, n: int, dt: float, restitution: float, rows, omega, shapes, eta, lags, certified: int, q, v,
    u_contact, v_contact, weights, on_q: int, out_lags, out, rec_force, rec_u, work: BlockWork,
) -> int:  # fmt: skip
    """Blocks of K steps of any law over any number of contacts C. Returns a status of `lcp`.

    n = padded(N), of which work.moving move; rows (ROWS, n); omega (N,); shapes (C, n); eta (C,); lags (C, C, 2K) from
    `make_lags` (of velocities for Moreau–Jean); certified: whether contacts out of reach may be passed over (exact-hold;
    `forget` after any change from outside); q, v (n,) in place; u_contact, v_contact (C,) position and velocity of the
    contacts, in and out, Moreau–Jean only; weights (P, n), on_q of them on displacements, and out_lags (P, C, 2K), out (P,
    ≥ blocks·K) the outputs after every step; rec_force (blocks·K, C) contact unknowns; rec_u (blocks·K, C) displacements of
    the contacts after each step, where certified is 0, or empty.
    """
    contacts = eta.size
    hold = law == EXACT_HOLD
    points = weights.shape[0]
    near, u, forces, looked = work.near, work.u, work.forces, work.looked[:contacts]
    result = SOLVED
    for t in range(blocks):
        at = t * BLOCK
        moving = work.moving[0]
        if certified and hold:
            certify(
                dt, omega[:moving], shapes, eta, q, v, work.clock[0], looked, work.until, work.margin, work.bounds,
                work.renewed, work.moved,
            )  # fmt: skip
        else:
            for c in range(contacts):
                looked[c], work.until[c], work.renewed[c] = 1, 0, -1
        if points > 0:
            observe(moving, rows, q, v, weights, on_q, out[:, at:])
        for k in range(BLOCK):
            for c in range(contacts):
                rec_force[at + k, c] = 0.0
        status = SOLVED
        touched = False
        m = gather(looked, near)
        look(moving, rows, shapes, q, v, 0 if hold else 1, near, m, u)
        if hold:
            while True:
                inside = False
                for i in range(m):
                    inside = inside or any_below(u[i], eta[near[i]])
                if not inside:
                    break
                touched = True
                if m == 1:
                    only = near[0]
                    press_sequence(u[0], eta[only], lags[only, only], forces[0])
                    add_forced(u[0], lags[only, only], forces[0])
                else:
                    status = _hold_sequence(m, eta, lags, work)
                if m == contacts or _others_stay_clear(m, lags, work):
                    break
                m = gather(looked, near)  # once more, with those that the forces might reach
                look(moving, rows, shapes, q, v, 0, near, m, u)
        elif m > 0:
            status = _impact_sequence(law, m, dt, restitution, eta, lags, u_contact, v_contact, work)
            for i in range(m):
                for k in range(BLOCK):
                    touched = touched or forces[i, k] > 0.0
        if status != SOLVED:
            result = status
        work.clock[0] += BLOCK
        if rec_u.size > 0:
            for i in range(m):
                for k in range(BLOCK):
                    rec_u[at + k, near[i]] = u[i, k]
        if touched:
            work.moving[0] = n
            for i in range(m):
                c = near[i]
                for k in range(BLOCK):
                    rec_force[at + k, c] = forces[i, k]
                for p in range(points):
                    add_forced(out[p, at:], out_lags[p, c], forces[i])
            if m == 1:
                drive(n, rows, q, v, shapes[near[0]], forces[0])
            else:
                drive_listed(n, rows, q, v, m, near, shapes, forces)
            for c in range(contacts):  # the forces have ended every certificate
                work.renewed[c] = -1
                if looked[c] == 0:
                    work.until[c] = work.clock[0]
        else:
            coast(moving, rows, q, v)
    return result
