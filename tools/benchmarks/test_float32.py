"""Modes in float32 against float64: time of a step, error of a run."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from kept_rows import rows_of, study_of
from speed_error.grid import AS_DEFAULT, BASE_HZ, E0, LONGEST_S, WITHOUT_R, Run, reference
from speed_error.jobs import SOURCES, row_of

from benchmarks import REPOSITORY, float32, kernels
from benchmarks.conftest import Race, noted
from benchmarks.count import times_less
from benchmarks.kernels import HOLD, Plucked, Setting
from synth.dsp.measures import relative_error
from synth.native.denormals import enable_ftz, restore
from synth.study.sweeping import read_arrays

#: the string flies, meets its bridge as it does when plucked, or lies on it all the time
SCENES = ("in flight", "plucked", "always pressed")
_LONG_S = 60.0


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("modes", [137, 1001, *(pytest.param(n, marks=pytest.mark.full) for n in (50, 103, 300))])
def test_float32_speed(race: Race, modes: int, scene: str, short: bool) -> None:
    setting = Setting(HOLD, modes, 1)
    plucked, steps = kernels.string(setting), kernels.steps_of(setting, short)
    if scene == "always pressed":
        m = plucked.model
        eta = m.under.eta + 2.0 * np.abs(m.under.shapes @ plucked.q)
        string = m.string._replace(contacts=m.string.contacts._replace(eta=eta))
        plucked = plucked._replace(model=replace(m, under=m.under._replace(eta=eta), string=string))
    flies = scene == "in flight"
    double, single = (float32.stretch(plucked, steps, flies, single=each)[0] for each in (False, True))
    race(double.call, reset=double.reset, against={"single": (single.call, single.reset)})
    faster = times_less(race.others["single"], race.seconds)
    race.note(
        "float32", precision="float32", lanes=float32.SINGLE_LANES, what="speed", modes=modes, scene=scene, faster=faster
    )


def _judge(finest: Run, seconds: float) -> np.ndarray:
    """The reference's displacement (n,) at 44.1 kHz [m], kept as the row of a study."""
    folder = REPOSITORY / "out" / "float32-reference"
    block = {"set": {**row_of(finest), "duration_s": seconds, "ledger_s": 0.0}}
    (row,) = rows_of(study_of("speed_error.jobs:compared", [block], SOURCES), folder, 0)
    return read_arrays(folder, row["key"])["raw"]


@pytest.mark.parametrize(
    ("scheme", "factor", "modes", "table"),
    [
        (HOLD, 1, 103, AS_DEFAULT),
        (HOLD, 2, 179, AS_DEFAULT),
        pytest.param(HOLD, 48, 1001, WITHOUT_R, marks=pytest.mark.full),
        pytest.param("moreau-jean", 48, 1001, E0, marks=pytest.mark.full),
    ],
)
def test_float32_error(benchmark: Any, scheme: str, factor: int, modes: int, table: tuple, short: bool) -> None:
    """The tanpura over 3 s and, where that is no long wait, 60 s: against float64 and against the case's reference."""
    run = Run("tanpura", scheme, factor, modes, table)
    seconds = LONGEST_S["tanpura"]
    scene = run.scene(seconds, 1)
    plucked = Plucked(scene.model, *scene.initial())
    long = factor < 8
    steps = 64 * int((_LONG_S if long else seconds) * run.rate_hz / 64)
    (_, finest), *_ = reference("tanpura", short)
    judge = _judge(finest, seconds)
    first, last = slice(0, round(seconds * BASE_HZ) - 64), slice(-BASE_HZ, None)
    flush = enable_ftz()
    try:
        (one, of_double), (other, of_single) = (float32.stretch(plucked, steps, single=each) for each in (False, True))
        one.call()
        benchmark.pedantic(other.call, setup=other.reset, rounds=1)
        double, single = of_double[factor - 1 :: factor], of_single[factor - 1 :: factor]
        errors = {
            "against_double": relative_error(single[first], double[first]),
            "last_second": relative_error(single[last], double[last]) if long else None,
            "own": relative_error(double[first], judge[1:][first]),
            "against_reference": relative_error(single[first], judge[1:][first]),
            "drift_cents": float32.drift(plucked, _LONG_S if long else seconds),
            "decay": float(np.abs(float32.misfit(plucked)[1][:20]).max()),
        }
    finally:
        restore(flush)
    two_step = float(float32.two_step_misfit(plucked)[0])
    noted(
        benchmark, "float32", precision="float32", lanes=float32.SINGLE_LANES, what="error",
        label=run.label, rate_hz=run.rate_hz, modes=modes, errors=errors,
        two_step=two_step if np.isfinite(two_step) else None,
    )  # fmt: skip
