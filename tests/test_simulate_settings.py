"""Any value of a case by its dotted key: `simulate(settings=…)` and `synth simulate --set`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import synth
from synth import cli
from synth.research.case import OVERRIDES, load_case
from synth.research.simulation import Overrides

SHORT: dict[str, Any] = {"quality": "draft", "duration_s": 0.005}


def test_a_setting_is_what_the_case_would_say() -> None:
    tables = load_case("tanpura").model_dump(exclude_unset=True)
    tables["string"]["tension_n"] = 30.0
    tables["obstacle"]["heights_m"] = [-1e-4]
    run = synth.simulate("tanpura", settings={"string.tension_n": 30.0, "obstacle.heights_m": [-1e-4]}, **SHORT)
    wanted = synth.simulate(tables, **SHORT)
    assert isinstance(run, synth.Result) and isinstance(wanted, synth.Result)
    assert np.array_equal(run.u, wanted.u) and run.metadata["case"]["string"]["tension_n"] == 30.0
    assert not np.array_equal(run.u, synth.simulate("tanpura", **SHORT).u)


def test_the_given_tables_stay_as_they_are() -> None:
    tables = load_case("tanpura").model_dump(exclude_unset=True)
    before = tables["string"]["tension_n"]
    synth.simulate(tables, settings={"string.tension_n": 30.0}, **SHORT)
    assert tables["string"]["tension_n"] == before


@pytest.mark.parametrize(
    ("settings", "error", "words"),
    [
        ({"string.tensoin_n": 1.0}, ValueError, r"with string.tensoin_n=1.0: string.tensoin_n: no such key"),
        ({"string.tension_n": "much"}, ValueError, "string.tension_n: must be a number, got 'much'"),
        ({"string.tension_n.deep": 1}, ValueError, "no setting 'string.tension_n.deep' \\('deep' does not exist\\)"),
        ({"modes": 3}, ValueError, "no setting 'modes'; its tables go before it with dots, such as run.modes"),
        ({"run.duration_s": 1.0}, ValueError, "setting run.duration_s and duration_s are the same; give one of them"),
        ({"run.modes": 20}, ValueError, "quality chooses rate and modes; leave out modes, or quality"),
        ([("string.tension_n", 1.0)], TypeError, "settings are a dict of dotted keys"),
    ],
)
def test_wrong_settings_are_refused_by_name(settings: Any, error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        synth.simulate("tanpura", settings=settings, **SHORT)


def test_the_command_takes_them_and_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    begin = ["simulate", "tanpura", "-o", str(tmp_path / "x.npz"), "--quality", "draft", "--duration", "0.005", "--quiet"]
    assert cli.main([*begin, "--set", "string.tension_n=30", "--set", "run.outputs_m=[0.3]"]) == 0
    run = synth.load_result(tmp_path / "x.npz")
    assert run.metadata["case"]["string"]["tension_n"] == 30.0 and run.positions.tolist() == [0.3]
    (tmp_path / "x.npz").unlink()
    for wrong, words in (
        ("string.tensoin_n=30", "string.tensoin_n: no such key"),
        ("tanpura:string.tension_n=30", "leave out 'tanpura:'"),
        ("string.tension_n", "must be KEY=VALUE"),
        ("tension_n=30", "no setting 'tension_n'"),
    ):
        try:
            code = cli.main([*begin, "--set", wrong])
        except SystemExit as left:
            code = left.code
        said = capsys.readouterr().err
        assert code == 2 and words in said and "Traceback" not in said, wrong
        assert not (tmp_path / "x.npz").exists()


def test_help_explains_every_override() -> None:
    words = synth.simulate.__doc__ or ""
    left_out = [name for name in (*Overrides.__annotations__, *OVERRIDES) if name not in words.replace(",", " ").split()
                and f"({name}" not in words and f"{name})" not in words]  # fmt: skip
    assert not left_out and "docs/reference/case-keys.md" in words
