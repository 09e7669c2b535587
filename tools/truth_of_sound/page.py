"""Parts of docs/sound.md that commands write: what stands between a pair of comments is replaced."""

from __future__ import annotations

from pathlib import Path

from documentation import page

PAGE = page.DOCS / "sound.md"


def check(name: str, path: Path = PAGE) -> None:
    """Raises ValueError where the page has no place `<!-- name -->` … `<!-- /name -->`."""
    text = path.read_text(encoding="utf-8")
    if f"<!-- {name} -->" not in text or f"<!-- /{name} -->" not in text:
        raise ValueError(
            f"{path} has no place <!-- {name} --> … <!-- /{name} -->; add both comments, or leave --publish out"
        )


def put(name: str, text: str, path: Path = PAGE) -> None:
    """Replace what stands between `<!-- name -->` and `<!-- /name -->`. Raises ValueError where these are not there."""
    page.put({name: text}, path)


def marked(text: str, missed: bool) -> str:
    """A cell of a table, bold where it misses an aim."""
    return f"**{text}**" if missed else text
