"""A notebook's source: Python whose cells begin with `# %%`, or `# %% [markdown]` and are comments then."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nbformat

_CODE, _MARKDOWN = "# %%", "# %% [markdown]"


def cells(text: str) -> list[tuple[str, str]]:
    """("markdown" or "code", what it says) of each cell. Raises ValueError, with the line, for what is none."""
    found: list[tuple[str, list[str]]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line in (_CODE, _MARKDOWN):
            found.append(("code" if line == _CODE else "markdown", []))
        elif line.startswith("# %%"):
            raise ValueError(f"line {number}: cells begin with {_CODE!r} or {_MARKDOWN!r}, got {line!r}")
        elif not found:
            if line.strip():
                raise ValueError(f"line {number}: there is no cell yet; begin it with {_CODE!r} or {_MARKDOWN!r}")
        elif found[-1][0] == "markdown" and line.strip():
            if line != "#" and not line.startswith("# "):
                raise ValueError(f"line {number}: text of a cell begins with '# ', got {line!r}")
            found[-1][1].append(line[2:])
        else:
            found[-1][1].append(line)
    return [(kind, "\n".join(lines).strip("\n")) for kind, lines in found]


def notebook(path: Path) -> Any:
    """The notebook of a source, not run; cells have their number as their name, so that differences are small."""
    book = nbformat.v4.new_notebook()
    book.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    for number, (kind, text) in enumerate(cells(path.read_text(encoding="utf-8")), start=1):
        make = nbformat.v4.new_code_cell if kind == "code" else nbformat.v4.new_markdown_cell
        book.cells.append(make(text, id=f"{path.stem}-{number:02d}"))
    return book
