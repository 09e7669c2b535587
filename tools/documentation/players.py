"""Players on a page: `<!-- players: SECTION -->` becomes those of a section of build/docs/sounds/sounds.json,
`<!-- player: NAME -->` the one of a preset."""

from __future__ import annotations

import json
import re
from html import escape
from pathlib import Path
from posixpath import dirname, relpath
from typing import Any

from mkdocs.plugins import get_plugin_logger

log = get_plugin_logger("players")
_PLACE = re.compile(r"^<!-- players?: ([a-z0-9-]+) -->$", re.MULTILINE)
#: the section that has every preset, by its name
_PRESETS = "instruments"


def fill(markdown: str, page: str, folder: Path) -> str:
    """A page's Markdown with its players. folder: with the sounds and sounds.json (`tools/listen`); without it the site is
    warned about, which is an error where it is built strictly."""

    def wanted(sound: dict[str, Any], match: re.Match[str]) -> bool:
        if match[0].startswith("<!-- players:"):
            return sound["section"] == match[1]
        return sound["section"] == _PRESETS and sound["piece"] == match[1]

    def players(match: re.Match[str]) -> str:
        here = [sound for sound in _sounds(folder) if wanted(sound, match)]
        if not here:
            log.warning(f"{page}: no sounds of {match[1]!r} in {folder}; ./tools/docs renders them")
        to = relpath("sounds", dirname(page) or ".")
        return '<div class="players" markdown="0">\n' + "\n".join(_player(sound, to) for sound in here) + "\n</div>"

    return _PLACE.sub(players, markdown)


def _sounds(folder: Path) -> list[dict[str, Any]]:
    try:
        return json.loads((folder / "sounds.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return []


def _player(sound: dict[str, Any], to: str) -> str:
    title, about = escape(sound["title"]), escape(sound["about"])
    if sound["file"] is None:  # tools/docs --no-sounds
        return f'<figure class="player"><figcaption><b>{title}</b> <span>{about} (not rendered)</span></figcaption></figure>'
    return (
        f'<figure class="player"><figcaption><b>{title}</b> <span>{about}</span></figcaption>'
        f'<audio controls preload="none" src="{to}/{escape(sound["file"])}" aria-label="{title}"></audio></figure>'
    )
