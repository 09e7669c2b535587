"""Parts of docs/sound.md that commands write: what stands between a pair of comments is replaced."""

from __future__ import annotations

import re
from pathlib import Path

from synth.files.targets import write_text

PAGE = Path(__file__).resolve().parents[2] / "docs" / "sound.md"


def put(name: str, text: str, path: Path = PAGE) -> None:
    """Replace what stands between `<!-- name -->` and `<!-- /name -->`. Raises ValueError where these are not there."""
    page = path.read_text(encoding="utf-8")
    begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
    if begin not in page or end not in page:
        raise ValueError(f"{path}: has no {begin} … {end}; put the two lines where the table is to be")
    pattern = re.escape(begin) + ".*?" + re.escape(end)
    write_text(path, re.sub(pattern, lambda _: f"{begin}\n\n{text.strip()}\n\n{end}", page, flags=re.DOTALL))
