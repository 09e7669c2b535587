"""How each scheme of `synth.solver.schemes` runs a scene."""

from __future__ import annotations

from collections.abc import Callable

from synth.research.case import CaseError
from synth.research.methods.compliant_schemes import run_compliant
from synth.research.methods.exact_schemes import CLOSED, EXACT_RUNNERS
from synth.research.methods.nonsmooth_schemes import run_law
from synth.research.methods.wall_schemes import run_wall
from synth.research.scene import Scene
from synth.solver.contact_laws import is_law, registered
from synth.solver.problem import Outcome
from synth.solver.schemes import COMPLIANT, LAWS, SCHEMES

RUNNERS: dict[str, Callable[[Scene], Outcome]] = {
    **dict.fromkeys(LAWS, run_law),
    **EXACT_RUNNERS,
    **dict.fromkeys(COMPLIANT, run_compliant),
    "wall": run_wall,
}
assert RUNNERS.keys() == SCHEMES.keys()


def run(scene: Scene) -> Outcome:
    """The scene from t = 0 to its end by the scheme that its case names; CaseError where it does not apply."""
    name = scene.case.scheme.name
    if not is_law(name) and (scene.case.bend or scene.case.obstacle.moves):
        raise CaseError(f"scheme {name!r} supports neither bends nor moving obstacles; use one of {', '.join(LAWS)}")
    if scene.case.obstacle.layer is not None and (name != "exact-hold" or scene.case.scheme.substeps > 1):
        got = name if name != "exact-hold" else f"{scene.case.scheme.substeps} substeps"
        raise CaseError(f"obstacle.layer: soft contacts need exact-hold without substeps, got {got}; raise internal_rate_hz")
    if registered(name) is not None and scene.case.run.ledger:
        raise CaseError(f"run.ledger: the contact law {name!r} does not say what its contacts store; leave the ledger out")
    if scene.kept is not None and name in CLOSED:
        raise CaseError(f"scheme {name!r} is a formula and cannot continue a run; run it for the whole time")
    try:
        return RUNNERS.get(name, run_law)(scene)
    except ValueError as error:
        if scene.kept is not None and not isinstance(error, CaseError):
            raise CaseError(f"resume_from: {error}") from None
        raise
