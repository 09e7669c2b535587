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
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from synth.solver.energy import stored
from synth.solver.kernels import fly
from synth.solver.laws import EXACT_HOLD, coefficients
from synth.solver.problem import Problem
from synth.solver.sine import Sine, make_sine, transform
from synth.solver.vectors import FAST, dot

#: ΩΔt beyond which the springs are softened: two steps of contact are the least that is still a spring
LARGEST_ANGLE = 2.0
#: steps that a string out of reach may be left alone
_LONGEST_SKIP = 64
# places in Run.sums
STORED, HELD, VISCOUS, LOST, PENETRATION, RISE, START = 0, 1, 2, 3, 4, 5, 6
_SUMS = 7
# places in Run.counts
LAST, TOUCHED, LOOKED = 0, 1, 2
_COUNTS = 3


class Wall(NamedTuple):
    """What does not change: N modes, the wall's C nodes are numbers first … first + C − 1 of the grid's N, from 0."""

    dt: float
    mu: float
    spacing: float  # Δx [m]
    scale: float  # √(2/L): what turns a sine transform into displacements
    kappa: float  # [1/s²]; negative: rigid
    restitution: float
    first: int
    coef: np.ndarray  # (6, N)
    omega: np.ndarray  # (N,)
    eta: np.ndarray  # (C,)
    out_shapes: np.ndarray  # (P, N)
    tables: Sine


class Run(NamedTuple):
    """State and results; n rows, every M steps."""

    q: np.ndarray  # (N,)
    v: np.ndarray  # (N,)
    touching: np.ndarray  # (C,) uint8
    account: np.ndarray  # (C,) [m²/s²] energy taken from the string, over μΔx
    impulse: np.ndarray  # (C,) [N s] since the row before
    u: np.ndarray  # (n, P)
    contact_u: np.ndarray  # (n, C)
    contact_force: np.ndarray  # (n, C)
    energy: np.ndarray  # (n, 5), or (0, 5)
    sums: np.ndarray  # float64
    counts: np.ndarray  # int64
    nodes: np.ndarray  # (5, N) sine transforms of q and v when last looked at, and work space


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
    if math.isinf(stiffness):
        kappa = -1.0
    else:
        kappa = (2.0 / dt * math.sin(0.5 * min(LARGEST_ANGLE, math.sqrt(stiffness / mu) * dt))) ** 2
    return Wall(
        dt,
        mu,
        length / (n + 1),
        math.sqrt(2.0 / length),
        kappa,
        restitution,
        int(numbers[0]),
        coefficients(EXACT_HOLD, omega, sigma, mu, dt),
        np.ascontiguousarray(omega, dtype=np.float64),
        np.ascontiguousarray(eta, dtype=np.float64),
        np.ascontiguousarray(out_shapes, dtype=np.float64),
        make_sine(n + 1),
    )


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


@njit(cache=True, nogil=True, fastmath=FAST)
def _extents(omega, q, v, out) -> None:
    """√(q² + v²/ω²) of every mode, which free motion does not enlarge."""
    for j in range(q.size):
        speed = v[j] / omega[j]
        out[j] = math.sqrt(q[j] * q[j] + speed * speed)


@njit(cache=True, nogil=True, fastmath=FAST)
def _moves_by(omega, extent, horizon: float) -> float:
    """No point of the freely moving string moves further than √(2/L) times this in `horizon` [s]; see `kernels.cull`."""
    total = 0.0
    for j in range(extent.size):
        total += extent[j] * min(2.0, omega[j] * horizon)
    return total


