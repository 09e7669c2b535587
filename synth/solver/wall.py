"""A wall under the string: contact everywhere along a stretch, at the nodes of the modal grid.

Between instants Δt apart every mode flies exactly (`laws`, exact-hold's propagator). At an instant each node x_i = iL/(N+1)
under the wall gets an impulse of its own. With as many modes as inner nodes the mode shapes at the nodes are orthogonal,
S Sᵀ = I/Δx: an impulse P changes the velocity of its node alone, by P/(μΔx), and kinetic energy is the sum over nodes.
No node knows another, so that there is no complementarity problem. Node i, gap g = u − η, velocity w:

springs      k [N/m per m of wall]: while g < 0, w⁺ = w − κ g Δt, κ = (2/Δt · sin(½ min(ΩΔt, 2)))², Ω² = k/μ, which gives a
             single node the exact frequency Ω. Each node keeps account of the energy that it took from the string, and gives
             back restitution² of it and no more: unloading (w > 0) uses restitution²·κ, an impulse that would overdraw the
             account stops at its balance, and what is left when the node lifts off (g ≥ 0, w > 0) is paid out at once.
rigid        Newton's law w⁺ = −e w where w < 0 and g + ½Δt w ≤ 0 (an instant that is early as often as late).

The energy of the string plus the accounts never grows, at any step, any number of modes and any k; with restitution 1
and no damping it is kept but for what a node still owes when it is lifted off while moving down. Equispaced impulses
between exact flights are the impulse method (Wisdom, Holman, Astronomical J. 102, 1991; García-Archilla, Sanz-Serna,
Skeel, SIAM J. Sci. Comput. 20, 1998). A rigid wall's elastic bounce is Schatzman's (J. Math. Anal. Appl. 73, 1980).

Instants at which no node can be reached are passed over in one flight, however many they are: a look at the string clears
them before and after it (`clearance`), two looks what lies between. Rows are flown apart, from the last impulse on, so that
how often there are rows changes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numba import njit

from synth.native.arrays import allocate
from synth.solver.clearance import FREE, Clearance, attend, clear_for, forget, make_clearance
from synth.solver.energy import stored
from synth.solver.laws import EXACT_HOLD, coefficients
from synth.solver.problem import Problem, Results, kept_array
from synth.solver.propagators import Flights, flown, hop, largest, make_flights
from synth.solver.sine import Sine, make_sine, transform
from synth.solver.stepwise import fly
from synth.solver.vectors import FAST, dot

#: ΩΔt beyond which the springs are softened: two steps of contact are the least that is still a spring
LARGEST_ANGLE = 2.0
#: steps that must be clear before instants further off are looked at
_FAR = 2
# places in Results.sums
STORED, HELD, VISCOUS, LOST, PENETRATION, RISE, START = 0, 1, 2, 3, 4, 5, 6
_SUMS = 7
# places in Results.counts
LAST, TOUCHED, LOOKED, HOLDING, PUSHED, AT, SHORTER, EXIT = 0, 1, 2, 3, 4, 5, 6, 7
_COUNTS = 8


class Wall(NamedTuple):
    """What does not change: N modes, the wall's C nodes are numbers first … first + C − 1 of the grid's N, from 0."""

    dt: float
    mu: float
    spacing: float  # Δx [m]
    scale: float  # √(2/L): what turns a sine transform into displacements
    kappa: float  # [1/s²]; negative: rigid
    restitution: float
    first: int
    omega: np.ndarray  # (N,)
    sigma: np.ndarray  # (N,)
    eta: np.ndarray  # (C,)
    out_shapes: np.ndarray  # (P, N)
    flights: Flights
    tables: Sine


class WallRun(NamedTuple):
    """State and results."""

    q: np.ndarray  # (N,)
    v: np.ndarray  # (N,)
    touching: np.ndarray  # (C,) uint8
    account: np.ndarray  # (C,) [m²/s²] energy taken from the string, over μΔx
    impulse: np.ndarray  # (C,) [N s] since the row before
    results: Results
    nodes: np.ndarray  # (5, N) sine transforms of q and v when last looked at, and work space
    gaps: np.ndarray  # (2, C)
    ahead: np.ndarray  # (4, N) q, v of two instants further off
    row: np.ndarray  # (2, N) q, v of the last row or impulse
    row_coef: np.ndarray  # (6, N) from row to row
    clearance: Clearance


def grid_numbers(positions: np.ndarray, length: float, modes: int) -> np.ndarray:
    """Which inner nodes iL/(modes + 1) of the modal grid these are, from 0; ValueError if they are none or not in a row."""
    places = np.asarray(positions) * (modes + 1) / length
    numbers = np.round(places).astype(int)
    off = np.abs(places - numbers) > 1e-6
    if off.any():
        raise ValueError(
            f"a wall's nodes must lie on the modal grid, multiples of {length / (modes + 1):g} m, got "
            f"{positions[off.argmax()]:g} m; leave nodes and spacing_m out"
        )
    if numbers.size == 0 or np.any(np.diff(numbers) != 1):
        raise ValueError("a wall's nodes must follow each other on the modal grid; leave nodes and spacing_m out")
    return numbers - 1


def make_wall(
    omega: np.ndarray,
    sigma: np.ndarray,
    mu: float,
    dt: float,
    length: float,
    positions: np.ndarray,
    eta: np.ndarray,
    out_shapes: np.ndarray,
    stiffness: float,
    restitution: float,
) -> Wall:
    """Modes ω, σ (N,), a wall of heights η (C,) at the grid's nodes `positions` (C,), outputs (P, N).

    stiffness : [N/m²], the wall's force per metre and metre of depth; infinity: rigid. Raises ValueError for nodes that
        are not in a row on the modal grid, stiffness not > 0 and restitution outside 0 … 1.
    """
    if not stiffness > 0.0:
        raise ValueError(f"wall stiffness must be > 0 N/m², got {stiffness:g}")
    if not 0.0 <= restitution <= 1.0:
        raise ValueError(f"restitution must be between 0 and 1, got {restitution:g}")
    n = omega.size
    numbers = grid_numbers(positions, length, n)
    kappa = -1.0 if math.isinf(stiffness) else spring_rate(stiffness, mu, dt)
    return Wall(
        dt,
        mu,
        length / (n + 1),
        math.sqrt(2.0 / length),
        kappa,
        restitution,
        int(numbers[0]),
        np.ascontiguousarray(omega, dtype=np.float64),
        np.ascontiguousarray(sigma, dtype=np.float64),
        np.ascontiguousarray(eta, dtype=np.float64),
        np.ascontiguousarray(out_shapes, dtype=np.float64),
        make_flights(omega, sigma, mu, dt),
        make_sine(n + 1),
    )


def spring_rate(stiffness: float, mu: float, dt: float) -> float:
    """κ [1/s²] of springs k = stiffness [N/m²] under a string μ [kg/m] at steps dt [s]; see the module's docstring."""
    return (2.0 / dt * math.sin(0.5 * min(LARGEST_ANGLE, math.sqrt(stiffness / mu) * dt))) ** 2


