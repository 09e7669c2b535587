"""An LV2 host for tests: the library is called as a host calls it, with as little between as can be."""

from __future__ import annotations

import ctypes as c
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

#: ports before the first parameter's
EVENTS, LEFT, RIGHT, LATENCY, ENABLED, FIRST_PARAMETER = range(6)

MIDI_EVENT = "http://lv2plug.in/ns/ext/midi#MidiEvent"
CHUNK = "http://lv2plug.in/ns/ext/atom#Chunk"
ATOM, TIME = "http://lv2plug.in/ns/ext/atom#", "http://lv2plug.in/ns/ext/time#"
SEQUENCE = "http://lv2plug.in/ns/ext/atom#Sequence"

_MAP = c.CFUNCTYPE(c.c_uint32, c.c_void_p, c.c_char_p)
_STORE = c.CFUNCTYPE(c.c_int, c.c_void_p, c.c_uint32, c.c_void_p, c.c_size_t, c.c_uint32, c.c_uint32)
_RETRIEVE = c.CFUNCTYPE(
    c.c_void_p, c.c_void_p, c.c_uint32, c.POINTER(c.c_size_t), c.POINTER(c.c_uint32), c.POINTER(c.c_uint32)
)
_PRINTF = c.CFUNCTYPE(c.c_int, c.c_void_p, c.c_uint32, c.c_char_p, c.c_char_p, c.c_char_p)


class _Feature(c.Structure):
    _fields_ = (("uri", c.c_char_p), ("data", c.c_void_p))


class _Mapper(c.Structure):
    _fields_ = (("handle", c.c_void_p), ("map", _MAP))


class _Log(c.Structure):
    _fields_ = (("handle", c.c_void_p), ("printf", _PRINTF), ("vprintf", c.c_void_p))


class _Descriptor(c.Structure):
    _fields_ = (
        ("uri", c.c_char_p),
        ("instantiate", c.CFUNCTYPE(c.c_void_p, c.c_void_p, c.c_double, c.c_char_p, c.POINTER(c.POINTER(_Feature)))),
        ("connect_port", c.CFUNCTYPE(None, c.c_void_p, c.c_uint32, c.c_void_p)),
        ("activate", c.CFUNCTYPE(None, c.c_void_p)),
        ("run", c.CFUNCTYPE(None, c.c_void_p, c.c_uint32)),
        ("deactivate", c.c_void_p),
        ("cleanup", c.CFUNCTYPE(None, c.c_void_p)),
        ("extension_data", c.CFUNCTYPE(c.c_void_p, c.c_char_p)),
    )


class _State(c.Structure):
    _fields_ = (
        ("save", c.CFUNCTYPE(c.c_int, c.c_void_p, _STORE, c.c_void_p, c.c_uint32, c.c_void_p)),
        ("restore", c.CFUNCTYPE(c.c_int, c.c_void_p, _RETRIEVE, c.c_void_p, c.c_uint32, c.c_void_p)),
    )


def descriptor(library: Path, index: int = 0) -> _Descriptor | None:
    """What the library says of itself; None: nothing of this number."""
    function = c.CDLL(str(library)).lv2_descriptor
    function.restype, function.argtypes = c.POINTER(_Descriptor), (c.c_uint32,)
    found = function(index)
    return found.contents if found else None


