"""What is being compiled, and how much is still to come.

Kernels are compiled when they are first called, each with those that it calls, and only once on a machine
(`kernel_cache`). How many there will be is read off the kernels themselves: whatever a kernel's code names is compiled with
it, unless it is kept already. Which kernels Python calls cannot be read off; the engine's stand in ENTRIES, and one that is
not there is counted from when it begins.
"""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

from synth.jit import prebuilt

#: what begins later than this after the end of what came before is another compilation [s]
REST_S = 2.0
#: work that takes more than half a minute, in bytes of Python's code with all that it calls: an engine is 5e5
LONG = 1e5
#: the kernels that Python calls, of an engine and of `simulate` by one of the laws; as module:function below `synth`
_STRING = (
    "solver.laws:step_coefficients",
    "solver.laws:contact_matrix",
    "solver.lanes:padded",
    "solver.responses:fill_rows",
    "solver.responses:fill_lags",
)
_PACKAGE = __name__.partition(".")[0]
#: the module whose presence says that an engine will run
ENGINE = "engine.layout"
ENTRIES = {
    ENGINE: (
        *_STRING,
        "dsp.decimator:split_taps",
        "engine.tasks:work_on",
        "engine.advance:make_steps",
        "engine.advance:make_steps_of_two",
        "engine.together:work_together",
        "engine.board_steps:make_steps_on_boards",
        "dsp.limiter_effect:_process",
        "dsp.limiter_effect:_silent",
        "engine.hands:respond",
        "engine.voices.policy:decide",
        "dsp.decimator:phase_space",
        "engine.team:_attend",
        "engine.process:process",
    ),
    "research.methods.nonsmooth_schemes": (
        *_STRING,
        "solver.energy:stored",
        "solver.energy:spring",
        "solver.study:write_output",
        "native.denormals:enable_ftz",
        "solver.study:advance_study",
        "native.denormals:restore",
    ),
    "research.coupled.coupled_run": (
        "solver.line_tables:fill_apart",
        "solver.line_tables:fill_looked_at",
        "solver.fingers:fill_grip",
        "solver.line_tables:fill_finger_end",
        "solver.coupling:gather_lines",
        "solver.coupled_ledger:weigh_now",
        "solver.coupled_advance:write_row",
        "solver.coupled_advance:advance_study",
    ),
}


class Progress(NamedTuple):
    """How far a compilation is.

    done, total: kernels.  share: of the work, 0 … 1 (large kernels count more).  seconds: since it began.  long: it takes
    minutes.
    """

    done: int
    total: int
    share: float
    seconds: float
    long: bool


_lock = threading.RLock()
#: the cache of each kernel that was imported, by its function
_caches: dict[Any, Any] = {}
#: what this process has compiled
_made: set[Any] = set()
#: what is to be compiled (with its weight), what is being, and what has been, since it began
_wanted: dict[Any, float] = {}
_active: list[Any] = []
_done: set[Any] = set()
_began: float | None = None
_ended = 0.0
_listeners: list[Callable[[], None]] = []


def is_ours(function: Any) -> bool:
    """Whether it is a function of this package."""
    return str(getattr(function, "__module__", "")).partition(".")[0] == _PACKAGE


def progress() -> Progress | None:
    """How far what is compiled now, or was last, is; None: nothing was compiled."""
    with _lock:
        if _began is None:
            return None
        _hear_of_others()
        whole = sum(_wanted.values())
        made = sum(weight for function, weight in _wanted.items() if function in _done)
        seconds = (time.monotonic() if _active else _ended) - _began
        return Progress(len(_done), len(_wanted), made / whole if whole else 0.0, seconds, whole > LONG)


def busy() -> bool:
    """Whether something is being compiled now, in any thread."""
    return bool(_active)


def finished() -> bool:
    """Whether nothing is being compiled, and nothing that is known of is still to come, for a little while."""
    with _lock:
        _hear_of_others()
        return not _active and len(_done) >= len(_wanted) and time.monotonic() - _ended >= REST_S


def _hear_of_others() -> None:
    """Count what other processes have compiled."""
    _done.update(function for function in _wanted if function not in _done and is_kept(function))


