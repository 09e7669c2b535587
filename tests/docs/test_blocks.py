"""What the pages say to type does what they say."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from synth.cli import command_parser
from synth.cli.render import joined_normalize
from tests.docs.blocks import PAGES, ROOT, Block, blocks_of, follow, like, synth_lines, unprinted

RUN = [page for page in PAGES if "<!-- run" in page.read_text("utf-8")]
#: those of docs/extending bring their own schemes and effects, and are run whole by tests/extending
TYPED = [page for page in PAGES if page.parent.name != "extending"]
GUIDES = [page for page in PAGES if page.parent.name in ("tutorials", "how-to")]


def name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, and no screen to draw on."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    return tmp_path


@pytest.mark.parametrize("page", RUN, ids=name)
def test_a_page_works_as_written(page: Path, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text = page.read_text("utf-8")
    ran = list(follow(text, lambda: "".join(capfd.readouterr())))
    assert ran or all(block.needs for block in blocks_of(text) if block.runs)


@pytest.mark.parametrize("page", GUIDES, ids=name)
def test_every_block_of_a_guide_is_run_or_says_why_not(page: Path) -> None:
    for block in blocks_of(page.read_text("utf-8")):
        if block.kind in ("sh", "python") and not block.title:
            assert block.runs or re.match("not run: .{5}", block.mark), f"line {block.line}"


@pytest.mark.parametrize("page", TYPED, ids=name)
def test_commands_have_options_that_there_are(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for line, words in synth_lines(page.read_text("utf-8")):
        if {"--help", "--version", "-h"} & set(words):
            continue
        try:
            command_parser().parse_args(joined_normalize(words))
        except SystemExit as end:
            pytest.fail(f"line {line}: synth {' '.join(words)}: {capsys.readouterr().err} ({end.code})")


@pytest.mark.parametrize("folder_name", ["tutorials", "how-to"])
def test_the_index_leads_to_every_page(folder_name: str) -> None:
    folder = ROOT / "docs" / folder_name
    linked = re.findall(r"\]\(([\w-]+\.md)\)", (folder / "index.md").read_text("utf-8"))
    assert sorted(linked) == sorted(path.name for path in folder.glob("*.md") if path.name != "index.md")


PAGE = """
```toml title="sub/given.toml"
x = 1
```

<!-- run -->
```sh
cat sub/given.toml
synth presets show tanpura > mine.toml
```
<!-- prints -->
```text
x = 1
```

```sh
exit 1
```

<!-- run -->
```python
from pathlib import Path

print(Path("mine.toml").read_text().splitlines()[1], "and", 1.05)
```
<!-- prints -->
```text
name = "tanpura" and 1
```
"""


def followed(text: str, capfd: pytest.CaptureFixture[str]) -> list[Block]:
    return list(follow(text, lambda: "".join(capfd.readouterr())))


def test_a_page_is_followed(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert [block.kind for block in followed(PAGE, capfd)] == ["sh", "python"]
    assert (folder / "sub" / "given.toml").read_text() == "x = 1\n"


@pytest.mark.parametrize(
    ("true", "false", "what"),
    [
        ("x = 1\n```\n\n```sh", "x = 2\n```\n\n```sh", "not printed"),
        ("and 1\n", "and 1.4\n", "not printed"),
        ("presets show tanpura", "presets show tampura", "ended with 2"),
        ("cat sub/given.toml", "cat given.toml", "ended with 1"),
        ("<!-- run -->\n```sh\ncat", "<!-- run, exits 2 -->\n```sh\ncat", "ended with 0"),
    ],
)
def test_what_is_not_true_is_said(folder: Path, capfd: pytest.CaptureFixture[str], true: str, false: str, what: str) -> None:
    assert PAGE.count(true) == 1
    with pytest.raises(AssertionError, match=what):
        followed(PAGE.replace(true, false), capfd)


def test_what_needs_a_module_that_is_not_there_is_left_out(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    page = "<!-- run, needs nothing_of_that_name -->\n```python\nraise OSError\n```\n<!-- prints -->\n```text\nx\n```\n"
    assert followed(page, capfd) == []


def test_the_tool_types_what_pages_say(tmp_path: Path) -> None:
    true = "<!-- run -->\n```sh\nsynth --version > v; cat v\n```\n<!-- prints -->\n```text\nsynth (jawari) …\n```\n"
    (tmp_path / "true.md").write_text(true)
    (tmp_path / "false.md").write_text("\n" + true.replace("jawari", "jiva"))
    pages = [str(tmp_path / name) for name in ("true.md", "false.md")]
    done = subprocess.run([sys.executable, ROOT / "tools" / "follow-pages", *pages], capture_output=True, text=True)
    assert done.returncode == 1 and not done.stderr
    first, second = done.stdout.split("\n", 1)
    assert "true.md: 1 blocks, " in first and "false.md: line 7: not printed" in second


def test_lines_are_alike() -> None:
    assert like("a.wav: 2.0 s, …, 8 notes", "  a.wav:  2.1 s, peak −6 dB, 8 notes")
    assert not like("a.wav: 2.0 s", "a.wav: 3.0 s") and not like("E1 to A1", "E1 to A2") and not like("−1 dB", "1 dB")
    assert unprinted("b\na\n", "a\nb\na") == [] and unprinted("b\na\n", "a\nb") == ["a"]


def test_commands_are_found() -> None:
    page = "    synth render a.mid | x\n\n```sh\nsynth play  # live\nls\n```\n\n```text\nsynth no\n```\n    synth body …\n"
    assert list(synth_lines(page)) == [(1, ["render", "a.mid"]), (4, ["play"])]