class Instance:
    """A plugin at a rate. Raises ValueError with what it logged where it would not be made.

    controls  the parameters' ports, with what they hold; enabled, latency: those ports
    bundle    what the plugin is told of the folder that it lies in, where that is not the library's
    """

    def __init__(
        self,
        library: Path,
        rate_hz: float,
        defaults: Sequence[float],
        *,
        mapped: bool = True,
        bundle: Path | None = None,
    ) -> None:
        found = descriptor(library)
        assert found is not None
        self.uri = found.uri.decode()
        self._d = found
        self._uris: list[str] = []
        self.logged: list[str] = []
        self._mapper = _Mapper(None, _MAP(lambda _, uri: self.urid(uri.decode())))
        self._log = _Log(None, _PRINTF(self._print), None)
        features = [_Feature(b"http://lv2plug.in/ns/ext/log#log", c.addressof(self._log))]
        if mapped:
            features.append(_Feature(b"http://lv2plug.in/ns/ext/urid#map", c.addressof(self._mapper)))
        self._features = features
        pointers = (c.POINTER(_Feature) * (len(features) + 1))(*(c.pointer(each) for each in features), None)
        self._pointers = pointers
        self._handle = found.instantiate(c.addressof(found), rate_hz, str(bundle or library.parent).encode(), pointers)
        if not self._handle:
            raise ValueError("; ".join(self.logged))
        self.controls = np.array(defaults, np.float32)
        self.enabled = np.ones(1, np.float32)
        self.latency = np.zeros(1, np.float32)
        for k in range(self.controls.size):
            found.connect_port(self._handle, FIRST_PARAMETER + k, self.controls[k:].ctypes.data)
        found.connect_port(self._handle, ENABLED, self.enabled.ctypes.data)
        found.connect_port(self._handle, LATENCY, self.latency.ctypes.data)

    def outputs(self, after: int, count: int) -> np.ndarray:
        """What the control outputs hold that come after so many parameters; not numbers before the first block."""
        held = np.full(count, np.nan, np.float32)
        for k in range(count):
            self._d.connect_port(self._handle, FIRST_PARAMETER + after + k, held[k:].ctypes.data)
        self._held = held
        return held

    def _print(self, _: int, kind: int, form: bytes, first: bytes, second: bytes) -> int:
        assert form == b"%s: %s\n", form
        self.logged.append(f"{first.decode()}: {second.decode()}")
        return 0

    def urid(self, uri: str) -> int:
        if uri not in self._uris:
            self._uris.append(uri)
        return self._uris.index(uri) + 1

    def activate(self) -> None:
        self._d.activate(self._handle)

    def position(self, frame: int, **said: float) -> tuple[int, int, bytes]:
        """A message (frame, kind, bytes) that says where the host is: names of time:…, floats or whole numbers."""
        body = np.uint32([0, self.urid(TIME + "Position")]).tobytes()
        for name, value in said.items():
            kind = "Long" if isinstance(value, int) else "Double"
            data = (np.int64 if isinstance(value, int) else np.float64)(value).tobytes()
            body += np.uint32([self.urid(TIME + name), 0, len(data), self.urid(ATOM + kind)]).tobytes() + data
        return frame, self.urid(ATOM + "Object"), body

    def run(self, frames: int, messages: Iterable[tuple] = (), *, sequence: bytes | None = None) -> np.ndarray:
        """(frames, 2) float32 of a block with MIDI messages (frame, bytes), those of `position`, or with a sequence as it
        stands."""
        if sequence is None:
            body = b"".join(
                np.int64(frame).tobytes()
                + np.uint32([len(data), kind[0] if kind else self.urid(MIDI_EVENT)]).tobytes()
                + data
                + bytes(-len(data) % 8)
                for frame, *kind, data in messages
            )
            sequence = np.uint32([len(body) + 8, self.urid(SEQUENCE), 0, 0]).tobytes() + body
        room = np.zeros(len(sequence) // 8 + 1, np.int64)
        room.view(np.uint8)[: len(sequence)] = np.frombuffer(sequence, np.uint8)
        sound = np.full((2, frames + 1), np.nan, np.float32)
        self._d.connect_port(self._handle, EVENTS, room.ctypes.data)
        self._d.connect_port(self._handle, LEFT, sound[0].ctypes.data)
        self._d.connect_port(self._handle, RIGHT, sound[1].ctypes.data)
        self._d.run(self._handle, frames)
        assert np.isnan(sound[:, frames]).all(), "written beyond the block"
        return sound[:, :frames].T

    def _states(self) -> _State:
        at = self._d.extension_data(b"http://lv2plug.in/ns/ext/state#interface")
        return _State.from_address(at)

    def save(self) -> bytes:
        kept: list[bytes] = []

        def store(_: int, key: int, value: int, size: int, kind: int, flags: int) -> int:
            assert self._uris[key - 1].startswith(self.uri) and self._uris[kind - 1] == CHUNK and flags == 3
            kept.append(c.string_at(value, size))
            return 0

        assert self._states().save(self._handle, _STORE(store), None, 3, None) == 0
        assert len(kept) == 1
        return kept[0]

    def restore(self, data: bytes | None, kind: str = CHUNK) -> int:
        """Its answer; None: there is nothing to be had."""
        room = c.create_string_buffer(data or b"", len(data or b"") + 1)

        def retrieve(_: int, key: int, size, type_, flags) -> int | None:  # type: ignore[no-untyped-def]
            assert self._uris[key - 1].startswith(self.uri)
            if data is None:
                return None
            size[0], type_[0], flags[0] = len(data), self.urid(kind), 3
            return c.addressof(room)

        return self._states().restore(self._handle, _RETRIEVE(retrieve), None, 0, None)

    def close(self) -> None:
        self._d.cleanup(self._handle)
        self._handle = None
