"""Every command of README and docs/install.md works with nothing but what the page installs for it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools"))

import fresh_pages  # noqa: E402

COMMANDS = list(dict.fromkeys(each for page in fresh_pages.PAGES for each in fresh_pages.commands(page.read_text("utf-8"))))


@pytest.fixture(scope="module")
def fresh() -> Iterator[fresh_pages.Fresh]:
    made = fresh_pages.Fresh(quick=True)
    yield made
    made.close()


def test_commands_are_read_off_a_page() -> None:
    page = """
Type `synth a -x` or `synth b --y
z`, not `other`; `synth COMMAND --help` is any.

    ./tools/demo      # sets up
    synth c           # live  (pip install '.[live]')

```sh
synth d | e
```
"""
    assert fresh_pages.commands(page) == [
        "synth a -x", "synth b --y z", "./tools/demo", "synth c", "pip install '.[live]'", "synth d | e",
    ]  # fmt: skip


def test_what_hides_a_missing_package_is_found() -> None:
    way = fresh_pages.Way("", "good", (0, 2))
    assert fresh_pages._wrong("good", way, 0) is None
    assert "ended with 1" in (fresh_pages._wrong("good", way, 1) or "")
    assert "No module named" in (fresh_pages._wrong("good\nNo module named 'pyarrow'", way, 2) or "")
    assert "did not print" in (fresh_pages._wrong("bad", way, 0) or "")


def test_every_way_is_that_of_a_command() -> None:
    assert fresh_pages.WAYS.keys() <= set(COMMANDS)


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_works_with_what_its_page_installs(command: str, fresh: fresh_pages.Fresh) -> None:
    """`tools/follow-pages --fresh` runs those too that take minutes."""
    assert fresh.run(command) is None
