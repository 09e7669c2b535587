"""The native library as tests call it: its interface (c/jawari.h) by ctypes, with arrays in and out."""

from __future__ import annotations

import ctypes as c
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from synth.midi.events import EVENT, make_events

WHY = 512


class NativePreset(c.Structure):
    _fields_ = [(name, c.c_char_p) for name in ("id", "name", "description")] + [
        (name, c.c_int32) for name in ("lowest_note", "highest_note")
    ]


class NativeParameter(c.Structure):
    _fields_ = (
        [(name, c.c_int32) for name in ("part", "index", "curve")]
        + [(name, c.c_char_p) for name in ("id", "name", "unit")]
        + [(name, c.c_double) for name in ("minimum", "maximum", "initial", "smoothing_s")]
    )


class NativeReport(c.Structure):
    _fields_ = [("peak", c.c_double)] + [
        (name, c.c_int64) for name in ("notes", "unplayed", "stolen", "dropped", "silenced")
    ]


_P, _I, _L, _D, _S = c.c_void_p, c.c_int32, c.c_int64, c.c_double, c.c_char_p
_FUNCTIONS = {
    "version": (_S,),
    "processor": (_S, _P),
    "open": (_P, _S, _P),
    "open_bytes": (_P, _P, c.c_size_t, _P),
    "open_own": (_P, _P),
    "hold": (_P, _P),
    "close": (None, _P),
    "presets": (_I, _P),
    "preset_of": (c.POINTER(NativePreset), _P, _I),
    "bank_id": (_S, _P),
    "bank_name": (_S, _P),
    "bank_uid": (_P, _P),
    "strings": (_I, _P),
    "rates": (_I, _P),
    "rate_of": (_D, _P, _I),
    "parameters": (_I, _P),
    "parameter_of": (c.POINTER(NativeParameter), _P, _I),
    "create": (_P, _P, _D, _I, _P),
    "destroy": (None, _P),
    "midi": (_I, _S, c.c_size_t, _L, _P, _I),
    "process": (None, _P, _P, _I, _I, _P, _P),
    "process_float": (None, _P, _P, _I, _I, _P, _P),
    "reset": (None, _P),
    "rate": (_D, _P),
    "threads": (_I, _P),
    "latency": (_I, _P),
    "tail": (_L, _P),
    "voices": (_I, _P),
    "silent": (_I, _P),
    "value": (_D, _P, _I, _I),
    "program": (_I, _P, _I),
    "pitch": (_D, _P, _I),
    "sounding": (_I, _P, _I, _I),
    "report_of": (None, _P, c.POINTER(NativeReport)),
    "lend": (None, _P),
    "help": (None, _P, _I),
    "kernel": (_P, _S),
    "kernels_version": (_S,),
}


class Refused(Exception):
    """What the library said."""


class Library:
    """libjawari.so; `call.create(…)` is `jawari_create(…)`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.loaded = c.CDLL(str(path))
        for name, (result, *arguments) in _FUNCTIONS.items():
            function = getattr(self.loaded, f"jawari_{name}")
            function.restype, function.argtypes = result, arguments
            setattr(self, name, function)

    def open_bank(self, path: Path) -> Bank:
        return Bank(self, self.told(self.open, str(path).encode()))

    def open_own_bank(self) -> Bank:
        return Bank(self, self.told(self.open_own))

    def told(self, function, *arguments):
        """What a function gives; raises Refused with what it says where that is nothing."""
        why = c.create_string_buffer(WHY)
        got = function(*arguments, why)
        if not got:
            raise Refused(why.value.decode())
        return got

    def read_midi(self, data: bytes, frame: int = 0, room: int = 256) -> np.ndarray:
        """Events of a message."""
        events = np.zeros(room, EVENT)
        return events[: self.midi(data, len(data), frame, events.ctypes.data, room)]


class Bank:
    def __init__(self, library: Library, address: int) -> None:
        self.library, self.address = library, address

    def close(self) -> None:
        self.library.close(self.address)
        self.address = None

    def engine(self, rate_hz: float = 44100.0, threads: int = 1) -> NativeEngine:
        return NativeEngine(self.library, self.library.told(self.library.create, self.address, rate_hz, threads))


class NativeEngine:
    """An engine; it ends with `close` or when it is collected."""

    def __init__(self, library: Library, address: int) -> None:
        self.library, self.address = library, address

    def close(self) -> None:
        address, self.address = self.address, None
        self.library.destroy(address)

    def __del__(self) -> None:
        if self.address is not None:
            self.close()

    def process(self, events: np.ndarray, frames: int, dtype=np.float64) -> np.ndarray:
        """(frames, 2), the next frames with EVENT events."""
        events = np.ascontiguousarray(events)
        left, right = np.zeros(max(1, frames), dtype), np.zeros(max(1, frames), dtype)
        call = self.library.process if dtype is np.float64 else self.library.process_float
        call(self.address, events.ctypes.data, events.size, frames, left.ctypes.data, right.ctypes.data)
        return np.stack([left[:frames], right[:frames]], axis=1)

    def play(
        self, events: np.ndarray | Iterable[tuple], frames: int, blocks: Iterable[int] | int = 512, dtype=np.float64
    ) -> np.ndarray:
        """As tests.engine.kit.play: (frames, 2) from now on; frames of events count from now on."""
        rows = events if isinstance(events, np.ndarray) else make_events(list(events))
        rows = rows[np.argsort(rows["frame"], kind="stable")]
        sizes = iter([blocks] * (frames // blocks + 1) if isinstance(blocks, int) else blocks)
        pieces, begin = [np.zeros((0, 2), dtype)], 0
        while begin < frames:
            end = min(frames, begin + next(sizes))
            here = rows[(rows["frame"] >= begin) & (rows["frame"] < end)].copy()
            here["frame"] -= begin
            pieces.append(self.process(here, end - begin, dtype))
            begin = end
        return np.concatenate(pieces)

    def reset(self) -> None:
        self.library.reset(self.address)

    @property
    def report(self) -> NativeReport:
        report = NativeReport()
        self.library.report_of(self.address, c.byref(report))
        return report

    @property
    def voices(self) -> int:
        return self.library.voices(self.address)

    @property
    def silent(self) -> bool:
        return bool(self.library.silent(self.address))
