"""A case of strings on a body as arrays: its lines at any tension and length, contacts, the state it starts from."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from synth.instrument.soundboard import body_of
from synth.physics.body_modes import Body, BridgePlace
from synth.physics.coupled import CoupledStrings, Line, Place
from synth.physics.excitation import pluck_weights, triangle_pluck
from synth.physics.modes import decay_rates, modal_frequencies, mode_shapes, residual_compliance
from synth.physics.obstacle import Obstacle, frets
from synth.physics.string import String
from synth.research.case import CaseError
from synth.research.coupled.coupled_case import CoupledCase, DirectedFingerTable
from synth.research.finger_paths import finger_end
from synth.research.scene import bent_tension, ramps, refuse_over_end, string_of
from synth.solver.coupled_lines import BodyArrays, LineArrays

#: what is not reached, for a contact behind the stopped end [m] (contacts are solved to 1e-13 of the widest gap), and the
#: compliance its row is given [m/N]
_FAR_BELOW, _NO_ROW = -0.1, 1e-3
_MOST_BYTES = 4 * 2**30
_MOST_MODE_STEPS = 1e14


@dataclass(frozen=True)
class LineOf:
    """A line: which string it is of, and whether it is its second polarisation."""

    string: int
    second: bool


class CoupledScene:
    """Strings, obstacles and body of a case; files count from `folder`. Raises CaseError."""

    def __init__(self, case: CoupledCase, folder: Path) -> None:
        self.case, self.folder = case, folder
        run = case.run
        self.frame_s = 1.0 / run.internal_rate_hz
        self.frames = max(1, round(run.duration_s * run.internal_rate_hz))
        self.rows = self.frames // run.steps_per_output + 1
        self.tables = case.string
        self.names = [table.name or str(number) for number, table in enumerate(self.tables, start=1)]
        self.strings = [string_of(table, folder, self.place(number)) for number, table in enumerate(self.tables)]
        self.body = self._body()
        self.lines = [
            LineOf(number, second)
            for number, table in enumerate(self.tables)
            for second in ((False, True) if table.polarisation is not None else (False,))
        ]
        #: number of each string's first line
        self.line_of = [self.lines.index(LineOf(number, False)) for number in range(len(self.tables))]
        self.obstacles = [self._obstacle(number) for number in range(len(self.tables))]
        self.substeps = [self.tables[line.string].substeps or case.scheme.substeps for line in self.lines]
        self.modes = [self.tables[line.string].modes or run.modes for line in self.lines]
        self._refuse_the_absurd()
        self._refuse_what_does_not_fit()

    # --- strings ---

    def place(self, number: int) -> str:
        """What messages call a string."""
        return f"string.{number} ({self.names[number]})" if self.tables[number].name else f"string.{number}"

    def _body(self) -> Body:
        try:
            return body_of(self.case.body.mode)
        except ValueError as error:
            raise CaseError(f"body.mode: {error}") from None

    @property
    def body_arrays(self) -> BodyArrays:
        """The body as the kernels take it: what it radiates is Σ radiation·p̈ [m/s²], panned to left and right."""
        body = self.body
        return BodyArrays(body.omega, body.sigma, body.mass, body.shapes, body.left_right())

    def _obstacle(self, number: int) -> Obstacle:
        table, where = self.tables[number].obstacle, f"{self.place(number)}.obstacle"
        try:
            if table.frets is not None:
                obstacle = frets(**table.frets.model_dump())
            elif table.positions_m is not None:
                heights = table.heights_m
                if not isinstance(heights, list):
                    heights = [heights] * len(table.positions_m)  # type: ignore[list-item]
                obstacle = Obstacle(tuple(table.positions_m), tuple(heights))  # type: ignore[arg-type]
            else:
                obstacle = Obstacle()
            obstacle.check(self.strings[number].length_m)
        except ValueError as error:
            raise CaseError(f"{where}: {error}") from None
        return obstacle

    def direction(self, line: LineOf) -> np.ndarray:
        """B (D,)"""
        table = self.tables[line.string]
        return BridgePlace(1e-3 * table.place_mm, table.angle_deg + (90.0 if line.second else 0.0)).direction(self.body.axes)

    # --- a line at some tension and length ---

    def bent(self, number: int, cents: float, stopped_m: float) -> String:
        """String `number` with its tension raised so that its open first mode is `cents` higher, stopped at stopped_m."""
        string = self.strings[number]
        if cents != 0.0:
            tension = bent_tension(string, cents)
            if not tension > 0.0:
                raise CaseError(
                    f"{self.place(number)}.bend: {cents:g} cents leave no tension; bend the string up, or less far down"
                )
            string = string.with_tension(tension)
        return replace(string, length_m=string.length_m - stopped_m) if stopped_m else string

    def modes_at(self, line: int, stopped_m: float) -> int:
        """N of a line stopped at stopped_m: as densely as it has them when open."""
        length = self.strings[self.lines[line].string].length_m
        return max(1, math.ceil(self.modes[line] * (length - stopped_m) / length - 1e-9))

    def arrays(self, line: int, cents: float = 0.0, stopped_m: float = 0.0) -> LineArrays:
        """A line as the kernels take it, contacts at their heights at t = 0; one behind the stopped end is out of reach."""
        of = self.lines[line]
        string, table = self.bent(of.string, cents, stopped_m), self.tables[of.string]
        n, length = self.modes_at(line, stopped_m), string.length_m
        omega, sigma = modal_frequencies(string, n), decay_rates(string, n)
        if of.second and table.polarisation is not None:
            omega = omega * 2.0 ** (table.polarisation.detuning_cents / 1200.0)
            sigma = sigma * table.polarisation.loss_ratio
        if not np.all(np.isfinite(omega) & np.isfinite(sigma)):
            raise CaseError(
                f"{self.place(of.string)}: frequencies or decay rates of its modes are no numbers; check the units"
            )
        made = Line(length, string.tension_n, string.linear_density_kg_m, omega, sigma, self.direction(of))
        obstacle = Obstacle() if of.second else self.obstacles[of.string]
        x = np.array(obstacle.positions_m) - stopped_m
        there = x > 1e-6 * length
        shapes, residual = np.zeros((x.size, n)), np.diag(np.full(x.size, _NO_ROW))
        eta, leverage = np.full(x.size, _FAR_BELOW), np.zeros(x.size)
        if there.any():
            shapes[there] = mode_shapes(length, x[there], n)
            kept = np.ix_(there, there)
            residual[kept] = residual_compliance(string, x[there], n) if self.case.scheme.tail == "static" else 0.0
            eta[there] = np.array(obstacle.heights_m)[there]
            leverage[there] = x[there] / length - float(table.obstacle.rides)
        return LineArrays(
            length, made.stiffness, made.linear_density_kg_m, made.omega, made.sigma, made.ramp, made.direction, shapes,
            leverage, eta, residual,
        )  # fmt: skip

    def far_leverage(self, line: int, stopped_m: float) -> np.ndarray:
        """1 − x/L (C,) of a line's contacts; 0 behind the stopped end."""
        of = self.lines[line]
        length = self.strings[of.string].length_m - stopped_m
        obstacle = Obstacle() if of.second else self.obstacles[of.string]
        x = np.array(obstacle.positions_m) - stopped_m
        return np.where(x > 1e-6 * length, 1.0 - x / length, 0.0)

    def finger_weights(self, finger: DirectedFingerTable, line: int, stopped_m: float) -> tuple[np.ndarray, float]:
        """(N,) weights of a finger on a line that is stopped at stopped_m, and x/L; CaseError behind the stopped end."""
        of = self.lines[line]
        length = self.strings[of.string].length_m - stopped_m
        x = finger.position_m - stopped_m
        if not 0.0 < x < length:
            raise CaseError(
                f"{self.place(of.string)}.finger: position_m must lie between {stopped_m:g} and "
                f"{stopped_m + length:g} m, where the string then sounds, got {finger.position_m:g}"
            )
        refuse_over_end(f"{self.place(of.string)}.finger.width_m", finger.width_m, 0.5, x, length)
        return pluck_weights(length, x, finger.width_m, self.modes_at(line, stopped_m)), x / length

    def obstacle_displacement(self, number: int, t: np.ndarray) -> np.ndarray:
        """How far a string's obstacle is above its heights at times t [s] → [m]."""
        motion = self.tables[number].obstacle.motion
        up = ramps(t, motion.ramp, [ramp.displacement_m for ramp in motion.ramp])
        for sine in motion.sine:
            up = up + sine.amplitude_m * np.sin(2.0 * np.pi * sine.frequency_hz * np.maximum(t - sine.start_s, 0.0))
        return up

    def cents(self, number: int, t: np.ndarray) -> np.ndarray:
        """How far a string is bent at times t [s]."""
        bend = self.tables[number].bend
        return ramps(t, bend, [each.cents for each in bend])

    # --- where it starts ---

    @cached_property
    def system(self) -> CoupledStrings:
        """The linear system of the open strings as they are at t = 0."""
        made = []
        for number, of in enumerate(self.lines):
            a = self.arrays(number)
            string = self.strings[of.string]
            made.append(Line(a.length_m, string.tension_n, a.mu, a.omega, a.sigma, a.direction))
        return CoupledStrings(tuple(made), self.body)

    def initial(self) -> np.ndarray:
        """x (n,) as `physics.coupled` lays it out."""
        x = np.zeros(self.system.size)
        w = self.system.parts()[0]
        for number, table in enumerate(self.tables):
            start, first = table.initial, self.line_of[number]
            if start.shape == "rest":
                continue
            assert start.position_m is not None
            length = self.strings[number].length_m
            if not 0.0 < start.position_m < length:
                raise CaseError(
                    f"{self.place(number)}.initial.position_m: must lie between 0 and the string's {length:g} m, "
                    f"got {start.position_m:g}; count it from the far end"
                )
            refuse_over_end(f"{self.place(number)}.initial.width_m", start.width_m or 0.0, 0.5, start.position_m, length)
            turn = math.radians(start.direction_deg)
            shares = [math.cos(turn), math.sin(turn)] if table.polarisation is not None else [1.0]
            for second, share in enumerate(shares):
                line = first + second
                if start.shape == "drawn":
                    assert start.force_n is not None
                    x += self.system.static_deflection([Place(line, start.position_m)], [share * start.force_n])
                else:
                    assert start.displacement_m is not None
                    where = (length, start.position_m, share * start.displacement_m)
                    x[w[line]] += triangle_pluck(*where, start.width_m or 0.0, self.modes[line])
        return x

    # --- what cannot be ---

    def _refuse_the_absurd(self) -> None:
        run, modes = self.case.run, sum(self.modes)
        contacts = sum(len(obstacle) for obstacle in self.obstacles)
        points = sum(len(table.outputs_m) for table in self.tables)
        n_bytes = 8.0 * self.rows * (1 + points + 2 * contacts + 2 * self.body.axes + 2 + (14 if run.ledger else 0))
        if n_bytes > _MOST_BYTES:
            raise CaseError(
                f"run: the results would take {n_bytes / 2**30:.4g} GiB, the limit is {_MOST_BYTES / 2**30:.0f}; "
                "lower output_rate_hz, duration_s or the number of points"
            )
        work = float(self.frames) * modes * (1 + contacts) * max(self.substeps)
        if work > _MOST_MODE_STEPS:
            raise CaseError(
                f"run: {work:.1e} mode-steps would take days, the limit is {_MOST_MODE_STEPS:.0e}; "
                "lower internal_rate_hz, modes or duration_s"
            )

    def _refuse_what_does_not_fit(self) -> None:
        for number, table in enumerate(self.tables):
            length = self.strings[number].length_m
            where = self.place(number)
            for x in table.outputs_m:
                if not 0.0 <= x <= length:
                    raise CaseError(f"{where}.outputs_m: must lie from 0 to the string's {length:g} m, got {x:g}")
            stops = sorted(table.fret, key=lambda fret: fret.start_s)
            for fret in stops:
                if not fret.position_m < 0.98 * length:
                    raise CaseError(
                        f"{where}.fret.position_m: must lie below {0.98 * length:g} m of the string's {length:g}, "
                        f"got {fret.position_m:g}; count it from the far end"
                    )
            for before, after in pairwise(stops):
                if after.start_s < before.start_s + before.ramp_s:
                    raise CaseError(f"{where}.fret: one must have come to its fret (ramp_s) before the next begins")
            held = sorted(table.finger, key=lambda finger: finger.start_s)
            for one, other in pairwise(held):
                if other.start_s < finger_end(one):
                    raise CaseError(f"{where}.finger: one must let go before the next takes hold")
            for finger in held:
                stopped = [fret.position_m for fret in stops if fret.start_s < finger.start_s]
                self.finger_weights(finger, self.line_of[number], stopped[-1] if stopped else 0.0)
                for fret in stops:
                    if finger.start_s <= fret.start_s < finger_end(finger):
                        raise CaseError(
                            f"{where}.fret: the string changes its length at {fret.start_s:g} s under a finger; let go first"
                        )
            for end in sorted(bend.start_s + bend.duration_s for bend in table.bend):
                self.bent(number, float(self.cents(number, np.array([end]))[0]) - 25.0, 0.0)
