"""Folders in the navigation: which pages they have, in which order."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from posixpath import normpath
from typing import Any

_LINK = re.compile(r"\]\(([^)#\s]+\.md)(?:#[^)]*)?\)")


def expand(nav: Iterable[Any], files: Mapping[str, Path]) -> list[Any]:
    """The navigation with every folder ("tutorials/") replaced by its pages, and left out where it has none.

    files: path below docs/ → where the page is read."""
    expanded = []
    for item in nav:
        if isinstance(item, dict):
            ((title, below),) = item.items()
            if isinstance(below, str) and below.endswith("/"):
                below = pages_of(below, files)
            elif isinstance(below, list):
                below = expand(below, files)
            if below:
                expanded.append({title: below})
        else:
            expanded.append(item)
    return expanded


def pages_of(folder: str, files: Mapping[str, Path]) -> list[Any]:
    """Pages of a folder ("tutorials/"): index.md, those that it links to in that order, the others by name; folders below
    it as sections of their own."""
    inside = sorted(name for name in files if name.startswith(folder) and name.endswith(".md"))
    index = f"{folder}index.md"
    order = [index] if index in inside else []
    if order:
        links = _LINK.findall(files[index].read_text(encoding="utf-8"))
        order += [normpath(folder + link) for link in links]
    order += inside
    pages: list[Any] = []
    seen: set[str] = set()
    for name in order:
        if name not in inside:
            continue
        section, _, rest = name.removeprefix(folder).partition("/")
        key = section if rest else name
        if key in seen:
            continue
        seen.add(key)
        pages.append({section.replace("-", " ").capitalize(): pages_of(f"{folder}{section}/", files)} if rest else name)
    return pages
