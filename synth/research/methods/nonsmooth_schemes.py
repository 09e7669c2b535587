"""How the laws of the block kernels run a scene."""

from __future__ import annotations

import math
import time

import numpy as np

from synth.jit import kernel_helpers
from synth.native.denormals import flushed
from synth.research.case import CaseError, FingerTable
from synth.research.finger_paths import Way, last_steps, sliding_off
from synth.research.scene import Scene
from synth.solver import driver, study
from synth.solver.driver import Finger
from synth.solver.laws import EXACT_HOLD
from synth.solver.lcp import SOLVED
from synth.solver.problem import Outcome, kept_array
from synth.solver.stepwise import LEAST_STIFFNESS

_MOST_PATH = 1 << 16  # steps of an obstacle's path that are prepared at once


def run_law(scene: Scene) -> Outcome:
    """Exact-hold and both Moreau–Jean forms, from the static contact solution if the start is pressed in."""
    kernel_helpers.compile_all("synth.research.methods.warmup:kernels")
    case, kept = scene.case, scene.kept
    every, ledger = case.run.steps_per_output, case.run.ledger
    tuning = _Tuning(scene)
    hold, done, lifted = None, 0, 0.0
    if kept is None:
        state, lifted = _started(scene)
    else:
        state = driver.resume_run(tuning.model, kept, scene.first, every, scene.outputs, ledger)
        done = int(kept_array(kept, "fingers", ()))
        if not 0 <= done <= len(scene.fingers) - ("hold" in kept):
            raise ValueError(f"state.fingers must be at most {len(scene.fingers)}, those of the case, got {done}")
        if "hold" in kept:
            begin, here, *held = kept_array(kept, "hold", (4,))
            if not 0 <= begin <= scene.first:
                raise ValueError(f"state.hold must begin before step {scene.first}, got {begin:g}")
            hold = _Hold(scene, scene.fingers[done], int(begin), float(here), np.array(held))
            if hold.slips_at <= scene.first:
                hold.slide(float(kept_array(kept, "slip_force", ())))
    _compile(scene, state, tuning.model)
    started = time.perf_counter()
    with flushed():
        for finger in scene.fingers[done:]:
            if hold is None:
                begin = max(_step(scene, finger.start_s), int(state.results.counts[study.STEPS]))
                _advance(scene, state, tuning, begin, None)
                if begin >= scene.last:
                    break
                hold = _Hold(scene, finger, begin, float(scene.pluck_weights(finger) @ state.q))
            _advance(scene, state, tuning, min(hold.slips_at, scene.last), hold)
            if hold.slips_at > scene.last:
                break
            hold.slide(hold.force)
            _advance(scene, state, tuning, min(hold.end, scene.last), hold)
            if hold.end > scene.last:
                break
            hold = None
            done += 1
        _advance(scene, state, tuning, scene.last, None)
    seconds = time.perf_counter() - started
    ended = driver.kept_of(state) | {"fingers": np.array(done)}
    if hold is not None:
        ended["hold"] = np.array([hold.begin, hold.here, *hold.state])
        if hold.slip_force is not None:
            ended["slip_force"] = np.array(hold.slip_force)
    sums, counts = state.results.sums, state.results.counts
    notes = {"started_from_static_contact": lifted > 0.0, "lifted_m": lifted}
    if scene.tail is not None:
        notes["lumped_modes"] = int(scene.tail.omega.size)
    if case.scheme.substeps > 1:
        notes["substeps"] = case.scheme.substeps
    if ledger:
        notes["initial_energy_j"] = float(sums[study.INITIAL])
    return Outcome(
        u=state.results.u,
        contact_u=state.results.contact_u,
        contact_force=state.results.contact_force,
        energy=state.results.energy if ledger else None,
        largest_penetration_m=float(sums[study.PENETRATION]),
        largest_energy_rise=float(sums[study.RISE]) if ledger else float("nan"),
        last_contact_step=int(counts[study.LAST_CONTACT]),
        contact_steps=int(counts[study.CONTACT_STEPS]),
        unsolved_steps=int(counts[study.BAD_STEPS]),
        seconds=seconds,
        notes=notes,
        state=ended,
    )


