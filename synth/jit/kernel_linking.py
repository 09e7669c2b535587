"""Large kernels are called where they lie, not copied into every kernel that calls them.

Numba links the code of each @njit kernel into all its callers, and LLVM optimises and translates it there once more, with
all that it calls in turn. What is small is inlined that way; what is large is not, and the copies are for nothing: half of
the time that compiling takes. So a kernel that is kept on disk (`kernel_cache`) and too large to be inlined is only named
in its callers, and found under its name when they are loaded: Numba compiles everything into one engine of LLVM's, where
every name is known. A caller that is loaded from disk needs those that it names loaded before: they are kept beside it.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any, NamedTuple

#: a kernel of so many instructions, optimised, is called and not copied; LLVM inlines some fifty, or more where constants
#: among the arguments take most of them away
LARGE = 300


class Called(NamedTuple):
    """A kernel that lies apart from those that call it: whose it is, for which arguments, and its name among symbols."""

    function: tuple[str, str, int]
    signature: Any
    symbol: str


class LinkedLibrary(NamedTuple):
    """What a library of compiled code, one kernel's, is to others: itself, if it is large; and which it calls."""

    itself: Called | None
    calls: tuple[Called, ...]


#: libraries of kernels that lie apart, by symbol
_APART: weakref.WeakValueDictionary[str, Any] = weakref.WeakValueDictionary()


def name_of(function: Any) -> tuple[str, str, int]:
    """What a kernel is known by in every process."""
    return function.__module__, function.__qualname__, function.__code__.co_firstlineno


def keep_apart(compiled: Any, function: Any, signature: Any) -> None:
    """Have what was compiled just now be called by others, if it is large."""
    library, symbol = compiled.library, compiled.fndesc.llvm_func_name
    large = _is_large(library._final_module.get_function(symbol))
    set_part(library, LinkedLibrary(Called(name_of(function), signature, symbol) if large else None, part_of(library).calls))


def part_of(library: Any) -> LinkedLibrary:
    return getattr(library, "_jawari_part", None) or LinkedLibrary(None, ())


def set_part(library: Any, part: LinkedLibrary) -> None:
    library._jawari_part = part
    if part.itself is not None:
        _APART[part.itself.symbol] = library


def library_of(symbol: str) -> Any:
    """The library of a kernel that lies apart and was compiled or loaded in this process. Raises KeyError."""
    return _APART[symbol]


def _is_large(function: Any) -> bool:
    count = 0
    for block in function.blocks:
        for _ in block.instructions:
            count += 1
            if count >= LARGE:
                return True
    return False


def is_there(compiled_for: Any, called: Called) -> bool:
    """Whether the engine of a target context knows a kernel."""
    return bool(compiled_for.codegen()._engine.is_symbol_defined(called.symbol))


def mend(library_class: Any, dispatcher_class: Any, is_ours: Callable[[Any], bool]) -> None:
    """Let libraries leave out what is called, and kernels of ours the wrapper for C, which nobody calls."""
    finalize, initialise = library_class.finalize, dispatcher_class.__init__

    def without_wrapper(self: Any, *arguments: Any, **options: Any) -> None:
        initialise(self, *arguments, **options)
        if is_ours(self.py_func):
            self.targetoptions.setdefault("no_cfunc_wrapper", True)

    def finalize_without_copies(self: Any) -> None:
        linked, calls = [], {}
        for library in self._linking_libraries:
            part = part_of(library)
            if part.itself is not None:
                calls[part.itself.symbol] = part.itself
            else:
                linked.append(library)
                calls |= {each.symbol: each for each in part.calls}
        self._linking_libraries = linked
        set_part(self, LinkedLibrary(None, tuple(calls.values())))
        finalize(self)

    library_class.finalize = finalize_without_copies
    dispatcher_class.__init__ = without_wrapper
