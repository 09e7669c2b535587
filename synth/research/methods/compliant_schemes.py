"""How the schemes with a compliant contact run a scene."""

from __future__ import annotations

import numpy as np

from synth.native.denormals import flushed
from synth.physics.modes import mode_shapes
from synth.research.case import CaseError
from synth.research.scene import Scene
from synth.solver import two_step
from synth.solver.problem import Outcome
from synth.solver.schemes import LAWS

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
    with flushed():
        outcome = two_step.solve(problem, model, scene.case.run.ledger, scene.kept, scene.first)
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
