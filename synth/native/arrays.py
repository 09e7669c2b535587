"""Arrays that compiled code works on, declared once: name, element type, symbolic shape.

    class Work(NamedTuple):
        steps: int
        q: Annotated[np.ndarray, f8("modes")]
        lags: Annotated[np.ndarray, f8("2*contacts, 16")]

    work = allocate(Work, {"modes": 64, "contacts": 3}, steps=8)

An extent is a sum of products of numbers and named sizes. By the declaration memory is made here, `views` finds each array
behind an address, and what is not as it says is refused. A field may be such a NamedTuple itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any, Generic, NamedTuple, TypeVar, get_type_hints

import numpy as np

#: arrays begin on a cache line of so many bytes, where vectors are loaded fastest; so many f8
LINE = 64
LINE_F8 = 8

Kind = TypeVar("Kind", bound=tuple)


class Field(NamedTuple):
    """Element type and the symbolic extent of each dimension; a number has none."""

    dtype: np.dtype
    shape: tuple[str, ...]


def struct(dtype: np.dtype, shape: str) -> Field:
    """Records, as many as `shape` says."""
    return Field(dtype, tuple(extent.strip() for extent in shape.split(",")))


def f8(shape: str) -> Field:
    """float64."""
    return struct(np.dtype(np.float64), shape)


def f4(shape: str) -> Field:
    """float32."""
    return struct(np.dtype(np.float32), shape)


def i8(shape: str) -> Field:
    """int64."""
    return struct(np.dtype(np.int64), shape)


def u1(shape: str) -> Field:
    """uint8."""
    return struct(np.dtype(np.uint8), shape)


@cache
def records(kind: Any) -> dict[str, Any]:
    """Fields of a NamedTuple that are NamedTuples themselves."""
    return {name: hint for name, hint in get_type_hints(kind).items() if hasattr(hint, "_fields")}


@cache
def fields(kind: Any) -> dict[str, Field]:
    """Arrays and numbers of a NamedTuple, in their order; those of a record in it by its name and theirs: `contacts.eta`."""
    out: dict[str, Field] = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if name in records(kind):
            out |= {f"{name}.{inner}": field for inner, field in fields(hint).items()}
        else:
            declared = getattr(hint, "__metadata__", None)
            out[name] = declared[0] if declared else Field(np.dtype(hint), ())
    return out


def values(part: Any) -> Iterator[Any]:
    """What `fields` of a NamedTuple are, in their order."""
    for each in part:
        if isinstance(each, tuple):
            yield from values(each)
        else:
            yield each


def arrays_of(part: Any) -> dict[str, np.ndarray]:
    """The arrays of a NamedTuple by the names of `fields`."""
    kind: Any = type(part)
    named = zip(fields(kind), values(part), strict=True)
    return {name: value for name, value in named if isinstance(value, np.ndarray)}


def allocate(kind: type[Kind], sizes: Mapping[str, int], **given: Any) -> Kind:
    """A `kind` of zeros with the extents that `sizes` names, but for what is given.

    Numbers have to be given, and records that hold some; a record is taken as it is. Raises TypeError for a field that is
    missing, unknown or of another element type, ValueError for an array whose shape is not the declared one and for an
    extent that `sizes` does not name.
    """
    known, inner = fields(kind), records(kind)
    if unknown := sorted(given.keys() - known.keys() - inner.keys()):
        raise TypeError(f"{kind.__name__} has no field {unknown[0]}")
    for name in inner.keys() - given.keys():
        given[name] = allocate(inner[name], sizes)
    for name, field in known.items():
        if "." in name:
            continue
        if name not in given:
            if not field.shape:
                raise TypeError(f"{kind.__name__}.{name} is a number, which must be given")
            given[name] = aligned(_extents(kind, name, sizes), field.dtype)
        elif field.shape:
            require_declared(kind, name, given[name])
            if given[name].shape != (extents := _extents(kind, name, sizes)):
                raise ValueError(f"{kind.__name__}.{name} must have the shape {extents}, got {given[name].shape}")
    return kind(**given)


def require_declared(kind: Any, name: str, value: Any) -> None:
    """Raises TypeError unless `value` is a contiguous array of the declared element type and number of dimensions."""
    dtype, shape = fields(kind)[name]
    fits = isinstance(value, np.ndarray) and value.dtype == dtype and value.ndim == len(shape)
    if not (fits and (flags := value.flags).c_contiguous and flags.aligned):
        raise TypeError(f"{kind.__name__}.{name} must be a contiguous {len(shape)}-d array of {dtype}")


def record(dtype: np.dtype, **values: Any) -> tuple[Any, ...]:
    """One element of an array of records. Raises TypeError unless every field has a value."""
    names = dtype.names or ()
    if values.keys() != set(names):
        raise TypeError(f"a record needs exactly {', '.join(names)}; wrong: {', '.join(sorted(values.keys() ^ set(names)))}")
    return tuple(values[name] for name in names)


def aligned(shape: int | tuple[int, ...], dtype: Any = np.float64) -> np.ndarray:
    """Zeros that begin on a cache line."""
    kind = np.dtype(dtype)
    size = math.prod(shape if isinstance(shape, tuple) else (shape,)) * kind.itemsize
    memory = np.zeros(size + LINE, np.uint8)
    start = -memory.__array_interface__["data"][0] % LINE
    return memory[start : start + size].view(kind).reshape(shape)


def bytes_of(array: np.ndarray) -> np.ndarray:
    """The memory of a contiguous array: records are copied by it in a tenth of the time that their fields take."""
    return array.reshape(-1).view(np.uint8)


def whole_lines(count: int) -> int:
    """The next multiple of a cache line's numbers."""
    return -(-count // LINE_F8) * LINE_F8


def _extents(kind: Any, name: str, sizes: Mapping[str, int]) -> tuple[int, ...]:
    try:
        return tuple(_extent(symbols, sizes) for symbols in fields(kind)[name].shape)
    except KeyError as missing:
        raise ValueError(f"{kind.__name__}.{name} needs the size {missing}, which is not given") from None


def _extent(symbols: str, sizes: Mapping[str, int]) -> int:
    total = 0
    for number, names in _products(symbols):
        for name in names:
            number *= sizes[name]
        total += number
    return total


@cache
def _products(symbols: str) -> tuple[tuple[int, tuple[str, ...]], ...]:
    """What an extent is the sum of: of each product its numbers, multiplied, and its names."""
    products = ([factor.strip() for factor in product.split("*")] for product in symbols.split("+"))
    return tuple(
        (math.prod(int(each) for each in factors if each.isdigit()), tuple(each for each in factors if not each.isdigit()))
        for factors in products
    )


def _assembled(kind: type[Kind], pieces: Iterator[Any]) -> Kind:
    """A NamedTuple of what `fields` are."""
    inner = records(kind)
    return kind(*(_assembled(inner[name], pieces) if name in inner else next(pieces) for name in get_type_hints(kind)))


class Pool(Generic[Kind]):
    """Many of a kind, each of sizes of its own: of every field one array, on which those of the items lie side by side.

    items   the many, in their order
    flat    the arrays of the fields, by name; between items there may be room, so that each begins on a cache line
    """

    def __init__(self, kind: type[Kind], sizes: Sequence[Mapping[str, int]]) -> None:
        self._kind = kind
        self.flat: dict[str, np.ndarray] = {}
        #: of each field where the part of each item begins, and its extents
        self._places: dict[str, list[tuple[int, tuple[int, ...]]]] = {}
        for name, (dtype, _) in fields(kind).items():
            step = LINE // math.gcd(LINE, dtype.itemsize)
            places, at = [], 0
            for each in sizes:
                extents = _extents(kind, name, each)
                places.append((at, extents))
                at += -(-math.prod(extents) // step) * step
            self.flat[name], self._places[name] = aligned(at, dtype), places
        self.items: list[Kind] = [self.item(i, self.flat) for i in range(len(sizes))]

    def item(self, i: int, flat: Mapping[str, np.ndarray]) -> Kind:
        """Item i on arrays like those of `flat`."""
        pieces = {}
        for name, places in self._places.items():
            at, extents = places[i]
            pieces[name] = flat[name][at : at + math.prod(extents)].reshape(extents)
        return _assembled(self._kind, iter(pieces.values()))
