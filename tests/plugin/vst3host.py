"""A VST 3 host for tests: the library is called as a host calls it, by the tables of functions of the specification, whose
numbers and layouts are written down here once more, not taken from the plugin."""

from __future__ import annotations

import ctypes as c
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

OK, FALSE, INVALID, NOT_IMPLEMENTED, INTERNAL, NOT_INITIALIZED = range(6)
NO_INTERFACE = -1
AUDIO, EVENT = 0, 1
INPUT, OUTPUT = 0, 1
SAMPLE_32, SAMPLE_64 = 0, 1
NO_PARAMETER = 0xFFFFFFFF


def _iid(text: str) -> bytes:
    return bytes.fromhex(text.replace(" ", ""))


UNKNOWN = _iid("00000000 00000000 C0000000 00000046")
COMPONENT = _iid("E831FF31 F2D54301 928EBBEE 25697802")
PROCESSOR = _iid("42043F99 B7DA453C A569E79D 9AAEC33D")
CONTROLLER = _iid("DCD7BBE3 7742448D A874AACC 979C759E")
MAPPING = _iid("DF0FF9F7 49B74669 B63AB732 7ADBF5E5")
UNITS = _iid("3D4BD6B5 913A4FD2 A886E768 A5EB92C1")
EXPRESSIONS = _iid("B7F8F859 41234872 91169581 4F3721A3")
REQUIREMENTS = _iid("2A654303 EF764E3D 95B5FE83 730EF6D0")
FACTORY_3 = _iid("4555A2AB C1234E57 9B122910 36878931")

#: places of functions in their tables
RELEASE = 2
INITIALIZE, TERMINATE = 3, 4
_BUS_COUNT, _BUS_INFO, _SET_ACTIVE, _SET_STATE, _GET_STATE = 7, 8, 11, 12, 13
_ARRANGE, _SIZE, _LATENCY, _SETUP, _PROCESSING, _PROCESS, _TAIL = 3, 5, 6, 7, 8, 9, 10
_COUNT, _INFO, _TEXT, _PARSE, _PLAIN, _NORM, _GET, _SET = 8, 9, 10, 11, 12, 13, 14, 15

P = c.c_void_p


class Setup(c.Structure):
    _fields_ = (("mode", c.c_int32), ("size", c.c_int32), ("most", c.c_int32), ("rate", c.c_double))


class _Bus(c.Structure):
    _fields_ = (("channels", c.c_int32), ("silence", c.c_uint64), ("buffers", P))


class _Data(c.Structure):
    _fields_ = (
        ("mode", c.c_int32),
        ("size", c.c_int32),
        ("frames", c.c_int32),
        ("ins", c.c_int32),
        ("outs", c.c_int32),
        ("inputs", P),
        ("outputs", P),
        ("changes", P),
        ("changes_out", P),
        ("events", P),
        ("events_out", P),
        ("context", P),
    )


class Context(c.Structure):
    """What a host says of its transport."""

    _fields_ = (
        ("state", c.c_uint32),
        ("rate", c.c_double),
        *((name, c.c_int64) for name in ("project_samples", "system_time", "continuous_samples")),
        *((name, c.c_double) for name in ("project_music", "bar_music", "cycle_start", "cycle_end", "tempo")),
        *((name, c.c_int32) for name in ("numerator", "denominator")),
        ("chord", c.c_uint8 * 4),
        ("smpte", c.c_int32),
        ("frame_rate", c.c_uint32 * 2),
        ("to_clock", c.c_int32),
    )


def context(playing: bool, beat: float | None, tempo: float | None) -> Context:
    """None: the host does not say."""
    state = playing << 1 | (beat is not None) << 9 | (tempo is not None) << 10
    return Context(state=state, project_music=beat or 0.0, tempo=tempo or 0.0)


class ParameterInfo(c.Structure):
    _fields_ = (
        ("id", c.c_uint32),
        ("_title", c.c_uint16 * 128),
        ("_short", c.c_uint16 * 128),
        ("_units", c.c_uint16 * 128),
        ("steps", c.c_int32),
        ("default", c.c_double),
        ("unit", c.c_int32),
        ("flags", c.c_int32),
    )

    @property
    def title(self) -> str:
        return wide(self._title)

    @property
    def units(self) -> str:
        return wide(self._units)


