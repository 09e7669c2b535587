"""The notebooks of the paper's figures run, what they state about numbers holds, and what the documentation shows is theirs.

They run shortened (JAWARI_NOTEBOOK=short): the same cells and the same checks over less time or at lower rates. One kernel
runs all of them, each in a clean namespace; `tools/notebooks` gives each its own.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools"))

from notebook_pages import made, source

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "docs" / "notebooks").glob("*.py"))
NAMES = [path.stem for path in SOURCES]
PAGE = (ROOT / "docs" / "paper-figures.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def said() -> str:
    """What `tools/notebooks --short` says of all of them."""
    command = [sys.executable, str(ROOT / "tools" / "notebooks"), "--short"]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True).stdout


def test_there_is_one_for_each_figure() -> None:
    assert NAMES == [*(f"figure-{number}" for number in range(2, 9)), "table-3"]


@pytest.mark.parametrize("path", SOURCES, ids=NAMES)
def test_it_runs_and_its_numbers_hold(path: Path, said: str) -> None:
    assert "assert " in source.notebook(path).cells[-1].source
    assert re.search(rf"^{path.stem}: ok, 1 picture, [1-9]\d* rows", said, re.MULTILINE), said


@pytest.mark.parametrize("path", SOURCES, ids=NAMES)
def test_what_is_kept_is_of_its_source(path: Path) -> None:
    kept = path.with_suffix(".ipynb")
    assert made.is_of(kept, path), f"run tools/notebooks {path.stem}"
    book = nbformat.read(kept, as_version=4)
    nbformat.validate(book)
    assert made.table(book).strip() == between(path.stem)
    shown = made.pictures(book)
    for number, png in enumerate(shown, start=1):
        name = f"{path.stem}.png" if number == 1 else f"{path.stem}-{number}.png"
        assert (ROOT / "docs" / "paper" / name).read_bytes() == png and f"(paper/{name})" in PAGE
        assert len(png) <= made.LARGEST


def between(name: str) -> str:
    """What the page has between the comments of a notebook."""
    return PAGE.partition(f"<!-- {name} -->")[2].partition(f"<!-- /{name} -->")[0].strip()


def test_all_of_it_is_small_and_nothing_is_left_over() -> None:
    files = [*(ROOT / "docs" / "notebooks").iterdir(), *(ROOT / "docs" / "paper").iterdir()]
    assert sum(path.stat().st_size for path in files if path.is_file()) <= 2_000_000
    assert {path.stem for path in (ROOT / "docs" / "notebooks").glob("*.ipynb")} == set(NAMES)
    assert {path.stem for path in (ROOT / "docs" / "paper").iterdir()} == set(NAMES)


def test_sources_are_read() -> None:
    text = "# %% [markdown]\n# # Title\n#\n# words\n\n# %%\nx = 1\n# a comment\n"
    assert source.cells(text) == [("markdown", "# Title\n\nwords"), ("code", "x = 1\n# a comment")]
    for wrong, words in (
        ("x = 1\n", "line 1: there is no cell yet"),
        ("# %% [raw]\n", r"line 1: cells begin with '# %%'"),
        ("# %% [markdown]\nx = 1\n", "line 2: text of a cell begins with '# '"),
    ):
        with pytest.raises(ValueError, match=words):
            source.cells(wrong)


def test_what_fails_is_said(tmp_path: Path) -> None:
    program = """
import sys
from pathlib import Path
from notebook_pages import made, source
with made.kernel() as kernel:
    for text in ("1 / 0", "import sys; print('x', file=sys.stderr)"):
        Path("a.py").write_text(f"# %%\\n{text}\\n")
        try:
            made.run(source.notebook(Path("a.py")), Path("."), kernel)
        except made.Failed as error:
            print("failed", str(error))
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tools")}
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.stdout.count("failed") == 2 and "ZeroDivisionError" in done.stdout and "a notebook warns" in done.stdout, (
        done
    )
    (tmp_path / "a.py").write_text("# %%\nx = 1\n")
    book = source.notebook(tmp_path / "a.py")
    with pytest.raises(made.Failed, match="shows no picture"):
        made.pictures(book)
    with pytest.raises(made.Failed, match="must show one table"):
        made.table(book)


def test_another_source_is_noticed(tmp_path: Path) -> None:
    kept = (ROOT / "docs" / "notebooks" / "figure-6.ipynb").read_text(encoding="utf-8")
    text = (ROOT / "docs" / "notebooks" / "figure-6.py").read_text(encoding="utf-8")
    (tmp_path / "figure-6.py").write_text(text)
    assert not made.is_of(tmp_path / "figure-6.ipynb", tmp_path / "figure-6.py")
    (tmp_path / "figure-6.ipynb").write_text(kept)
    assert made.is_of(tmp_path / "figure-6.ipynb", tmp_path / "figure-6.py")
    (tmp_path / "figure-6.py").write_text(text.replace("off_mm < 1.2", "off_mm < 12"))
    assert not made.is_of(tmp_path / "figure-6.ipynb", tmp_path / "figure-6.py")
    (tmp_path / "figure-6.py").write_text(text)
    (tmp_path / "figure-6.ipynb").write_text(kept.replace('"execution_count": 2', '"execution_count": 7'))
    assert not made.is_of(tmp_path / "figure-6.ipynb", tmp_path / "figure-6.py")


def test_pictures_get_fewer_colours_and_stay_small() -> None:
    import io

    import numpy as np
    from PIL import Image

    def png(pixels: np.ndarray) -> bytes:
        out = io.BytesIO()
        Image.fromarray(pixels).save(out, "PNG")
        return out.getvalue()

    shades = np.arange(300 * 400 * 3, dtype=np.uint64).reshape(300, 400, 3)
    smooth = png((shades // 7 % 256).astype(np.uint8))
    assert Image.open(io.BytesIO(made.fewer_colours(smooth))).mode == "P"
    with pytest.raises(made.Failed, match="is too large; draw it smaller"):
        made.fewer_colours(png(np.random.default_rng(0).integers(0, 256, (900, 900, 3), dtype=np.uint8)))
