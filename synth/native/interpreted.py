"""Kernels as the Python that they are written in: with JAWARI_DEBUG=1 nothing is compiled, and a debugger stops anywhere.

What kernels are written in besides Python (vector code, arrays behind addresses, calls of addresses, words shared by
threads) has a plain function here or beside it, which takes its place: `intrinsic(plain=…)`. A run takes some thousand times
as long, and differs from a compiled one by rounding, since sums are formed in another order and nothing is fused.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numba.extending import intrinsic as _intrinsic

from synth.native.arrays import fields, records
from synth.native.debugging import INTERPRETED

#: what `register` has numbered
_FUNCTIONS: dict[int, Callable[..., Any]] = {}
if INTERPRETED:
    np.seterr(over="ignore")  # products of 64-bit words wrap around, as in compiled code


def require_compiled(what: str) -> None:
    """Raise ValueError where kernels are interpreted and `what` needs them compiled."""
    if INTERPRETED:
        raise ValueError(f"{what} needs compiled kernels, and JAWARI_DEBUG interprets them: unset JAWARI_DEBUG")


def intrinsic(plain: Callable[..., Any]) -> Any:
    """Decorate what writes a function in LLVM's language; interpreted, `plain` takes its place, which does the same."""

    def decorate(function: Callable[..., Any]) -> Any:
        if INTERPRETED:
            return plain
        made: Any = _intrinsic(function)
        made.__doc__ = function.__doc__
        return made

    return decorate


def register(function: Callable[..., Any]) -> int:
    """A number that stands for the address of a function, as long as the process lives."""
    address = id(function)
    _FUNCTIONS[address] = function
    return address


def call(address: int, *words: int) -> Any:
    """The answer of the function of an address."""
    return _FUNCTIONS[int(address)](*words)


class Record(np.void):  # type: ignore[misc]
    """A record whose fields are attributes, those too that have the name of an attribute of NumPy's."""

    def __getattribute__(self, name: str) -> Any:
        names = super().__getattribute__("dtype").names
        return self[name] if name in names else super().__getattribute__(name)

    def __setattr__(self, name: str, value: Any) -> None:
        self[name] = value


def array_at(address: int, dtype: np.dtype, shape: tuple[int, ...]) -> np.ndarray:
    """The array that lies at an address, records with their fields as attributes. It is not kept alive."""
    size = int(np.prod(shape)) * dtype.itemsize
    if size == 0:
        return with_attributes(np.empty(shape, dtype))
    memory: Any = (ctypes.c_char * size).from_address(int(address))
    return with_attributes(np.frombuffer(memory, dtype).reshape(shape))


def with_attributes(value: Any) -> Any:
    """An array of records as one whose fields are attributes, as they are in compiled code; anything else as it is."""
    if isinstance(value, np.ndarray) and value.dtype.names is not None:
        return value.view(np.dtype((Record, value.dtype)))
    return value


class TableFields:
    """The fields of one NamedTuple in a table, which `views.Opened` describes."""

    def __init__(self, opened: Any, address: int) -> None:
        self._opened = opened
        self._address = int(address)

    def __getattr__(self, name: str) -> Any:
        if name in records(self._opened.kind):
            return TableFields(self._opened.member(name), self._address)
        if name not in (known := fields(self._opened.kind)):
            raise AttributeError(name)
        dtype, extents = known[name]
        at = self._address + 8 * self._opened.place(name)
        if not extents:
            return array_at(at, dtype, (1,))[0].item()
        address, *shape = array_at(at, np.dtype(np.int64), (1 + len(extents),)).tolist()
        return array_at(address, dtype, tuple(shape))
