"""Which tests run: those marked slow only with --all, or where their file or they themselves are named."""

from __future__ import annotations

import pytest

from tests.conftest import LONGEST, ROOT, SLOW, SLOW_CASES

pytest_plugins = ["pytester"]

CONFTEST = "from tests.conftest import pytest_addoption, pytest_collection_modifyitems, pytest_configure_node\n"
INI = f"""
[pytest]
testpaths = some
pythonpath = {ROOT}
addopts = --import-mode=importlib
markers = slow: long
"""
TESTS = """
import pytest

def test_quick():
    pass

@pytest.mark.slow
def test_long():
    pass
"""


@pytest.fixture
def folder(pytester: pytest.Pytester) -> pytest.Pytester:
    pytester.makeini(INI)
    pytester.makeconftest(CONFTEST)
    (pytester.mkdir("some") / "test_some.py").write_text(TESTS)
    return pytester


@pytest.mark.parametrize("workers", ["0", "1"])
@pytest.mark.parametrize("words, passed", [([], 1), (["--all"], 2), (["some/test_some.py"], 2)])
def test_slow_tests_run_where_they_are_asked_for(
    folder: pytest.Pytester, words: list[str], passed: int, workers: str
) -> None:
    done = folder.runpytest_subprocess("-n", workers, *words)
    done.assert_outcomes(passed=passed)


def test_files_that_are_named_are_there() -> None:
    assert [name for name in (*LONGEST, *SLOW) if not (ROOT / name).exists()] == []


def test_tests_whose_cases_are_named_are_there() -> None:
    for name in SLOW_CASES:
        path, _, test = name.partition("::")
        assert f"def {test.partition('[')[0]}(" in (ROOT / path).read_text(encoding="utf-8"), name
