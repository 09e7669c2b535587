"""The limits of a state (`engine.state_limits`, and its effects' own) as the native library looks at them (c/core_check.c).

A limit becomes rows (LIMIT) of words that lie at equal distances from each other and have the same bounds; where it holds is
a run of CONDITION. Places are bytes from where a state begins in the core. NONE stands for no place.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from synth.dsp.delay_effect import DELAY
from synth.dsp.limiter import LOOKAHEAD, MOST_COUNTS, WINDOW
from synth.dsp.limiter_effect import LIMITER
from synth.engine import layout
from synth.engine.bank import default_parameters
from synth.engine.effect_chains import Placed
from synth.engine.engine import Engine
from synth.engine.state_limits import Limit, StateWords, limits_of
from synth.plugin.addresses import Memory

NONE = 0xFFFFFFFF
#: kinds of words
INTEGER, NUMBER, BYTE = range(3)
LIMIT = np.dtype(
    [
        ("low", "<i8"),  # of a NUMBER, the bits of a double
        ("high", "<i8"),
        ("at", "<u4"),
        ("stride", "<u4"),
        ("count", "<u4"),
        ("counted", "<u4"),  # a word that says how many there are, at most `count` …
        ("skip", "<u4"),  # … and that so many stand before the first
        ("above", "<u4"),  # words that `low` counts from
        ("above_stride", "<u4"),
        ("below", "<u4"),  # …and `high`
        ("below_stride", "<u4"),
        ("condition", "<u4"),  # the first of them
        ("conditions", "<u4"),
        ("multiple", "<u4"),
        ("kind", "<u4"),
        ("name", "<u4"),
    ]
)
CONDITION = np.dtype([("low", "<i8"), ("high", "<i8"), ("at", "<u4"), ("stride", "<u4")])
NAME = np.dtype([("name", "S40")])
#: where the limiter is, which looks ahead: what it delays may be above the ceiling where it knows by how much to reduce
#: that. A `window` of 0: there is none
AHEAD = np.dtype(
    [
        ("delay", "<u4"),
        ("required", "<u4"),
        ("counters", "<u4"),
        ("frames", "<u4"),
        ("channels", "<u4"),
        ("window", "<u4"),
        ("ceiling", "<f8"),
    ]
)


class Limits(NamedTuple):
    """Rows of LIMIT, CONDITION and NAME, and an AHEAD."""

    limits: np.ndarray
    conditions: np.ndarray
    names: np.ndarray
    ahead: np.ndarray


def limits_in(memory: Memory, begin: int, engine: Engine) -> Limits:
    """The limits of what sounds in the memory of a prepared engine, from `begin` on in its core. Raises ValueError for an
    effect whose state only Python can look at."""
    inside = engine.memory
    arrays = inside.changing
    most = inside.state.pending.size
    defaults = default_parameters(engine.compiled)
    writer = _Writer(memory, begin, arrays)
    for limit in limits_of(inside.built.bank, inside.settings, inside.strings, arrays, defaults, (0, most)):
        writer.add(limit)
    ahead = np.zeros((), AHEAD)
    for placed in inside.chains.placed:
        for limit in _of_effect(placed):
            writer.add(limit)
        if placed.effect is LIMITER:
            delay, required, _, counters, _ = placed.places
            numbers, counts = (memory.place(arrays[f"effect_{each}"]) - begin for each in ("numbers", "counts"))
            channels, ceiling = placed.at_rest.delay.shape[1], placed.made.ceiling
            places = numbers + 8 * delay, numbers + 8 * required, counts + 8 * counters
            ahead[()] = (*places, LOOKAHEAD, channels, WINDOW, ceiling)
    return writer.done(ahead)


def _of_effect(placed: Placed) -> Iterator[Limit]:
    """What its `problem` looks at, but for what AHEAD says."""
    if placed.effect is DELAY:
        yield Limit(_words(placed, "place"), 0, placed.made.frames - 1)
    elif placed.effect is LIMITER:
        yield Limit(_words(placed, "counters"), 0, np.array([most for _, most in MOST_COUNTS]))
        for name in ("required", "released", "levels"):
            yield Limit(_words(placed, name), 0.0, np.nextafter(1.0, 0.0))
        for name in ("required", "released"):
            ring = _words(placed, name)
            first, second = (ring._replace(places=places) for places in np.split(ring.places, [WINDOW]))
            yield Limit(second, 0.0, 0.0, above=first, below=first)
    elif any(rest.dtype.kind == "i" for rest in placed.at_rest):
        raise ValueError(f"a state of the effect {placed.effect.kind} is accessible in Python only")


def _words(placed: Placed, name: str) -> StateWords:
    """All words of an array of an effect's state."""
    k = placed.at_rest._fields.index(name)
    rest = placed.at_rest[k]
    array = "effect_numbers" if rest.dtype.kind == "f" else "effect_counts"
    return StateWords(array, "", placed.places[k] + np.arange(rest.size))


