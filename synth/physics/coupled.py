"""Strings on one body, as the linear system that they are, and its exact complex modes.

A *line* is one polarisation of one string: u(x, t) = Σ_j w_j φ_j(x) + (x/L) b, with the modes of a string with rigid ends
and the motion b = B·β of the bridge at x = L along it (a string whose bridge is its other end is looked at from there). With
c_j = ∫ φ_j x/L dx = √(2L) (−1)^{j+1}/(jπ) and y_j = w_j + c_j b, Lagrange's equations of the line and of the body are

    ẇ = ẏ − c ḃ,     ÿ = −ω² w − 2σ(ẏ − c ḃ) + φ(x_c) λ/μ
    m(p̈ + 2Σ ṗ + Ω² p) = Ψᵀ Σ B f,     f = −μ Σ c ÿ − μ c_r² b̈ − (T/L) b + ξ λ

for a force λ at x_c, ξ = x_c/L, less 1 where what gives the force rides on the bridge. Losses act on the string's bending
away from the line between its ends, not on its motion with them. c_r² = L/3 − Σ c² is the mass of the modes left out, which
follow the bridge without delay: with it frequencies err as 1/N³, without as 1/N. State: x = (w, ẏ, p, ṗ).

    E = Σ ½μ(ẏ² + ω²w²) + ½μ c_r² ḃ² + ½(T/L) b² + Σ ½m(ṗ² + Ω²p²),     Ė = −Σ 2μσ(ẏ − cḃ)² − Σ 2mΣṗ² + λ·(Sẇ + ξḃ)

Real (undamped) modes of the same system give poor results, as damping and coupling are alike in size (Woodhouse, On the
synthesis of guitar plucks, Acta Acustica 90 (2004) 928).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from synth.physics.body_modes import Body
from synth.physics.modes import decay_rates, modal_frequencies, mode_shapes, ramp_moments
from synth.physics.string import String

#: float64 of any shape
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Line:
    """One polarisation of one string, by the modes of its rigid ends.

    length_m, tension_n, linear_density_kg_m  L [m], T [N], μ [kg/m]
    omega, sigma  (N,) frequencies and decay rates of the modes [rad/s, 1/s], without what the body takes
    direction     B (D,), see `body_modes.BridgePlace`
    keeps_mass    whether the mass of the modes left out moves with the bridge

    Raises ValueError for shapes that do not fit and numbers that are not positive.
    """

    length_m: float
    tension_n: float
    linear_density_kg_m: float
    omega: Array
    sigma: Array
    direction: Array
    keeps_mass: bool = True

    def __post_init__(self) -> None:
        for name in ("omega", "sigma", "direction"):
            value = np.array(getattr(self, name), dtype=np.float64, ndmin=1)
            if value.ndim != 1 or not np.all(np.isfinite(value)):
                raise ValueError(f"{name} of a line must be a list of finite numbers, got {value}")
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        if self.omega.shape != self.sigma.shape:
            raise ValueError(f"omega and sigma must be equally long, got {self.omega.size} and {self.sigma.size}")
        for name, value in (("omega", self.omega), ("length_m, tension_n and linear_density_kg_m", self._scalars)):
            if not np.all(value > 0.0):
                raise ValueError(f"{name} of a line must be > 0, got {value[~(value > 0.0)][0]:g}")
        if np.any(self.sigma < 0.0):
            raise ValueError(f"sigma of a line must be >= 0 1/s, got {self.sigma.min():g}; a string gains no energy")

    @property
    def _scalars(self) -> Array:
        return np.array([self.length_m, self.tension_n, self.linear_density_kg_m])

    @classmethod
    def from_string(cls, string: String, modes: int, direction: ArrayLike, keeps_mass: bool = True) -> Line:
        """The first `modes` modes of a string, all its losses: its `nut` should not hold what the body does."""
        return cls(
            string.length_m,
            string.tension_n,
            string.linear_density_kg_m,
            modal_frequencies(string, modes),
            decay_rates(string, modes),
            np.asarray(direction, dtype=np.float64),
            keeps_mass,
        )

    @property
    def ramp(self) -> Array:
        """c (N,) [√m]: each mode's share in the straight line from (0, 0) to (L, 1)."""
        return ramp_moments(self.length_m, self.omega.size)

    @property
    def ramp_left_out(self) -> float:
        """c_r [√m]: that of all modes above N together; 0 where they are left out with their mass."""
        rest = self.length_m / 3.0 - float(self.ramp @ self.ramp)
        return math.sqrt(max(0.0, rest)) if self.keeps_mass else 0.0

    @property
    def stiffness(self) -> float:
        """T/L [N/m]: what the string drawn straight holds against the bridge's motion."""
        return self.tension_n / self.length_m


class Place(NamedTuple):
    """A point of a line: its number, the distance x from the far end [m], whether what stands there rides on the bridge."""

    line: int
    position_m: float
    rides: bool = False


