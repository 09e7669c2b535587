"""How each scheme of `synth.schemes` runs a scene."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from synth.case import CaseError, FingerTable
from synth.dsp.denormals import enable_ftz, restore
from synth.physics.excitation import pluck_weights
from synth.physics.modes import mode_shapes
from synth.scene import Scene, finger_end
from synth.schemes import COMPLIANT, LAWS, SCHEMES
from synth.solver import driver, two_step
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


#: K [N/m^α] and α where the case gives none: Issanchou et al.'s 10¹³ per metre on their grid of 1 mm, α = 3/2
STIFFNESS, EXPONENT = 1e10, 1.5


def run_compliant(scene: Scene) -> Outcome:
    """The schemes with a power-law contact, from the start as given."""
    table = scene.case.scheme
    if scene.fingers:
        raise CaseError(f"finger: scheme {table.name!r} has none; use {', '.join(LAWS)}, or start from [initial]")
    given = table.model_dump(include={"loss", "tolerance", "iterations"}, exclude_none=True)
    law = two_step.Law(
        stiffness=table.stiffness or STIFFNESS,
        exponent=table.exponent or EXPONENT,
        correction=table.drift_correction or 0.0,
        **given,
    )
    problem = scene.problem()
    nodes = _nodes(scene) if table.grid == "full" else None
    grid = None
    if nodes is not None:
        cells = scene.case.run.modes + 1
        inner = np.arange(1, cells) * scene.string.length_m / cells
        grid = mode_shapes(scene.string.length_m, inner, scene.case.run.modes)
    model = two_step.make_model(problem, table.name, law, grid, nodes)
    flush = enable_ftz()
    try:
        outcome = two_step.solve(problem, model, scene.case.run.ledger)
    finally:
        restore(flush)
    if nodes is not None:
        moved = (nodes + 1) * scene.string.length_m / (scene.case.run.modes + 1) - scene.positions
        outcome.notes["contacts_moved_m"] = float(np.abs(moved).max(initial=0.0))
    return outcome


def _nodes(scene: Scene) -> np.ndarray:
    """The obstacle's points (C,) among the inner nodes x_i = iL/(N + 1) of the paper's grid, N the number of modes."""
    cells = scene.case.run.modes + 1
    nodes = np.rint(scene.positions / scene.string.length_m * cells).astype(np.int64) - 1
    if np.any(nodes < 0) or np.any(nodes >= cells - 1) or np.unique(nodes).size < nodes.size:
        raise CaseError(
            f"scheme.grid: a grid of {cells} cells puts points of the obstacle on one another or on an end; "
            'take more modes or grid = "contacts"'
        )
    return nodes


RUNNERS: dict[str, Callable[[Scene], Outcome]] = {
    **dict.fromkeys(LAWS, run_law),
    **dict.fromkeys(COMPLIANT, run_compliant),
}
assert RUNNERS.keys() == SCHEMES.keys()


def run(scene: Scene) -> Outcome:
    """The scene from t = 0 to its end by the scheme that its case names; CaseError where it does not apply."""
    return RUNNERS[scene.case.scheme.name](scene)
