"""Parts of docs/sound.md that commands write: what stands between a pair of comments is replaced."""

from __future__ import annotations

from pathlib import Path

from documentation import page

PAGE = page.DOCS / "sound.md"


def put(name: str, text: str, path: Path = PAGE) -> None:
    """Replace what stands between `<!-- name -->` and `<!-- /name -->`. Raises ValueError where these are not there."""
    page.put({name: text}, path)
