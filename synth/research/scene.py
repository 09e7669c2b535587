"""A case turned into the arrays that a scheme works on."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from synth.physics.excitation import pluck_weights, rounded_triangle, triangle_pluck
from synth.physics.modes import (
    base_frequencies,
    decay_rates,
    modal_frequencies,
    mode_shapes,
    model_decay_rates,
    model_frequencies,
    residual_compliance,
)
from synth.physics.obstacle import Obstacle, bass_neck_height, frets, parabola_height, wall_positions
from synth.physics.string import NutResonance, String
from synth.physics.tail import Tail, lumped_tail
from synth.research.case import (
    MOST_AMPLITUDE,
    MOST_SPEED,
    BendTable,
    Case,
    CaseError,
    FingerTable,
    ObstacleTable,
    RampTable,
    StringTable,
    WallTable,
    arrays_of,
)
from synth.research.finger_paths import finger_end
from synth.solver import driver
from synth.solver.contact_laws import step_of
from synth.solver.laws import EXACT_HOLD, law_of
from synth.solver.problem import Problem
from synth.solver.stringmodel import StringContacts, StringModes

_MOST_BYTES = 4 * 2**30
_MOST_MODE_STEPS = 1e14  # a day of one core
_MOST_POINTS = 1e6  # of a wall, before anything is made of them
#: a bend renews the tension this often
_BEND_INTERVAL_S = 1e-3
#: residual compliance is worked out at bends this far apart
_RESIDUAL_GRID_CENTS = 25.0


class Scene:
    """String, obstacle, fingers, modes and contacts of a case; files count from `folder`.

    `kept` is the state at step `first`, from which a run goes on: times count on, and the case's start is of no account.
    """

    def __init__(self, case: Case, folder: Path, first: int = 0, kept: Mapping[str, np.ndarray] | None = None) -> None:
        self.case, self.folder, self.first, self.kept = case, folder, first, kept
        self.dt = 1.0 / case.run.internal_rate_hz
        self.steps = max(1, round(case.run.duration_s * case.run.internal_rate_hz))
        every = case.run.steps_per_output
        self.outputs = self.steps // every + 1
        self.last = first + (self.outputs - 1) * every  # the step of the last row
        self.string = string_of(self.case.string, self.folder, "string")
        self.obstacle = self._obstacle()
        self._refuse_the_absurd()

        length, n = self.string.length_m, case.run.modes
        start = case.initial
        if start.position_m is not None:
            _refuse_off_string("initial.position_m", start.position_m, length)
            for key, reach in (("rounding_half_width_m", 1.0), ("width_m", 0.5)):
                refuse_over_end(f"initial.{key}", getattr(start, key) or 0.0, reach, start.position_m, length)
        self.fingers = sorted(case.finger, key=lambda f: f.start_s)
        for number, finger in enumerate(self.fingers):
            _refuse_off_string("finger.position_m", finger.position_m, length)
            refuse_over_end("finger.width_m", finger.width_m, 0.5, finger.position_m, length)
            if number and finger.start_s < finger_end(self.fingers[number - 1]):
                raise CaseError("finger: one must let go before the next takes hold")
        self.positions = np.array(self.obstacle.positions_m)
        self.eta = np.array(self.obstacle.heights_m)
        self.omega = modal_frequencies(self.string, n)
        self.sigma = decay_rates(self.string, n)
        if not np.all(np.isfinite(self.omega) & np.isfinite(self.sigma)):
            raise CaseError("string: frequencies or decay rates of its modes are beyond all numbers; check the units")
        self.shapes = mode_shapes(length, self.positions, n)
        self._bent_residuals: dict[int, np.ndarray] = {}
        try:
            self.out_shapes = mode_shapes(length, np.array(case.run.outputs_m), n)
        except ValueError as error:
            raise CaseError(f"run.outputs_m: {error}") from None
        for end in sorted(bend.start_s + bend.duration_s for bend in case.bend):
            cents = float(self._cents(np.array([end]))[0])
            if not self._tension_at(cents - _RESIDUAL_GRID_CENTS) > 0.0:
                raise CaseError(f"bend: {cents:g} cents at {end:g} s leave no tension; bend the string up, or less far down")

        if case.bend and case.scheme.name == "exact-hold" and case.scheme.tail == "lumped":
            raise CaseError('scheme.tail: lumped modes do not follow a bend; take tail = "static"')
        if case.obstacle.moves and case.scheme.substeps > 1:
            raise CaseError(
                f"scheme.substeps: not over a moving obstacle, got {case.scheme.substeps}; raise internal_rate_hz"
            )

    @cached_property
    def tail(self) -> Tail | None:
        """The lumped modes of those left out, where the scheme is exact-hold and wants them.

        Unless asked for by name there are none with a bend, whose R follows the tension, and none where contacts are more
        than a fourth of the modes, a wall of points: they would be as many as those.
        """
        scheme, run = self.case.scheme, self.case.run
        if scheme.name != "exact-hold" or scheme.tail_kind != "lumped" or self.positions.size == 0 or self.case.bend:
            return None
        if scheme.tail is None and 4 * self.positions.size > run.modes:
            return None
        return lumped_tail(self.string, self.positions, run.modes, run.internal_rate_hz * scheme.substeps)

    @cached_property
    def layers(self) -> np.ndarray:
        """(3, C) of the contacts (`solver.layers`), or (3, 0)."""
        layer = self.case.obstacle.layer
        if layer is None:
            return np.zeros((3, 0))
        of_each = [[layer.stiffness_n_m], [layer.resistance_n_s_m], [layer.thickness_m]]
        return np.repeat(of_each, self.positions.size, axis=1)

    @cached_property
    def residual(self) -> np.ndarray:
        """R (C, C) [m/N], static compliance of what neither modes nor lumped modes stand for; zero if not wanted."""
        return self._residual(self.string) if self.tail is None else self.tail.residual

    @cached_property
    def model(self) -> driver.Model:
        """Coefficients and contact matrix of a case whose scheme is a law of the block kernels; lumped modes come last."""
        return self._model(self.omega, self.sigma, 0.0)

    def bent_model(self, cents: float) -> driver.Model:
        """`model` at another tension: mode shapes and contacts stay, ω, σ and R follow.

        The added tension is that which moves the first mode of the pinned string by `cents`. Measured frequencies and
        decay rates, which belong to the tension at rest, are scaled as the model's.
        """
        n = self.omega.size
        plain, bent = self._bent_string(0.0), self._bent_string(cents)
        omega, sigma = model_frequencies(bent, n), model_decay_rates(bent, n)
        measured = len(self.string.measured_frequencies_hz)
        omega[:measured] = self.omega[:measured] * (omega / model_frequencies(plain, n))[:measured]
        measured = min(n, len(self.string.measured_decay_rates))
        rest = model_decay_rates(plain, measured)
        sigma[:measured] = self.sigma[:measured] * np.divide(sigma[:measured], rest, out=np.ones(measured), where=rest > 0.0)
        return self._model(omega, sigma, cents)

    @cached_property
    def tension_changes(self) -> list[tuple[int, float]]:
        """(step, cents) from which step on the string is bent by how much; empty without a bend.

        The bend is a staircase: each tread has the value in its middle.
        """
        if not self.case.bend:
            return []
        tread = max(1, round(_BEND_INTERVAL_S / self.dt))
        begin = np.arange(0, self.first + self.steps, tread)
        cents = self._cents((begin + 0.5 * tread) * self.dt)
        changes = np.flatnonzero(np.diff(cents, prepend=0.0))
        return [(int(begin[k]), float(cents[k])) for k in changes]

    def obstacle_displacement(self, t: np.ndarray) -> np.ndarray:
        """How far the obstacle is above its heights at the times t [s], any shape → [m]."""
        motion = self.case.obstacle.motion
        up = ramps(t, motion.ramp, [ramp.displacement_m for ramp in motion.ramp])
        for sine in motion.sine:
            up = up + sine.amplitude_m * np.sin(2.0 * np.pi * sine.frequency_hz * np.maximum(t - sine.start_s, 0.0))
        return up

    def _cents(self, t: np.ndarray) -> np.ndarray:
        return ramps(t, self.case.bend, [bend.cents for bend in self.case.bend])

    def _tension_at(self, cents: float) -> float:
        return bent_tension(self.string, cents)

    def _bent_string(self, cents: float) -> String:
        tension = self._tension_at(cents)
        return replace(self.string, tension_n=tension, measured_frequencies_hz=(), measured_decay_rates=())

    def _bent_residual(self, cents: float) -> np.ndarray:
        """R, between two of a grid of bends linear in 1/T: exact for an ideal string, off by < 3e-4 for others."""
        if cents == 0.0:
            return self.residual
        below = math.floor(cents / _RESIDUAL_GRID_CENTS)
        low, high = self._residual_of_bend(below), self._residual_of_bend(below + 1)
        at_low, here, at_high = (
            1.0 / self._tension_at(c) for c in (below * _RESIDUAL_GRID_CENTS, cents, (below + 1) * _RESIDUAL_GRID_CENTS)
        )
        share = (here - at_low) / (at_high - at_low)
        return (1.0 - share) * low + share * high

    def _residual_of_bend(self, place: int) -> np.ndarray:
        if place not in self._bent_residuals:
            self._bent_residuals[place] = self._residual(self._bent_string(place * _RESIDUAL_GRID_CENTS))
        return self._bent_residuals[place]

    def _residual(self, string: String) -> np.ndarray:
        contacts = self.positions.size
        if self.case.scheme.tail_kind != "none" and contacts > 0:
            return residual_compliance(string, self.positions, self.case.run.modes)
        return np.zeros((contacts, contacts))

    def _model(self, omega: np.ndarray, sigma: np.ndarray, cents: float) -> driver.Model:
        law = law_of(self.case.scheme.name)
        contacts = self.positions.size
        shapes, out_shapes = self.shapes, self.out_shapes
        if self.tail is not None:
            outputs = mode_shapes(self.string.length_m, np.array(self.case.run.outputs_m), self.tail.modes)
            omega = np.append(omega, self.tail.omega)
            sigma = np.append(sigma, self.tail.sigma)
            shapes = np.hstack([shapes, self.tail.shapes])
            out_shapes = np.hstack([out_shapes, self.tail.weights(outputs)])
        residual = self._bent_residual(cents) if law == EXACT_HOLD else np.zeros((contacts, contacts))
        return driver.make_model(
            law,
            StringModes(self.string.linear_density_kg_m, omega, sigma),
            self.dt,
            StringContacts(shapes, self.eta, residual, self.layers),
            out_shapes,
            self.case.scheme.restitution,
            self.case.scheme.substeps,
            step_of(self.case.scheme.name),
        )

    def pluck_weights(self, finger: FingerTable) -> np.ndarray:
        """(N,) weights of a finger's width on the coordinates of `model`."""
        n = self.case.run.modes
        where = (self.string.length_m, finger.position_m, finger.width_m)
        if self.tail is None:
            return pluck_weights(*where, n)
        full = pluck_weights(*where, self.tail.modes)
        return np.append(full[:n], self.tail.weights(full))

    def problem(self) -> Problem:
        """The arrays for any other scheme."""
        q, v = self.initial()
        return Problem(
            self.dt,
            self.steps,
            self.case.run.steps_per_output,
            self.string.linear_density_kg_m,
            self.omega,
            self.sigma,
            self.shapes,
            self.eta,
            self.out_shapes,
            q,
            v,
        )

    def _obstacle(self) -> Obstacle:
        table = self.case.obstacle
        try:
            obstacle = self._points(table)
            obstacle.check(self.string.length_m)
        except CaseError:
            raise
        except ValueError as error:
            kind = "wall" if table.wall is not None else "frets" if table.frets is not None else "positions_m"
            raise CaseError(f"obstacle.{kind}: {error}") from None
        return obstacle

    def _points(self, table: ObstacleTable) -> Obstacle:
        if table.wall is not None:
            return self._wall(table.wall)
        if table.frets is not None:
            return frets(**table.frets.model_dump())
        if table.positions_m is not None:
            heights = table.heights_m
            if not isinstance(heights, list):
                heights = [heights] * len(table.positions_m)  # type: ignore[list-item]
            return Obstacle(tuple(table.positions_m), tuple(heights))  # type: ignore[arg-type]
        return Obstacle()

    def _wall(self, table: WallTable) -> Obstacle:
        stretch = abs(table.to_m - table.from_m)
        points = stretch / self.string.length_m * self.case.run.modes
        if table.nodes is not None:
            points = table.nodes
        elif table.spacing_m is not None:
            points = stretch / table.spacing_m
        if points > _MOST_POINTS:
            raise CaseError(
                f"obstacle.wall: {points:.3g} points are too many, the limit is {_MOST_POINTS:g}; take fewer nodes or modes"
            )
        x = wall_positions(
            self.string.length_m, table.from_m, table.to_m, intervals=self.case.run.modes + 1, nodes=table.nodes,
            spacing_m=table.spacing_m,
        )  # fmt: skip
        if table.neck is not None:
            heights = bass_neck_height(x)
        elif table.parabola is not None:
            heights = parabola_height(x, **table.parabola.model_dump())
        else:
            heights = np.full(x.size, table.height_m)
        return Obstacle(tuple(x.tolist()), tuple(heights.tolist()))

    def _refuse_the_absurd(self) -> None:
        run = self.case.run
        contacts, points = len(self.obstacle), len(run.outputs_m)
        rows = run.modes if self.case.scheme.grid == "full" else contacts  # of S
        columns = 1 + points + 2 * contacts + (5 if run.ledger else 0)
        pairs = 0 if self.case.scheme.name == "wall" else 8 * contacts**2  # compliances, factors
        n_bytes = 8.0 * (self.outputs * columns + run.modes * (rows + points + 12) + run.steps_per_output * contacts + pairs)
        if n_bytes > _MOST_BYTES:
            raise CaseError(
                f"run: the results would take {n_bytes / 2**30:.4g} GiB, the limit is {_MOST_BYTES / 2**30:.0f}; "
                "lower output_rate_hz, duration_s, modes or the number of points"
            )
        work = float(self.steps) * run.modes * (1 + rows)
        if work > _MOST_MODE_STEPS:
            raise CaseError(
                f"run: {work:.1e} mode-steps would take days, the limit is {_MOST_MODE_STEPS:.0e}; "
                "lower internal_rate_hz, modes or duration_s"
            )

    def initial(self) -> tuple[np.ndarray, np.ndarray]:
        """q, v (N,) on the coordinates of `model`, as the case gives them, whatever the obstacle says to that."""
        n = self.case.run.modes
        if self.tail is None:
            return self._initial(n)
        q, v = self._initial(self.tail.modes)
        return np.append(q[:n], self.tail.state(q)), np.append(v[:n], self.tail.state(v))

    def _initial(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """q, v (n,) of the string's first n modes."""
        table, length = self.case.initial, self.string.length_m
        q, v = np.zeros(n), np.zeros(n)
        if table.shape == "triangle":
            assert table.position_m is not None and table.displacement_m is not None
            where = (length, table.position_m, table.displacement_m)
            if table.rounding_half_width_m is not None:
                q = rounded_triangle(*where, table.rounding_half_width_m, n)
            else:
                q = triangle_pluck(*where, table.width_m or 0.0, n)
        elif table.shape == "modes":
            keys = {name: key for name in ("q", "v") if isinstance(key := getattr(table, name), str)}
            found = arrays_of(self.folder, table.file, keys) if table.file is not None and keys else {}
            for name, target, most in (("q", q, MOST_AMPLITUDE), ("v", v, MOST_SPEED)):
                given = found.get(name, getattr(table, name))
                if given is not None:
                    if np.abs(given).max(initial=0.0) > most:
                        worst = np.abs(given).max()
                        raise CaseError(
                            f"initial.{name}: must lie within ±{most:g}, got {worst:g}; q is in m·√m, v its rate"
                        )
                    given = np.asarray(given, dtype=np.float64)[:n]
                    target[: given.size] = given
        return q, v


def _refuse_off_string(field: str, position_m: float, length_m: float) -> None:
    if not 0.0 < position_m < length_m:
        raise CaseError(
            f"{field}: must lie between 0 and the string's {length_m:g} m, got {position_m:g}; count it from the nut"
        )


def refuse_over_end(field: str, width_m: float, reach: float, position_m: float, length_m: float) -> None:
    """A width of which `reach` lies on either side of a place must end on the string."""
    most = min(position_m, length_m - position_m) / reach
    if width_m > most:
        raise CaseError(
            f"{field}: must be at most {most:g} m at {position_m:g} m of a {length_m:g} m string, where it reaches an end, "
            f"got {width_m:g} m; take less, or a place further from it"
        )


def string_of(table: StringTable, folder: Path, place: str) -> String:
    """The string of a table, or of one that has more beside; its file counts from `folder`. Raises CaseError that names
    `place`."""
    left_out = {"inharmonicity", "bending_stiffness_n_m2", "nut", "measured"}
    values = table.model_dump(include=set(StringTable.model_fields) - left_out)
    if table.measured is not None:
        keys = {"frequencies": table.measured.frequencies, "rates": table.measured.decay_rates}
        found = arrays_of(folder, table.measured.file, keys)
        values["measured_frequencies_hz"] = tuple(found["frequencies"])
        values["measured_decay_rates"] = tuple(found["rates"])
    try:
        values["nut"] = tuple(NutResonance(**nut.model_dump()) for nut in table.nut)
        if table.inharmonicity is not None:
            return String.from_inharmonicity(inharmonicity=table.inharmonicity, **values)
        return String(bending_stiffness_n_m2=table.bending_stiffness_n_m2 or 0.0, **values)
    except ValueError as error:
        raise CaseError(f"{place}: {error}") from None


def bent_tension(string: String, cents: float) -> float:
    """T [N] at which the first mode of a pinned string is so much higher."""
    first = float(base_frequencies(string, 1)[0]) * string.length_m / np.pi  # ω̂₁/k₁
    return string.tension_n + (2.0 ** (cents / 600.0) - 1.0) * string.linear_density_kg_m * first**2


def ramps(t: np.ndarray, tables: Sequence[RampTable | BendTable], heights: Sequence[float]) -> np.ndarray:
    """Σ of raised cosines from 0 to each height over start_s … start_s + duration_s, at the times t [s]."""
    total = np.zeros_like(t)
    for ramp, height in zip(tables, heights, strict=True):
        share = np.clip((t - ramp.start_s) / ramp.duration_s, 0.0, 1.0)
        total = total + height * 0.5 * (1.0 - np.cos(np.pi * share))
    return total
