"""The pages of the reference, made from the code.

markdown       tables, headings, texts
fields         range, default and kind of a field of a table
instruments    a page for every preset of the program, to be played
command_line, preset_keys, case_keys, controls, python_api    a page each: `page()` gives its text
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from . import case_keys, command_line, controls, instruments, preset_keys, python_api
from .markdown import link_list

#: file name → (title, what is on it, the page)
PAGES: dict[str, tuple[str, str, Callable[[], str]]] = {
    "command-line.md": ("Command line", "every command with its options", command_line.page),
    "preset-keys.md": ("Keys of presets", "every table and key of an instrument's file", preset_keys.page),
    "case-keys.md": ("Keys of cases", "every table and key of a case for `synth simulate`", case_keys.page),
    "controls.md": ("Controllers and live parameters", "what MIDI and automation can do while it sounds", controls.page),
    "python.md": ("Python", "every public name of the package `synth`", python_api.page),
}


def index() -> str:
    """The page that leads to the others."""
    links = [f"[{title}]({name}): {what}." for name, (title, what, _) in PAGES.items()]
    links.append(f"[Instruments]({instruments.FOLDER}/index.md): every preset, to be played and heard.")
    return "# Reference\n\nThese pages are made from the program itself.\n\n" + link_list(links)


def pages() -> dict[str, str]:
    """Text of every page by its file's name. Raises LookupError where something has no words."""
    of_instruments = {f"{instruments.FOLDER}/{name}": text for name, text in instruments.pages().items()}
    return {"index.md": index(), **{name: page() for name, (_, _, page) in PAGES.items()}, **of_instruments}


def write(folder: Path) -> list[Path]:
    """Write the pages into a folder; what was written. Pages of presets that there are no more go. Raises LookupError as
    `pages` does, OSError."""
    written = []
    texts = pages()
    (folder / instruments.FOLDER).mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:  # watchers see only what has changed
            path.write_text(text, encoding="utf-8")
            written.append(path)
    for old in set((folder / instruments.FOLDER).glob("*.md")) - {folder / name for name in texts}:
        old.unlink()
    return written
