"""A benchmark of collisions of strings that anybody's solver can enter: fixed scenes, converged references, a scorer.

    tools/collisions score RUN.npz …      # plain arrays of displacement: e and more, with uncertainty

scenes/     NAME.toml: what a scene is, in physical terms; NAME.json: the same as numbers, for any solver
outside/    scenes on modes that others publish, made where their files are at hand (JAWARI_REFERENCE)
references/ NAME.npz: displacement (float32) at the scene's instants; references.json: how each was made, how far it stands
entries/    scores of solvers: this program's schemes, Siconos, anybody's who sends a file
examples/   a solver of some sixty lines that reads a scene, runs it and writes a run to be scored

`scene`, `runfile`, `score`, `suspicion`, `resample` and `report` need NumPy and this package's measures alone; `neutral`,
`ways`, `recipes`, `references`, `blind`, `contest` and `siconos` run the program. docs/collisions.md describes all of it.
"""

from __future__ import annotations

from pathlib import Path

#: of scenes and references: scores of another version are not comparable. A change of either must raise it
VERSION = 1
FOLDER = Path(__file__).resolve().parent


class ContestError(ValueError):
    """A scene, a reference, a run or an entry that cannot be used; one line that names the file."""
