"""Many arrays behind one address.

A compiled function that took the engine's arrays as arguments would hand some 500 words to each function it calls.
Instead it takes the address of a table of pointers and sizes and opens what it needs:

    work_of = opener(Work)      # a NamedTuple as `arrays` declares them
    …
    work = work_of(address)     # in compiled code: work.q, work.steps

Only what is used is ever loaded. A record within a record stands in the table of that one: `work.string.q` is one load, as
`work.q`. The tables own nothing: who makes one keeps it and the arrays alive, and in place.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, models, register_model
from numba.np.arrayobj import make_array, populate_array

from synth.native import interpreted
from synth.native.arrays import fields, records, require_declared, values
from synth.native.interpreted import intrinsic

_I64 = ir.IntType(64)
_WHOLE = np.dtype(np.int64)


def words(kind: Any) -> int:
    """Words that a table of this kind takes: a number or an address for each field, and its extents."""
    return sum(1 + len(shape) for _, shape in fields(kind).values())


def table(*parts: Any) -> np.ndarray:
    """int64 table of NamedTuples in this order: pointer and sizes of each array, value of each number.

    Raises TypeError for an array that is not as declared: it would be read as something else.
    """
    out: list[int] = []
    for part in parts:
        kind: Any = type(part)
        for value, (name, (dtype, shape)) in zip(values(part), fields(kind).items(), strict=True):
            if shape:
                require_declared(kind, name, value)
                out.append(value.__array_interface__["data"][0])  # in a fourth of the time of `ctypes`
                out += value.shape
            elif type(value) is int and dtype == _WHOLE:
                out.append(value)
            else:
                out.append(int(np.array(value, dtype).view(np.int64)))
    return np.array(out, np.int64)


class Opened(types.Type):
    """One of the NamedTuples in a table, `skip` words from its start: an address whose attributes are its fields."""

    def __init__(self, kind: Any, skip: int) -> None:
        self.kind = kind
        self.skip = skip
        # types of one name are one type to Numba
        super().__init__(name=f"Opened({kind.__module__}.{kind.__qualname__}, {skip})")

    def member(self, name: str) -> Any:
        """Numba type of a field, None where there is none."""
        if name in records(self.kind):
            return Opened(records(self.kind)[name], self.place(name))
        if name not in fields(self.kind):
            return None
        dtype, shape = fields(self.kind)[name]
        return types.Array(from_dtype(dtype), len(shape), "C") if shape else from_dtype(dtype)

    def place(self, name: str) -> int:
        """The first word of a field."""
        at = self.skip
        for field, (_, shape) in fields(self.kind).items():
            if field == name or field.startswith(f"{name}."):
                return at
            at += 1 + len(shape)
        raise KeyError(name)


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
    if isinstance(member, Opened):
        return address
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
    """The function that opens the table of a NamedTuple, `skip` words from where the address points to."""
    opened = Opened(kind, skip)

    @intrinsic(plain=partial(interpreted.TableFields, opened))
    def open_table(typingctx, address):
        return opened(types.int64), lambda context, builder, signature, arguments: arguments[0]

    return open_table


def _calling(count: int) -> tuple[Any, Any]:
    """A call of what is compiled at an address with so many int64. Who calls it is spared compiling it once more."""

    def generate(context, builder, signature, arguments):
        kind = ir.FunctionType(ir.VoidType(), [_I64] * count)
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])
        return context.get_dummy_value()

    return types.void(*[types.int64] * (count + 1)), generate


@intrinsic(plain=interpreted.call)
def tell(typingctx, function, address):
    """Call the function at an address, compiled for one int64."""
    return _calling(1)


@intrinsic(plain=interpreted.call)
def call_back(typingctx, function, core, thread, s, more):
    """The same, compiled for four."""
    return _calling(4)


@intrinsic(plain=interpreted.call)
def ask(typingctx, function, core, thread, action, place, velocity):
    """The same, compiled for five."""
    return _calling(5)


def _asking(count: int) -> tuple[Any, Any]:
    """A call of what is compiled at an address with so many int64; the int64 that it gives."""

    def generate(context, builder, signature, arguments):
        kind = ir.FunctionType(_I64, [_I64] * count)
        return builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])

    return types.int64(*[types.int64] * (count + 1)), generate


@intrinsic(plain=interpreted.call)
def query(typingctx, function, address):
    """The answer of the function at an address, compiled for one int64."""
    return _asking(1)


@intrinsic(plain=interpreted.call)
def consult(typingctx, function, model, state, scratch):
    """The same, compiled for three."""
    return _asking(3)


def _plain_frames_at(address: int, frames: int, channels: int) -> np.ndarray:
    return interpreted.array_at(address, np.dtype(np.float64), (frames, channels))


@intrinsic(plain=_plain_frames_at)
def frames_at(typingctx, address, frames, channels):
    """The float64 at an address as an array (frames, channels), in compiled code."""
    kind = types.Array(types.float64, 2, "C")

    def generate(context, builder, signature, arguments):
        place, *shape = arguments
        array = make_array(kind)(context, builder)
        strides = [builder.mul(shape[1], _I64(8)), _I64(8)]
        data = builder.inttoptr(place, array.data.type)
        populate_array(array, data=data, shape=shape, strides=strides, itemsize=_I64(8), meminfo=None)
        return array._getvalue()

    return kind(types.int64, types.int64, types.int64), generate


def _plain_in_rows(array: np.ndarray, rows: int, columns: int) -> np.ndarray:
    return array.reshape(-1)[: rows * columns].reshape(rows, columns)


@intrinsic(plain=_plain_in_rows)
def in_rows(typingctx, array, rows, columns):
    """The first rows·columns elements of an array as (rows, columns): Numba's own `reshape` takes longer than what is done
    with a short row. Nothing holds on to the array."""
    kind = types.Array(array.dtype, 2, "C")

    def generate(context, builder, signature, arguments):
        made = make_array(kind)(context, builder)
        data = make_array(signature.args[0])(context, builder, arguments[0]).data
        size = _I64(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
        strides = [builder.mul(arguments[2], size), size]
        populate_array(made, data=data, shape=arguments[1:], strides=strides, itemsize=size, meminfo=None)
        return made._getvalue()

    return kind(array, types.int64, types.int64), generate


def _plain_address_of(array: np.ndarray) -> int:
    return int(array.ctypes.data)


@intrinsic(plain=_plain_address_of)
def address_of(typingctx, array):
    """Where an array's first element is."""

    def generate(context, builder, signature, arguments):
        return builder.ptrtoint(make_array(array)(context, builder, arguments[0]).data, _I64)

    return types.int64(array), generate
