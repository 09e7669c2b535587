"""What a terminal sends when keys are pressed → keys.

Characters are their keys. Other keys are sequences that begin with an escape (ECMA-48); terminals with kitty's keyboard
protocol send all keys so, and what happens to them. Whatever comes, nothing is raised, and a sequence that is unknown,
malformed or without an end is left out.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from dataclasses import dataclass

PRESSED, REPEATED, RELEASED = 1, 2, 3
ESCAPE = "\x1b"
#: escape alone is a key; followed by something within this time, the beginning of a sequence [s]
ESCAPE_S = 0.05
#: a sequence is no longer than so many characters
MOST_CHARACTERS = 64
_NAMED = {"A": "up", "B": "down", "C": "right", "D": "left", "H": "home"}
#: Home as some terminals have it, by number
_HOME = (1, 7)
_SEQUENCE = re.compile(r"\x1b(?:\[(?P<digits>[ -?]*)(?P<end>[@-~])|O(?P<ss3>.))")
_BEGINNING = re.compile(r"\x1b(?:\[[ -?]*|O)")
_NUMBERS = re.compile(r"[0-9:;]*")
_SHIFT, _CONTROL = 1, 4


@dataclass(frozen=True)
class Key:
    """name: a character, or "up", "down", "left", "right", "home".  told: by kitty's protocol, which tells of keys that go
    up."""

    name: str
    happens: int = PRESSED
    told: bool = False


class KeyDecoder:
    """Feed it bytes as they come. `waits`: whether it has the beginning of a sequence, or an escape, and must be asked
    again (with nothing) a little later.
    """

    def __init__(self) -> None:
        self._text = ""
        self._text_at = 0.0
        self._decoder = codecs.getincrementaldecoder("utf-8")("ignore")

    @property
    def waits(self) -> bool:
        return bool(self._text)

    def feed(self, data: bytes, now: float) -> Iterator[Key]:
        """The keys in what was sent at a time [s]; to be gone through to the end."""
        text = self._decoder.decode(data)
        if text:
            self._text += text
            self._text_at = now
        while self._text:
            if self._text[0] != ESCAPE:
                name, self._text = self._text[0], self._text[1:]
                yield Key(name)
                continue
            found = _SEQUENCE.match(self._text)
            if found is not None:
                self._text = self._text[found.end() :]
                key = _key_of(found)
                if key is not None:
                    yield key
                continue
            beginning = _BEGINNING.match(self._text)
            length = beginning.end() if beginning is not None else 1
            if length == len(self._text) <= MOST_CHARACTERS and now - self._text_at < ESCAPE_S:
                return  # more may follow
            self._text = self._text[length:]
            if beginning is None:
                yield Key(ESCAPE)


def _key_of(found: re.Match[str]) -> Key | None:
    digits, end = found["digits"] or "", found["end"] or found["ss3"]
    if len(digits) > MOST_CHARACTERS or not _NUMBERS.fullmatch(digits):
        return None
    fields = [[int(number or 0) for number in field.split(":")] for field in digits.split(";")]
    modifiers, happens = (*fields[1], 0, 0)[:2] if len(fields) > 1 else (0, 0)
    # Counted from 1; Caps Lock and Num Lock (64, 128) change no key.
    modifiers = max(modifiers - 1, 0) & 63
    happens = happens if happens in (REPEATED, RELEASED) else PRESSED
    if end in _NAMED:
        return Key(_NAMED[end], happens)
    if end == "~" and fields[0][0] in _HOME:
        return Key("home", happens)
    if end != "u" or not digits:
        return None
    code, shifted = (*fields[0], 0)[:2]
    if modifiers & _CONTROL:
        # As terminals send it without that protocol.
        name = chr(code & 0x1F) if 0x40 <= code < 0x80 else ""
    elif modifiers & _SHIFT:
        # Terminals need not say what a key is with Shift.
        name = _character(shifted) or ("!" if code == ord("1") else _character(code))
    else:
        name = _character(code)
    return Key(name, happens, told=True)


def _character(code: int) -> str:
    """A key's character; none for the keys that kitty has numbers of its own for (0xE000…0xF8FF: modifiers and the like)."""
    return chr(code) if 0 < code < 0xD800 or 0xF900 <= code < 0x110000 else ""
