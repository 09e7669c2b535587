"""What the documentation names is there: files of the repository, and tests by name."""

import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
PAGES = [REPOSITORY / name for name in ("README.md", "docs")]
PAGES = sorted(path for page in PAGES for path in ([page] if page.is_file() else page.rglob("*.md")))
#: `tests/a.py::test_b`, `tools/demo`, `synth/physics/`, not `tools/NAME` nor a pattern
_PATH = re.compile(r"`(?:\./)?((?:tests|tools|synth|presets|docs)/[a-z][\w./-]*)(?:::(\w+))?[^`*]*`")
_TEST = re.compile(r"`(test_\w+)`")


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(REPOSITORY).as_posix())
def test_what_a_page_names_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for path, test in _PATH.findall(text):
        found = REPOSITORY / path
        assert found.exists(), path
        if test:
            assert f"def {test}(" in found.read_text(encoding="utf-8"), f"{path}::{test}"


@pytest.mark.parametrize("page", sorted((REPOSITORY / "docs" / "theory").glob("*.md")), ids=lambda path: path.name)
def test_a_test_that_is_named_alone_is_in_a_file_that_the_page_names(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    files = [REPOSITORY / path for path, _ in _PATH.findall(text) if path.startswith("tests/") and path.endswith(".py")]
    defined = set(re.findall(r"def (test_\w+)\(", "".join(path.read_text(encoding="utf-8") for path in files)))
    assert set(_TEST.findall(text)) <= defined
