"""What the tools that calibrate keep as studies: scenes that were computed are not computed again."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from kept_rows import ROOMS, rows_of, study_of
from promise import jobs, runs

from synth.files.code_version import code_version
from synth.study.addressing import Addresses
from synth.study.studyfile import StudyError, read_study
from synth.study.sweeping import read_arrays


def scenes(*seeds: int) -> dict[str, Any]:
    block = {"set": {"kind": "points", "number": 2, "duration_s": 0.05, "every": 4}, "grid": {"seed": list(seeds)}}
    return study_of("promise.jobs:converged", [block], jobs.SOURCES)


def test_scenes_are_kept_and_gone_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "out" / "scenes"
    (first,) = rows_of(scenes(5), folder, 0)
    u, record = runs.reference(jobs.tested("points", 2, 5, 0.05), "points")
    assert {name: first.get(name) for name in record} == record
    kept = read_arrays(folder, first["key"])["u"]
    assert kept.dtype == np.float32 and np.array_equal(kept, jobs.rounded(u[::4]))
    asked = []
    computed = runs.reference
    monkeypatch.setattr(runs, "reference", lambda tables, kind: (asked.append(kind), computed(tables, kind))[1])
    again, second = rows_of(scenes(5, 6), folder, 0)
    assert asked == ["points"] and again["stands"] == first["stands"] != second["stands"]


def test_rows_that_fail_are_said_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(tables: dict[str, Any], kind: str) -> Any:
        raise ArithmeticError("not today")

    with monkeypatch.context() as patch:
        patch.setattr(runs, "reference", refuse)
        with pytest.raises(
            RuntimeError, match=r"1 of 1 rows of .* failed:\nkind points.*seed 5: ArithmeticError: not today"
        ):
            rows_of(scenes(5), tmp_path / "s", 0)
    assert "failure" not in rows_of(scenes(5), tmp_path / "s", 0)[0]


def test_rows_depend_on_the_rooms_that_their_study_names() -> None:
    """What a calibration writes makes none of its rows anew."""
    study, folder, _ = read_study(scenes(5))
    assert "instrument" not in ROOMS and not any("calibration" in source for source in study.base.sources)
    assert Addresses(study, folder).head["versions"]["code"] == code_version((*ROOMS, "study/work"))
    wrong = scenes(5)
    wrong["base"] |= {"rooms": ["cellar"]}
    with pytest.raises(StudyError, match=r"base\.rooms: synth has no room 'cellar'"):
        Addresses(read_study(wrong)[0], folder)
    with pytest.raises(StudyError, match="rooms tells which modules a function's rows depend on"):
        read_study({"base": {"case": "bass", "rooms": ["dsp"]}, "measures": ["rms"]})
