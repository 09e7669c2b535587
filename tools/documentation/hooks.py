"""What the site adds to MkDocs: pages that are generated, navigation by folder, formulas, players, instruments.

The reference is read from build/docs/reference, the sounds from build/docs/sounds, the instruments from build/docs/live,
where `tools/docs` puts them; another folder in place of build/docs is named by JAWARI_DOCS_BUILD (the tests').
"""

from __future__ import annotations

import os
import re
from pathlib import Path

import formulas
import live
import players
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from navigation import expand

ROOT = Path(__file__).resolve().parents[2]
#: pages that lie elsewhere in the repository, and where they are shown
ELSEWHERE = {"changelog.md": ROOT / "CHANGELOG.md"}
#: of a preset's page, by the page that stands for all in a checkout
_OF_INSTRUMENT = re.compile(r"(?<=\]\()((?:\.\./)*reference/instruments/)index\.md#([a-z0-9-]+)(?=\))")


def build_folder() -> Path:
    """Where generated pages and sounds are."""
    return Path(os.environ.get("JAWARI_DOCS_BUILD") or ROOT / "build" / "docs")


def generated() -> dict[str, Path]:
    """Path in the site's sources → file, of all that does not lie in docs/."""
    found = dict(ELSEWHERE)
    build = build_folder()
    for folder in ("reference", "sounds"):
        for path in sorted((build / folder).rglob("*")):
            if path.is_file() and path.suffix in (".md", ".svg", ".png", ".ogg", ".css"):
                found[path.relative_to(build).as_posix()] = path
    for path in sorted((build / "live").glob("*")):
        if path.suffix in (".js", ".css", ".wasm", ".jawari"):
            found[path.relative_to(build).as_posix()] = path
    return found


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Replace folders in the navigation by their pages."""
    files = {path.relative_to(config.docs_dir).as_posix(): path for path in Path(config.docs_dir).rglob("*.md")}
    config.nav = expand(config.nav or [], files | generated())
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add generated pages, each in the place of the page in docs/ that stands for it in a checkout."""
    for name, path in generated().items():
        if (stand_in := files.get_file_from_path(name)) is None or name.startswith("reference/"):
            if stand_in is not None:
                files.remove(stand_in)
            files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Put players and instruments where a page asks for them; a page at the top of the repository links to docs/, one that
    links to a preset among all instruments to that preset's page."""
    if page.file.src_uri in ELSEWHERE:
        markdown = markdown.replace("](docs/", "](")
    markdown = _OF_INSTRUMENT.sub(r"\1\2.md", markdown)
    markdown = players.fill(markdown, page.file.src_uri, build_folder() / "sounds")
    return live.fill(markdown, page.file.src_uri, build_folder() / "live")


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Formulas as MathML. A stroke inside code in a table is written `\\|`, which Python-Markdown leaves as it is."""
    html = re.sub(r"<td.*?</td>", lambda cell: cell[0].replace("\\|", "|"), html, flags=re.DOTALL)
    html = formulas.to_mathml(html, page.file.src_uri)
    return f'<div class="reference">{html}</div>' if page.file.src_uri.startswith("reference/") else html
