"""The targets that play, in turn with those of another commit: how many times faster is this tree?"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from in_turn.session import in_turn
from same_sound import trees
from same_sound.trees import Side

from benchmarks import versus
from benchmarks.conftest import noted
from synth.instrument.plan import planned_precision
from synth.jit.kernel_cache import cache_folder
from synth.solver.lanes import LANES


@pytest.fixture(scope="module")
def base(request: pytest.FixtureRequest) -> trees.Base:
    """The package at `--against`; its kernels are kept beside it."""
    return trees.base_at(request.config.getoption("--against"), cache_folder().parent / "same-sound")


@pytest.fixture
def scene(base: trees.Base, name: str) -> dict[str, Any]:
    """What is played; made before `benchmark`, which wants to be used."""
    try:
        return versus.scene(name, base.side.tree / "presets")
    except FileNotFoundError as error:
        pytest.skip(f"{base.commit[:10]} has no {Path(error.filename).name}")


@pytest.mark.versus
@pytest.mark.parametrize("name", versus.NAMES)
def test_in_turn(scene: dict[str, Any], benchmark: Any, base: trees.Base, short: bool, all_cores: Any, name: str) -> None:
    """CPU time of one thread, wall-clock time of several."""
    several = scene["options"].get("threads", 1) > 1
    if several:
        all_cores()
    found: list[list[dict[str, float]]] = []
    sides = (base.side, Side("this tree", trees.ROOT))
    benchmark.pedantic(lambda: found.extend(in_turn(sides, scene, 3 if short else 9)), rounds=1, iterations=1)
    theirs, ours = ([each["wall_s" if several else "cpu_s"] for each in rounds] for rounds in found)
    clock = "wall clock" if several else "CPU"
    noted(
        benchmark,
        "against",
        what=name,
        commit=base.commit[:10],
        theirs=theirs,
        seconds=ours,
        work=found[0][0]["mode_steps"] / found[1][0]["mode_steps"],
        clock=clock,
        precision=planned_precision("standard"),
        lanes=2 * LANES,
    )
