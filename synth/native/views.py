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
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, models, register_model
from numba.np.arrayobj import make_array, populate_array

from synth.engine.layout import FIELDS, Bank, Scratch, Settings, Shared, State

_I64 = ir.IntType(64)
#: what stands in the table of a core, in this order
CORE_PARTS: tuple[Any, ...] = (Bank, State, Shared, Settings)


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


class Opened(types.Type):
    """One of the NamedTuples in a table, `skip` words from its start: an address whose attributes are its fields."""

    def __init__(self, kind: Any, skip: int) -> None:
        self.kind = kind
        self.skip = skip
        super().__init__(name=f"Opened({kind.__name__})")

    def member(self, name: str) -> Any:
        """Numba type of a field, None where there is none."""
        if name not in FIELDS[self.kind]:
            return None
        dtype, dimensions = FIELDS[self.kind][name]
        return types.Array(from_dtype(dtype), dimensions, "C") if dimensions else from_dtype(dtype)

    def place(self, name: str) -> int:
        """The first word of a field."""
        names = list(FIELDS[self.kind])
        return self.skip + sum(1 + FIELDS[self.kind][before][1] for before in names[: names.index(name)])


@register_model(Opened)
class _OpenedModel(models.PrimitiveModel):
    def __init__(self, manager: Any, opened: Opened) -> None:
        super().__init__(manager, opened, _I64)


@infer_getattr
class _Fields(AttributeTemplate):
    key = Opened

    def generic_resolve(self, value, attr):  # type: ignore[override]
        return value.member(attr)


@lower_getattr_generic(Opened)
def _field(context: Any, builder: Any, opened: Opened, address: Any, name: str) -> Any:
    start = builder.inttoptr(address, _I64.as_pointer())
    member = opened.member(name)
    place = opened.place(name)

    def word(offset: int) -> Any:
        value = builder.load(builder.gep(start, [_I64(place + offset)]))
        # tables do not change: stores to arrays need not make the compiler look again
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value

    if not isinstance(member, types.Array):
        return builder.bitcast(word(0), context.get_value_type(member))
    array = make_array(member)(context, builder)
    shape = [word(1 + axis) for axis in range(member.ndim)]
    size = _I64(context.get_abi_sizeof(context.get_data_type(member.dtype)))
    strides = [size]
    for extent in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], extent))
    data = builder.inttoptr(word(0), array.data.type)
    populate_array(array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
    return array._getvalue()


def opener(kind: Any, skip: int = 0) -> Any:
    """The function that opens the table of a NamedTuple in FIELDS, `skip` words from where the address points to."""
    opened = Opened(kind, skip)

    def open_table(typingctx, address):
        return opened(types.int64), lambda context, builder, signature, arguments: arguments[0]

    return intrinsic(open_table)


bank_of, state_of, shared_of, settings_of = (
    opener(kind, sum(map(_words, CORE_PARTS[:before]))) for before, kind in enumerate(CORE_PARTS)
)
scratch_of = opener(Scratch)


def _call_back(typingctx, function, core, desk, s, more):
    """Call the compiled function at an address with four int64. Who calls it is spared compiling it once more."""

    def generate(context, builder, signature, arguments):
        kind = ir.FunctionType(ir.VoidType(), [_I64] * 4)
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])
        return context.get_dummy_value()

    return types.void(*[types.int64] * 5), generate


call_back: Any = intrinsic(_call_back)
