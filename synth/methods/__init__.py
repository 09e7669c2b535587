"""How each scheme of `synth.schemes` runs a scene."""

from __future__ import annotations

from collections.abc import Callable

from synth.case import CaseError
from synth.methods.compliant import run_compliant
from synth.methods.exact import CLOSED, EXACT_RUNNERS
from synth.methods.laws import run_law
from synth.methods.walls import run_wall
from synth.scene import Scene
from synth.schemes import COMPLIANT, LAWS, SCHEMES
from synth.solver.problem import Outcome

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
    if name not in LAWS and (scene.case.bend or scene.case.obstacle.moves):
        raise CaseError(f"scheme {name!r} knows no bend and no moving obstacle; use one of {', '.join(LAWS)}")
    if scene.kept is not None and name in CLOSED:
        raise CaseError(f"scheme {name!r} is a formula and goes on from nothing; run it for the whole time")
    try:
        return RUNNERS[name](scene)
    except ValueError as error:
        if scene.kept is not None and not isinstance(error, CaseError):
            raise CaseError(f"resume_from: {error}") from None
        raise
