"""Modules of WebAssembly with a bank in their memory, where a library has it behind its end.

    whole = with_own_bank(Path("jawari.wasm").read_bytes(), bank(presets))

It becomes a data segment on pages of its own behind the module's memory; c/bank_alone.c has the place where that is told.
"""

from __future__ import annotations

from collections.abc import Iterator

_MAGIC = b"\0asm\1\0\0\0"
_MARK = b"jawari-own-bank\0"
_MEMORY, _DATA, _DATA_COUNT = 5, 11, 12
_PAGE = 65536


def with_own_bank(module: bytes, bank: bytes) -> bytes:
    """The module's bytes with a bank. Raises ValueError where there is no place for one in it."""
    at = module.find(_MARK)
    if module[:8] != _MAGIC or at < 0 or any(module[at + 16 : at + 24]):
        raise ValueError("the module has no place for a bank, or has one already; build it again")
    sections = list(_sections(module))
    pages = next(_memory(body)[1] for kind, body in sections if kind == _MEMORY)
    address = pages * _PAGE
    told = _MARK + address.to_bytes(4, "little") + len(bank).to_bytes(4, "little")
    made = bytearray(_MAGIC)
    for kind, body in sections:
        if kind == _MEMORY:
            flags, least, rest = _memory(body)
            body = b"\1" + bytes([flags]) + _unsigned(least - (-len(bank) // _PAGE)) + rest
        elif kind == _DATA_COUNT:
            body = _unsigned(_number(body, 0)[0] + 1)
        elif kind == _DATA:
            count, behind = _number(body, 0)
            segment = b"\0\x41" + _signed(address) + b"\x0b" + _unsigned(len(bank)) + bank
            begun = body[behind:].replace(_MARK + bytes(8), told)
            if begun.count(told) != 1:
                raise ValueError("the module's place for a bank is not whole; build it again")
            body = _unsigned(count + 1) + begun + segment
        made += bytes([kind]) + _unsigned(len(body)) + body
    return bytes(made)


def _memory(body: bytes) -> tuple[int, int, bytes]:
    """Of the one memory: flags, pages that it begins with, what follows. Raises ValueError where it cannot grow."""
    flags = body[1]
    if flags != 0:
        raise ValueError("the module's memory has a largest size; build it without")
    least, behind = _number(body, 2)
    return flags, least, body[behind:]


def _sections(module: bytes) -> Iterator[tuple[int, bytes]]:
    at = len(_MAGIC)
    while at < len(module):
        size, begin = _number(module, at + 1)
        yield module[at], module[begin : begin + size]
        at = begin + size


def _number(data: bytes, at: int) -> tuple[int, int]:
    """An unsigned number, and where it ends."""
    value = shift = 0
    while True:
        value |= (data[at] & 127) << shift
        shift += 7
        at += 1
        if data[at - 1] < 128:
            return value, at


def _unsigned(value: int) -> bytes:
    made = bytearray()
    while value >= 128:
        made.append(value & 127 | 128)
        value >>= 7
    made.append(value)
    return bytes(made)


def _signed(value: int) -> bytes:
    """A number from 0 on, as one that has a sign, of 32 bits."""
    made = bytearray()
    value -= (value & 1 << 31) << 1
    while not -64 <= value < 64:
        made.append(value & 127 | 128)
        value >>= 7
    made.append(value & 127)
    return bytes(made)
