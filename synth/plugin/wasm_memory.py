"""Kernels for 32-bit addresses, from those whose memory is laid out for 64 bits.

The optimiser has counted with eight bytes for an address before it is known that wasm32's take four. An address that lies
in memory by itself may keep its eight bytes: what is stored and loaded is their lower half. Numba's arrays, records of
addresses and extents, are taken apart into words at the places where the optimiser has put them.
"""

from __future__ import annotations

import re

_ARRAY = r"\{ ptr, ptr, i64, i64, ptr, \[(\d) x i64\], \[\d x i64\] \}"
_LOADED = re.compile(rf"^  (%\S+) = load {_ARRAY}, ptr (\S+), align 8[^\n]*$", re.MULTILINE)
_PLACE = re.compile(rf"getelementptr inbounds {_ARRAY}, ptr (\S+), i32 0, i32 (\d)")
_LEFT = re.compile(
    r"(?:alloca|getelementptr)[a-z ]* (?:\{[^}]*ptr[^}]*\}|\[\d+ x ptr\])|(?:load|store)[a-z ]* \{[^}]*ptr[^}]*\}"
)


def with_words(text: str) -> str:
    """A module's text with arrays in memory as words of eight bytes. Raises ValueError for another record of addresses."""
    text = re.sub(rf"alloca {_ARRAY}", lambda found: f"alloca {_words(found[1])}", text)
    text = re.sub(rf"store {_ARRAY} zeroinitializer", lambda found: f"store {_words(found[1])} zeroinitializer", text)
    text = _PLACE.sub(
        lambda found: f"getelementptr inbounds i8, ptr {found[2]}, i32 {_offset(int(found[3]), int(found[1]))}", text
    )
    text = _LOADED.sub(_part_by_part, text)
    if left := _LEFT.search(text):
        raise ValueError(f"the kernels keep a record of addresses in memory, {left[0]}, which is not supported in wasm32")
    return text


def _words(axes: str) -> str:
    """The type of an array's record as words."""
    return f"[{5 + 2 * int(axes)} x i64]"


def _offset(field: int, axes: int) -> int:
    """Where a field of an array's record lies [bytes]."""
    return 8 * field if field < 6 else 40 + 8 * axes


def _part_by_part(found: re.Match[str]) -> str:
    """The load of an array's record as loads of its fields."""
    result, axes, place = found[1], int(found[2]), found[3]
    extents = f"[{axes} x i64]"
    kinds = ["ptr", "ptr", "i64", "i64", "ptr", extents, extents]
    record = f"{{ {', '.join(kinds)} }}"
    stem = result[1:].strip('"')
    lines, before = [], "undef"
    for field, kind in enumerate(kinds):
        at, loaded = f'%"{stem}.at{field}"', f'%"{stem}.field{field}"'
        after = result if field == len(kinds) - 1 else f'%"{stem}.with{field}"'
        lines += [
            f"  {at} = getelementptr i8, ptr {place}, i32 {_offset(field, axes)}",
            f"  {loaded} = load {kind}, ptr {at}, align 8",
            f"  {after} = insertvalue {record} {before}, {kind} {loaded}, {field}",
        ]
        before = after
    return "\n".join(lines)
