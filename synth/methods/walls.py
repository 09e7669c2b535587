"""How the scheme for walls runs a scene."""

from __future__ import annotations

import math
import time

from synth.case import CaseError
from synth.dsp.denormals import enable_ftz, restore
from synth.scene import Scene
from synth.solver import wall
from synth.solver.problem import Outcome


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
