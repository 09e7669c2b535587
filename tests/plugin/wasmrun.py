"""The engine as WebAssembly in wasmtime, as tests call it: its functions by name, bytes in and out of its memory."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

wasmtime = pytest.importorskip("wasmtime", reason="runs WebAssembly (pip install wasmtime)")

WHY = 512
#: an address comes as a signed number: one beyond half of them is negative
ADDRESSES = 2**32


_ENGINE = wasmtime.Engine()


@cache
def _compiled(data: bytes) -> Any:
    return wasmtime.Module(_ENGINE, data)


class Refused(Exception):
    """What the engine said."""


class Module:
    """An instance of a module, which imports nothing."""

    def __init__(self, data: bytes) -> None:
        module = _compiled(data)
        assert list(module.imports) == [], "the module asks something of its host"
        self.store = wasmtime.Store(_ENGINE)
        self.exports = wasmtime.Instance(self.store, module, []).exports(self.store)
        self.memory = self.exports["memory"]
        self.call("_initialize")
        self.why = self.room(WHY)

    def call(self, name: str, *given: Any) -> Any:
        """A function; raises wasmtime's Trap where the module ends itself."""
        return self.exports[name](self.store, *given)

    def told(self, name: str, *given: Any) -> int:
        """What a function gives that says why it gives nothing. Raises Refused."""
        got = self.call(name, *given, self.why)
        if got == 0:
            raise Refused(self.text(self.why))
        return got

    def room(self, size: int) -> int:
        """The address of new memory, on a border of 64."""
        at = self.call("jawari_alloc", size)
        assert at, f"no memory for {size} bytes"
        return at

    def put(self, data: bytes) -> int:
        """The address of a copy."""
        at = self.room(max(1, len(data)))
        self.write(at, data)
        return at

    def write(self, at: int, data: bytes) -> None:
        self.memory.write(self.store, data, at % ADDRESSES)

    def read(self, at: int, size: int) -> bytes:
        return bytes(self.memory.read(self.store, at % ADDRESSES, at % ADDRESSES + size))

    def text(self, at: int) -> str:
        """Up to its zero."""
        data = b""
        while b"\0" not in data:
            data += self.read(at + len(data), 64)
        return data[: data.index(0)].decode()

    def open_bank(self, bank: bytes) -> int:
        """Raises Refused."""
        return self.told("jawari_open_bytes", self.put(bank), len(bank))

    def engine(self, bank: int, rate_hz: float) -> int:
        """Raises Refused."""
        return self.told("jawari_create", bank, rate_hz, 1)


class Sides:
    """Memory of a module for events and for the sound of a block."""

    def __init__(self, module: Module, frames: int, events: int) -> None:
        self._module = module
        self._left, self._right = module.room(8 * max(1, frames)), module.room(8 * max(1, frames))
        self._events = module.room(32 * max(1, events))

    def process(self, engine: int, events: np.ndarray, frames: int) -> np.ndarray:
        """(frames, 2), the next block with EVENT events."""
        self._module.write(self._events, events.tobytes())
        self._module.call("jawari_process", engine, self._events, len(events), frames, self._left, self._right)
        sides = [np.frombuffer(self._module.read(at, 8 * frames)) for at in (self._left, self._right)]
        return np.stack(sides, axis=1)
