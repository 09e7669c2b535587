"""tools/mutants: the sample, what becomes of a mutant, what is told of it, and that the table names what is there."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from mutation.table import Table, folded, read_table

ROOT = Path(__file__).parents[1]
TOY = '''"""Toy."""
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import fractions


def larger(a: int | None, b: int) -> int:
    return a if a > b else b


def unseen(a: int) -> int:
    return a + 1
'''
TOY_TEST = """from toy import larger, unseen

def test_larger():
    assert larger(2, 3) == 3 and larger(3, 2) == 3
    unseen(0)
"""


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A tree of a module and a test of half of it; what a bench does to the process is undone."""
    (tmp_path / "toy.py").write_text(TOY, encoding="utf-8")
    (tmp_path / "test_toy.py").write_text(TOY_TEST, encoding="utf-8")
    (tmp_path / "pytest.ini").write_text("[pytest]\npythonpath = .\nmarkers = slow\n", encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", os.environ.get("PYTHONPATH", ""))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_caught_mutant_and_one_that_survives_are_told_apart(toy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from mutation.run import told
    from mutation.sample import at_line
    from mutation.trial import CAUGHT, SURVIVED, Bench

    bench = Bench(toy)
    turned = next(mutant for mutant in at_line(toy, "toy.py", 9) if mutant.operator.endswith("_Gt_Lt"))
    less = next(mutant for mutant in at_line(toy, "toy.py", 13) if mutant.operator.endswith("_Add_Sub"))
    trials = [bench.tried(mutant, ["test_toy.py"]) for mutant in (turned, less)]
    assert [trial.verdict for trial in trials] == [CAUGHT, SURVIVED]
    assert (toy / "toy.py").read_text(encoding="utf-8") == TOY
    assert told({"toy": trials}, Table({}, ())) == 1
    out = capsys.readouterr().out
    assert "| toy | 2 | 1 | 0 | 1 | 0 | 50.0% |" in out
    assert "survived: 1\ntoy.py:13\n  - return a + 1\n  + return a - 1\n" in out
    known = read_table_of(toy, "return a + 1", "return a  -  1")
    assert told({"toy": trials}, known) == 0
    out = capsys.readouterr().out
    assert "| toy | 2 | 1 | 0 | 0 | 1 | 100.0% |" in out and "equivalent: 1" in out and "because" in out


def read_table_of(folder: Path, was: str, now: str) -> Table:
    path = folder / "mutants.toml"
    entry = f'[[known]]\nmodule = "toy.py"\nwas = "{was}"\nnow = "{now}"\nreason = "because"\n'
    path.write_text(f'[groups.toy]\n"toy.py" = ["test_toy.py"]\n{entry}', encoding="utf-8")
    return read_table(path)


def test_tests_that_fail_without_a_mutant_are_refused(toy: Path) -> None:
    from mutation.sample import sample
    from mutation.trial import Bench, WrongUse

    (toy / "test_toy.py").write_text("def test_it():\n    assert False\n", encoding="utf-8")
    (mutant,) = sample(toy, ["toy.py"], 1, "1")
    with pytest.raises(WrongUse, match=r"must pass without a mutant: .* test_toy\.py"):
        Bench(toy).tried(mutant, ["test_toy.py"])


def test_a_sample_is_that_of_its_seed_and_takes_each_place_once(toy: Path) -> None:
    from mutation.sample import sample

    drawn = {seed: sample(toy, ["toy.py"], 3, seed) for seed in "abcdef"}
    assert all(sample(toy, ["toy.py"], 3, seed) == mutants for seed, mutants in drawn.items())
    assert len({tuple(mutants) for mutants in drawn.values()}) > 1
    every = sample(toy, ["toy.py"], 99, "a")
    # the comparison, `a > b` as a condition, the sum and its number; annotations are not in it
    assert {mutant.place[0][0] for mutant in every} == {9, 13}
    assert len({mutant.place for mutant in every}) == len(every)


def test_a_copy_has_what_the_tree_has_and_nothing_else(tmp_path: Path) -> None:
    from mutation.trial import copied

    (tmp_path / "here" / "deep").mkdir(parents=True)
    (tmp_path / "there").mkdir()
    (tmp_path / "here" / "deep" / "a.py").write_text("1\n", encoding="utf-8")
    (tmp_path / "there" / "old.py").write_text("2\n", encoding="utf-8")
    copied(tmp_path / "here", tmp_path / "there", ["deep/a.py"])
    (copy,) = [path for path in (tmp_path / "there").rglob("*") if path.is_file()]
    assert copy.read_text(encoding="utf-8") == "1\n"
    assert copy.stat().st_mtime_ns == (tmp_path / "here" / "deep" / "a.py").stat().st_mtime_ns


def test_the_table_names_files_that_are_there_and_lines_that_they_have() -> None:
    table = read_table(ROOT / "tests" / "mutants.toml")
    for modules in table.groups.values():
        for module, tests in modules.items():
            assert tests and all((ROOT / name).is_file() for name in (module, *tests)), module
    mutated = {module for modules in table.groups.values() for module in modules}
    for known in table.known:
        assert known.module in mutated and known.reason, known
        assert folded(known.was) in folded((ROOT / known.module).read_text(encoding="utf-8")), known


@pytest.mark.parametrize("folder", ["physics", "host", "fit"])
def test_no_module_of_these_folders_is_left_out(folder: str) -> None:
    modules = read_table(ROOT / "tests" / "mutants.toml").groups[folder]
    assert set(modules) == {
        f"synth/{folder}/{path.name}" for path in (ROOT / "synth" / folder).glob("*.py") if path.name != "__init__.py"
    }
