"""What a pluck over an obstacle sounds like: the forward model of the contact fit.

One string over rigid points, drawn aside by a finger, let go, and heard at its end, by the block kernels that the engine
and `simulate` have (exact-hold). All of it scales: heights, displacement and sound times the same factor are the same
motion, so that only heights over the displacement can be told from a sound of unknown gain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from synth.engine.stroke import WIDEST
from synth.instrument.compile import make_string, open_string, output_weights
from synth.instrument.preset import BridgeObstacle, Preset, at_note
from synth.jit import kernel_helpers
from synth.native.denormals import flushed
from synth.physics.excitation import pluck_weights
from synth.physics.modes import (
    base_frequencies,
    count_modes_below,
    decay_rates,
    force_weights,
    modal_frequencies,
    mode_shapes,
)
from synth.physics.obstacle import Obstacle, parabola_height
from synth.physics.string import String
from synth.physics.tail import lumped_tail
from synth.solver import driver, study
from synth.solver.laws import EXACT_HOLD
from synth.solver.plucked import pluck
from synth.solver.stringmodel import StringContacts, StringModes

Real = NDArray[np.float64]
#: modes beyond that are left out [Hz]: features end far below
HIGHEST_MODE_HZ = 22000.0


@dataclass(frozen=True)
class PluckingHand:
    """What is held of a pluck: its width [m], the finger's spring [N/m] and its dashpot in units of the string's impedance;
    and about how long the string takes to slide off it, which is looked for, or 0, let go at once."""

    width_m: float = 0.01
    slip_s: float = 0.0
    stiffness_n_m: float = 5e4
    loss: float = 0.5


@dataclass(frozen=True)
class Bridge:
    """A bridge of one point, or a curved one of several, `met` of them under the string, evenly from the end to the
    distance, on an arc of radius_m that falls away from the string there (`obstacle_of`)."""

    points: int = 1
    met: int = 1
    radius_m: float = 0.9

    def obstacle(self, length_m: float, height_m: float, distance_m: float) -> Obstacle:
        places = np.array([distance_m * k / self.points for k in range(self.met, 0, -1)])
        fallen = np.zeros(places.size) if self.points == 1 else parabola_height(places, 0.0, 0.0, self.radius_m)
        return Obstacle(tuple(length_m - places), tuple(fallen - height_m))


@dataclass(frozen=True)
class ContactStroke:
    """One note. height_m: of the thread over the bridge; distance_m of the bridge's edge from the
    end; position: of the pluck, from that end as a share of L; displacement_m it draws the ideal string by in draw_s;
    losses: factor of all decay rates; slip_s in which the string slides off the finger; inner: a second point between the
    bridge's edge and the end, its place as a share of the distance and how far it lies below the thread [m], or none."""

    height_m: float
    distance_m: float
    position: float
    displacement_m: float
    draw_s: float
    losses: float = 1.0
    slip_s: float = 0.0
    inner: tuple[float, float] | None = None


@dataclass(frozen=True)
class Grid:
    """How finely is computed: steps a second and modes."""

    rate_hz: float
    modes: int


class ContactSound(NamedTuple):
    """frames (n,) at the grid's rate, in the output's units; touching: share of the steps in which a contact presses."""

    frames: Real
    touching: float


