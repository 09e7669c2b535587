"""What an audio callback needs of the system in compiled code: clocks that do not wait, and memory by its address."""

from __future__ import annotations

import ctypes
import sys
import time
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from synth.native import windows
from synth.native.interpreted import intrinsic

_I32, _I64 = ir.IntType(32), ir.IntType(64)
_MAC = sys.platform == "darwin"
#: the clock behind time.monotonic_ns, and the processor time of this thread
MONOTONIC, THREAD = (8, 16) if _MAC else (1, 3)


def _clock(number: int, plain: Callable[[], int]) -> Any:
    def clock(typingctx):
        def generate(context, builder, signature, arguments):
            if sys.platform == "win32":
                return windows.monotonic(builder) if number == MONOTONIC else windows.thread_time(builder)
            kind = ir.FunctionType(_I32, [_I32, _I64.as_pointer()])
            function = cgutils.get_or_insert_function(builder.module, kind, "clock_gettime")
            time = cgutils.alloca_once(builder, _I64, 2)
            builder.call(function, [_I32(number), time])
            seconds = builder.load(time)
            rest = builder.load(builder.gep(time, [_I64(1)]))
            return builder.add(builder.mul(seconds, _I64(1_000_000_000)), rest)

        return types.int64(), generate

    return intrinsic(plain)(clock)


def _pointer(typingctx, address):
    def generate(context, builder, signature, arguments):
        return builder.inttoptr(arguments[0], ir.IntType(8).as_pointer())

    return types.voidptr(types.int64), generate


def _nap(typingctx, nanoseconds):
    def generate(context, builder, signature, arguments):
        if sys.platform == "win32":
            windows.sleep(builder, arguments[0])
            return context.get_dummy_value()
        kind = ir.FunctionType(_I32, [_I64.as_pointer(), _I64.as_pointer()])
        function = cgutils.get_or_insert_function(builder.module, kind, "nanosleep")
        time = cgutils.alloca_once(builder, _I64, 2)
        builder.store(_I64(0), time)
        builder.store(arguments[0], builder.gep(time, [_I64(1)]))
        builder.call(function, [time, _I64(0).inttoptr(_I64.as_pointer())])
        return context.get_dummy_value()

    return types.void(types.int64), generate


#: time.monotonic_ns() in compiled code [ns]
monotonic_ns: Any = _clock(MONOTONIC, time.monotonic_ns)
#: processor time that this thread has used [ns]
thread_ns: Any = _clock(THREAD, time.thread_time_ns)
#: int64 address as a pointer for `numba.carray`
pointer: Any = intrinsic(ctypes.c_void_p)(_pointer)
#: sleep for so many ns, less than a second
nap: Any = intrinsic(lambda nanoseconds: time.sleep(1e-9 * nanoseconds))(_nap)