class ClassInfoW(c.Structure):
    _fields_ = (
        ("cid", c.c_uint8 * 16),
        ("many", c.c_int32),
        ("category", c.c_char * 32),
        ("_name", c.c_uint16 * 64),
        ("flags", c.c_uint32),
        ("sub", c.c_char * 128),
        ("_vendor", c.c_uint16 * 64),
        ("_version", c.c_uint16 * 64),
        ("_sdk", c.c_uint16 * 64),
    )

    @property
    def name(self) -> str:
        return wide(self._name)


def wide(units: Any) -> str:
    """A text of UTF-16 up to its end."""
    kept = list(units)
    return np.array(kept[: kept.index(0)], np.uint16).tobytes().decode("utf-16-le")


def note_on(channel: int, key: int, velocity: float, note: int = -1, tuning: float = 0.0) -> bytes:
    return (
        np.int16([channel, key]).tobytes() + np.float32([tuning, velocity]).tobytes() + np.int32([0, note]).tobytes()
    ).ljust(24, b"\0") + np.uint16([0]).tobytes()


def note_off(channel: int, key: int, velocity: float, note: int = -1) -> bytes:
    return (
        np.int16([channel, key]).tobytes()
        + np.float32([velocity]).tobytes()
        + np.int32([note]).tobytes()
        + np.float32([0.0]).tobytes()
    ).ljust(24, b"\0") + np.uint16([1]).tobytes()


def pressure(channel: int, key: int, value: float) -> bytes:
    return (np.int16([channel, key]).tobytes() + np.float32([value]).tobytes() + np.int32([-1]).tobytes()).ljust(
        24, b"\0"
    ) + np.uint16([3]).tobytes()


def expression(kind: int, note: int, value: float) -> bytes:
    return (np.uint32([kind]).tobytes() + np.int32([note]).tobytes() + np.float64([value]).tobytes()).ljust(
        24, b"\0"
    ) + np.uint16([4]).tobytes()


_KEPT: list[Any] = []  # texts that events of system exclusive messages point to


def exclusive(data: bytes) -> bytes:
    room = c.create_string_buffer(data, len(data))
    _KEPT.append(room)
    return (np.uint32([len(data), 0]).tobytes() + np.uint64([c.addressof(room)]).tobytes()).ljust(24, b"\0") + np.uint16(
        [2]
    ).tobytes()


class _Object:
    """An object of this host that the plugin calls: a table of functions."""

    def __init__(self, *functions: tuple[Any, Callable[..., Any]]) -> None:
        query = c.CFUNCTYPE(c.c_int32, P, P, P)(lambda *_: NO_INTERFACE)
        count = c.CFUNCTYPE(c.c_uint32, P)(lambda _: 1)
        made = [query, count, count, *(kind(function) for kind, function in functions)]
        self._made = made
        self._table = (P * len(made))(*(c.cast(each, P) for each in made))
        self._pointer = P(c.addressof(self._table))
        self.address = c.addressof(self._pointer)


def _stream(data: bytearray, most: int = 1000) -> _Object:
    """A stream that reads from, or writes behind, the bytes; a part at a time, as hosts may."""
    at = 0

    def read(_: int, to: int, size: int, got: Any) -> int:
        nonlocal at
        part = bytes(data[at : at + min(size, most)])
        c.memmove(to, part, len(part))
        at += len(part)
        got[0] = len(part)
        return OK

    def write(_: int, of: int, size: int, written: Any) -> int:
        data.extend(c.string_at(of, min(size, most)))
        written[0] = min(size, most)
        return OK

    transfer = c.CFUNCTYPE(c.c_int32, P, P, c.c_int32, c.POINTER(c.c_int32))
    return _Object((transfer, read), (transfer, write))


def _queue(id: int, points: Sequence[tuple[int, float]]) -> _Object:
    def point(_: int, k: int, frame: Any, value: Any) -> int:
        frame[0], value[0] = points[k]
        return OK

    return _Object(
        (c.CFUNCTYPE(c.c_uint32, P), lambda _: id),
        (c.CFUNCTYPE(c.c_int32, P), lambda _: len(points)),
        (c.CFUNCTYPE(c.c_int32, P, c.c_int32, c.POINTER(c.c_int32), c.POINTER(c.c_double)), point),
    )


