"""What compiled code calls of Windows in the place of POSIX functions: clocks, sleep, and bytes through a pipe.

    define()                       # once, before such code runs
    nanoseconds = counter(builder) # LLVM's code for it, at this place

Times are those behind Python's own clocks, so that both can be compared. None of this has been run on Windows: the code that
is emitted is tested with functions of the same types in the place of the system's.
"""

from __future__ import annotations

import ctypes
import sys
from typing import Any

import llvmlite.binding
from llvmlite import ir
from numba.core import cgutils

_I8, _I32, _I64 = ir.IntType(8), ir.IntType(32), ir.IntType(64)
#: what each is called here: the library that has it, and its name there. The C library is that of Python's descriptors
FUNCTIONS = {
    "jawari_yield": ("kernel32", "SwitchToThread"),
    "jawari_sleep": ("kernel32", "Sleep"),
    "jawari_counter": ("kernel32", "QueryPerformanceCounter"),
    "jawari_frequency": ("kernel32", "QueryPerformanceFrequency"),
    "jawari_ticks": ("kernel32", "GetTickCount64"),
    "jawari_thread_times": ("kernel32", "GetThreadTimes"),
    "jawari_read": ("ucrtbase", "_read"),
    "jawari_write": ("ucrtbase", "_write"),
}
#: GetCurrentThread() is always this
_THIS_THREAD = -2
#: whether time.monotonic counts with the performance counter; before 3.13, it has ticks of some 15 ms
COUNTS = sys.version_info >= (3, 13)


def define() -> None:
    """Let compiled code find them. Raises OSError, AttributeError on other systems."""
    load: Any = ctypes.WinDLL  # type: ignore[attr-defined]
    for symbol, (library, name) in FUNCTIONS.items():
        address = ctypes.cast(getattr(load(library), name), ctypes.c_void_p).value
        llvmlite.binding.add_symbol(symbol, address)


def _call(builder: Any, name: str, answer: Any, kinds: list[Any], arguments: list[Any]) -> Any:
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(answer, kinds), name)
    return builder.call(function, arguments)


def give_way(builder: Any) -> None:
    """Let another thread have this processor."""
    _call(builder, "jawari_yield", _I32, [], [])


def sleep(builder: Any, nanoseconds: Any) -> None:
    """Sleep for so many ns (int64), rounded up to ms."""
    milliseconds = builder.sdiv(builder.add(nanoseconds, _I64(999_999)), _I64(1_000_000))
    _call(builder, "jawari_sleep", ir.VoidType(), [_I32], [builder.trunc(milliseconds, _I32)])


def monotonic(builder: Any) -> Any:
    """time.monotonic_ns()."""
    if not COUNTS:
        return builder.mul(_call(builder, "jawari_ticks", _I64, [], []), _I64(1_000_000))
    values = []
    for name in ("jawari_counter", "jawari_frequency"):
        place = cgutils.alloca_once(builder, _I64)
        _call(builder, name, _I32, [_I64.as_pointer()], [place])
        values.append(builder.load(place))
    count, per_second = values
    whole = builder.mul(builder.sdiv(count, per_second), _I64(1_000_000_000))
    rest = builder.mul(builder.srem(count, per_second), _I64(1_000_000_000))
    return builder.add(whole, builder.sdiv(rest, per_second))


def thread_time(builder: Any) -> Any:
    """Processor time that this thread has used [ns]."""
    times = cgutils.alloca_once(builder, _I64, 4)  # made, ended, in the system, in the program; in units of 100 ns
    places = [builder.gep(times, [_I64(i)]) for i in range(4)]
    pointer = _I64.as_pointer()
    _call(builder, "jawari_thread_times", _I32, [_I64, *[pointer] * 4], [_I64(_THIS_THREAD), *places])
    used = builder.add(builder.load(places[2]), builder.load(places[3]))
    return builder.mul(used, _I64(100))


def transfer(builder: Any, name: str, descriptor: Any, place: Any) -> Any:
    """`name` (read or write) of eight bytes at `place`, with a descriptor (int32); whether they went through."""
    kinds = [_I32, _I8.as_pointer(), _I32]
    moved = _call(builder, f"jawari_{name}", _I32, kinds, [descriptor, place, _I32(8)])
    return builder.icmp_signed("==", moved, _I32(8))


if sys.platform == "win32":
    define()
