"""Pieces of Markdown: cells, tables, texts of docstrings."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Iterable, Sequence


def cell(text: str) -> str:
    """A text within a table: on one line, with no bars that end the cell."""
    return re.sub(r"\s+", " ", text).strip().replace("|", "\\|")


def plain(text: str) -> str:
    """A text that is no Markdown: nothing in it is a link, HTML or emphasis. What stands in backquotes stays code."""
    pieces = re.split(r"(`[^`]+`)", text)
    return "".join(piece if at % 2 else re.sub(r"([\\*_\[\]<>#])", r"\\\1", piece) for at, piece in enumerate(pieces))


def code(text: str) -> str:
    """A text as code; nothing for an empty one."""
    return f"`{text}`" if text else ""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; columns in which no row has anything are left out."""
    body = [[cell(each) for each in row] for row in rows]
    kept = [at for at in range(len(head)) if any(row[at] for row in body)]
    lines = [[head[at] for at in kept], ["---"] * len(kept), *([row[at] for at in kept] for row in body)]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def anchor(name: str) -> str:
    """A place that links lead to."""
    return f'<a id="{name}"></a>'


def link_list(links: Iterable[str]) -> str:
    return "".join(f"- {link}\n" for link in links)


def fence(text: str, language: str = "text") -> str:
    return f"```{language}\n{text.rstrip()}\n```\n"


#: sections of numpydoc that list things with what is to be said of each
_LISTS = ("Parameters", "Attributes", "Returns", "Raises")


def docstring(text: str) -> str:
    """A docstring: prose, then the sections that numpydoc has, each under its title in bold."""
    prose, *sections = re.split(r"^(\w+)\n-{3,}$", inspect.cleandoc(text), flags=re.MULTILINE)
    out = [_prose(prose.strip())]
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        out.append(f"**{title}**\n")
        if title in _LISTS:
            out.append(_listed(body, title))
        else:
            out.append(fence(body.strip("\n"), "pycon") if title == "Examples" else _prose(body.strip()))
    return "\n".join(out)


def _listed(body: str, title: str) -> str:
    """A list of a section's entries: `name : kind`, or the kind alone of what is returned, and its words below, set in."""
    items = []
    for head, words in re.findall(r"^(\S.*)\n((?:[ ]+.*(?:\n|\Z)|\n(?= ))*)", body, re.MULTILINE):
        names, _, kind = head.partition(" : ")
        if title == "Returns":
            shown = f"*{plain(head)}*"
        else:
            shown = ", ".join(code(name.strip()) for name in names.split(",")) + (f" ({plain(kind)})" if kind else "")
        items.append(f"- {shown}: {plain(' '.join(words.split()))}\n")
    return "".join(items)


def _prose(text: str) -> str:
    """Paragraphs of prose as such, what is laid out in columns or is an example as it is written."""
    out = []
    for paragraph in re.split(r"\n\s*\n", text):
        lines = paragraph.splitlines()
        laid_out = any(
            re.match(r"\s", line) or re.search(r"\S {2,}\S", line) or re.match(r"\w+ +: ", line) for line in lines
        )
        listed = sum(bool(re.match(r"[\w, …]+: ", line)) for line in lines) > 1
        out.append(fence(textwrap.dedent(paragraph)) if laid_out or listed else plain(" ".join(lines)) + "\n")
    return "\n".join(out)