def _changes(queues: Mapping[int, Sequence[tuple[int, float]]]) -> _Object:
    made = [_queue(id, points) for id, points in queues.items()]
    out = _Object(
        (c.CFUNCTYPE(c.c_int32, P), lambda _: len(made)),
        (c.CFUNCTYPE(P, P, c.c_int32), lambda _, k: made[k].address),
    )
    out.queues = made  # type: ignore[attr-defined]
    return out


def _events(rows: Sequence[tuple[int, bytes]]) -> _Object:
    def event(_: int, k: int, to: int) -> int:
        frame, body = rows[k]
        data = np.int32([0, frame]).tobytes() + bytes(8) + bytes(2) + body[24:26] + bytes(4) + body[:24]
        c.memmove(to, data, len(data))
        return OK

    return _Object((c.CFUNCTYPE(c.c_int32, P), lambda _: len(rows)), (c.CFUNCTYPE(c.c_int32, P, c.c_int32, P), event))


class Face:
    """An interface of the plugin's."""

    def __init__(self, address: int) -> None:
        self.address = address

    def call(self, place: int, result: Any, *arguments: tuple[Any, Any]) -> Any:
        table = c.cast(P.from_address(self.address), c.POINTER(P))
        function = c.CFUNCTYPE(result, P, *(kind for kind, _ in arguments))(table[place])
        return function(self.address, *(value for _, value in arguments))

    def query(self, iid: bytes) -> Face | None:
        out = P()
        said = self.call(0, c.c_int32, (c.c_char_p, iid), (P, c.addressof(out)))
        assert (said == OK) == bool(out.value)
        return Face(out.value) if out.value else None

    def release(self) -> int:
        return self.call(RELEASE, c.c_uint32)


class Factory(Face):
    """What the library gives a host first. Raises ValueError for a library that gives nothing."""

    def __init__(self, library: Path) -> None:
        self.library = c.CDLL(str(library))
        self.library.ModuleEntry.argtypes, self.library.ModuleEntry.restype = (P,), c.c_bool
        assert self.library.ModuleEntry(None)
        self.library.GetPluginFactory.restype = P
        address = self.library.GetPluginFactory()
        if not address:
            raise ValueError("no factory")
        super().__init__(address)

    def about(self) -> ClassInfoW:
        third = self.query(FACTORY_3)
        assert third is not None and self.call(4, c.c_int32) == 1
        info = ClassInfoW()
        assert third.call(8, c.c_int32, (c.c_int32, 0), (P, c.addressof(info))) == OK
        third.release()
        return info

    def create(self, cid: bytes, iid: bytes = COMPONENT) -> Face | None:
        out = P()
        self.call(6, c.c_int32, (c.c_char_p, cid), (c.c_char_p, iid), (P, c.addressof(out)))
        return Face(out.value) if out.value else None


@dataclass
class Block:
    """What goes into a block: note events (frame, bytes), and points (frame, position) of parameters by their ids."""

    events: list[tuple[int, bytes]] = field(default_factory=list)
    points: dict[int, list[tuple[int, float]]] = field(default_factory=dict)
    context: Context | None = None


