"""A host for CLAPs as WebAssembly, in wasmtime: what it gives a plugin lies in the module's memory, and its functions in the
module's table.

    host = WclapHost(Path("tanpura-light.wclap.tar.gz"))
    plugin = host.instance()
    plugin.activate(48000.0)
    out = plugin.process([abi.note_on(0, 60, 0.8)], 256)
    plugin.close()
    host.close()

The structures are those of `clapabi`, with addresses of four bytes. What a plugin does that CLAP forbids fails at once.
"""

from __future__ import annotations

import ctypes as c
import tarfile
from collections.abc import Callable, Sequence
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from synth.plugin.wclap import MODULE
from tests.plugin import clapabi as abi
from tests.plugin.wasmrun import Module, wasmtime

_ADDRESSES = (c._Pointer, c._CFuncPtr, c.c_void_p, c.c_char_p)
_KINDS = {"i": wasmtime.ValType.i32, "l": wasmtime.ValType.i64}
#: bytes that a stream moves at once
_MOVED = 4097


@cache
def narrow(kind: Any) -> Any:
    """A structure as wasm32 lays it out; itself where it has no address."""
    if issubclass(kind, _ADDRESSES):
        return c.c_uint32
    if not issubclass(kind, c.Structure):
        return kind
    fields = [(name, narrow(of)) for name, of in kind._fields_]
    return kind if fields == kind._fields_ else abi.struct(f"{kind.__name__}32", *fields)


class WclapHost:
    """A host with the module of an archive in memory."""

    def __init__(self, archive: Path) -> None:
        with tarfile.open(archive) as files:
            module = files.extractfile(MODULE)
            assert module is not None and files.getnames() == [MODULE]
            self.module = Module(module.read())
        self._table = self.module.exports["__indirect_function_table"]
        entry = self.structure(abi.Entry, self.module.exports["clap_entry"].value(self.module.store))
        assert entry.version.major == 1
        assert self.call(entry.init, self.put(b"/plugin\0")), "clap_entry.init refused"
        self._entry = entry
        assert self.call(entry.get_factory, self.put(b"clap.nonsense\0")) == 0
        self.factory_at = self.call(entry.get_factory, self.put(b"clap.plugin-factory\0"))
        self.factory = self.structure(abi.Factory, self.factory_at)
        assert self.call(self.factory.count, self.factory_at) == 1
        assert self.call(self.factory.descriptor, self.factory_at, 1) == 0
        self.descriptor = self.structure(abi.Descriptor, self.call(self.factory.descriptor, self.factory_at, 0))

    def close(self) -> None:
        self.call(self._entry.deinit)
        assert self.call(self.factory.count, self.factory_at) == 0

    def instance(self) -> WclapInstance:
        return WclapInstance(self)

    # -- memory and functions --

    def room(self, size: int) -> int:
        at = self.module.call("malloc", size)
        assert at, f"no memory for {size} bytes"
        return at

    def put(self, data: bytes | c.Structure) -> int:
        """The address of a copy, which stays."""
        at = self.room(len(bytes(data)))
        self.module.write(at, bytes(data))
        return at

    def free(self, at: int) -> None:
        self.module.call("free", at)

    def structure(self, kind: Any, at: int) -> Any:
        """A copy of what lies at an address, which may be nowhere."""
        assert at, f"there is no {kind.__name__}"
        kind = narrow(kind)
        return kind.from_buffer_copy(self.module.read(at, c.sizeof(kind)))

    def text(self, at: int) -> str:
        return self.module.text(at)

    def call(self, function: int, *given: Any) -> Any:
        """A function of the module's by its place in the table."""
        return self._table.get(self.module.store, function)(self.module.store, *given)

    def own(self, gives: str, takes: str, function: Callable[..., Any]) -> int:
        """The place in the table of a function of the host's; `takes`: its arguments, i (and addresses) or l."""
        kind = wasmtime.FuncType([_KINDS[each]() for each in takes], [_KINDS[each]() for each in gives])
        return self._table.grow(self.module.store, 1, wasmtime.Func(self.module.store, kind, function))


