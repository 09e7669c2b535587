"""Instruments to be played on a page: `<!-- instrument: NAME -->` becomes a button that loads one of build/docs/live."""

from __future__ import annotations

import json
import re
from html import escape
from pathlib import Path
from posixpath import dirname, relpath
from typing import Any

from mkdocs.plugins import get_plugin_logger

log = get_plugin_logger("live")
PLACE = re.compile(r"^<!-- instrument: ([a-z0-9-]+) -->$", re.MULTILINE)


def fill(markdown: str, page: str, folder: Path) -> str:
    """A page's Markdown with its instruments. folder: what `tools/live` has written; without it the site is warned about,
    which is an error where it is built strictly."""

    def button(match: re.Match[str]) -> str:
        found = next((each for each in _listed(folder) if each["name"] == match[1]), None)
        if found is None:
            log.warning(f"{page}: no instrument {match[1]!r} in {folder}; ./tools/docs makes it")
            return ""
        return _button(found, relpath("live", dirname(page) or "."))

    return PLACE.sub(button, markdown)


def _listed(folder: Path) -> list[dict[str, Any]]:
    try:
        return json.loads((folder / "live.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return []


def _button(found: dict[str, Any], to: str) -> str:
    title = escape(found["title"])
    if found["file"] is None:  # there is no engine for pages
        return (
            f'<p class="live-missing">{title}: to be played here where the site was built with the engine for web pages.</p>'
        )
    size = f"{found['bytes'] / 1e6:.1f} MB"
    return (
        f'<div class="live" data-live="{to}/" data-bank="{escape(found["file"])}">'
        f'<button type="button" class="md-button md-button--primary">Play it here: {title}</button>'
        f" <small>loads {size}; every string is computed in this page</small></div>"
    )
