"""Parts of pages that commands write: what stands between a pair of comments is replaced."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from synth.files.targets import write_text

DOCS = Path(__file__).resolve().parents[2] / "docs"


def put(parts: Mapping[str, str], path: Path) -> None:
    """Replace what stands between `<!-- name -->` and `<!-- /name -->` by the text of each name. Raises ValueError where
    one of these pairs is not there, and then writes nothing."""
    page = path.read_text(encoding="utf-8")
    for name, text in parts.items():
        begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
        before, found, rest = page.partition(begin)
        _, found_too, after = rest.partition(end)
        if not (found and found_too):
            raise ValueError(f"{path}: has no {begin} … {end}; put the two lines where the table belongs")
        page = f"{before}{begin}\n\n{text.strip()}\n\n{end}{after}"
    write_text(path, page)
