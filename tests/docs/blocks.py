"""The fenced blocks of a page as what a reader types, in order, in one folder.

    <!-- run -->            before a block: it is run; `run, exits 2`: ends so; `run, needs scipy`: where that is installed
    <!-- prints -->         before a block of text: the block run last printed these lines, in this order
    <!-- not run: why -->   before a block that needs a sound card, a browser or minutes

A block with a title, ```python title="song.py", is a file that the reader writes. Of `sh` each line is a command; `synth`
and `python FILE` are run within the test's own process. In what is printed … stands for anything, and numbers may be a fifth
beside.
"""

from __future__ import annotations

import importlib.util
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from synth.cli import main

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
_BLOCK = re.compile(
    r"^(?:<!-- (?P<mark>(?:run|prints|not run)\b[^\n]*?) -->\n)?"
    r"^```(?P<kind>\w*)(?:[ \t]+title=\"(?P<title>[^\"\n]+)\")?[^\n]*\n(?P<text>.*?)^```[ \t]*$",
    re.MULTILINE | re.DOTALL,
)
_NUMBER = re.compile(r"(?<![\w.#])[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w#])")
#: how far numbers may lie beside what a page shows, of the larger
BESIDE = 0.2


@dataclass(frozen=True)
class Block:
    """kind: language; title: name of a file, or ""; line: of the page, from 1."""

    kind: str
    title: str
    text: str
    mark: str
    line: int

    @property
    def runs(self) -> bool:
        return self.mark == "run" or self.mark.startswith("run,")

    @property
    def exit_code(self) -> int:
        found = re.search(r"exits (\d+)", self.mark)
        return int(found[1]) if found else 0

    @property
    def needs(self) -> list[str]:
        """Modules without which it is not run."""
        found = re.search(r"needs ([\w ]+)", self.mark)
        return found[1].split() if found else []


def blocks_of(text: str) -> Iterator[Block]:
    for found in _BLOCK.finditer(text):
        line = text.count("\n", 0, found.start("kind")) + 1
        yield Block(found["kind"], found["title"] or "", found["text"], found["mark"] or "", line)


def follow(
    text: str, printed: Callable[[], str], type_in: Callable[[str, Block], int] | None = None, slow: bool = False
) -> Iterator[Block]:
    """Do in the current folder what a page says, block by block; those that were run.

    `printed` gives what was printed since it was asked last. type_in: what runs a command and gives its exit code, `typed`
    if none is given. slow: blocks that are not run because they take minutes are. AssertionError names the line of the page
    that is not true.
    """
    last: str | None = None
    for block in blocks_of(text):
        if block.title:
            path = Path(block.title)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
        takes_minutes = slow and block.mark.startswith("not run:") and block.mark.endswith("minutes")
        if (block.runs or takes_minutes) and all(importlib.util.find_spec(name) for name in block.needs):
            printed()
            for command in commands_of(block):
                code = (type_in or typed)(command, block)
                assert code == block.exit_code, f"line {block.line}: {command} ended with {code}: {printed()}"
            last = printed()
            yield block
        elif block.runs:
            last = None
        elif block.mark == "prints" and last is not None:
            wrong = unprinted(block.text, last)
            assert not wrong, f"line {block.line}: not printed: {wrong}; but:\n{last}"


def commands_of(block: Block) -> list[str]:
    """The command lines of a block; Python is one."""
    if block.kind == "python":
        return [block.text]
    joined = block.text.replace("\\\n", " ")
    return [line for line in joined.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def typed(command: str, block: Block) -> int:
    """Run a command, or a block of Python; its exit code."""
    if block.kind == "python":
        exec(compile(command, f"line {block.line}", "exec"), {"__name__": "__main__"})
        return 0
    words = words_of(command)
    plain = not set(words) & {"|", "&&", ";", "<"}
    if plain and words[0] == "synth":
        words, target = _redirected(words)
        with _standard_output(target):
            return _ended(lambda: main(words[1:]))
    if plain and words[0] == "python" and words[1].endswith(".py"):
        before, sys.argv = sys.argv, words[1:]
        try:
            return _ended(lambda: runpy.run_path(words[1], run_name="__main__") and None)
        finally:
            sys.argv = before
    return subprocess.run(["bash", "-c", command], check=False).returncode


def words_of(command: str) -> list[str]:
    """The words of a command line; # begins a comment only where a space is before it."""
    return shlex.split(re.sub(r"(^|\s)#.*$", "", command))


def _ended(what: Callable[[], int | None]) -> int:
    try:
        return what() or 0
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(bool(end.code))


def _redirected(words: Sequence[str]) -> tuple[list[str], str | None]:
    if ">" in words:
        at = words.index(">")
        return [*words[:at], *words[at + 2 :]], words[at + 1]
    return list(words), None


@contextmanager
def _standard_output(target: str | None) -> Iterator[None]:
    """Standard output goes to a file, if one is named."""
    if target is None:
        yield
        return
    with open(target, "w", encoding="utf-8") as file, redirect_stdout(file):
        yield


def unprinted(expected: str, printed: str) -> list[str]:
    """The lines of `expected` that are not among those printed, in their order."""
    rest = printed.splitlines()
    missing = []
    for line in filter(str.strip, expected.splitlines()):
        at = next((at for at, each in enumerate(rest) if like(line, each)), None)
        if at is None:
            missing.append(line)
        else:
            rest = rest[at + 1 :]
    return missing


def like(expected: str, printed: str) -> bool:
    """Whether a line was printed as a page shows it: the same words, numbers a fifth beside at most."""
    numbers = [_value(each) for each in _NUMBER.findall(expected)]
    pieces = [re.escape(piece) for piece in _NUMBER.split(" ".join(expected.split()))]
    pattern = f"({_NUMBER.pattern})".join(pieces).replace("…", ".*?").replace(r"\ ", r"\s+").replace(" ", r"\s+")
    found = re.fullmatch(pattern, printed.strip())
    if not found:
        return False
    got = [_value(each) for each in found.groups()]
    return all(abs(a - b) <= BESIDE * max(abs(a), abs(b)) for a, b in zip(numbers, got, strict=True))


def _value(text: str) -> float:
    return float(text.replace("−", "-"))


def synth_lines(text: str) -> Iterator[tuple[int, list[str]]]:
    """(line, words behind `synth`) of every command of this program on a page, as far as it is one: up to a pipe, without
    redirections."""
    fenced = ""
    for number, line in enumerate(text.splitlines(), start=1):
        opened = re.match(r"```(\w*)", line)
        if opened:
            fenced = "" if fenced else opened[1] or "text"
            continue
        shell = fenced == "sh" or (not fenced and line.startswith("    "))
        if shell and re.match(r"\s*synth \w", line) and "…" not in line:
            words = words_of(re.split(r" [|>&]", line)[0])
            yield number, words[1:]
