"""Lists of events in C (realtime.c), and calls of the audio thread that are watched."""

from __future__ import annotations

import ctypes as c
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.plugin.clapabi import Pointer, struct

#: bytes for an event in a list of realtime.c, which all have
STRIDE = 128
_LIST_HEAD = (("self", Pointer), ("first", Pointer))
FastInput = struct(
    "FastInput",
    *_LIST_HEAD,
    ("get", Pointer),
    ("bytes", Pointer),
    ("count", c.c_uint32),
    ("stride", c.c_uint32),
    ("beyond", c.c_uint32),
)
FastOutput = struct(
    "FastOutput",
    *_LIST_HEAD,
    ("bytes", Pointer),
    ("count", c.c_uint32),
    ("room", c.c_uint32),
    ("stride", c.c_uint32),
    ("refused", c.c_uint32),
)


class Realtime:
    """realtime.c as a library: lists of events, calls that are watched."""

    def __init__(self, path: Path | str) -> None:
        self.library = c.CDLL(str(path))
        self.counting = bool(self.library.rt_sees())

    def counts(self) -> dict[str, int]:
        """What audio threads did that they must not; nothing is counted where the library was not loaded before all else."""
        counts = (c.c_int64 * 4)()
        self.library.rt_counts(counts)
        return dict(zip(("allocated", "freed", "locked", "opened"), counts, strict=True))


class FastLists:
    """An instance's two lists of events in C."""

    def __init__(self, realtime: Realtime, room: int = 4096) -> None:
        self.input, self.output = FastInput(stride=STRIDE), FastOutput(stride=STRIDE, room=room)
        realtime.library.rt_lists(c.byref(self.input), c.byref(self.output))
        self.pushed = c.create_string_buffer(STRIDE * room)
        self.output.bytes = c.addressof(self.pushed)

    def fill(self, events: Sequence[Any]) -> None:
        """These go in."""
        self.given = c.create_string_buffer(STRIDE * max(1, len(events)))
        base = c.addressof(self.given)
        for k, event in enumerate(events):
            c.memmove(base + STRIDE * k, c.addressof(event), c.sizeof(event))
        self.input.bytes, self.input.count, self.output.count = base, len(events), 0

    def addresses(self) -> list[int]:
        """Of what came out."""
        return [c.addressof(self.pushed) + STRIDE * k for k in range(self.output.count)]