class Instance:
    """A plugin, initialized; `start` before blocks."""

    def __init__(self, factory: Factory) -> None:
        self.component = self._made(factory.create(bytes(factory.about().cid)))
        assert self.component.call(INITIALIZE, c.c_int32, (P, None)) == OK
        self.processor = self._made(self.component.query(PROCESSOR))
        self.controller = self._made(self.component.query(CONTROLLER))
        self.silence = 0
        self._size = SAMPLE_32

    @staticmethod
    def _made(face: Face | None) -> Face:
        assert face is not None
        return face

    def setup(self, rate_hz: float, most: int = 4096, size: int = SAMPLE_32) -> int:
        self._size = size
        given = Setup(0, size, most, rate_hz)
        return self.processor.call(_SETUP, c.c_int32, (P, c.addressof(given)))

    def active(self, on: bool) -> int:
        return self.component.call(_SET_ACTIVE, c.c_int32, (c.c_uint8, on))

    def processing(self, on: bool) -> int:
        return self.processor.call(_PROCESSING, c.c_int32, (c.c_uint8, on))

    def start(self, rate_hz: float, most: int = 4096, size: int = SAMPLE_32) -> None:
        assert self.setup(rate_hz, most, size) == OK
        assert self.active(True) == OK
        assert self.processing(True) == OK

    def process(self, frames: int, block: Block | None = None, *, heard: bool = True, expected: int = OK) -> np.ndarray:
        """(frames, 2) of a block; not `heard`: the host gives no buffers."""
        block = block or Block()
        kind = np.float64 if self._size == SAMPLE_64 else np.float32
        sound = np.full((2, frames + 1), np.nan, kind)
        buffers = (P * 2)(sound[0].ctypes.data, sound[1].ctypes.data)
        bus = _Bus(2, 7, c.addressof(buffers))
        changes, events = _changes(block.points), _events(block.events)
        data = _Data(
            size=self._size,
            frames=frames,
            outs=1 if heard else 0,
            outputs=c.addressof(bus) if heard else None,
            changes=changes.address,
            events=events.address,
            context=None if block.context is None else c.addressof(block.context),
        )
        assert self.processor.call(_PROCESS, c.c_int32, (P, c.addressof(data))) == expected
        assert np.isnan(sound[:, frames]).all(), "written beyond the block"
        self.silence = bus.silence
        return sound[:, :frames].T

    # what a host asks

    def buses(self, media: int, direction: int) -> int:
        return self.component.call(_BUS_COUNT, c.c_int32, (c.c_int32, media), (c.c_int32, direction))

    def latency(self) -> int:
        return self.processor.call(_LATENCY, c.c_uint32)

    def tail(self) -> int:
        return self.processor.call(_TAIL, c.c_uint32)

    def save(self) -> bytes:
        data = bytearray()
        stream = _stream(data)
        assert self.component.call(_GET_STATE, c.c_int32, (P, stream.address)) == OK
        return bytes(data)

    def load(self, data: bytes) -> int:
        stream = _stream(bytearray(data))
        return self.component.call(_SET_STATE, c.c_int32, (P, stream.address))

    def parameters(self) -> list[ParameterInfo]:
        out = []
        for k in range(self.controller.call(_COUNT, c.c_int32)):
            info = ParameterInfo()
            assert self.controller.call(_INFO, c.c_int32, (c.c_int32, k), (P, c.addressof(info))) == OK
            out.append(info)
        return out

    def text(self, id: int, position: float) -> str:
        room = (c.c_uint16 * 128)()
        said = self.controller.call(_TEXT, c.c_int32, (c.c_uint32, id), (c.c_double, position), (P, c.addressof(room)))
        assert said == OK
        return wide(room)

    def parse(self, id: int, text: str) -> float | None:
        data = c.create_string_buffer(text.encode("utf-16-le") + b"\0\0")
        out = c.c_double()
        said = self.controller.call(_PARSE, c.c_int32, (c.c_uint32, id), (P, c.addressof(data)), (P, c.addressof(out)))
        return out.value if said == OK else None

    def plain(self, id: int, position: float) -> float:
        return self.controller.call(_PLAIN, c.c_double, (c.c_uint32, id), (c.c_double, position))

    def normalized(self, id: int, value: float) -> float:
        return self.controller.call(_NORM, c.c_double, (c.c_uint32, id), (c.c_double, value))

    def position(self, id: int) -> float:
        return self.controller.call(_GET, c.c_double, (c.c_uint32, id))

    def turn(self, id: int, position: float) -> int:
        return self.controller.call(_SET, c.c_int32, (c.c_uint32, id), (c.c_double, position))

    def mapped(self, channel: int, controller: int) -> int | None:
        """The parameter that a MIDI controller is."""
        mapping = self._made(self.component.query(MAPPING))
        out = c.c_uint32()
        said = mapping.call(
            3, c.c_int32, (c.c_int32, 0), (c.c_int16, channel), (c.c_int16, controller), (P, c.addressof(out))
        )
        mapping.release()
        return out.value if said == OK else None

    def close(self) -> None:
        """Everything is given back, and nothing may be left."""
        assert self.component.call(TERMINATE, c.c_int32) == OK
        self.processor.release()
        self.controller.release()
        assert self.component.release() == 0


def blocks(frames: int, sizes: Iterable[int]) -> list[tuple[int, int]]:
    """(first, end) of blocks of these sizes, one after the other and again, up to `frames`."""
    out, first, given = [], 0, list(sizes)
    while first < frames:
        end = min(frames, first + given[len(out) % len(given)])
        out.append((first, end))
        first = end
    return out
