"""Every array of the core behind one address.

A compiled function that took Bank, State and Scratch as arguments would hand some 500 words to each function it calls.
Instead it takes the address of a table of pointers and sizes and opens what it needs:

    bank, state = bank_of(core), state_of(core)

`core` is the table of everything that the threads of an engine share, `desk` that of one thread's own work arrays. Only
what is used is ever loaded. The tables own nothing: who makes one keeps it and the arrays alive, and in place.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from synth.engine.layout import FIELDS, Bank, Scratch, Settings, Shared, State

_I64 = ir.IntType(64)
#: what stands in the table of a core, in this order
CORE_PARTS: tuple[Any, ...] = (Bank, State, Shared, Settings)


def _types(kind: Any) -> list[Any]:
    """Numba types of the fields of one of the NamedTuples."""
    return [
        types.Array(from_dtype(dtype), dimensions, "C") if dimensions else from_dtype(dtype)
        for dtype, dimensions in (FIELDS[kind][name] for name in kind._fields)
    ]


def _words(kind: Any) -> int:
    return sum(1 + dimensions for _, dimensions in FIELDS[kind].values())


def table(*parts: Any) -> np.ndarray:
    """int64 table of Bank, State, … in this order: pointer and sizes of each array, value of each number.

    Raises TypeError for an array that is not as FIELDS says: it would be read as something else.
    """
    out: list[int] = []
    for part in parts:
        for name, value in part._asdict().items():
            dtype, dimensions = FIELDS[type(part)][name]
            if dimensions:
                fits = isinstance(value, np.ndarray) and value.dtype == dtype and value.ndim == dimensions
                if not (fits and value.flags.c_contiguous and value.flags.aligned):
                    raise TypeError(f"{type(part).__name__}.{name} must be a contiguous {dimensions}-d array of {dtype}")
                out += [value.ctypes.data, *value.shape]
            else:
                out.append(int(np.array(value, dtype).view(np.int64)))
    return np.array(out, np.int64)


def _opener(kind: Any, skip: int) -> Any:
    """The function that opens one NamedTuple in a table, `skip` words from its start."""
    members = _types(kind)
    opened = types.NamedTuple(members, kind)

    def generate(context, builder, signature, arguments):
        start = builder.inttoptr(arguments[0], _I64.as_pointer())
        place = skip

        def word():
            nonlocal place
            place += 1
            return builder.load(builder.gep(start, [_I64(place - 1)]))

        values = []
        for member in members:
            if not isinstance(member, types.Array):
                values.append(builder.bitcast(word(), context.get_value_type(member)))
                continue
            array = make_array(member)(context, builder)
            data = builder.inttoptr(word(), array.data.type)
            shape = [word() for _ in range(member.ndim)]
            size = _I64(context.get_abi_sizeof(context.get_data_type(member.dtype)))
            strides = [size]
            for extent in reversed(shape[1:]):
                strides.insert(0, builder.mul(strides[0], extent))
            populate_array(array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
            values.append(array._getvalue())
        return context.make_tuple(builder, opened, values)

    def open_table(typingctx, address):
        return opened(types.int64), generate

    return intrinsic(open_table)


bank_of, state_of, shared_of, settings_of = (
    _opener(kind, sum(map(_words, CORE_PARTS[:before]))) for before, kind in enumerate(CORE_PARTS)
)
scratch_of = _opener(Scratch, 0)
