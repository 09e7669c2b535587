"""How the laws of the block kernels run a scene."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from synth.case import CaseError, FingerTable
from synth.dsp.denormals import enable_ftz, restore
from synth.scene import Scene, finger_end
from synth.solver import driver
from synth.solver.kernels import Finger, finger_row, no_finger
from synth.solver.lcp import SOLVED
from synth.solver.problem import Outcome

_MOST_PATH = 1 << 16  # steps of an obstacle's path that are prepared at once


def run_law(scene: Scene) -> Outcome:
    """Exact-hold and both Moreau–Jean forms, from the static contact solution if the start is pressed in."""
    case, model = scene.case, scene.model
    q0, v0 = scene.initial()
    q, force, status = driver.static_contact(model, q0)
    if status != SOLVED:
        raise CaseError("obstacle: no static shape of the string lies over it; lower heights_m or take more modes")
    lifted = float(np.abs(model.shapes @ (q - q0)).max(initial=0.0))
    every, ledger = case.run.steps_per_output, case.run.ledger
    started = time.perf_counter()
    state = driver.start_run(model, q, v0, force, every, scene.outputs, ledger, case.scheme.start == "published")
    tuning = _Tuning(scene)
    flush = enable_ftz()
    try:
        for finger in scene.fingers:
            begin = max(_step(scene, finger.start_s), int(state.counts[driver.STEPS]))
            _advance(scene, state, tuning, begin, None)
            end = max(begin + 1, _step(scene, finger_end(finger)))
            _advance(scene, state, tuning, min(end, scene.steps), finger)
        _advance(scene, state, tuning, scene.steps, None)
    finally:
        restore(flush)
    seconds = time.perf_counter() - started
    sums, counts = state.sums, state.counts
    notes = {"started_from_static_contact": lifted > 0.0, "lifted_m": lifted}
    if scene.tail is not None:
        notes["lumped_modes"] = int(scene.tail.omega.size)
    if case.scheme.substeps > 1:
        notes["substeps"] = case.scheme.substeps
    if ledger:
        notes["initial_energy_j"] = float(sums[driver.INITIAL])
    return Outcome(
        u=state.u,
        contact_u=state.contact_u,
        contact_force=state.contact_force,
        energy=state.energy if ledger else None,
        largest_penetration_m=float(sums[driver.PENETRATION]),
        largest_energy_rise=float(sums[driver.RISE]) if ledger else float("nan"),
        last_contact_step=int(counts[driver.LAST_CONTACT]),
        contact_steps=int(counts[driver.CONTACT_STEPS]),
        unsolved_steps=int(counts[driver.BAD_STEPS]),
        seconds=seconds,
        notes=notes,
    )


def _step(scene: Scene, t: float) -> int:
    """The step that a time [s] falls on, at most the last one."""
    return round(min(t / scene.dt, scene.steps))


class _Tuning:
    """The model of the moment; its tension changes as the scene says."""

    def __init__(self, scene: Scene) -> None:
        self.model = scene.model
        self._scene = scene
        self._changes = list(reversed(scene.tension_changes))

    def until(self, step: int, state: driver.Run) -> float:
        """Makes the changes that are due at `step`; returns the step of the next one."""
        while self._changes and self._changes[-1][0] <= step:
            before, self.model = self.model, self._scene.bent_model(self._changes.pop()[1])
            driver.change_model(before, self.model, state)
        return self._changes[-1][0] if self._changes else math.inf


@dataclass
class _Hold:
    """One finger from its touch to its release."""

    finger: FingerTable
    begin: int
    weights: np.ndarray
    path: np.ndarray
    state: np.ndarray

    def row(self, model: driver.Model, start: int, stop: int) -> Finger:
        coupling, parts = np.zeros(model.eta.size), model.sub.parts
        own = finger_row(model.law, model.sub.coef if parts > 1 else model.coef, model.shapes, self.weights, coupling)
        path = self.path[(start - self.begin) * parts : (stop - self.begin) * parts + 1]
        return Finger(
            1, self.weights, coupling, own, self.finger.stiffness_n_m, self.finger.resistance_n_s_m, path, self.state
        )


def _advance(scene: Scene, state: driver.Run, tuning: _Tuning, until: int, finger: FingerTable | None) -> None:
    step = begin = int(state.counts[driver.STEPS])
    if until <= begin:
        return
    hold = None
    if finger is not None:
        weights, parts = scene.pluck_weights(finger), scene.case.scheme.substeps
        here = float(weights @ state.q)
        ramp = np.clip(np.arange((until - begin) * parts + 1) * scene.dt / parts / finger.draw_s, 0.0, 1.0)
        path = here + (finger.displacement_m - here) * 0.5 * (1.0 - np.cos(np.pi * ramp))
        hold = _Hold(finger, begin, weights, path, np.array([here, 0.0]))
    moves = scene.case.obstacle.moves
    while step < until:
        stop = int(min(until, tuning.until(step, state), step + _MOST_PATH if moves else until))
        model = tuning.model
        row = no_finger(model.omega.size, model.eta.size) if hold is None else hold.row(model, step, stop)
        if moves:
            heights = scene.obstacle_displacement(np.arange(step, stop + 1) * scene.dt)
            driver.run_moving(model, state, stop - step, row, heights)
        else:
            driver.run(model, state, stop - step, row)
        step = stop
