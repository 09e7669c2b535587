"""A readable twin of the coupled step: the bridge ramps over a frame, and the strings' mean force is held on the body.

Over a frame H of r steps h the bridge moves at a constant velocity V (D,), and every line under it exactly: with constant V
and contact forces λ, its modes, the bridge's displacement b along it and the impulse J that it gives the bridge are one
linear system,

    ẇ = ẏ − cV    ÿ = −ω²w − 2σ(ẏ − cV) + Sᵀλ/μ    ḃ = V    J̇ = −μ c·ÿ − (T/L) b + ξ·λ    V̇ = λ̇ = 0

whose matrix exponential is the step. The body's modes move under F = Σ B J/H, held, by another. Frames are solved as a
whole: all gaps of the r steps against all forces in them, V eliminated, are one linear complementarity problem, which
Lemke's method solves; where it ends on a ray one λ is held over the frame instead, a problem that always has a root.

    H_total = Σ ½μ(ẏ² + ω²w² + y_r²) + ½(T/L) b² + Σ ½m(ṗ² + Ω²p²) + ½ λᵀRλ,   λ the last,   never grows

The mass of the modes left out moves as one mode without displacement, y_r⁺ = c_r V − ρ(y_r − c_r V), once a frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from synth.physics.coupled import CoupledStrings, Place
from synth.physics.modes import mode_shapes

Array = NDArray[np.float64]
#: a row of a problem may miss its condition by that part of the largest entry of its right side
TOLERANCE = 1e-10
MOST_ENUMERATED = 12


@dataclass
class State:
    """x (n,) as in `coupled`, y_r (lines,), the last forces (C,) [N]."""

    x: Array
    left_out: Array
    force: Array


@dataclass
class Frame:
    """What one frame was: forces (r, C) [N], gaps (r, C) [m] without Rλ, V (D,) [m/s], mean force on the body (D,) [N], and
    whether one λ had to be held over it."""

    force: Array
    gap: Array
    velocity: Array
    on_body: Array
    held: bool


class RampFrames:
    """Frames of frame_s seconds in `steps` steps of a coupled system over contacts.

    places    contact points of the lines; heights_m (C,) over the string at rest, of what rides over the bridge
    residual  R (C, C) [m/N], symmetric, positive semidefinite
    rho       ρ of the mass left out, −1 < ρ ≤ 1
    """

    def __init__(self, system: CoupledStrings, frame_s: float, steps=1, places=(), heights_m=(), residual=None, rho=0.9):
        self.system, self.frame_s, self.steps, self.rho = system, frame_s, steps, rho
        self.places: list[Place] = list(places)
        self.heights = np.asarray(heights_m, dtype=float)
        count = len(self.places)
        self.residual = np.zeros((count, count)) if residual is None else np.asarray(residual, dtype=float)
        self.directions = np.array([line.direction for line in system.lines]).reshape(-1, system.body.axes)
        self._lines = [self._line_step(number) for number in range(len(system.lines))]
        self._make_body()
        self._probe()

    # --- one step of a line, one frame of the body, by matrix exponentials ------------------------------------------

    def _line_step(self, number: int) -> tuple[Array, list[int], Array, Array]:
        """exp(A h) over (w, ẏ, b, J, V, λ), its contacts, S, ξ."""
        line = self.system.lines[number]
        mine = [c for c, place in enumerate(self.places) if place.line == number]
        n, mu, c = line.omega.size, line.linear_density_kg_m, line.ramp
        shapes = np.array([mode_shapes(line.length_m, self.places[i].position_m, n)[0] for i in mine]).reshape(-1, n)
        share = np.array([self.places[i].position_m / line.length_m - self.places[i].rides for i in mine])
        a = np.zeros((2 * n + 3 + len(mine),) * 2)
        w, y, b, impulse, v, force = slice(0, n), slice(n, 2 * n), 2 * n, 2 * n + 1, 2 * n + 2, slice(2 * n + 3, None)
        a[w, y] = np.eye(n)
        a[w, v] = -c
        a[y, w] = -np.diag(line.omega**2)
        a[y, y] = -2 * np.diag(line.sigma)
        a[y, v] = 2 * line.sigma * c
        a[y, force] = shapes.T / mu
        a[b, v] = 1.0
        a[impulse] = -mu * (c @ a[y])
        a[impulse, b] -= line.stiffness
        a[impulse, force] += share
        unit = np.ones(len(a))
        unit[w] = line.omega  # displacements as velocities, so that no entry dwarfs another
        step = expm(a * unit[:, None] / unit * (self.frame_s / self.steps)) / unit[:, None] * unit
        return step, mine, shapes, share

    def _make_body(self) -> None:
        """exp over (p, ṗ, F): the body's frame, Ψ and what of β a held F gives, Γ."""
        body = self.system.body
        m, d = len(body.modes), body.axes
        a = np.zeros((2 * m + d,) * 2)
        a[:m, m : 2 * m] = np.eye(m)
        a[m : 2 * m, :m] = -np.diag(body.omega**2)
        a[m : 2 * m, m : 2 * m] = -2 * np.diag(body.sigma)
        a[m : 2 * m, 2 * m :] = (body.shapes / body.mass).T
        unit = np.ones(len(a))
        unit[:m] = body.omega
        self._body = expm(a * unit[:, None] / unit * self.frame_s) / unit[:, None] * unit
        self._gamma = body.shapes @ self._body[:m, 2 * m :]

    # --- a frame for given V and λ --------------------------------------------------------------------------------

    def _move(self, x: Array, velocity: Array, force: Array) -> tuple[Array, Array, Array]:
        """Every line through r steps with V (D,) and λ (r, C): x with the lines moved, gaps S w + ξ b (r, C), J (lines,)."""
        w, rates, p, _ = self.system.parts()
        x, gaps, impulse = x.copy(), np.zeros((self.steps, len(self.places))), np.zeros(len(self._lines))
        beta = self.system.body.shapes @ x[p]
        for number, (step, mine, shapes, share) in enumerate(self._lines):
            direction, n = self.directions[number], shapes.shape[1]
            z = np.concatenate(
                [x[w[number]], x[rates[number]], [direction @ beta, 0.0, direction @ velocity], force[0, mine]]
            )
            for k in range(self.steps):
                z[2 * n + 3 :] = force[k, mine]
                z = step @ z
                gaps[k, mine] = shapes @ z[:n] + share * z[2 * n]
            x[w[number]], x[rates[number]], impulse[number] = z[:n], z[n : 2 * n], z[2 * n + 1]
        return x, gaps, impulse

    def _probe(self) -> None:
        """Responses of gaps (rC,) and of F (D,) to V and to every force, by moving from rest."""
        d, count, r = self.system.body.axes, len(self.places), self.steps
        rest, still, none = np.zeros(self.system.size), np.zeros(d), np.zeros((r, count))
        self._gap_v, self._on_v = np.zeros((r * count, d)), np.zeros((d, d))
        self._gap_f, self._on_f = np.zeros((r * count, r * count)), np.zeros((d, r * count))
        for i in range(d):
            _, gaps, impulse = self._move(rest, np.eye(d)[i], none)
            self._gap_v[:, i], self._on_v[:, i] = gaps.ravel(), self.directions.T @ impulse / self.frame_s
        for i in range(r * count):
            unit = np.zeros(r * count)
            unit[i] = 1.0
            _, gaps, impulse = self._move(rest, still, unit.reshape(r, count))
            self._gap_f[:, i], self._on_f[:, i] = gaps.ravel(), self.directions.T @ impulse / self.frame_s
        for line, direction in zip(self.system.lines, self.directions, strict=True):
            inertia = line.linear_density_kg_m * line.ramp_left_out**2 * (1 + self.rho) / self.frame_s
            self._on_v -= inertia * np.outer(direction, direction)
        # V H = Δβ_free + Γ (F_0 + F_V V + F_λ λ)
        self._solved = np.linalg.inv(self.frame_s * np.eye(d) - self._gamma @ self._on_v)
        per_force = self._solved @ self._gamma @ self._on_f
        self.matrix_of_forces = self._gap_f + self._gap_v @ per_force + np.kron(np.eye(r), self.residual)

    def problem(self, state: State) -> tuple[Array, Array]:
        """b (rC,) of the frame's problem 0 ≤ matrix_of_forces λ + b ⊥ λ ≥ 0, and V (D,) without forces."""
        _, _, p, v = self.system.parts()
        body, r = self.system.body, self.steps
        free = self._body @ np.concatenate([state.x[p], state.x[v], np.zeros(body.axes)])
        drift = body.shapes @ (free[: len(body.modes)] - state.x[p])
        _, gaps, impulse = self._move(state.x, np.zeros(body.axes), np.zeros((r, len(self.places))))
        on_body = self.directions.T @ (impulse / self.frame_s + self._mass_force(state.left_out))
        velocity = self._solved @ (drift + self._gamma @ on_body)
        return gaps.ravel() - np.tile(self.heights, r) + self._gap_v @ velocity, velocity

    def advance(self, state: State, force: Array | None = None, hold: bool = False) -> tuple[State, Frame]:
        """One frame. The forces (rC,) are those given, or a root of the frame's problem, or, with `hold` and where Lemke's
        method ends on a ray, one that is held."""
        right, velocity = self.problem(state)
        if force is None and not hold:
            force = lemke(self.matrix_of_forces, right)
        held = force is None
        if force is None:
            force = self._held(right)
        velocity = velocity + self._solved @ self._gamma @ (self._on_f @ force)
        force = force.reshape(self.steps, -1)

        body, (_, _, p, v) = self.system.body, self.system.parts()
        x, gaps, impulse = self._move(state.x, velocity, force)
        ends = self.directions @ velocity
        c_r = np.array([line.ramp_left_out for line in self.system.lines])
        left_out = c_r * ends - self.rho * (state.left_out - c_r * ends)
        mu = np.array([line.linear_density_kg_m for line in self.system.lines])
        on_body = self.directions.T @ ((impulse - mu * c_r * (left_out - state.left_out)) / self.frame_s)
        moved = self._body @ np.concatenate([state.x[p], state.x[v], on_body])
        x[p], x[v] = np.split(moved[: -body.axes], 2)
        return State(x, left_out, force[-1].copy()), Frame(force, gaps - self.heights, velocity, on_body, held)

    def _held(self, right: Array) -> Array:
        """(rC,): one λ in all steps that solves the gaps at the frame's end."""
        count = len(self.places)
        spread = np.tile(np.eye(count), (self.steps, 1))
        problem = (self.matrix_of_forces @ spread)[-count:]
        one = lemke(0.5 * (problem + problem.T), right[-count:])
        if one is None:
            raise ArithmeticError("the problem of one held force has no solution")
        return spread @ one

    def _mass_force(self, left_out: Array) -> Array:
        """What the masses left out give the bridge at V = 0 (lines,)."""
        lines = self.system.lines
        return np.array(
            [
                x.linear_density_kg_m * x.ramp_left_out * (1 + self.rho) * y / self.frame_s
                for x, y in zip(lines, left_out, strict=True)
            ]
        )

    def start(self, x: Array) -> State:
        """x (n,) of a coupled system, the mass left out moving with the bridge, no contact."""
        velocity = self.system.body.shapes @ x[self.system.parts()[3]]
        c_r = np.array([line.ramp_left_out for line in self.system.lines])
        return State(np.array(x, dtype=float), c_r * (self.directions @ velocity), np.zeros(len(self.places)))

    def energy(self, state: State) -> float:
        """H_total [J]."""
        body, (w, rates, p, v) = self.system.body, self.system.parts()
        total = 0.5 * body.mass @ (state.x[v] ** 2 + (body.omega * state.x[p]) ** 2)
        for number, line in enumerate(self.system.lines):
            b = self.directions[number] @ (body.shapes @ state.x[p])
            bent = state.x[rates[number]] ** 2 + (line.omega * state.x[w[number]]) ** 2
            total += (
                0.5 * line.linear_density_kg_m * (bent.sum() + state.left_out[number] ** 2) + 0.5 * line.stiffness * b**2
            )
        return float(total + 0.5 * state.force @ self.residual @ state.force)

    def linear_step(self) -> Array:
        """The frame without contacts as a matrix over (x, y_r)."""
        lines, size = len(self.system.lines), self.system.size
        columns = []
        for unit in np.eye(size + lines):
            after, _ = self.advance(State(unit[:size], unit[size:], np.zeros(len(self.places))))
            columns.append(np.concatenate([after.x, after.left_out]))
        return np.array(columns).T


