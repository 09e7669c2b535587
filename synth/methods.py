"""How each scheme of `synth.schemes` runs a scene."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from synth.case import CaseError, FingerTable
from synth.dsp.denormals import enable_ftz, restore
from synth.physics.excitation import pluck_weights
from synth.scene import Scene, finger_end
from synth.schemes import LAWS, SCHEMES
from synth.solver import driver, wall
from synth.solver.kernels import Finger, finger_row, no_finger
from synth.solver.lcp import SOLVED
from synth.solver.problem import Outcome


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
    flush = enable_ftz()
    try:
        for finger in scene.fingers:
            begin = max(round(finger.start_s / scene.dt), int(state.counts[driver.STEPS]))
            _advance(scene, state, begin, None)
            end = max(begin + 1, round(finger_end(finger) / scene.dt))
            _advance(scene, state, min(end, scene.steps), finger)
        _advance(scene, state, scene.steps, None)
    finally:
        restore(flush)
    seconds = time.perf_counter() - started
    sums, counts = state.sums, state.counts
    notes = {"started_from_static_contact": lifted > 0.0, "lifted_m": lifted}
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


def _advance(scene: Scene, state: driver.Run, until: int, finger: FingerTable | None) -> None:
    steps = until - int(state.counts[driver.STEPS])
    if steps <= 0:
        return
    model = scene.model
    if finger is None:
        driver.run(model, state, steps, no_finger(model.omega.size, model.eta.size))
        return
    weights = pluck_weights(scene.string.length_m, finger.position_m, finger.width_m, model.omega.size)
    coupling = np.zeros(model.eta.size)
    own = finger_row(model.law, model.coef, model.shapes, weights, coupling)
    here = float(weights @ state.q)
    ramp = np.clip(np.arange(steps + 1) * scene.dt / finger.draw_s, 0.0, 1.0)
    path = here + (finger.displacement_m - here) * 0.5 * (1.0 - np.cos(np.pi * ramp))
    row = Finger(1, weights, coupling, own, finger.stiffness_n_m, finger.resistance_n_s_m, path, np.array([here, 0.0]))
    driver.run(model, state, steps, row)


def run_wall(scene: Scene) -> Outcome:
    """Impulses at the nodes of the modal grid under the case's wall."""
    case, table = scene.case, scene.case.obstacle.wall
    if table is None:
        raise CaseError(f"obstacle: scheme {case.scheme.name!r} needs a wall; give obstacle.wall or take another scheme")
    if scene.fingers:
        raise CaseError(f"finger: scheme {case.scheme.name!r} takes none; start from an initial shape")
    problem = scene.problem()
    stiffness = math.inf if table.stiffness_n_m2 == "rigid" else table.stiffness_n_m2
    try:
        model = wall.make_wall(
            problem.omega, problem.sigma, problem.mu, problem.dt, scene.string.length_m, scene.positions, problem.eta,
            problem.out_shapes, stiffness, case.scheme.restitution,
        )  # fmt: skip
        state = wall.start_run(problem, model, case.run.ledger)
    except ValueError as error:
        raise CaseError(f"obstacle.wall: {error}") from None
    flush = enable_ftz()
    started = time.perf_counter()
    try:
        wall.advance(model, state, problem.steps, problem.every)
    finally:
        restore(flush)
    seconds = time.perf_counter() - started
    sums, counts = state.sums, state.counts
    return Outcome(
        u=state.u,
        contact_u=state.contact_u,
        contact_force=state.contact_force,
        energy=state.energy if case.run.ledger else None,
        largest_penetration_m=float(sums[wall.PENETRATION]),
        largest_energy_rise=float(sums[wall.RISE]) if case.run.ledger else float("nan"),
        last_contact_step=int(counts[wall.LAST]),
        contact_steps=int(counts[wall.TOUCHED]),
        seconds=seconds,
        notes={"steps_looked_at": int(counts[wall.LOOKED]), "spring_radians_per_step": wall.spring_angle(model)},
    )


RUNNERS: dict[str, Callable[[Scene], Outcome]] = {
    **dict.fromkeys(LAWS, run_law),
    "wall": run_wall,
}
assert RUNNERS.keys() == SCHEMES.keys()


def run(scene: Scene) -> Outcome:
    """The scene from t = 0 to its end by the scheme that its case names; CaseError where it does not apply."""
    return RUNNERS[scene.case.scheme.name](scene)