def spring_angle(wall: Wall) -> float | None:
    """ΩΔt of the springs as used; None where rigid."""
    return None if wall.kappa < 0.0 else 2.0 * math.asin(0.5 * wall.dt * math.sqrt(wall.kappa))


@njit(cache=True, nogil=True)
def after_contact(gap: float, w: float, touching: int, account: float, kappa: float, e: float, dt: float):
    """One node's (w⁺, touching, account, lost) from gap [m], velocity w [m/s] and account [m²/s²]; letters as above.

    ½(w² − w⁺²) + account − account⁺ − lost = 0 always.
    """
    if kappa < 0.0:
        if w < 0.0 and gap + 0.5 * dt * w <= 0.0:
            return -e * w, 0, 0.0, 0.5 * w * w * (1.0 - e * e)
        return w, 0, 0.0, 0.0
    if gap >= 0.0:
        if touching and w > 0.0:
            back = e * e * account
            return math.sqrt(w * w + 2.0 * back), 0, 0.0, account - back
        return w, 0, 0.0, account
    if w < 0.0:
        after = w - kappa * gap * dt
        if after <= 0.0:
            return after, 1, account + 0.5 * (w * w - after * after), 0.0
        account += 0.5 * w * w  # stopped and turned round within the instant
        given = min(0.5 * after * after, account)
        after = e * math.sqrt(2.0 * given)
    else:
        after, given = w, 0.0
        if not touching:
            return w, 0, 0.0, 0.0
        if e > 0.0:
            after = w - e * e * kappa * gap * dt
            given = min(0.5 * (after * after - w * w) / (e * e), account)
            after = math.sqrt(w * w + 2.0 * e * e * given)
    return after, 1 if account > given else 0, account - given, given * (1.0 - e * e)


