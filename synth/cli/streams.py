"""Standard input, output and error as they are found: closed, full, of an encoding that knows few letters.

What cannot be said on standard error is not said, and nothing fails for it. What cannot be said on standard output is an
OSError that names it: a result that nobody gets is no success.
"""

from __future__ import annotations

import codecs
import os
import sys
import unicodedata
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from synth.files.targets import naming

_HANDLER = "jawari.shown"


def _shown(error: UnicodeError) -> tuple[str, int]:
    """What an encoding does not know, as an escape; a byte of a file's name that is no UTF-8 as \\xNN."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(_escape(letter) for letter in text), error.end


def _escape(letter: str) -> str:
    number = ord(letter)
    if 0xDC80 <= number <= 0xDCFF:
        return f"\\x{number - 0xDC00:02x}"
    return letter.encode("unicode_escape").decode("ascii")


codecs.register_error(_HANDLER, _shown)


class Wording:
    """Names from the command line as they are said: one with a line break or another control character would break the line
    that it stands in, or speak to the terminal."""

    def __init__(self, arguments: Sequence[str]) -> None:
        names: set[str] = set()
        for argument in arguments:
            for word in (argument, argument.partition("=")[2], argument[2:]):
                names.update((word, Path(word).name, Path(word).stem, str(Path(word).parent)))
        odd = [name for name in names if name.strip() and any(map(_controls, name))]
        self._shown = [(name, _without_controls(name)) for name in sorted(odd, key=len, reverse=True)]

    def __call__(self, text: str) -> str:
        for name, shown in self._shown:
            text = text.replace(name, shown)
        return text


def _controls(letter: str) -> bool:
    return unicodedata.category(letter) in ("Cc", "Zl", "Zp")


def _without_controls(name: str) -> str:
    return "".join(_escape(letter) if _controls(letter) else letter for letter in name)


class _Stream:
    """A standard stream that says names as `wording` has them. forgiving: what cannot be written is dropped."""

    def __init__(self, stream: Any, wording: Wording, forgiving: bool) -> None:
        self._stream, self._wording, self._forgiving = stream, wording, forgiving

    def write(self, text: str) -> int:
        with self._failing():
            self._stream.write(self._wording(text))
        return len(text)

    def flush(self) -> None:
        with self._failing():
            self._stream.flush()

    @contextmanager
    def _failing(self) -> Iterator[None]:
        try:
            with naming("-"):
                yield
        except OSError:
            if not self._forgiving:
                raise

    def writelines(self, lines: Any) -> None:
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def ready(wording: Wording) -> Iterator[None]:
    """The three streams are there, whatever the program was started with, and say every letter somehow."""
    _open_closed()
    before = sys.stdout, sys.stderr
    errors = [getattr(stream, "errors", None) for stream in before]
    for stream in before:
        with suppress(AttributeError, ValueError):
            stream.reconfigure(errors=_HANDLER)  # type: ignore[union-attr]
    mine = _Stream(before[0], wording, False), _Stream(before[1], wording, True)
    sys.stdout, sys.stderr = mine  # type: ignore[assignment]
    try:
        yield
    finally:
        # Whoever has put streams of their own there meanwhile keeps them.
        if sys.stdout is mine[0]:  # type: ignore[comparison-overlap]
            sys.stdout = before[0]
        if sys.stderr is mine[1]:  # type: ignore[comparison-overlap]
            sys.stderr = before[1]
        for stream, was in zip(before, errors, strict=True):
            with suppress(AttributeError, ValueError, OSError):
                stream.reconfigure(errors=was)  # type: ignore[union-attr]


def _open_closed() -> None:
    """A number below 3 that is free would be the next file's, and what is said would be written into that. Standard output
    is opened so that writing to it fails: it was closed."""
    with suppress(OSError):
        for number in range(3):
            try:
                os.fstat(number)
            except OSError:
                handle = os.open(os.devnull, os.O_WRONLY if number == 2 else os.O_RDONLY)
                if handle != number:
                    os.dup2(handle, number)
                    os.close(handle)
    for name, number, mode in (("stdin", 0, "r"), ("stdout", 1, "w"), ("stderr", 2, "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", errors=_HANDLER, closefd=False))


def settle_output() -> None:
    """Standard output is flushed once more at exit, which must not fail: what it cannot say by now goes nowhere."""
    try:
        sys.stdout.flush()
    except OSError:
        drop_output()


def drop_output() -> None:
    """What standard output still holds goes nowhere: whoever reads it may have stopped reading."""
    with suppress(OSError, ValueError):
        number = sys.stdout.fileno()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, number)
        os.close(nowhere)