class _Writer:
    def __init__(self, memory: Memory, begin: int, arrays: Mapping[str, np.ndarray]) -> None:
        self._arrays = arrays
        self._at = {name: memory.place(array) - begin for name, array in arrays.items() if array.nbytes}
        self._limits: list[tuple] = []
        self._conditions: list[tuple] = []
        self._runs: dict[tuple, int] = {}  # where runs of conditions begin that are there already
        self._names: dict[str, int] = {}
        self._waiting = self._at["counters"] + 8 * layout.PENDING

    def add(self, limit: Limit) -> None:
        words = limit.words
        count = words.places.size
        if count == 0:
            return
        kind = self._kind(words)
        low, high = (self._bits(np.broadcast_to(bound, count), kind) for bound in (limit.low, limit.high))
        counted_from = [None if each is None else self._places(each, count) for each in (limit.above, limit.below)]
        where = [self._places(each.words, count) for each in limit.where]
        columns = [self._places(words, count), *(each for each in (*counted_from, *where) if each is not None)]
        steps = np.diff(np.stack(columns), axis=1)
        same = (np.diff(low) == 0) & (np.diff(high) == 0)
        name = self._names.setdefault(limit.label, len(self._names))
        begin = 0
        while begin < count:
            end = begin + 1
            if begin < count - 1 and same[begin]:
                stops = ~same[begin:] | (steps[:, begin:] != steps[:, begin : begin + 1]).any(axis=0)
                end = begin + 1 + (int(stops.argmax()) if stops.any() else count - 1 - begin)
            one = end == begin + 1

            def at(column: np.ndarray | None, begin: int = begin, one: bool = one) -> tuple[int, int]:
                if column is None:
                    return NONE, 0
                return int(column[begin]), 0 if one else int(column[begin + 1] - column[begin])

            conditions = tuple((each.low, each.high, *at(column)) for each, column in zip(limit.where, where, strict=True))
            self._limits.append(
                (
                    low[begin],
                    high[begin],
                    *at(columns[0]),
                    end - begin,
                    self._waiting if words.array == "pending" else NONE,
                    int(words.places[begin]) if words.array == "pending" else 0,
                    *at(counted_from[0]),
                    *at(counted_from[1]),
                    self._run(conditions),
                    len(conditions),
                    limit.multiple,
                    kind,
                    name,
                )
            )
            begin = end

    def done(self, ahead: np.ndarray) -> Limits:
        names = np.array([(name.encode(),) for name in self._names], NAME)
        return Limits(np.array(self._limits, LIMIT), np.array(self._conditions, CONDITION), names, ahead)

    def _run(self, conditions: tuple) -> int:
        if conditions not in self._runs:
            self._runs[conditions] = len(self._conditions)
            self._conditions += conditions
        return self._runs[conditions]

    def _places(self, words: StateWords, count: int) -> np.ndarray:
        """(count,) where words lie."""
        array = self._arrays[words.array]
        first = 0
        if words.field:
            assert array.dtype.fields is not None
            first = int(array.dtype.fields[words.field][1])
        return np.broadcast_to(self._at[words.array] + first + array.itemsize * words.places.astype(np.int64), count)

    def _kind(self, words: StateWords) -> int:
        dtype = self._arrays[words.array].dtype
        dtype = dtype[words.field] if words.field else dtype
        return {"f8": NUMBER, "i8": INTEGER, "u1": BYTE}[dtype.str[1:]]

    @staticmethod
    def _bits(bounds: np.ndarray, kind: int) -> np.ndarray:
        return np.array(bounds, np.float64).view(np.int64) if kind == NUMBER else np.array(bounds, np.int64)
