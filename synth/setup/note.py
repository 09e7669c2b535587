"""One note of an instrument under strokes of any strength: when the string touches, and what is heard of it.

Until something is touched the string is linear: one run over nothing, by a stroke that draws it one metre aside, holds all
strokes of that kind. `SetupNote.reach_m` follows from it without another run; only what follows the first touch is computed
with the contacts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from synth.instrument.compile import Position
from synth.native.denormals import flushed
from synth.physics.excitation import pluck_weights
from synth.physics.modes import decay_rates, modal_frequencies
from synth.physics.string import String
from synth.setup.audible import WINDOW_S, band_energies, buzz_db, buzz_seconds, fade
from synth.setup.places import Below
from synth.setup.plucking import Stroke
from synth.solver import driver
from synth.solver.laws import EXACT_HOLD
from synth.solver.lcp import SOLVED
from synth.solver.plucked import pluck
from synth.solver.stringmodel import StringContacts, StringModes, no_contacts


@dataclass(frozen=True)
class StrokeContacts:
    """A stroke with its contacts.

    buzz_db     B [dB]
    impulse_ns  (C,) what each contact gave [N s]; zeros where that is not known
    """

    buzz_db: float
    impulse_ns: np.ndarray


@dataclass(frozen=True)
class _Unit:
    """What a stroke of one metre does over nothing.

    heard     (n,) what is heard
    lowest    (C,) lowest displacement over each contact, of the whole note; early: until the string is free
    released  (2, N) q and v as it becomes free
    """

    heard: np.ndarray
    lowest: np.ndarray
    early: np.ndarray
    released: np.ndarray


class SetupNote:
    """A string at a fret, or open, under strokes that differ in displacement alone.

    position    as compiled; its contacts may be given other heights
    speed       whether its velocity is heard, as by a pickup
    shapes      (C, N) of the modes where something lies below, where that is not the model's contacts
    """

    def __init__(
        self,
        position: Position,
        stroke: Stroke,
        *,
        speed: bool,
        seconds: float = WINDOW_S,
        shapes: np.ndarray | None = None,
    ) -> None:
        self.position, self.stroke, self.speed = position, stroke, speed
        self._shapes = position.shapes if shapes is None else shapes
        self.dt = 1.0 / position.plan.rate_hz
        self.pitch_hz = float(position.omega[0]) / (2.0 * math.pi)
        self._draw = max(1, round(stroke.draw_s / self.dt))
        self._slip = round(stroke.slip_s / self.dt)
        #: steps until the string is free, and altogether
        self.free_step = self._draw + self._slip
        self.steps = self.free_step + round(seconds / self.dt)
        heard = position.wv if speed else position.wq
        self._heard = np.ascontiguousarray(heard, np.float64)[None, :]
        n = position.omega.size
        self._weights = np.zeros(n)
        x = position.length_m - stroke.distance_m
        self._weights[: position.own] = pluck_weights(position.length_m, x, stroke.width_m, position.own)

    def with_stroke(self, stroke: Stroke) -> SetupNote:
        """The same string under another stroke, for `reach_m` and `clearance_m`."""
        return SetupNote(self.position, stroke, speed=self.speed, shapes=self._shapes)

    def with_string(self, string: String) -> SetupNote:
        """Another string of the same length under the same stroke, its own modes alone, for `reach_m`."""
        here, n = self.position, self.position.own
        other = replace(
            here,
            omega=modal_frequencies(string, n),
            sigma=decay_rates(string, n),
            string=string,
            shapes=here.shapes[:, :n],
            wq=here.wq[:n],
            wv=here.wv[:n],
        )
        return SetupNote(other, self.stroke, speed=self.speed, shapes=self._shapes[:, :n])

    def _model(self, eta: np.ndarray | None, out_shapes: np.ndarray) -> driver.Model:
        here, n = self.position, self.position.omega.size
        under = no_contacts(n) if eta is None else StringContacts(here.shapes, eta, here.residual, here.layers)
        return driver.make_model(EXACT_HOLD, StringModes(here.mu, here.omega, here.sigma), self.dt, under, out_shapes, 0.0)

    def _pluck(self, model: driver.Model, run: driver.Run, displacement_m: float) -> None:
        """The finger draws the string to a displacement and lets it slide off."""
        stroke = self.stroke
        drawn, slipped = (np.linspace(0.0, 1.0, steps + 1) for steps in (self._draw, self._slip))
        pluck(model, run, self._weights, stroke.stiffness_n_m, stroke.resistance_n_s_m, displacement_m, drawn, slipped)

    @cached_property
    def _unit(self) -> _Unit:
        """The stroke of one metre, over nothing."""
        here = self.position
        model = self._model(None, np.vstack([self._heard, self._shapes]))
        zero = np.zeros(here.omega.size)
        run = driver.start_run(model, zero, zero, np.zeros(0), 1, self.steps + 1, False, True)
        with flushed():
            self._pluck(model, run, 1.0)
            released = np.array([run.q, run.v])
            driver.run(model, run, self.steps - self.free_step)
        at = run.results.u[:, 1:]
        return _Unit(run.results.u[:, 0].copy(), at.min(axis=0), at[: self.free_step + 1].min(axis=0), released)

    @property
    def deepest(self) -> np.ndarray:
        """(C,) how far down the string goes over each contact, in parts of the stroke's displacement."""
        return -self._unit.lowest

    def reach_m(self, below: Below) -> np.ndarray:
        """(C,) the least displacement at which each contact is touched, were it alone [m]; inf: never, 0: at rest."""
        eta = below.heights_m
        reach = np.full(eta.size, np.inf)
        np.divide(-eta, self.deepest, out=reach, where=self.deepest > 0.0)
        return np.where(eta >= 0.0, 0.0, np.maximum(reach, 0.0))

    def clearance_m(self, displacement_m: float, below: Below) -> np.ndarray:
        """(C,) the least clearance over each contact during a stroke over nothing [m]; negative: it would be pressed in."""
        return -below.heights_m - displacement_m * self.deepest

    @cached_property
    def _free_energies(self) -> tuple[np.ndarray, float]:
        y = self._unit.heard * fade(self.steps + 1, self.free_step)
        return band_energies(y, 1.0 / self.dt, self.pitch_hz, speed=self.speed)

    def play(self, displacement_m: float, below: Below) -> StrokeContacts:
        """The stroke with what lies below. Raises ValueError where no static shape of the string lies over it."""
        y, force = self._run(displacement_m, below)
        energies, _ = band_energies(y * fade(y.size, self.free_step), 1.0 / self.dt, self.pitch_hz, speed=self.speed)
        free, whole = self._free_energies
        square = displacement_m**2
        return StrokeContacts(buzz_db(energies, square * free, square * whole), force.sum(axis=0) * self.dt)

    def buzz_seconds(self, displacement_m: float, below: Below, audible_db: float) -> float:
        """How long the stroke buzzes audibly once the string is free, all moments together [s]."""
        y, _ = self._run(displacement_m, below)
        return buzz_seconds(
            y, displacement_m * self._unit.heard, 1.0 / self.dt, self.free_step, self.pitch_hz, audible_db, speed=self.speed
        )

    def _run(self, displacement_m: float, below: Below) -> tuple[np.ndarray, np.ndarray]:
        """What is heard of the stroke (steps + 1,), and the forces of the contacts in each step that was computed [N]."""
        unit = self._unit
        eta, n = below.heights_m, self.position.omega.size
        model = self._model(eta, self._heard)
        early = bool(eta.max(initial=-1.0) >= 0.0) or bool(np.any(displacement_m * unit.early <= eta))
        if early:
            q, force, status = driver.static_contact(model, np.zeros(n))
            if status != SOLVED:
                raise ValueError("no static shape of the string lies over its contacts; lower them")
            run = driver.start_run(model, q, np.zeros(n), force, 1, self.steps + 1, False, True)
        else:
            q, v = displacement_m * unit.released
            run = driver.start_run(model, q, v, np.zeros(eta.size), 1, self.steps - self.free_step + 1, False, True)
        with flushed():
            if early:
                self._pluck(model, run, displacement_m)
            driver.run(model, run, self.steps - self.free_step)
        before = displacement_m * unit.heard[: 0 if early else self.free_step]
        return np.concatenate([before, run.results.u[:, 0]]), run.results.contact_force
