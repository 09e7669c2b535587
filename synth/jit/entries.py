"""Kernels that are called from outside compiled code: by their address, or by Python.

Each is taken from the native library where there is one that fits (`prebuilt`), else Numba compiles it.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numba import cfunc, njit, types
from numba.extending import typeof_impl
from numba.np.numpy_support import as_dtype

from synth.jit import prebuilt
from synth.native import interpreted
from synth.native.debugging import INTERPRETED


class Entry(NamedTuple):
    """A compiled function of so many int64: its address, and how Python calls it."""

    address: int
    ctypes: Any


#: what `entry` has given, by address
_ENTERED: dict[int, Callable[..., Any]] = {}


@cache
def entry(function: Callable[..., Any], words: int, answers: bool = False) -> Any:
    """A plain function of so many int64, compiled to be called by its `.address`; answers: it gives an int64.

    Kept for as long as the process lives: whoever has the address may call it.
    """
    made: Any
    if INTERPRETED:
        made = Entry(interpreted.register(function), function)
    elif (address := prebuilt.found().address(function)) is not None:
        prototype = ctypes.CFUNCTYPE(ctypes.c_int64 if answers else None, *[ctypes.c_int64] * words)
        made = Entry(address, prototype(address))
    else:
        made = compiled(function, words, answers)
    _ENTERED[made.address] = function
    return made


def compiled(function: Callable[..., Any], words: int, answers: bool = False) -> Any:
    """The same, compiled by Numba."""
    kinds = ", ".join(["int64"] * words)
    return cfunc(f"{'int64' if answers else 'void'}({kinds})", cache=True)(function)


def entered(address: int) -> Callable[..., Any] | None:
    """The function that `entry` gave an address of, None: it gave none."""
    return _ENTERED.get(address)


class Kernel:
    """A kernel that Python calls with arguments of these types (Numba's; arrays C-contiguous), and compiled code too.

    Other arguments are Numba's to compile for.
    """

    def __init__(self, dispatcher: Any, arguments: tuple[Any, ...], answer: Any) -> None:
        self.dispatcher = dispatcher
        self.arguments = arguments
        self.answer = answer
        self.__doc__ = dispatcher.__doc__
        self.__module__ = self.py_func.__module__
        self.__wrapped__ = self.py_func

    def __reduce__(self) -> str:
        return self.py_func.__qualname__  # copied and pickled as functions are: by name

    @property
    def py_func(self) -> Any:
        return getattr(self.dispatcher, "py_func", self.dispatcher)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "dispatcher":
            raise AttributeError(name)
        return getattr(self.dispatcher, name)

    def __call__(self, *arguments: Any) -> Any:
        if INTERPRETED:
            return self.dispatcher(*map(interpreted.with_attributes, arguments))
        native = self._native
        if native is None or len(arguments) != len(self.arguments):
            return self.dispatcher(*arguments)
        given: list[Any] = []
        for value, kind, dtype, dimensions in zip(arguments, self.arguments, self._dtypes, self._dimensions, strict=True):
            if dimensions > 0:
                fits = isinstance(value, np.ndarray) and value.dtype == dtype and value.ndim == dimensions
                if not (fits and value.flags.carray):  # contiguous, aligned, and may be written
                    return self.dispatcher(*arguments)
                given += [value.ctypes.data, *value.shape]
            elif _is_of(kind, value):
                given.append(float(value) if kind == types.float64 else int(value))
            else:
                return self.dispatcher(*arguments)
        return native(*given)

    def ready(self) -> None:
        """Compile it, where it is not in the native library."""
        if self._native is None and hasattr(self.dispatcher, "compile"):
            self.dispatcher.compile(self.arguments)

    @cached_property
    def _native(self) -> Any:
        """The function of the native library, None without one."""
        address = prebuilt.found().address(self.py_func)
        if address is None:
            return None
        words: list[Any] = []
        for kind in self.arguments:
            words += [ctypes.c_int64] * (1 + kind.ndim) if isinstance(kind, types.Array) else [_word(kind)]
        return ctypes.CFUNCTYPE(None if self.answer is None else _word(self.answer), *words)(address)

    @cached_property
    def _dtypes(self) -> list[Any]:
        return [as_dtype(kind.dtype) if isinstance(kind, types.Array) else None for kind in self.arguments]

    @cached_property
    def _dimensions(self) -> list[int]:
        return [kind.ndim if isinstance(kind, types.Array) else 0 for kind in self.arguments]


def _is_of(kind: Any, value: Any) -> bool:
    """Whether a number is one of Numba's type; a whole one may stand for a double."""
    if kind == types.float64 and isinstance(value, (float, np.floating)):
        return True
    return isinstance(value, (int, np.integer)) and -(2**63) <= int(value) < 2**63


def _word(kind: Any) -> Any:
    return ctypes.c_double if kind == types.float64 else ctypes.c_int64


@typeof_impl.register(Kernel)
def _type_of_kernel(kernel: Kernel, _: Any) -> Any:
    return types.Dispatcher(kernel.dispatcher)


#: every kernel of Python's, for who puts them into the library
KERNELS: list[Kernel] = []


def kernel(*arguments: Any, answer: Any = None, **options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorates a function that Numba compiles (`options` as of njit) and Python calls; see `Kernel`."""

    def decorate(function: Callable[..., Any]) -> Any:
        made = Kernel(njit(cache=True, nogil=True, **options)(function), arguments, answer)
        KERNELS.append(made)
        return made

    return decorate
