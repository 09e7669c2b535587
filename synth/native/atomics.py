"""Words that threads share: atomic operations on int64 arrays, what waiting loops do, and tokens to sleep for.

All operations on words are sequentially consistent. `array` is a one-dimensional contiguous int64 array, `i` an index
inside it (it is not checked).
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from synth.native import windows
from synth.native.denormals import machine
from synth.native.interpreted import intrinsic

_I8, _I32, _I64 = ir.IntType(8), ir.IntType(32), ir.IntType(64)
_ORDER = "seq_cst"
#: of the plain functions
_LOCK = threading.Lock()


def _word(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    return builder.gep(array.data, [arguments[1]])


def _plain_load(array: Any, i: int) -> int:
    return int(array[i])


def _plain_store(array: Any, i: int, value: int) -> None:
    array[i] = value


def _plain_add(array: Any, i: int, value: int) -> int:
    with _LOCK:
        before = int(array[i])
        array[i] = before + value
    return before


def _plain_exchange_if(array: Any, i: int, expected: int, value: int) -> bool:
    with _LOCK:
        as_expected = int(array[i]) == expected
        if as_expected:
            array[i] = value
    return as_expected


def _plain_pause() -> None:
    time.sleep(0.0)


def _plain_receive(descriptor: int) -> bool:
    return len(os.read(descriptor, 8)) == 8


def _plain_send(descriptor: int) -> bool:
    return os.write(descriptor, (1).to_bytes(8, sys.byteorder)) == 8


def _load(typingctx, array, i):
    def generate(context, builder, signature, arguments):
        return builder.load_atomic(_word(context, builder, signature, arguments), _ORDER, 8)

    return types.int64(array, types.int64), generate


def _store(typingctx, array, i, value):
    def generate(context, builder, signature, arguments):
        builder.store_atomic(arguments[2], _word(context, builder, signature, arguments), _ORDER, 8)
        return context.get_dummy_value()

    return types.void(array, types.int64, types.int64), generate


def _add(typingctx, array, i, value):
    def generate(context, builder, signature, arguments):
        return builder.atomic_rmw("add", _word(context, builder, signature, arguments), arguments[2], _ORDER)

    return types.int64(array, types.int64, types.int64), generate


def _exchange_if(typingctx, array, i, expected, value):
    def generate(context, builder, signature, arguments):
        place = _word(context, builder, signature, arguments)
        return builder.extract_value(builder.cmpxchg(place, arguments[2], arguments[3], _ORDER, _ORDER), 1)

    return types.boolean(array, types.int64, types.int64, types.int64), generate


def _pause(typingctx):
    def generate(context, builder, signature, arguments):
        kind = machine()
        if kind == "x86":
            function = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(ir.VoidType(), []), "llvm.x86.sse2.pause"
            )
            builder.call(function, [])
        elif kind == "aarch64":
            function = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(ir.VoidType(), [_I32]), "llvm.aarch64.hint"
            )
            builder.call(function, [_I32(1)])
        return context.get_dummy_value()

    return types.void(), generate


def _yield(typingctx):
    def generate(context, builder, signature, arguments):
        if sys.platform == "win32":
            windows.give_way(builder)
            return context.get_dummy_value()
        function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_I32, []), "sched_yield")
        builder.call(function, [])
        return context.get_dummy_value()

    return types.void(), generate


def _transfer(name: str, plain: Callable[[int], bool]) -> Any:
    """read or write of eight bytes, the number 1, with the C library; True if they went through."""

    def transfer(typingctx, descriptor):
        def generate(context, builder, signature, arguments):
            token = cgutils.alloca_once_value(builder, _I64(1))
            pointer = builder.bitcast(token, _I8.as_pointer())
            if sys.platform == "win32":
                return windows.transfer(builder, name, builder.trunc(arguments[0], _I32), pointer)
            kind = ir.FunctionType(_I64, [_I32, _I8.as_pointer(), _I64])
            function = cgutils.get_or_insert_function(builder.module, kind, name)
            moved = builder.call(function, [builder.trunc(arguments[0], _I32), pointer, _I64(8)])
            return builder.icmp_signed("==", moved, _I64(8))

        return types.boolean(types.int64), generate

    return intrinsic(plain)(transfer)


#: the word
load: Any = intrinsic(_plain_load)(_load)
#: put a value into the word
store: Any = intrinsic(_plain_store)(_store)
#: add a value to the word; what it was before
add: Any = intrinsic(_plain_add)(_add)
#: put a value into the word if it still holds what is expected; whether it did
exchange_if: Any = intrinsic(_plain_exchange_if)(_exchange_if)
#: tell the processor that this is a waiting loop
pause: Any = intrinsic(_plain_pause)(_pause)
#: let another thread have this processor, if one waits for it
give_way: Any = intrinsic(_plain_pause)(_yield)
#: wait for a token from a descriptor of `tokens` / put one in; whether it went through
receive = _transfer("read", _plain_receive)
send = _transfer("write", _plain_send)


def tokens() -> tuple[int, int]:
    """Descriptors to receive tokens from and to send them to; they may be the same. For the caller to close."""
    if hasattr(os, "eventfd"):
        # whoever writes to a pipe is taken to sleep next, and the reader put on its processor, where it waits
        descriptor = os.eventfd(0, os.EFD_SEMAPHORE | os.EFD_CLOEXEC)
        return descriptor, descriptor
    return os.pipe()