class WclapInstance:
    """A plugin, and what it has told its host."""

    def __init__(self, host: WclapHost) -> None:
        self.host = host
        self.requests: list[str] = []
        self.told: list[tuple[int, int, int]] = []  # frame, type, key or parameter
        self._events: list[int] = []
        self._frames = self._steady = 0
        self._extensions = {
            "clap.params": host.put(
                narrow(abi.HostParams)(self._noted("rescan", "ii"), self._noted("clear", "iii"), self._noted("flush"))
            ),
            "clap.latency": host.put(narrow(abi.HostOne)(self._noted("latency"))),
            "clap.log": host.put(narrow(abi.HostLog)(host.own("", "iii", self._log))),
        }
        own = narrow(abi.HostStruct)(
            abi.Version(1, 2, 2),
            0,
            *(host.put(text) for text in (b"host of tests\0", b"\0", b"\0", b"1\0")),
            host.own("i", "ii", lambda _, name: self._extensions.get(host.text(name), 0)),
            *(self._noted(name) for name in ("restart", "process", "callback")),
        )
        address, identity = host.put(own), host.descriptor.id
        assert host.call(host.factory.create, host.factory_at, address, host.put(b"org.unknown\0")) == 0
        self.at = host.call(host.factory.create, host.factory_at, address, identity)
        self.plugin = host.structure(abi.Plugin, self.at)
        assert self._called(self.plugin.init), self.requests
        self._params = self._extension("clap.params")
        self._state = self._extension("clap.state")
        assert self._called(self.plugin.get_extension, host.put(b"clap.nonsense\0")) == 0
        self._input = host.put(
            narrow(abi.InputEvents)(0, host.own("i", "i", lambda _: len(self._events)), host.own("i", "ii", self._event))
        )
        self._output = host.put(narrow(abi.OutputEvents)(0, host.own("i", "ii", self._pushed)))
        self.params = self._infos()

    def _called(self, function: int, *given: Any) -> Any:
        return self.host.call(function, self.at, *given)

    def _extension(self, name: str) -> Any:
        return self.host.structure(
            abi.KINDS[name], self._called(self.plugin.get_extension, self.host.put(name.encode() + b"\0"))
        )

    def _noted(self, name: str, takes: str = "i") -> int:
        return self.host.own("", takes, lambda *_: self.requests.append(name))

    def _log(self, _: int, severity: int, text: int) -> None:
        self.requests.append(f"log {severity}: {self.host.text(text)}")

    def _event(self, _: int, k: int) -> int:
        return self._events[k]

    def _pushed(self, _: int, at: int) -> int:
        header = self.host.structure(abi.Header, at)
        assert header.space == 0 and header.time < max(1, self._frames)
        if header.type == abi.NOTE_END:
            self.told.append((header.time, header.type, self.host.structure(abi.Note, at).key))
        else:
            assert header.type == abi.PARAM_VALUE
            self.told.append((header.time, header.type, self.host.structure(abi.ParamValue, at).param_id))
        return 1

    # -- playing --

    def activate(self, rate_hz: float, most_frames: int = 4096) -> bool:
        """And begin to process; False where the rate is refused."""
        if not self._called(self.plugin.activate, rate_hz, 1, most_frames):
            return False
        assert self._called(self.plugin.start_processing)
        return True

    def deactivate(self) -> None:
        self._called(self.plugin.stop_processing)
        self._called(self.plugin.deactivate)

    def reset(self) -> None:
        self._called(self.plugin.reset)

    def close(self) -> None:
        self._called(self.plugin.destroy)

    def _placed(self, event: Any) -> list[int]:
        """The addresses of an event of `clapabi`'s and of what it names; a cookie is left out."""
        made, named = narrow(type(event))(), []
        for name, _ in made._fields_:
            if name not in ("cookie", "buffer"):
                setattr(made, name, getattr(event, name))
        made.header.size = c.sizeof(made)
        if isinstance(event, abi.Sysex):
            named = [self.host.put(event.kept.raw)]
            made.buffer = named[0]
        return [self.host.put(made), *named]

    def process(self, events: Sequence[Any], frames: int, kind: Any = np.float64) -> np.ndarray:
        """A block; (frames, 2)."""
        host, size = self.host, np.dtype(kind).itemsize * max(1, frames)
        placed = [self._placed(event) for event in events]
        self._events, self._frames = [at for at, *_ in placed], frames
        sides = [host.put(np.full(size, 0xFF, np.uint8).tobytes()) for _ in range(2)]  # which is no number
        both = host.put(np.array(sides, np.uint32).tobytes())
        wide = kind == np.float64
        buffer = host.put(narrow(abi.AudioBuffer)(0 if wide else both, both if wide else 0, 2, 0, 0))
        block = host.put(narrow(abi.Process)(self._steady, frames, 0, 0, buffer, 0, 1, self._input, self._output))
        status = self._called(self.plugin.process, block)
        assert status in (abi.CONTINUE, abi.SLEEP), f"process gave {status}"
        out = [np.frombuffer(host.module.read(at, size), kind)[:frames] for at in sides]
        for at in (*chain.from_iterable(placed), *sides, both, buffer, block):
            host.free(at)
        self._events = []
        self._steady += frames
        return np.stack(out, axis=1)

    # -- parameters and state --

    def _infos(self) -> list[Any]:
        """What there is of every parameter."""
        kind, out = narrow(abi.ParamInfo), []
        for k in range(self._called(self._params.count)):
            at = self.host.room(c.sizeof(kind))
            assert self._called(self._params.get_info, k, at)
            out.append(self.host.structure(abi.ParamInfo, at))
            self.host.free(at)
        return out

    def value(self, identity: int) -> float:
        at = self.host.room(8)
        assert self._called(self._params.get_value, _signed(identity), at)
        return float(np.frombuffer(self.host.module.read(at, 8))[0])

    def text(self, identity: int, value: float) -> str:
        at = self.host.room(256)
        assert self._called(self._params.value_to_text, _signed(identity), value, at, 256)
        return self.host.text(at)

    def save(self) -> bytes:
        kept = bytearray()

        def write(_: int, data: int, size: int) -> int:
            kept.extend(self.host.module.read(data, min(size, _MOVED)))
            return min(size, _MOVED)

        assert self._called(self._state.save, self._stream(write))
        return bytes(kept)

    def load(self, data: bytes) -> bool:
        at = 0

        def read(_: int, to: int, size: int) -> int:
            nonlocal at
            given = data[at : at + min(size, _MOVED)]
            self.host.module.write(to, given)
            at += len(given)
            return len(given)

        return bool(self._called(self._state.load, self._stream(read)))

    def _stream(self, move: Callable[[int, int, int], int]) -> int:
        return self.host.put(narrow(abi.Stream)(0, self.host.own("l", "iil", move)))


def _signed(identity: int) -> int:
    """A number of 32 bits as wasmtime takes it."""
    return c.c_int32(identity).value