@dataclass(frozen=True, eq=False)
class CoupledStrings:
    """Lines on a body: matrices of ẋ = A x + g λ, u = r x, over the state x = (w, ẏ, p, ṗ) (n,), n = 2(ΣN + M).

    lines  whose directions have as many components as the body's shapes; else ValueError
    """

    lines: tuple[Line, ...]
    body: Body
    #: (lines + 1,) where the modes of each line begin, and ΣN
    offsets: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "lines", tuple(self.lines))
        for number, line in enumerate(self.lines):
            if line.direction.size != self.body.axes:
                raise ValueError(
                    f"direction of line {number} must have {self.body.axes} components as the body's shapes, "
                    f"got {line.direction.size}"
                )
        object.__setattr__(self, "offsets", np.concatenate([[0], np.cumsum([line.omega.size for line in self.lines])]))

    @property
    def size(self) -> int:
        """n."""
        return 2 * (int(self.offsets[-1]) + len(self.body.modes))

    def parts(self) -> tuple[list[slice], list[slice], slice, slice]:
        """Where in x stand w and ẏ of each line, p and ṗ."""
        total, modes = int(self.offsets[-1]), len(self.body.modes)
        spans = list(zip(self.offsets[:-1], self.offsets[1:], strict=True))
        w = [slice(int(a), int(b)) for a, b in spans]
        rates = [slice(total + int(a), total + int(b)) for a, b in spans]
        return w, rates, slice(2 * total, 2 * total + modes), slice(2 * total + modes, 2 * total + 2 * modes)

    @cached_property
    def ends(self) -> Array:
        """(lines, M): motion of each line's end per p."""
        return np.array([line.direction @ self.body.shapes for line in self.lines]).reshape(len(self.lines), -1)

    @cached_property
    def body_mass(self) -> Array:
        """(M, M) [kg]: the modal masses, and those of the strings' modes left out."""
        mass = np.diag(self.body.mass)
        for line, end in zip(self.lines, self.ends, strict=True):
            mass += line.linear_density_kg_m * line.ramp_left_out**2 * np.outer(end, end)
        return mass

    @cached_property
    def body_stiffness(self) -> Array:
        """(M, M) [N/m]: of the body's modes, and of the strings drawn straight."""
        stiffness = np.diag(self.body.mass * self.body.omega**2)
        for line, end in zip(self.lines, self.ends, strict=True):
            stiffness += line.stiffness * np.outer(end, end)
        return stiffness

    @cached_property
    def matrix(self) -> Array:
        """A (n, n) [1/s and what the state's units make of it]."""
        w, rates, p, v = self.parts()
        a = np.zeros((self.size, self.size))
        a[p, v] = np.eye(len(self.body.modes))
        push = np.zeros((len(self.body.modes), self.size))
        push[:, p] = -self.body_stiffness
        push[:, v] = -np.diag(2.0 * self.body.mass * self.body.sigma)
        for number, (line, end) in enumerate(zip(self.lines, self.ends, strict=True)):
            c, mu = line.ramp, line.linear_density_kg_m
            a[w[number], rates[number]] = np.eye(c.size)
            a[w[number], v] = -np.outer(c, end)
            a[rates[number], w[number]] = -np.diag(line.omega**2)
            a[rates[number], rates[number]] = -np.diag(2.0 * line.sigma)
            a[rates[number], v] = np.outer(2.0 * line.sigma * c, end)
            push -= np.outer(end, mu * (c @ a[rates[number]]))
        a[v] = np.linalg.solve(self.body_mass, push)
        return a

    @cached_property
    def energy_matrix(self) -> Array:
        """H (n, n): E = ½ xᵀ H x [J]."""
        w, rates, p, v = self.parts()
        h = np.zeros((self.size, self.size))
        for number, line in enumerate(self.lines):
            h[w[number], w[number]] = np.diag(line.linear_density_kg_m * line.omega**2)
            h[rates[number], rates[number]] = line.linear_density_kg_m * np.eye(line.omega.size)
        h[p, p] = self.body_stiffness
        h[v, v] = self.body_mass
        return h

    def energy(self, states: ArrayLike) -> Array:
        """½ xᵀ H x [J] of states (…, n) → (…)."""
        states = np.asarray(states, dtype=np.float64)
        return 0.5 * np.einsum("...i,...i->...", states @ self.energy_matrix, states)

    def displacement_rows(self, places: Sequence[Place]) -> Array:
        """r (C, n): u = r x [m], over the bridge where the place rides on it. Of the kept modes: the static compliance R of
        the others (`modes.residual_compliance`) is the caller's. ValueError for places outside the line."""
        rows = np.zeros((len(places), self.size))
        w, _, p, _ = self.parts()
        for row, place in zip(rows, places, strict=True):
            row[w[place.line]], share = self._shape(place)
            row[p] = share * self.ends[place.line]
        return rows

    def velocity_rows(self, places: Sequence[Place]) -> Array:
        """(C, n): u̇ [m/s] of the same places."""
        return self.displacement_rows(places) @ self.matrix

    def force_columns(self, places: Sequence[Place]) -> Array:
        """g (n, C): ẋ by a unit force on the string at each place [1/N]; what rides gives its reaction to the bridge."""
        columns = np.zeros((self.size, len(places)))
        _, rates, _, v = self.parts()
        for number, place in enumerate(places):
            line = self.lines[place.line]
            shape, share = self._shape(place)
            columns[rates[place.line], number] = shape / line.linear_density_kg_m
            columns[v, number] = np.linalg.solve(self.body_mass, self.ends[place.line] * (share - line.ramp @ shape))
        return columns

    def bridge_rows(self) -> Array:
        """(D, n): β."""
        rows = np.zeros((self.body.axes, self.size))
        rows[:, self.parts()[2]] = self.body.shapes
        return rows

    def bridge_columns(self) -> Array:
        """(n, D): ẋ by a unit force on the bridge at its reference point."""
        columns = np.zeros((self.size, self.body.axes))
        columns[self.parts()[3]] = np.linalg.solve(self.body_mass, self.body.shapes.T)
        return columns

    def _shape(self, place: Place) -> tuple[Array, float]:
        """φ(x) (N,), ξ."""
        line = self.lines[place.line]
        shape = mode_shapes(line.length_m, place.position_m, line.omega.size)[0]
        return shape, place.position_m / line.length_m - (1.0 if place.rides else 0.0)

    def static_deflection(self, places: Sequence[Place], forces_n: ArrayLike) -> Array:
        """(n,): the state at rest under constant forces (C,) [N] at places, of the kept modes."""
        forces = np.asarray(forces_n, dtype=np.float64)
        if forces.shape != (len(places),):
            raise ValueError(f"forces_n must be one force for each of {len(places)} places, got shape {forces.shape}")
        state = np.zeros(self.size)
        w, _, p, _ = self.parts()
        on_body = np.zeros(len(self.body.modes))
        for place, force in zip(places, forces, strict=True):
            line = self.lines[place.line]
            shape, share = self._shape(place)
            state[w[place.line]] += force * shape / (line.linear_density_kg_m * line.omega**2)
            on_body += force * share * self.ends[place.line]
        state[p] = np.linalg.solve(self.body_stiffness, on_body)
        return state

    def modes(self) -> ComplexModes:
        """The complex modes, by an eigenvalue problem of n × n: some seconds for n = 1000, n³ beyond."""
        unit = 1.0 / np.sqrt(np.diag(self.energy_matrix))  # energy as the norm, in which A is nearly normal
        eigenvalues, right = np.linalg.eig(self.matrix * unit / unit[:, None])
        order = np.lexsort((eigenvalues.real, eigenvalues.imag))
        eigenvalues, right = eigenvalues[order], right[:, order]
        condition = float(np.linalg.cond(right))
        left: NDArray[np.complex128] = np.linalg.inv(right).astype(np.complex128)
        return ComplexModes(eigenvalues, unit[:, None] * right, left / unit, condition)


