"""What a built site links to and what it would ask of other hosts."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

#: attributes by which a page asks for something as it is shown; `a` only leads somewhere
_ASKS = {"src", "srcset", "poster", "data", "action", "href"}
#: a style sheet asks for what stands in url(…) and @import
_STYLE = re.compile(r"""url\(\s*['"]?([^'")]+)|@import\s+['"]([^'"]+)""")


@dataclass
class Built(HTMLParser):
    """ids and links of one page. links: (address, whether the browser asks for it by itself)."""

    ids: set[str] = field(default_factory=set)
    links: list[tuple[str, bool]] = field(default_factory=list)
    classes: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id" or (tag == "a" and name == "name"):
                self.ids.add(value or "")
            elif name == "class":
                self.classes.update((value or "").split())
            elif name in _ASKS and value is not None:
                self.links.append((value, tag not in ("a", "form")))
            elif name == "style":
                self.links += [(first or second, True) for first, second in _STYLE.findall(value or "")]

    handle_startendtag = handle_starttag


def pages(site: Path) -> dict[Path, Built]:
    """Every page of a site, read."""
    found = {}
    for path in sorted(site.rglob("*.html")):
        found[path] = page = Built()
        page.feed(path.read_text(encoding="utf-8"))
    return found


def broken(site: Path) -> list[str]:
    """ "page: address" of every link, anchor, picture and sound of a site that is not there."""
    read = pages(site)
    wrong = []
    for path, page in read.items():
        for address, _ in page.links:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = path if not parts.path else (path.parent / unquote(parts.path)).resolve()
            # no page of its own stands behind a server's error: its links begin at the top
            if path.name == "404.html" and parts.path.startswith("/"):
                target = (site / unquote(parts.path).lstrip("/")).resolve()
            if target.is_dir():
                target /= "index.html"
            there = target.is_file()
            if there and parts.fragment and target.suffix == ".html":
                there = unquote(parts.fragment) in read[target].ids or parts.fragment.startswith("__")
            if not there:
                wrong.append(f"{path.relative_to(site)}: {address}")
    return wrong


def foreign(site: Path) -> list[str]:
    """ "file: address" of everything that a page or style sheet of a site would ask of another host."""
    asked = [(path, address) for path, page in pages(site).items() for address, asks in page.links if asks]
    for path in sorted(site.rglob("*.css")):
        asked += [(path, first or second) for first, second in _STYLE.findall(path.read_text(encoding="utf-8"))]
    return [
        f"{path.relative_to(site)}: {address}"
        for path, address in asked
        if urlsplit(address).scheme not in ("", "data") or urlsplit(address).netloc
    ]
