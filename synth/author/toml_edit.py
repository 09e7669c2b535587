"""Changes of a TOML document by paths such as ``string.0.length_m``, which leave comments and order where they are."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import tomlkit
from tomlkit import TOMLDocument
from tomlkit.container import Container
from tomlkit.items import AoT, Array, Item, Table

from synth.units import midi_to_note

#: numbers are written with so many digits: those behind them come from a mouse or from binary fractions
DIGITS = 9
_KEY = re.compile(r"[A-Za-z0-9_#♯♭-]+")


def plain(value: Any) -> Any:
    """A value as a file has it: numbers short, notes by name where they are keys."""
    if isinstance(value, bool) or not isinstance(value, float | Mapping | list | tuple):
        return value
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, Mapping):
        return {_key(key): plain(each) for key, each in value.items() if each is not None}
    return [plain(each) for each in value]


def _key(key: Any) -> str:
    text = str(key)
    return midi_to_note(int(text)) if text.isdecimal() and int(text) < 128 else text


def item_of(value: Any, *, inside: bool = False) -> Item:
    """A tomlkit item of plain data; tables inside a table stand on its line, but lists of them that a table at the top
    has."""
    value = plain(value)
    if isinstance(value, Mapping):
        table: Any = tomlkit.inline_table() if inside else tomlkit.table()
        for key, each in value.items():
            table.append(key, item_of(each, inside=inside or not _tables(each)))
        return table
    if isinstance(value, list):
        if not inside and _tables(value):
            tables = tomlkit.aot()
            for each in value:
                tables.append(item_of(each))
            return tables
        array = tomlkit.array()
        for each in value:
            array.append(item_of(each, inside=True))
        if sum(len(str(each)) + 2 for each in value) > 100:
            array.multiline(True)
        return array
    if isinstance(value, str) and "\n" in value:
        # TOML drops a newline right behind the quotes, which lets the first line begin where the others do
        quotes = '"""'
        return tomlkit.value(quotes + "\n" + tomlkit.string(value, multiline=True).as_string().removeprefix(quotes))
    return tomlkit.item(value)


def change_in(document: TOMLDocument, path: str, value: Any) -> TOMLDocument:
    """The document with the value at `path` replaced, put in, or (None) taken out; `document` itself may be changed, also
    where it raises: KeyError for a path that leads nowhere."""
    parts = path.split(".")
    if not all(_KEY.fullmatch(part) for part in parts):
        raise KeyError(path)
    place: Any = document
    for depth, part in enumerate(parts[:-1]):
        if isinstance(place, list):
            place = place[_index(part, len(place) - 1, path)]
        elif part in place:
            place = place[part]
        elif value is None:
            return document
        else:  # a table that the file leaves out
            rest = _nested(parts[depth + 1 :], value, path)
            return _put(document, place, part, rest, path)
        if not isinstance(place, Mapping | list):
            raise KeyError(path)
    last = parts[-1]
    if isinstance(place, list):
        index = _index(last, len(place), path)
        if value is None:
            if index < len(place):
                del place[index]
            if not place and isinstance(place, AoT):
                return change_in(document, ".".join(parts[:-1]), None)
        elif isinstance(place, AoT) and not isinstance(value, Mapping):
            raise KeyError(path)
        elif index == len(place):
            item = item_of(value, inside=isinstance(place, Array))
            if isinstance(item, Table):
                item.add(tomlkit.nl())
            place.append(item)
        else:
            place[index] = item_of(value, inside=isinstance(place, Array))
        return document
    if value is None:
        if last in place:
            del place[last]
        return document
    return _put(document, place, last, value, path)


def _index(part: str, largest: int, path: str) -> int:
    if not part.isdecimal() or int(part) > largest:
        raise KeyError(path)
    return int(part)


def _nested(parts: Sequence[str], value: Any, path: str) -> Any:
    """`value` in the tables that `parts` name; an index must be the first of a list."""
    for part in reversed(parts):
        if part.isdecimal():
            if part != "0":
                raise KeyError(path)
            value = [value]
        else:
            value = {part: value}
    return value


def _put(document: TOMLDocument, place: Any, key: str, value: Any, path: str) -> TOMLDocument:
    """The document with `key` of a table set: where it stands, else behind the table's last key."""
    at_root = place is document
    becomes_table = at_root and (isinstance(value, Mapping) or _tables(value))
    item = item_of(value, inside=not becomes_table)
    if key in place:
        there = place[key]
        if isinstance(there, Table | AoT) != becomes_table or isinstance(there, Table) != isinstance(item, Table):
            raise KeyError(path)
        if becomes_table and isinstance(there, Table):
            _fill(there, item)
        else:
            place[key] = item
        return document
    if becomes_table:
        return _behind_all(document, tomlkit.dumps({key: item}))
    within = path.split(".")[0]
    if _tables(value) and isinstance(place, Table) and place is document.get(within):
        tables = tomlkit.dumps({key: item_of(value)})
        return _behind_all(document, re.sub(r"(?m)^\[\[", f"[[{within}.", tables))
    if at_root:
        return tomlkit.parse(_put_at_root(document, key, item))
    if isinstance(place, Table):
        _append(place.value, key, item)
    else:
        place.append(key, item)
    return document


def _behind_all(document: TOMLDocument, tables: str) -> TOMLDocument:
    """The document with tables at its end."""
    return tomlkit.parse(tomlkit.dumps(document).rstrip("\n") + "\n\n" + tables.rstrip("\n") + "\n")


def _tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(each, Mapping) for each in value)


def _fill(table: Table, new: Any) -> None:
    """Make a table's contents those of another, keeping the comments of the keys that stay."""
    for key in [key for key in table if key not in new]:
        del table[key]
    for key, each in new.items():
        if key in table:
            if table[key] != each:
                table[key] = each
        else:
            _append(table.value, key, each)


def _append(container: Container, key: str, item: Item) -> None:
    """Put a key behind the last one, before the blank lines and comments that lead over to the next table."""
    body = container.body
    behind = []
    while body and body[-1][0] is None:
        behind.append(body.pop())
    container.append(key, item)
    body.extend(reversed(behind))


def _put_at_root(document: tomlkit.TOMLDocument, key: str, item: Item) -> str:
    body = document.body
    last = -1
    for number, (each, value) in enumerate(body):
        if isinstance(value, Table | AoT):
            break
        if each is not None:
            last = number
    head = Container(True)
    head.body.extend(body[: last + 1])
    before = head.as_string()
    line = f"{key} = {item.as_string()}\n"
    return before + line + tomlkit.dumps(document)[len(before) :]
