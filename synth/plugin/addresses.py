"""Arrays that point to each other, as bytes that can be put anywhere: where each lies, and which words are addresses.

    memory = Memory()
    memory.add(CONSTANT, taps)
    memory.add(CORE, table, points=pointers(table, Bank))
    image = memory.image(functions)

Every word that is an address is known by its declaration, and has to lead into an array that was added, or to a compiled
function. No other word may look as if it did: that would be one that nobody has declared.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from synth.native.arrays import LINE, fields

#: regions: what never changes, of all engines alike; what an engine has; what each of its threads has
CONSTANT, CORE, THREAD = range(3)
#: what a word may lead to: one of these, or a function by its number
TO_FUNCTION = 3

RELOCATION = np.dtype([("word", "<u8"), ("target", "<u8"), ("region", "<u4"), ("to", "<u4")])


class PlacedArray(NamedTuple):
    """An array of a region; `content`: its bytes to begin with; `points`: words of it that are addresses or 0."""

    region: int
    address: int
    content: bytes
    points: tuple[int, ...]


class Region(NamedTuple):
    """A region laid out: the first bytes of it, and how many there are with the zeros behind them."""

    stored: bytes
    size: int


class Image(NamedTuple):
    """All regions, the words that are addresses (RELOCATION), the functions that these name."""

    regions: tuple[Region, Region, Region]
    relocations: np.ndarray
    functions: list[str]


class Memory:
    """See the module's docstring."""

    def __init__(self) -> None:
        self._pieces: list[PlacedArray] = []
        self._known: dict[tuple[int, int], int] = {}
        self._constant: dict[bytes, int] = {}
        self._offsets: list[int] = []
        self._ends = [0, 0, 0]

    def add(self, region: int, array: np.ndarray, *, content: np.ndarray | None = None, points: Sequence[int] = ()) -> None:
        """An array, behind the others of its region; what is there already is not added again, and constant arrays of the
        same bytes lie at one place.

        content: what it holds to begin with, where that is not what it holds now.
        """
        held = array if content is None else content
        if held.nbytes != array.nbytes or not array.flags.c_contiguous:
            raise ValueError("an array must be contiguous, and its initial content must have the same size")
        key = array.ctypes.data, array.nbytes
        if array.nbytes == 0 or key in self._known:
            return
        piece = PlacedArray(region, array.ctypes.data, held.tobytes(), tuple(points))
        self._known[key] = len(self._pieces)
        self._pieces.append(piece)
        at = self._ends[region]
        if region == CONSTANT:
            at = self._constant.setdefault(piece.content, at)
        self._offsets.append(at)
        if at == self._ends[region]:
            self._ends[region] += -(-array.nbytes // LINE) * LINE

    def end(self, region: int) -> int:
        """Where the next array of a region will begin."""
        return self._ends[region]

    def place(self, array: np.ndarray) -> int:
        """Where an array that was added begins in its region."""
        return self._offsets[self._known[array.ctypes.data, array.nbytes]]

    def constants(self) -> list[bytes]:
        """What is constant, once each, as it lies."""
        return list(self._constant)

    def arrange(self, constants: Sequence[bytes]) -> None:
        """Lay what is constant out in this order, all of it."""
        at = 0
        for content in constants:
            self._constant[content] = at
            at += -(-len(content) // LINE) * LINE
        for k, piece in enumerate(self._pieces):
            if piece.region == CONSTANT:
                self._offsets[k] = self._constant[piece.content]

    def image(self, function_at: Callable[[int], str | None]) -> Image:
        """All of it; `function_at` names the compiled function at an address.

        Raises ValueError for an address that points nowhere, and for a word that nobody declared to be one.
        """
        order = sorted(range(len(self._pieces)), key=lambda i: self._pieces[i].address)
        starts = np.array([self._pieces[i].address for i in order], np.int64)
        ends = np.array([self._pieces[i].address + len(self._pieces[i].content) for i in order], np.int64)
        if (ends[:-1] > starts[1:]).any():
            raise ValueError("two arrays overlap: declare one of them as a part of the other, instead of adding it")
        functions: list[str] = []
        relocations: list[tuple[int, int, int, int]] = []
        regions = [bytearray(self._ends[region]) for region in (CONSTANT, CORE, THREAD)]
        for piece, offset in zip(self._pieces, self._offsets, strict=True):
            words = np.frombuffer(piece.content.ljust(-(-len(piece.content) // 8) * 8, b"\0"), np.int64).copy()
            for word in piece.points:
                address = int(words[word])
                words[word] = 0
                if address == 0:
                    continue
                at = bisect.bisect_right(starts, address) - 1
                if at >= 0 and address < ends[at]:
                    to = self._pieces[order[at]].region
                    target = self._offsets[order[at]] + address - int(starts[at])
                elif (name := function_at(address)) is not None:
                    if name not in functions:
                        functions.append(name)
                    to, target = TO_FUNCTION, functions.index(name)
                else:
                    raise ValueError(f"word {word} of an array of region {piece.region} points nowhere")
                if piece.region == CONSTANT:
                    raise ValueError(
                        "constant arrays lie at different addresses in every process, and must not contain addresses"
                    )
                relocations.append((offset + 8 * word, target, piece.region, to))
            nearest = np.searchsorted(starts, words, side="right") - 1
            if ((nearest >= 0) & (words < ends[nearest])).any() or any(function_at(int(word)) for word in np.unique(words)):
                raise ValueError(f"an array of region {piece.region} holds an address that is not declared as one")
            data = words.tobytes()
            regions[piece.region][offset : offset + len(data)] = data
        laid = [Region(bytes(region).rstrip(b"\0"), len(region)) for region in regions]
        return Image((laid[0], laid[1], laid[2]), np.array(relocations, RELOCATION), functions)


def pointers(table: np.ndarray, *kinds: Any) -> list[int]:
    """Words of a table of `views` that are addresses of arrays. What has no elements lies nowhere: its word is now 0."""
    out, at = [], 0
    for kind in kinds:
        for _, shape in fields(kind).values():
            if shape:
                if math.prod(int(extent) for extent in table[at + 1 : at + 1 + len(shape)]):
                    out.append(at)
                else:
                    table[at] = 0
            at += 1 + len(shape)
    if at != table.size:
        raise ValueError(f"a table of {table.size} words was declared with {at}")
    return out


def word_of(kind: Any, name: str) -> int:
    """The word of a table where a field begins."""
    at = 0
    for field, (_, shape) in fields(kind).items():
        if field == name:
            return at
        at += 1 + len(shape)
    raise KeyError(name)