@contextmanager
def listening(listener: Callable[[], None]) -> Iterator[None]:
    """Have `listener` called, in whatever thread compiles, whenever a kernel begins and has ended."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


def _tell() -> None:
    for listener in list(_listeners):
        listener()


# --- told by the cache ---


def found(function: Any, cache: Any) -> None:
    """A kernel was imported."""
    _caches[function] = cache


def begins(function: Any) -> None:
    """A kernel is being compiled."""
    with _lock:
        _begin(function)
        _want(function)
        _active.append(function)
    _tell()


def _begin(function: Any) -> None:
    global _began
    if _began is None or finished():  # a new beginning
        _wanted.clear()
        _done.clear()
        _began = time.monotonic()
    if not _active:
        for entry in _expected(function):
            _want(entry)


@contextmanager
def expecting(functions: Sequence[Any]) -> Iterator[None]:
    """Kernels are compiled meanwhile, by other processes too."""
    global _ended
    with _lock:
        _begin(functions[0])
        for function in functions:
            _want(function)
        _active.append(expecting)
    _tell()
    try:
        yield
    finally:
        with _lock:
            _ended = time.monotonic()
            _active.remove(expecting)
        _tell()


def ends(function: Any) -> None:
    """…and has been."""
    global _ended
    with _lock:
        _ended = time.monotonic()
        if function in _active:
            _active.remove(function)
        # the same kernel may come again for other kinds of arguments
        if function not in _active:
            _done.add(function)
            _made.add(function)
    _tell()


def fails(function: Any) -> None:
    """…or cannot be."""
    with _lock:
        if function in _active:
            _active.remove(function)
            _wanted.pop(function, None)
    _tell()


def spares(function: Any) -> None:
    """It will not be compiled after all."""
    with _lock:
        _wanted.pop(function, None)
    _tell()


def _want(function: Any) -> None:
    if function in _wanted:
        return
    waiting = [function]
    while waiting:
        one = waiting.pop()
        if one not in _wanted:
            _wanted[one] = float(sum(len(code.co_code) for code in map(_code, _closure(one))))
            waiting += [each for each in called(one) if not is_kept(each)]


def _functions(names: Sequence[str]) -> list[Any]:
    """The functions behind entries, "module:name" each; None for one whose module has not been imported."""
    entries = []
    for name in names:
        module, _, wanted = name.partition(":")
        entries.append(getattr(sys.modules.get(f"{_PACKAGE}.{module}"), wanted, None))
    return [getattr(entry, "py_func", entry) for entry in entries]


def _expected(function: Any) -> list[Any]:
    """What will be compiled as well when this kernel is: the rest of its entries, those of the module that was imported."""
    for sign, names in ENTRIES.items():
        if f"{_PACKAGE}.{sign}" not in sys.modules:
            continue
        entries = [entry for entry in _functions(names) if entry is not None]
        if sign == ENGINE or any(function in _closure(entry) for entry in entries):
            return [entry for entry in entries if not is_kept(entry)]
    return []


def to_come(sign: str = ENGINE) -> tuple[int, int]:
    """How many of the kernels that Python calls are still to be compiled before such a thing runs, and how many there are.

    sign: one of ENTRIES, whose module has been imported.
    """
    functions = _functions(ENTRIES[sign])
    for function in functions:
        if function is not None and function not in _caches:  # one that is called by its address only
            from numba.core import ccallback

            users: Any = ccallback
            users.FunctionCache(function)
    return sum(function is None or not is_kept(function) for function in functions), len(functions)


def is_kept(function: Any) -> bool:
    """Whether it need not be compiled any more."""
    cache = _caches.get(function)
    if function in _made or prebuilt.found().address(function) is not None:
        return True
    return cache is not None and cache.holds_any()


# --- what calls what ---


def called(function: Any) -> set[Any]:
    """The functions of the kernels that a function names."""
    found: set[Any] = set()
    for value in _values(function):
        inner = getattr(value, "py_func", None)
        if inner is None:
            continue
        if getattr(value, "targetoptions", {}).get("inline") == "always":  # is no kernel of its own
            found |= called(inner)
        elif is_ours(inner):
            found.add(inner)
    return found


def calls_ours(function: Any) -> bool:
    """Whether a function is of this package, or names one that is, or one that does, on and on."""
    reached: set[Any] = set()
    waiting = [function]
    while waiting:
        one = waiting.pop()
        if is_ours(one):
            return True
        if isinstance(one, FunctionType) and one not in reached:
            reached.add(one)
            waiting += [inner for inner in (getattr(value, "py_func", None) for value in _values(one)) if inner is not None]
    return False


def _values(function: FunctionType) -> Iterator[Any]:
    """What a function's names stand for, outside it."""
    names = set(_names(function.__code__))
    for name in names:
        value = function.__globals__.get(name)
        yield value
        if isinstance(value, ModuleType):
            yield from map(vars(value).get, names)  # what a module makes up when it is asked may come with warnings
    for cell in function.__closure__ or ():
        try:
            yield cell.cell_contents
        except ValueError:  # not filled yet
            continue


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names(constant)


def _closure(function: Any) -> set[Any]:
    """A function and all kernels that it calls, on and on: LLVM works on each with these inside."""
    reached: set[Any] = set()
    waiting = [function]
    while waiting:
        one = waiting.pop()
        if one not in reached:
            reached.add(one)
            waiting += called(one)
    return reached


def _code(function: Any) -> CodeType:
    return function.__code__
