"""Arrays from their declaration: extents, element types, what is refused; and found again behind an address."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
import pytest
from numba import njit

from synth.engine import layout
from synth.native.arrays import (
    LINE,
    Pool,
    aligned,
    allocate,
    arrays_of,
    f8,
    fields,
    i8,
    record,
    struct,
    u1,
    values,
    whole_lines,
)  # fmt: skip
from synth.native.views import opener, table, words
from synth.solver.stringmodel import Scratch, StringState

POINT = np.dtype([("x", "f8"), ("n", "i8")], align=True)


class Work(NamedTuple):
    steps: int
    rate: float
    q: Annotated[np.ndarray, f8("modes")]
    pairs: Annotated[np.ndarray, i8("2*modes + 1, contacts")]
    flags: Annotated[np.ndarray, u1("3")]
    points: Annotated[np.ndarray, struct(POINT, "contacts")]


class Arrays(NamedTuple):
    q: Annotated[np.ndarray, f8("modes")]
    pairs: Annotated[np.ndarray, i8("2*contacts + 1, 3")]
    flags: Annotated[np.ndarray, u1("modes, 3")]
    points: Annotated[np.ndarray, struct(POINT, "contacts")]


class Pair(NamedTuple):
    """A record with two others in it, one of which has no numbers."""

    count: int
    work: Work
    arrays: Arrays
    last: Annotated[np.ndarray, i8("contacts")]


class Nest(NamedTuple):
    first: Annotated[np.ndarray, i8("contacts")]
    arrays: Arrays


SIZES = {"modes": 5, "contacts": 3}


def test_what_is_not_given_is_zeros_of_the_declared_shape() -> None:
    q = np.arange(5.0)
    work = allocate(Work, SIZES, steps=7, rate=0.5, q=q)
    assert work.q is q and (work.steps, work.rate) == (7, 0.5)
    assert [array.shape for array in work[3:]] == [(11, 3), (3,), (3,)]
    assert [array.dtype for array in work[3:]] == [np.int64, np.uint8, POINT]
    for array in work[3:]:
        assert array.ctypes.data % LINE == 0 and not array.view(np.uint8).any() and array.flags.c_contiguous


@pytest.mark.parametrize(
    ("given", "error", "says"),
    [
        ({"rate": 1.0}, TypeError, "Work.steps is a number, which must be given"),
        ({"steps": 1, "rate": 1.0, "speed": 1}, TypeError, "Work has no field speed"),
        (
            {"steps": 1, "rate": 1.0, "q": np.zeros(5, np.float32)},
            TypeError,
            "Work.q must be a contiguous 1-d array of float64",
        ),
        ({"steps": 1, "rate": 1.0, "q": np.zeros((5, 1))}, TypeError, "Work.q must be a contiguous 1-d array"),
        ({"steps": 1, "rate": 1.0, "q": np.zeros(10)[::2]}, TypeError, "Work.q must be a contiguous 1-d array"),
        ({"steps": 1, "rate": 1.0, "q": np.zeros(4)}, ValueError, r"Work.q must have the shape \(5,\), got \(4,\)"),
    ],
)
def test_what_is_not_as_declared_is_refused(given: dict, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        allocate(Work, SIZES, **given)


def test_a_size_that_is_not_named_is_refused() -> None:
    with pytest.raises(ValueError, match=r"Work.pairs needs the size 'contacts', which is not given"):
        allocate(Work, {"modes": 5}, steps=1, rate=1.0)


def test_a_record_has_every_field_by_name() -> None:
    assert np.array([record(POINT, n=3, x=0.5)], POINT)["n"] == 3
    for given in ({"x": 1.0}, {"x": 1.0, "n": 2, "y": 3}):
        with pytest.raises(TypeError, match="exactly x, n; wrong: "):
            record(POINT, **given)


def test_lines_are_whole() -> None:
    assert [whole_lines(n) for n in (0, 1, 8, 9)] == [0, 8, 8, 16]
    assert aligned(3, np.uint8).shape == (3,) and aligned((2, 0)).shape == (2, 0)


def test_the_engine_declares_every_array_with_its_extents() -> None:
    for kind in (*layout.CORE_PARTS[: layout.CORE_PARTS.index(layout.Settings)], StringState, Scratch):
        assert all(field.shape for field in fields(kind).values())
    assert fields(StringState)["grip.contacts"] == (np.dtype("f8"), ("contacts", "RESPONSE"))


def test_many_of_a_kind_lie_side_by_side_and_apart() -> None:
    sizes = [SIZES | {"modes": 5}, SIZES | {"modes": 0}, SIZES | {"modes": 11}]
    pool = Pool(Arrays, sizes)
    for number, (item, size) in enumerate(zip(pool.items, sizes, strict=True)):
        assert item.q.shape == (size["modes"],) and item.pairs.shape == (2 * SIZES["contacts"] + 1, 3)
        assert all(array.ctypes.data % LINE == 0 for array in item if array.dtype != POINT)
        for array in item:
            array[...] = np.full((), number + 1).astype(array.dtype)
    for number, item in enumerate(pool.items):
        assert all((array == np.full((), number + 1).astype(array.dtype)).all() for array in item)
    assert {name: array.dtype for name, array in pool.flat.items()} == {n: f.dtype for n, f in fields(Arrays).items()}
    again = pool.item(2, {name: array.copy() for name, array in pool.flat.items()})
    assert np.array_equal(again.q, pool.items[2].q) and not np.shares_memory(again.q, pool.items[2].q)


def test_every_field_is_found_behind_an_address() -> None:
    """Each at its own place: numbers, extents and elements that differ everywhere."""
    work = allocate(Work, SIZES, steps=7, rate=0.5)
    work.q[:] = np.arange(5.0)
    work.pairs[10, 2] = 42
    work.flags[1] = 9
    work.points["n"][2] = 77
    behind = opener(Work, words(Work))

    @njit
    def look(address):
        found = behind(address)
        return found.steps, found.rate, found.q[4], found.pairs.shape, found.pairs[10, 2], found.flags[1], found.points[2].n

    tables = table(allocate(Work, SIZES, steps=1, rate=2.0), work)
    assert tables.size == 2 * words(Work)
    assert look(tables.ctypes.data) == (7, 0.5, 4.0, (11, 3), 42, 9, 77)
    with pytest.raises(TypeError, match=r"Work\.q must be"):
        table(work._replace(q=np.zeros(5, np.float32)))


def test_a_record_may_hold_others() -> None:
    work = allocate(Work, SIZES, steps=7, rate=0.5)
    pair = allocate(Pair, SIZES, count=2, work=work)
    assert pair.work.pairs is work.pairs and pair.arrays.pairs.shape == (7, 3) and pair.last.shape == (3,)
    assert list(arrays_of(pair)) == [name for name, field in fields(Pair).items() if field.shape]
    assert arrays_of(pair)["arrays.flags"] is pair.arrays.flags and len(list(values(pair))) == len(fields(Pair))
    with pytest.raises(TypeError, match=r"Work\.steps is a number, which must be given"):
        allocate(Pair, SIZES, count=2)
    with pytest.raises(TypeError, match=r"Pair\.work\.q must be"):
        table(pair._replace(work=work._replace(q=np.zeros(5, np.float32))))


def test_records_within_a_record_are_found_behind_its_address() -> None:
    pair = allocate(Pair, SIZES, count=2, work=allocate(Work, SIZES, steps=7, rate=0.5))
    pair.work.points["n"][2], pair.arrays.pairs[6, 2], pair.last[1] = 77, 42, 5
    behind = opener(Pair, words(Work))

    @njit
    def inner(work):
        return work.steps, work.points[2].n

    @njit
    def look(address):
        pair = behind(address)
        return pair.count, inner(pair.work), pair.work.rate, pair.arrays.pairs.shape, pair.arrays.pairs[6, 2], pair.last[1]

    tables = table(allocate(Work, SIZES, steps=1, rate=2.0), pair)
    assert tables.size == words(Work) + words(Pair) == 2 * words(Work) + words(Arrays) + 3
    assert look(tables.ctypes.data) == (2, (7, 77), 0.5, (7, 3), 42, 5)


def test_many_records_that_hold_others_lie_side_by_side() -> None:
    sizes = [SIZES, SIZES | {"modes": 11}]
    pool = Pool(Nest, sizes)
    assert list(pool.flat) == list(fields(Nest)) and "arrays.q" in pool.flat
    pool.items[1].arrays.q[:] = 3.0
    assert [item.arrays.q.size for item in pool.items] == [5, 11] and not pool.items[0].arrays.q.any()
    assert np.count_nonzero(pool.flat["arrays.q"] == 3.0) == 11
