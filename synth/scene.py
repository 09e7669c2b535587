"""A case turned into the arrays that a scheme works on."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np

from synth.case import Case, CaseError, FingerTable, WallTable, arrays_of
from synth.physics.excitation import pluck_weights, rounded_triangle, triangle_pluck
from synth.physics.modes import decay_rates, modal_frequencies, mode_shapes, residual_compliance
from synth.physics.obstacle import Obstacle, bass_neck_height, frets, parabola_height, wall_positions
from synth.physics.string import NutResonance, String
from synth.solver import driver
from synth.solver.laws import EXACT_HOLD, law_of
from synth.solver.problem import Problem

_MOST_BYTES = 4 * 2**30
_MOST_MODE_STEPS = 1e14  # a day of one core


class Scene:
    """String, obstacle, fingers, modes and contacts of a case; files count from `folder`."""

    def __init__(self, case: Case, folder: Path) -> None:
        self.case, self.folder = case, folder
        self.dt = 1.0 / case.run.internal_rate_hz
        self.steps = max(1, round(case.run.duration_s * case.run.internal_rate_hz))
        every = case.run.steps_per_output
        self.outputs = self.steps // every + 1
        self.string = self._string()
        self.obstacle = self._obstacle()
        self._refuse_the_absurd()

        length, n = self.string.length_m, case.run.modes
        self.fingers = sorted(case.finger, key=lambda f: f.start_s)
        for number, finger in enumerate(self.fingers):
            pluck_weights(length, finger.position_m, finger.width_m, 1)
            if number and finger.start_s < finger_end(self.fingers[number - 1]):
                raise CaseError("finger: one must let go before the next takes hold")
        self.positions = np.array(self.obstacle.positions_m)
        self.eta = np.array(self.obstacle.heights_m)
        self.omega = modal_frequencies(self.string, n)
        self.sigma = decay_rates(self.string, n)
        self.shapes = mode_shapes(length, self.positions, n)
        self.out_shapes = mode_shapes(length, np.array(case.run.outputs_m), n)

    @cached_property
    def residual(self) -> np.ndarray:
        """R (C, C) [m/N] of the modes left out, zero where the case wants none."""
        contacts = self.positions.size
        if self.case.scheme.residual_compliance and contacts > 0:
            return residual_compliance(self.string, self.positions, self.case.run.modes)
        return np.zeros((contacts, contacts))

    @cached_property
    def model(self) -> driver.Model:
        """Coefficients and contact matrix of a case whose scheme is a law of the block kernels."""
        law = law_of(self.case.scheme.name)
        contacts = self.positions.size
        return driver.make_model(
            law,
            self.omega,
            self.sigma,
            self.string.linear_density_kg_m,
            self.dt,
            self.shapes,
            self.eta,
            self.residual if law == EXACT_HOLD else np.zeros((contacts, contacts)),
            self.out_shapes,
            self.case.scheme.restitution,
        )

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

    def _string(self) -> String:
        table = self.case.string
        values = table.model_dump(exclude={"inharmonicity", "bending_stiffness_n_m2", "nut", "measured"})
        values["nut"] = tuple(NutResonance(**nut.model_dump()) for nut in table.nut)
        if table.measured is not None:
            found = arrays_of(
                self.folder,
                table.measured.file,
                {"frequencies": table.measured.frequencies, "rates": table.measured.decay_rates},
            )
            values["measured_frequencies_hz"] = tuple(found["frequencies"])
            values["measured_decay_rates"] = tuple(found["rates"])
        if table.inharmonicity is not None:
            return String.from_inharmonicity(inharmonicity=table.inharmonicity, **values)
        return String(bending_stiffness_n_m2=table.bending_stiffness_n_m2 or 0.0, **values)

    def _obstacle(self) -> Obstacle:
        table = self.case.obstacle
        if table.wall is not None:
            obstacle = self._wall(table.wall)
        elif table.frets is not None:
            obstacle = frets(**table.frets.model_dump())
        elif table.positions_m is not None:
            heights = table.heights_m
            if not isinstance(heights, list):
                heights = [heights] * len(table.positions_m)  # type: ignore[list-item]
            obstacle = Obstacle(tuple(table.positions_m), tuple(heights))  # type: ignore[arg-type]
        else:
            obstacle = Obstacle()
        obstacle.check(self.string.length_m)
        return obstacle

    def _wall(self, table: WallTable) -> Obstacle:
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
        columns = 1 + points + 2 * contacts + (5 if run.ledger else 0)
        n_bytes = 8.0 * (self.outputs * columns + run.modes * (contacts + points + 12) + run.steps_per_output * contacts)
        if n_bytes > _MOST_BYTES:
            raise CaseError(
                f"run: the results would take {n_bytes / 2**30:.1f} GiB, the limit is {_MOST_BYTES / 2**30:.0f}; "
                "lower output_rate_hz, duration_s or the number of points"
            )
        work = float(self.steps) * run.modes * (1 + contacts)
        if work > _MOST_MODE_STEPS:
            raise CaseError(
                f"run: {work:.1e} mode-steps would take days, the limit is {_MOST_MODE_STEPS:.0e}; "
                "lower internal_rate_hz, modes or duration_s"
            )

    def initial(self) -> tuple[np.ndarray, np.ndarray]:
        """q, v (N,) as the case gives them, whatever the obstacle says to that."""
        table, n, length = self.case.initial, self.case.run.modes, self.string.length_m
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
            for name, target in (("q", q), ("v", v)):
                given = found.get(name, getattr(table, name))
                if given is not None:
                    given = np.asarray(given, dtype=np.float64)[:n]
                    target[: given.size] = given
        return q, v


def finger_end(finger: FingerTable) -> float:
    """When a finger lets go [s]."""
    return finger.start_s + finger.draw_s + finger.hold_s
