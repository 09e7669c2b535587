"""`synth dataset` as it is typed: one line and exit code 2 for what cannot be, the same bits for what is made again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from synth.cli import main
from tests.dataset.kit import HEAD, NOTES, rows


@pytest.fixture
def recipe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "r.toml"
    path.write_text(HEAD + NOTES.replace('"C3", "E3", "G3", "C4"', '"C4"'))
    return path


def test_from_the_recipe_to_what_is_checked(recipe: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dataset", "r.toml", "--check", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["items"] == 4
    assert main(["dataset", "r.toml", "--dry-run", "--workers", "1"]) == 0
    assert "4 items in" in capsys.readouterr().out and not Path("set").exists()
    assert main(["dataset", "r.toml", "-o", "set", "--workers", "1"]) == 0
    assert "4 items" in capsys.readouterr().out
    assert main(["dataset", "set", "--quiet"]) == 0 and capsys.readouterr().out == ""
    assert main(["dataset", "set", "--verify", "4"]) == 0
    assert "set: 4 items checked, 0 faults" in capsys.readouterr().out
    key = rows(Path("set"))[0]["key"]
    for source in ("set", "r.toml"):
        assert main(["dataset", source, "--item", key, "-o", "x.flac", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["sha256"] == rows(Path("set"))[0]["sha256"]
    assert main(["dataset", "set", "--regenerate", key]) == 0
    assert f"{key}: the same" in capsys.readouterr().out
    Path("set/recipe.toml").write_bytes(Path("set/recipe.toml").read_bytes().replace(b"hold_s = 0.15", b"hold_s = 0.16"))
    assert main(["dataset", "set", "--verify", "4"]) == 1
    assert main(["dataset", "set", "--regenerate", key]) == 1


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["r.toml"], "-o is missing"),
        (["none.toml", "--check"], "none.toml: No such file"),
        (["none", "--check"], "there is no recipe 'none'"),
        (["r.toml", "--verify", "3"], "--verify takes the folder of a data set"),
        (["r.toml", "--item", "n0-00000000"], "--item writes FLAC"),
        (["r.toml", "--item", "n9-00000000", "-o", "x.flac"], "there is no item 'n9-00000000'"),
        (["r.toml", "-o", "r.toml"], "r.toml: is a file"),
        (["r.toml", "-o", "no/where"], "there is no directory no"),
        ([".", "--verify", "1"], "is not the folder of a data set"),
        (["r.toml", "--check", "--verify", "1"], "not allowed with"),
        (["r.toml", "-o", "set", "--workers", "0"], "must be a whole number from 1"),
    ],
)
def test_what_cannot_be_is_said_in_a_line(
    recipe: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    before = sorted(path.name for path in recipe.parent.iterdir())
    try:
        code = main(["dataset", *arguments])
    except SystemExit as end:
        code = int(end.code or 0)
    told = capsys.readouterr()
    assert code == 2 and said in told.err and told.err.count("\n") == 1 and told.out == ""
    assert sorted(path.name for path in recipe.parent.iterdir()) == before


def test_without_its_packages_it_says_which(
    recipe: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("synth.cli.dataset.PACKAGES", ("pyarrow", "no_such_package"))
    assert main(["dataset", "r.toml", "--check"]) == 2
    assert "needs no_such_package: pip install 'jawari[dataset]'" in capsys.readouterr().err
