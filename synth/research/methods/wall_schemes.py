"""How the scheme for walls runs a scene."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from synth.native.denormals import flushed
from synth.research.case import CaseError
from synth.research.scene import Scene
from synth.solver import wall
from synth.solver.problem import Outcome, Problem


@dataclass
class ContactRows:
    """Rows of a wall's nodes, made when they are first asked for: the same run once more, bit for bit."""

    begin: Callable[..., wall.WallRun]
    problem: Problem
    model: wall.Wall
    rows: tuple[np.ndarray, np.ndarray] | None = None

    def of(self, which: int) -> np.ndarray:
        """0: displacements (n, C) [m]; 1: forces (n, C) [N]."""
        if self.rows is None:
            state = _advanced(self.problem, self.model, self.begin(ledger=False))
            self.rows = state.results.contact_u, state.results.contact_force
        return self.rows[which]


def _advanced(problem: Problem, model: wall.Wall, state: wall.WallRun) -> wall.WallRun:
    with flushed():
        wall.advance(model, state, problem.steps, problem.every)
    return state


def run_wall(scene: Scene) -> Outcome:
    """Impulses at the nodes of the modal grid under the case's wall."""
    case, table = scene.case, scene.case.obstacle.wall
    if table is None:
        raise CaseError(f"obstacle: scheme {case.scheme.name!r} needs a wall; give obstacle.wall or take another scheme")
    if scene.fingers:
        raise CaseError(f"finger: scheme {case.scheme.name!r} takes none; start from an initial shape")
    problem = scene.problem()
    problem = problem._replace(steps=(scene.outputs - 1) * problem.every)
    stiffness = math.inf if table.stiffness_n_m2 == "rigid" else table.stiffness_n_m2
    try:
        model = wall.make_wall(
            problem.omega, problem.sigma, problem.mu, problem.dt, scene.string.length_m, scene.positions, problem.eta,
            problem.out_shapes, stiffness, case.scheme.restitution,
        )  # fmt: skip
        begin: Callable[..., wall.WallRun] = partial(wall.start_run, problem, model)
        if scene.kept is not None:
            begin = partial(wall.resume_run, problem, model, scene.kept)
        state = begin(ledger=case.run.ledger, contact_rows=False)
    except ValueError as error:
        raise CaseError(f"obstacle.wall: {error}") from None
    nothing = problem._replace(steps=0)
    _advanced(nothing, model, begin(ledger=case.run.ledger, contact_rows=False))  # compiles
    started = time.perf_counter()
    _advanced(problem, model, state)
    seconds = time.perf_counter() - started
    sums, counts, rows = state.results.sums, state.results.counts, ContactRows(begin, problem, model)
    exit_step, last = int(counts[wall.EXIT]), int(counts[wall.LAST])
    return Outcome(
        u=state.results.u,
        contact_u=partial(rows.of, 0),
        contact_force=partial(rows.of, 1),
        energy=state.results.energy if case.run.ledger else None,
        largest_penetration_m=float(sums[wall.PENETRATION]),
        largest_energy_rise=float(sums[wall.RISE]) if case.run.ledger else float("nan"),
        last_contact_step=scene.first + last if last >= 0 else -1,
        contact_steps=int(counts[wall.TOUCHED]),
        seconds=seconds,
        notes={
            "steps_looked_at": int(counts[wall.LOOKED]),
            "free_from_s": (scene.first + exit_step) * problem.dt if exit_step >= 0 else None,
            "spring_radians_per_step": wall.spring_angle(model),
        },
        state=wall.kept_of(state),
    )