@dataclass(frozen=True, eq=False)
class ComplexModes:
    """ẋ = A x by its eigenvectors: A = right diag(eigenvalues) left.

    eigenvalues  (n,) [1/s], ordered by imaginary part, conjugate pairs both
    right, left  (n, n) eigenvectors in columns, and their inverse
    condition    of the eigenvectors in the energy's norm: as many digits are lost; large where two modes are nearly one
    """

    eigenvalues: NDArray[np.complex128]
    right: NDArray[np.complex128]
    left: NDArray[np.complex128]
    condition: float

    def oscillations(self) -> NDArray[np.complex128]:
        """s = −σ + iω (K,) of positive frequency, lowest first."""
        return self.eigenvalues[self.eigenvalues.imag > 0.0]

    def free_response(self, state: ArrayLike, times_s: ArrayLike, rows: ArrayLike) -> Array:
        """(t, outputs): rows (outputs, n) @ x(t) for x(0) = state (n,), at any times (t,) [s]."""
        amplitudes = self.left @ np.asarray(state, dtype=np.float64)
        weights = (np.asarray(rows, dtype=np.float64) @ self.right) * amplitudes
        times = np.asarray(times_s, dtype=np.float64)
        result = np.empty((times.size, weights.shape[0]))
        for some in np.array_split(np.arange(times.size), 1 + times.size // 1024):
            result[some] = (np.exp(np.outer(times[some], self.eigenvalues)) @ weights.T).real
        return result

    def transfer(self, rows: ArrayLike, columns: ArrayLike, s: ArrayLike) -> NDArray[np.complex128]:
        """rows (s − A)⁻¹ columns at complex frequencies s, any shape [1/s] → (…, outputs, inputs): displacement per force
        for displacement_rows and force_columns."""
        s = np.asarray(s, dtype=np.complex128)[..., None]
        out, into = np.asarray(rows) @ self.right, self.left @ np.asarray(columns)
        return np.einsum("ik,...k,kj->...ij", out, 1.0 / (s - self.eigenvalues), into)