@njit(cache=True, nogil=True)
def _gaps(wall: Wall, displacement, gap) -> float:
    """Fill gap (C,) from a sine transform of q; returns the smallest."""
    least = np.inf
    displacement = displacement[wall.first : wall.first + gap.size]
    for c in range(gap.size):
        gap[c] = wall.scale * displacement[c] - wall.eta[c]
        least = min(least, gap[c])
    return least


@njit(cache=True, nogil=True)
def _weigh(wall: Wall, run: WallRun, q, v) -> None:
    """What has been lost to damping since energy was last weighed."""
    sums, flown_to = run.results.sums, stored(EXACT_HOLD, wall.omega, wall.omega, wall.mu, wall.dt, q, v)
    sums[VISCOUS] += sums[STORED] - flown_to
    sums[STORED] = flown_to


@njit(cache=True, nogil=True, fastmath=FAST)
def _fly_rows(coef, shapes, q, v, u) -> None:
    """Outputs u (n, P) of the state and of n − 1 flights from it."""
    for t in range(u.shape[0]):
        if t > 0:
            fly(coef, q, v)
        for p in range(shapes.shape[0]):
            u[t, p] = dot(shapes[p], q)


@njit(cache=True, nogil=True)
def _fly_contact_rows(wall: Wall, coef, q, v, u, contact_u, work) -> None:
    """`_fly_rows` with the nodes' displacements contact_u (n, C), two rows to a transform; work (4, N)."""
    rows, before, even, odd = u.shape[0], work[0], work[1], work[2]
    for t in range(rows):
        if t > 0:
            fly(coef, q, v)
        _fly_rows(coef, wall.out_shapes, q, v, u[t : t + 1])
        if t % 2 == 0:
            before[:] = q
        if t % 2 == 1 or t == rows - 1:
            transform(wall.tables, before, q, even, odd)
            last = wall.first + wall.eta.size
            contact_u[t] = wall.scale * (odd if t % 2 else even)[wall.first : last]
            if t % 2:
                contact_u[t - 1] = wall.scale * even[wall.first : last]


@njit(cache=True, nogil=True)
def _write(wall: Wall, run: WallRun, row: int, rows: int, every: int, q, v) -> None:
    """So many rows, the first of the state q, v, the rest of free flight from it; impulses enter the first."""
    u = run.results.u[row : row + rows]
    if run.results.contact_u.shape[0] > 0:
        _fly_contact_rows(wall, run.row_coef, q, v, u, run.results.contact_u[row : row + rows], run.ahead)
    else:
        _fly_rows(run.row_coef, wall.out_shapes, q, v, u)
    if run.results.counts[PUSHED] and run.results.contact_force.shape[0] > 0:
        run.results.counts[PUSHED] = 0
        for c in range(wall.eta.size):
            run.results.contact_force[row, c] = run.impulse[c] / (every * wall.dt)
            run.impulse[c] = 0.0
    if run.results.energy.shape[0] > 0:
        for k in range(4):
            run.results.energy[row, k] = run.results.sums[k]