class ContactModel:
    """The notes of one string over one kind of obstacle.

    string    as it would sound if it touched nothing
    shape     what lies below it
    hand      what of the pluck is held
    output    (string, n) → weights (n,), (n,) of what is heard on q and q̇ of modes; None: the force at the obstacle's end
    """

    def __init__(self, string: String, shape: Bridge, hand: PluckingHand, output: Any = None) -> None:
        self.string, self.shape, self.hand = string, shape, hand
        self._output = output
        self._known: dict[Grid, tuple[Real, Real]] = {}
        self._heard: dict[int, Real] = {}
        kernel_helpers.compile_all("synth.research.methods.warmup:kernels")

    @classmethod
    def of_preset(
        cls, preset: Preset, index: int, note: int | None = None, frequency_hz: float | None = None
    ) -> ContactModel:
        """Of string `index` of a preset at one of its open notes, by default the lowest, tuned as the preset has it or to
        frequency_hz. Raises ValueError where nothing of it is to be found: another obstacle than a bridge, or
        something soft on it."""
        table = preset.string[index]
        note = table.notes[0] if note is None else note
        string, _ = open_string(preset, table, note)
        if frequency_hz is not None:
            string = make_string(preset, table, note, frequency_hz)
        shape = preset.obstacle
        if isinstance(shape, BridgeObstacle) and shape.layer is None:
            met = shape.points if table.bridge_points is None else table.bridge_points
            if met == 0:
                raise ValueError(f"string {index} of {preset.name} lies over no bridge (bridge_points = 0); choose another")
            found = Bridge(shape.points, met, 1e-3 * shape.radius_mm)
        else:
            raise ValueError(
                f"obstacle of {preset.name} must be a bridge without a layer, got {shape.kind}; name a preset "
                "that has one, such as tanpura-light"
            )
        pluck = preset.pluck
        slip_s = 1e-3 * (at_note(pluck.hardest_slip_ms, note) or at_note(pluck.slip_ms, note))
        hand = PluckingHand(1e-3 * pluck.width_mm, slip_s, 1e3 * pluck.finger_stiffness_n_mm, pluck.finger_loss)
        if preset.output.kind == "body":
            return cls(string, found, hand)
        return cls(string, found, hand, lambda of, n: output_weights(preset, of, string.length_m, n))

    def over(self, shape: Bridge) -> ContactModel:
        """The same string and hand over another bridge."""
        return ContactModel(self.string, shape, self.hand, self._output)

    def grid(self, steps_a_period: float, least_hz: float, highest_hz: float = HIGHEST_MODE_HZ) -> Grid:
        """So many steps a period of the open string, or least_hz; modes up to highest_hz."""
        rate = max(steps_a_period * self.string.fundamental_hz, least_hz)
        return Grid(rate, max(4, count_modes_below(self.string, min(highest_hz, 0.49 * rate))))

    def _modal(self, grid: Grid) -> tuple[Real, Real]:
        if grid not in self._known:
            self._known[grid] = modal_frequencies(self.string, grid.modes), decay_rates(self.string, grid.modes)
        return self._known[grid]

    def _weights(self, n: int) -> Real:
        """Of an output of displacements and velocities both the first is what is heard; its bands have offsets anyhow."""
        if n not in self._heard:
            if self._output is None:
                self._heard[n] = force_weights(self.string, self.string.length_m, n)
            else:
                on_q, on_v = self._output(self.string, n)
                # the velocity of a mode is its displacement times ω, but for the phase
                self._heard[n] = on_q if np.any(on_q) else on_v * base_frequencies(self.string, n)
        return self._heard[n]

    def _scene(self, grid: Grid, stroke: ContactStroke) -> driver.Model:
        omega, sigma = self._modal(grid)
        n, string = grid.modes, self.string
        obstacle = self.shape.obstacle(string.length_m, stroke.height_m, stroke.distance_m)
        if stroke.inner is not None:
            place, below_m = stroke.inner
            where = string.length_m - place * stroke.distance_m
            obstacle = Obstacle((*obstacle.positions_m, where), (*obstacle.heights_m, -below_m))
        obstacle.check(string.length_m)
        x, eta = np.array(obstacle.positions_m), np.array(obstacle.heights_m)
        shapes, sigma = mode_shapes(string.length_m, x, n), stroke.losses * sigma
        tail = lumped_tail(string, x, n, grid.rate_hz)
        heard = self._weights(tail.modes)
        return driver.make_model(
            EXACT_HOLD,
            StringModes(string.linear_density_kg_m, np.append(omega, tail.omega), np.append(sigma, tail.sigma)),
            1.0 / grid.rate_hz,
            StringContacts(np.hstack([shapes, tail.shapes]), eta, tail.residual),
            np.append(heard[:n], tail.weights(heard))[None],
            1.0,
        )

    def sound(self, stroke: ContactStroke, grid: Grid, seconds: float) -> ContactSound:
        """The note from the moment the finger lets go (begins to slide)."""
        model, n = self._scene(grid, stroke), grid.modes
        string, rate = self.string, grid.rate_hz
        frames = math.ceil(seconds * rate)
        draw, slip = max(2, math.ceil(stroke.draw_s * rate)), math.ceil(stroke.slip_s * rate)
        q, force, _ = driver.static_contact(model, np.zeros(model.modes.omega.size))
        run = driver.start_run(model, q, np.zeros_like(q), force, 1, draw + frames + 1, False, False)
        place = stroke.position * string.length_m
        width = min(self.hand.width_m, WIDEST * place)
        weights = np.zeros(model.modes.omega.size)
        weights[:n] = pluck_weights(string.length_m, string.length_m - place, width, n)
        impedance = math.sqrt(string.tension_n * string.linear_density_kg_m)
        # both times count in parts of a step: what is heard has to change with them smoothly
        drawn = 1.0 - np.arange(draw, -1, -1) / (stroke.draw_s * rate)
        slipped = np.arange(slip + 1) / (stroke.slip_s * rate) if slip else np.zeros(1)
        with flushed():
            pluck(
                model, run, weights, self.hand.stiffness_n_m, self.hand.loss * impedance, stroke.displacement_m, drawn,
                slipped,
            )  # fmt: skip
            driver.run(model, run, max(0, frames - slip))
        u, touched = run.results.u[draw + 1 : draw + 1 + frames, 0], int(run.results.counts[study.CONTACT_STEPS])
        return ContactSound(u, touched / (draw + frames))