@njit(cache=True, nogil=True)
def touch(wall: Wall, run: Run, step: int) -> int:
    """Impulses of one instant; returns for how many steps from here nothing can be touched."""
    contacts, n = wall.eta.size, run.q.size
    u, w, change, spare, kick = run.nodes[0], run.nodes[1], run.nodes[2], run.nodes[3], run.nodes[4]
    transform(wall.tables, run.q, run.v, u, w)
    run.counts[LOOKED] += 1
    hit, held, least = False, 0, np.inf
    for c in range(contacts):
        i = wall.first + c
        gap, speed = wall.scale * u[i] - wall.eta[c], wall.scale * w[i]
        least = min(least, gap)
        after, touching, account, lost = after_contact(
            gap, speed, run.touching[c], run.account[c], wall.kappa, wall.restitution, wall.dt
        )
        run.sums[LOST] += wall.mu * wall.spacing * lost
        run.sums[HELD] += wall.mu * wall.spacing * (account - run.account[c])
        run.touching[c] = touching
        run.account[c] = account
        held += touching
        if after != speed:
            hit = True
            change[i] = after - speed
            run.impulse[c] += wall.mu * wall.spacing * (after - speed)
    run.sums[PENETRATION] = max(run.sums[PENETRATION], -least)
    if hit:
        run.counts[LAST] = step
        run.counts[TOUCHED] += 1
        w[:] = 0.0
        transform(wall.tables, change, w, kick, spare)
        gain = wall.spacing * wall.scale
        for j in range(n):
            run.v[j] += gain * kick[j]
        for c in range(contacts):
            change[wall.first + c] = 0.0
        return 0
    if held > 0:
        return 0
    _extents(wall.omega, run.q, run.v, spare)
    steps = _LONGEST_SKIP
    while steps > 1 and least <= 1.001 * wall.scale * _moves_by(wall.omega, spare, (steps + 1) * wall.dt):
        steps //= 2
    return steps - 1


@njit(cache=True, nogil=True)
def _write(wall: Wall, run: Run, row: int, every: int) -> None:
    for p in range(wall.out_shapes.shape[0]):
        run.u[row, p] = dot(wall.out_shapes[p], run.q)
    for c in range(wall.eta.size):
        run.contact_u[row, c] = wall.scale * run.nodes[0, wall.first + c]
        run.contact_force[row, c] = run.impulse[c] / (every * wall.dt)
        run.impulse[c] = 0.0
    if run.energy.shape[0] > 0:
        for k in range(4):
            run.energy[row, k] = run.sums[k]


@njit(cache=True, nogil=True)
def advance(wall: Wall, run: Run, steps: int, every: int) -> None:
    """All steps from t = 0 on, rows included; the energies of every step are weighed where rows of them are wanted."""
    sums = run.sums
    ledger = run.energy.shape[0] > 0
    run.nodes[:] = 0.0
    transform(wall.tables, run.q, run.v, run.nodes[0], run.nodes[1])
    before = sums[STORED] = sums[START] = stored(EXACT_HOLD, wall.omega, wall.omega, wall.mu, wall.dt, run.q, run.v)
    _write(wall, run, 0, every)
    skip = 0
    for t in range(1, steps + 1):
        fly(wall.coef, run.q, run.v)
        whole = before + sums[HELD]
        if ledger:
            flown = stored(EXACT_HOLD, wall.omega, wall.omega, wall.mu, wall.dt, run.q, run.v)
            sums[VISCOUS] += before - flown
            before = flown
        if skip > 0 and t % every != 0:
            skip -= 1
        else:  # rows are looked at in any case: they need the nodes' positions
            skip = touch(wall, run, t)
            if ledger:
                before = stored(EXACT_HOLD, wall.omega, wall.omega, wall.mu, wall.dt, run.q, run.v)
        if ledger:
            sums[STORED] = before
            if sums[START] > 0.0:
                sums[RISE] = max(sums[RISE], (before + sums[HELD] - whole) / sums[START])
        if t % every == 0:
            _write(wall, run, t // every, every)


def start_run(problem: Problem, wall: Wall, ledger: bool) -> Run:
    """A run at t = 0 from the problem's q, v. Raises ValueError for a start that is pressed into the wall."""
    depth = float((problem.eta - problem.shapes @ problem.q).max())
    if depth > 1e-9 * max(float(np.abs(problem.q).max()), 1e-6):
        raise ValueError(f"the start must lie over the wall, got {depth:g} m below it; lower the wall or raise the string")
    rows, contacts, n = problem.steps // problem.every + 1, problem.eta.size, problem.omega.size
    run = Run(
        q=np.array(problem.q, dtype=np.float64),
        v=np.array(problem.v, dtype=np.float64),
        touching=np.zeros(contacts, np.uint8),
        account=np.zeros(contacts),
        impulse=np.zeros(contacts),
        u=np.zeros((rows, problem.out_shapes.shape[0])),
        contact_u=np.zeros((rows, contacts)),
        contact_force=np.zeros((rows, contacts)),
        energy=np.zeros((rows if ledger else 0, 5)),
        sums=np.zeros(_SUMS),
        counts=np.zeros(_COUNTS, np.int64),
        nodes=np.zeros((5, n)),
    )
    run.sums[PENETRATION] = -np.inf
    run.counts[LAST] = -1
    return run