# --- linear complementarity problems 0 ≤ A z + b ⊥ z ≥ 0 of any matrix -------------------------------------------------


def complementary(a: Array, b: Array, z: Array) -> bool:
    """Whether z solves the problem, its rows made comparable by A's diagonal."""
    slack, pressed = a @ z + b, np.abs(np.diag(a)) * z
    return bool(np.abs(np.minimum(slack, pressed)).max(initial=0.0) <= TOLERANCE * np.abs(b).max(initial=0.0))


def lemke(a: Array, b: Array) -> Array | None:
    """A solution by Lemke's pivots on a tableau, refined by a solve; None where it ends on a ray (Lemke, Management Science
    11(7), 1965)."""
    n = b.size
    if n == 0 or b.min() >= 0.0:
        return np.zeros(n)
    unit = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(a)), 1e-300))
    scaled, right = a * np.outer(unit, unit), b * unit
    size = np.abs(right).max()
    # w − A z − 1 z0 = b
    table = np.hstack([np.eye(n), -scaled, -np.ones((n, 1)), (right / size)[:, None]])
    basis = list(range(n))
    row, entering = int(np.argmin(right)), 2 * n
    for _ in range(50 * n + 50):
        table[row] /= table[row, entering]
        for other in range(n):
            if other != row:
                table[other] -= table[other, entering] * table[row]
        leaving, basis[row] = basis[row], entering
        if leaving == 2 * n:
            return _refined(a, b, sorted(i - n for i in basis if n <= i < 2 * n))
        entering = leaving + n if leaving < n else leaving - n
        column = table[:, entering]
        able = np.flatnonzero(column > 1e-12)
        if able.size == 0:
            return None
        ratio = table[able, -1] / column[able]
        ties = able[ratio <= ratio.min() + 1e-14]
        row = next((int(i) for i in ties if basis[i] == 2 * n), int(ties[0]))
    return None


def enumerated(a: Array, b: Array) -> list[Array]:
    """Every solution, of up to MOST_ENUMERATED rows, by trying each set of forces."""
    if b.size > MOST_ENUMERATED:
        raise ValueError(f"at most {MOST_ENUMERATED} rows can be enumerated, got {b.size}")
    sets = (chosen for count in range(b.size + 1) for chosen in combinations(range(b.size), count))
    return [z for chosen in sets if (z := _refined(a, b, list(chosen))) is not None]


def _refined(a: Array, b: Array, chosen: list[int]) -> Array | None:
    """Forces on the chosen rows alone, if they solve the problem."""
    z = np.zeros(b.size)
    if chosen:
        try:
            z[chosen] = np.linalg.solve(a[np.ix_(chosen, chosen)], -b[chosen])
        except np.linalg.LinAlgError:
            return None
    return np.maximum(z, 0.0) if complementary(a, b, z) else None