@njit(cache=True, nogil=True)
def _rows(wall: Wall, run: WallRun, every: int, until: int) -> None:
    """The rows that are due up to step `until`, between which and the last impulse the string flew free."""
    at, q, v = run.results.counts[AT], run.row[0], run.row[1]
    following = (at // every + 1) * every
    if following > until:
        return
    hop(wall.flights, following - at, q, v)
    first, rows = following // every, (until - following) // every + 1
    if run.results.energy.shape[0] > 0:
        for row in range(first, first + rows):
            if row > first:
                fly(run.row_coef, q, v)
            _weigh(wall, run, q, v)
            _write(wall, run, row, 1, every, q, v)
    else:
        _write(wall, run, first, rows, every, q, v)
    run.results.counts[AT] = (first + rows - 1) * every


@njit(cache=True, nogil=True)
def _strike(wall: Wall, run: WallRun) -> bool:
    """Impulses of one instant, gaps (C,) and node velocities at hand; False: there were none."""
    change, spare, kick, w = run.nodes[2], run.nodes[3], run.nodes[4], run.nodes[1]
    hit, holding, mass, sums = False, 0, wall.mu * wall.spacing, run.results.sums
    for c in range(wall.eta.size):
        i = wall.first + c
        speed = wall.scale * w[i]
        after, touching, account, lost = after_contact(
            run.gaps[0, c], speed, run.touching[c], run.account[c], wall.kappa, wall.restitution, wall.dt
        )
        sums[LOST] += mass * lost
        sums[HELD] += mass * (account - run.account[c])
        run.touching[c] = touching
        run.account[c] = account
        holding += touching
        if after != speed:
            hit = True
            change[i] = after - speed
            run.impulse[c] += mass * (after - speed)
    run.results.counts[HOLDING] = holding
    if hit:
        w[:] = 0.0
        transform(wall.tables, change, w, kick, spare)
        gain = wall.spacing * wall.scale
        for j in range(run.v.size):
            run.v[j] += gain * kick[j]
        change[wall.first : wall.first + wall.eta.size] = 0.0
    return hit


@njit(cache=True, nogil=True)
def touch(wall: Wall, run: WallRun, step: int, every: int) -> int:
    """Impulses of one instant; returns for how many steps from here nothing can be touched."""
    u, w, gap, sums, counts = run.nodes[0], run.nodes[1], run.gaps[0], run.results.sums, run.results.counts
    transform(wall.tables, run.q, run.v, u, w)
    counts[LOOKED] += 1
    least = _gaps(wall, u, gap)
    sums[PENETRATION] = max(sums[PENETRATION], -least)
    engaged = counts[HOLDING] > 0
    if wall.kappa >= 0.0:
        engaged = engaged or least < 0.0
    else:
        for c in range(gap.size):
            speed = wall.scale * w[wall.first + c]
            engaged = engaged or (speed < 0.0 and gap[c] + 0.5 * wall.dt * speed <= 0.0)
    if engaged:
        ledger = run.results.energy.shape[0] > 0
        _rows(wall, run, every, step - 1)
        whole = sums[STORED] + sums[HELD]
        if ledger:
            _weigh(wall, run, run.q, run.v)
        hit = _strike(wall, run)
        if hit:
            counts[LAST] = step
            counts[TOUCHED] += 1
            counts[PUSHED] = 1
            run.row[0] = run.q
            run.row[1] = run.v
            counts[AT] = step
            forget(run.clearance)
        if ledger:
            sums[STORED] = stored(EXACT_HOLD, wall.omega, wall.omega, wall.mu, wall.dt, run.q, run.v)
            if sums[START] > 0.0:
                sums[RISE] = max(sums[RISE], (sums[STORED] + sums[HELD] - whole) / sums[START])
        if hit and step % every == 0:
            _write(wall, run, step // every, 1, every, run.q, run.v)
        if hit or counts[HOLDING] > 0:
            return 0
    attend(run.clearance, run.q, run.v)
    return max(0, clear_for(run.clearance, gap, least))


@njit(cache=True, nogil=True)
def _look_ahead(wall: Wall, run: WallRun, clear: int, k: int):
    """Looks one and two strides k further off; flies to the furthest that is clear all the way; (steps, clear there)."""
    stride, sums = wall.flights.strides[k], run.results.sums
    q1, v1, q2, v2 = run.ahead[0], run.ahead[1], run.ahead[2], run.ahead[3]
    flown(wall.flights.coef[k], run.q, run.v, q1, v1)
    flown(wall.flights.coef[k], q1, v1, q2, v2)
    transform(wall.tables, q1, q2, run.nodes[0], run.nodes[1])
    run.results.counts[LOOKED] += 2
    least1, least2 = _gaps(wall, run.nodes[0], run.gaps[0]), _gaps(wall, run.nodes[1], run.gaps[1])
    clear1 = clear_for(run.clearance, run.gaps[0], least1)
    if clear1 < 0 or clear + clear1 < stride - 1:
        return 0, clear
    sums[PENETRATION] = max(sums[PENETRATION], -least1)
    clear2 = clear_for(run.clearance, run.gaps[1], least2)
    if clear2 < 0 or clear1 + clear2 < stride - 1:
        run.q[:] = q1
        run.v[:] = v1
        attend(run.clearance, q1, v1)
        return stride, clear1
    sums[PENETRATION] = max(sums[PENETRATION], -least2)
    run.q[:] = q2
    run.v[:] = v2
    attend(run.clearance, q2, v2)
    return 2 * stride, clear2


@njit(cache=True, nogil=True)
def advance(wall: Wall, run: WallRun, steps: int, every: int) -> None:
    """All steps from t = 0 on, rows included; the energies of every flight are weighed where rows of them are wanted."""
    sums, counts, flights = run.results.sums, run.results.counts, wall.flights
    run.nodes[:] = 0.0
    run.row[0] = run.q
    run.row[1] = run.v
    sums[STORED] = sums[START] = stored(EXACT_HOLD, wall.omega, wall.omega, wall.mu, wall.dt, run.q, run.v)
    _write(wall, run, 0, 1, every, run.q, run.v)
    step, clear = 0, 0
    while step < steps:
        left = steps - step
        if clear >= left:
            break
        if clear >= _FAR and clear < left // 2:
            k = largest(flights, min(2 * clear + 1, left // 2)) - counts[SHORTER]
            if k > 0 and flights.strides[k] > clear + 1:
                by, clear = _look_ahead(wall, run, clear, k)
                step += by
                if by < 2 * flights.strides[k]:
                    counts[SHORTER] += 1
                elif counts[SHORTER] > 0:
                    counts[SHORTER] -= 1
                continue
            counts[SHORTER] = 0
        k = largest(flights, min(clear + 1, left))
        fly(flights.coef[k], run.q, run.v)
        step += flights.strides[k]
        clear = touch(wall, run, step, every)
    if run.clearance.counts[FREE]:
        counts[EXIT] = step
    _rows(wall, run, every, steps)
    hop(flights, steps - step, run.q, run.v)
    if run.results.energy.shape[0] > 0:
        _weigh(wall, run, run.q, run.v)


def start_run(problem: Problem, wall: Wall, ledger: bool, contact_rows: bool = True) -> WallRun:
    """A run at t = 0 from the problem's q, v; contact rows cost more than all the rest, and may be left out.

    Raises ValueError for a start that is pressed into the wall.
    """
    depth = float((problem.eta - problem.shapes @ problem.q).max())
    if depth > 1e-9 * max(float(np.abs(problem.q).max()), 1e-6):
        raise ValueError(
            f"the string must start above the wall, got {depth:g} m below it; lower the wall or raise the string"
        )
    return _make_run(problem, wall, ledger, contact_rows)


def kept_of(run: WallRun) -> dict[str, np.ndarray]:
    """What `resume_run` goes on from: the run after its last step, which is a row."""
    return {"q": run.q.copy(), "v": run.v.copy(), "touching": run.touching.copy(), "account": run.account.copy(),
            "sums": run.results.sums.copy()}  # fmt: skip


def resume_run(
    problem: Problem, wall: Wall, kept: Mapping[str, np.ndarray], ledger: bool, contact_rows: bool = True
) -> WallRun:
    """A run from where another ended, steps counted anew; the problem's q, v are of no account. Its row 0 is that row.

    Flights from row to row are divided otherwise than in an undivided run: the same to rounding.
    """
    q, v = (kept_array(kept, name, wall.omega.shape) for name in ("q", "v"))
    run = _make_run(problem._replace(q=q, v=v), wall, ledger, contact_rows)
    run.touching[:] = kept_array(kept, "touching", run.touching.shape) != 0
    run.account[:] = kept_array(kept, "account", run.account.shape)
    run.results.counts[HOLDING] = np.count_nonzero(run.touching)
    run.results.sums[HELD] = wall.mu * wall.spacing * run.account.sum()
    if ledger:
        for place in (VISCOUS, LOST):
            run.results.sums[place] = kept_array(kept, "sums", run.results.sums.shape)[place]
    return run


def _make_run(problem: Problem, wall: Wall, ledger: bool, contact_rows: bool) -> WallRun:
    rows, contacts, n = problem.steps // problem.every + 1, problem.eta.size, problem.omega.size
    sizes = {
        "rows": rows, "contact_rows": rows if contact_rows else 0, "weighed": rows if ledger else 0,
        "points": problem.out_shapes.shape[0], "contacts": contacts, "sums": _SUMS, "counts": _COUNTS,
    }  # fmt: skip
    run = WallRun(
        q=np.array(problem.q, dtype=np.float64),
        v=np.array(problem.v, dtype=np.float64),
        touching=np.zeros(contacts, np.uint8),
        account=np.zeros(contacts),
        impulse=np.zeros(contacts),
        results=allocate(Results, sizes),
        nodes=np.zeros((5, n)),
        gaps=np.zeros((2, contacts)),
        ahead=np.zeros((4, n)),
        row=np.zeros((2, n)),
        row_coef=coefficients(EXACT_HOLD, wall.omega, wall.sigma, wall.mu, problem.every * wall.dt),
        clearance=make_clearance(
            wall.omega, wall.sigma, wall.tables.half, wall.eta, wall.flights.strides, wall.dt, wall.scale,
            wall.first, wall.kappa < 0.0,
        ),
    )  # fmt: skip
    run.results.sums[PENETRATION] = -np.inf
    run.results.counts[LAST] = run.results.counts[EXIT] = -1
    return run