def _started(scene: Scene) -> tuple[driver.Run, float]:
    """The run at t = 0, and how far [m] a contact point had to be lifted on to the obstacle."""
    case, model = scene.case, scene.model
    q0, v0 = scene.initial()
    q, force, status = driver.static_contact(model, q0)
    if status != SOLVED:
        raise CaseError("obstacle: no static shape of the string lies over it; lower heights_m or take more modes")
    lifted = float(np.abs(model.under.shapes @ (q - q0)).max(initial=0.0))
    published = case.scheme.start == "published"
    every = case.run.steps_per_output
    return driver.start_run(model, q, v0, force, every, scene.outputs, case.run.ledger, published), lifted


def _compile(scene: Scene, state: driver.Run, model: driver.Model) -> None:
    """Kernels made, or loaded, by no step of the run, so that its time is that of the steps."""
    driver.run(model, state, 0)
    for finger in scene.fingers[:1]:
        model.finger_row(scene.pluck_weights(finger))


def _step(scene: Scene, t: float) -> int:
    """The step that a time [s] falls on, at most one behind the last."""
    return round(min(t / scene.dt, scene.first + scene.steps + 1.0))


class _Tuning:
    """The model of the moment; its tension changes as the scene says, from its first step on."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        past = [cents for step, cents in scene.tension_changes if step < scene.first]
        self.model = scene.bent_model(past[-1]) if past else scene.model
        self._changes = [change for change in reversed(scene.tension_changes) if change[0] >= scene.first]

    def until(self, step: int, state: driver.Run) -> float:
        """Makes the changes that are due at `step`; returns the step of the next one."""
        while self._changes and self._changes[-1][0] <= step:
            before, self.model = self.model, self._scene.bent_model(self._changes.pop()[1])
            driver.change_model(before, self.model, state)
        return self._changes[-1][0] if self._changes else math.inf


class _Hold:
    """One finger from its touch, at step `begin` where the string was `here` [m], to its release at step `end`; from step
    `slips_at` on the string slides off it."""

    def __init__(self, scene: Scene, finger: FingerTable, begin: int, here: float, state: np.ndarray | None = None) -> None:
        self.begin, self.here = begin, here
        self.slips_at, self.end = last_steps(finger, begin, scene.dt)
        self.slip_force: float | None = None  # [N] with which it begins
        self.weights = scene.pluck_weights(finger)
        self.state = np.array([here, 0.0]) if state is None else state
        self._dt, self._law = scene.dt, scene.model.string.law
        self._way = Way(begin, here, finger.displacement_m, finger.draw_s)
        self._stiffness, self._resistance = finger.stiffness_n_m, finger.resistance_n_s_m

    @property
    def force(self) -> float:
        """What the finger does to the string in the last step [N]."""
        push = float(self.state[1])
        return push if self._law == EXACT_HOLD else push / self._dt

    def slide(self, force_n: float) -> None:
        """The string slides off as a force fades from force_n [N], unless it already does or is let go at once."""
        if self.end == self.slips_at or self.slip_force is not None:
            return
        self.slip_force, self._way = force_n, sliding_off(self.slips_at, self.end, force_n, self._dt)
        self._stiffness, self._resistance = LEAST_STIFFNESS, 0.0

    def row(self, model: driver.Model, start: int, stop: int) -> Finger:
        coupling, own = model.finger_row(self.weights)
        path = self._way.path(start, stop - start, self._dt, model.parts)
        return Finger(self.weights, coupling, own, self._stiffness, self._resistance, path, self.state)


def _advance(scene: Scene, state: driver.Run, tuning: _Tuning, until: int, hold: _Hold | None) -> None:
    step, until = int(state.results.counts[study.STEPS]), min(until, scene.last)
    moves = scene.case.obstacle.moves
    while step < until:
        stop = int(min(until, tuning.until(step, state), step + _MOST_PATH if moves else until))
        finger = None if hold is None else hold.row(tuning.model, step, stop)
        heights = scene.obstacle_displacement(np.arange(step, stop + 1) * scene.dt) if moves else None
        driver.run(tuning.model, state, stop - step, finger, heights)
        step = stop
