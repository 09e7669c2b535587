"""A CLAP host for tests, and a strict one: whatever the specification forbids a plugin counts as a violation.

    host = Host(path)
    with host.instance() as plugin:
        plugin.activate(48000.0)
        plugin.start()
        out = plugin.process([note_on(0, 60, 0.8)], 256)
    host.check()

It knows which thread is main and which is audio (that is a real one), in which state an instance is and in which call it
just now is; it checks every call that a plugin makes and everything that it gives back. Buffers have guards and are filled
with NaN before; events are handed over one by one; streams take and give some bytes at a time.
"""

from __future__ import annotations

import ctypes as c
import math
import random
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tests.plugin.clapabi import (
    AUTOMATABLE,
    BYPASS,
    CONTINUE,
    CONTINUE_IF_NOT_QUIET,
    EXTENSIONS,
    INVALID_ID,
    KINDS,
    NOTE_END,
    NOTE_ON,
    PARAM_VALUE,
    READONLY,
    RESCAN_TEXT,
    RESCAN_VALUES,
    SLEEP,
    STEPPED,
    TAIL,
    AudioBuffer,
    Entry,
    Extension,
    Factory,
    FlagsFunction,
    GetFunction,
    Header,
    HostLog,
    HostOne,
    HostParams,
    HostPool,
    HostStruct,
    HostThreads,
    InputEvents,
    Note,
    Nothing,
    OutputEvents,
    ParamInfo,
    ParamValue,
    Pointer,
    Process,
    PushFunction,
    SizeFunction,
    Stream,
    StreamFunction,
    Version,
    Yes,
)
from tests.plugin.claplists import FastLists, Realtime

#: frames of a buffer before and after what the plugin may write
GUARD = 16
_GUARD_VALUE = 12345.0


class Host:
    """A host with one plugin file open. `pool`: how it lends threads: None (it has none to lend), "threads", or on the audio
    thread alone in some order ("forward", "backward"), or "refuses". `realtime`: event lists in C, and calls of the audio
    thread that are watched."""

    def __init__(self, path: Path | str, pool: str | None = None, seed: int = 0, realtime: Realtime | None = None) -> None:
        self.realtime = realtime
        self.violations: list[str] = []
        self.random = random.Random(seed)
        self.main = threading.get_ident()
        self.pool = pool
        self._workers = ThreadPoolExecutor(3) if pool == "threads" else None
        self._library = c.CDLL(str(path))
        self.entry = Entry.in_dll(self._library, "clap_entry")
        if self.entry.version.major != 1:
            self.violation(f"entry has CLAP version {self.entry.version.major}")
        if not self.entry.init(str(path).encode()):
            raise OSError(f"{path}: clap_entry.init refused")
        self.instances: list[Instance] = []
        address = self.entry.get_factory(b"clap.plugin-factory")
        if self.entry.get_factory(b"clap.nonsense"):
            self.violation("a factory of an unknown kind")
        self.factory = Factory.from_address(address)
        self.factory_address = address
        count = self.factory.count(address)
        if self.factory.descriptor(address, count):
            self.violation("a descriptor beyond the last")
        self.descriptors = [self._checked(self.factory.descriptor(address, k).contents) for k in range(count)]

    def _checked(self, descriptor: Any) -> Any:
        for name in ("id", "name", "vendor", "url", "manual_url", "support_url", "version", "description"):
            text = getattr(descriptor, name)
            if text is None:
                self.violation(f"the descriptor's {name} is NULL")
            else:
                text.decode()
        for name in ("id", "name"):
            if not getattr(descriptor, name):
                self.violation(f"the descriptor's {name} is empty")
        if b"instrument" not in features_of(descriptor):
            self.violation("an instrument without that feature")
        return descriptor

    def violation(self, text: str) -> None:
        self.violations.append(text)

    def check(self) -> None:
        """Raises AssertionError where the plugin did what it may not."""
        assert not self.violations, f"{len(self.violations)} violations, the first: {self.violations[:5]}"

    def instance(self) -> Instance:
        made = Instance(self)
        self.instances.append(made)
        return made

    def close(self) -> None:
        for each in self.instances:
            each.close()
        if self._workers:
            self._workers.shutdown()
        self.entry.deinit()
        self.check()

    def __enter__(self) -> Host:
        return self

    def __exit__(self, kind: Any, *_: Any) -> None:
        if kind is None:
            self.close()


def features_of(descriptor: Any) -> list[bytes]:
    out = []
    for text in descriptor.features:
        if text is None:
            return out
        out.append(text)
    return out


class Instance:
    """One plugin. Its stages: inactive, active, processing; a call in a wrong one is the test's own fault (RuntimeError)."""

    def __init__(self, host: Host) -> None:
        self.host = host
        self.restarts = self.process_requests = self.callbacks = self.rescans = self.latency_changes = self.flushes = 0
        self.lent_tasks = 0
        self.transport: Any = None  # of the blocks that follow
        self.ordered = True  # as the specification wants events; a test may have it otherwise
        self.logged: list[str] = []
        self.ended: list[tuple[int, int, int, int]] = []
        self.told: list[tuple[int, float]] = []
        self.status = CONTINUE
        self._kept: list[Any] = []
        self._audio = ThreadPoolExecutor(1)
        self._audio_ident = self._audio.submit(threading.get_ident).result()
        self.stage = "creating"
        self._calls: dict[int, list[str]] = {}
        self._events: Sequence[Any] = ()
        self._frames = 0
        self._last_time = 0
        self._open: dict[tuple[int, int], list[int]] = {}
        self._steady = 0
        self._ranges: dict[int, tuple[float, float]] = {}
        self._struct = self._host_struct()
        wanted = host.descriptors[0].id
        made = host.factory.create(host.factory_address, c.addressof(self._struct), wanted)
        if not made:
            raise OSError("the plugin could not be created")
        self.plugin = made.contents
        self.address = c.addressof(self.plugin)
        if host.factory.create(host.factory_address, c.addressof(self._struct), b"org.unknown"):
            host.violation("a plugin of an unknown id was created")
        self.stage = "initializing"
        if not self._on_main("init", self.plugin.init):
            raise OSError("; ".join(self.logged) or "the plugin's init refused")
        self.stage = "inactive"
        self._fast = FastLists(host.realtime) if host.realtime else None
        self._input = self._list_of_input()
        self._output = self._list_of_output()
        self.ext = {name: self._extension(name) for name in EXTENSIONS}
        if self.plugin.get_extension(self.address, b"clap.nonsense"):
            host.violation("an extension of an unknown kind")
        self.params = self.read_params()

    # -- what the plugin calls --

    def _callback(self, kind: Any, function: Callable[..., Any], failing: Any = None) -> Any:
        def guarded(*given: Any) -> Any:
            try:
                return function(*given)
            except Exception as error:  # ctypes would only print it
                self.host.violation(f"{function.__name__}: {error!r}")
                return failing

        made = kind(guarded)
        self._kept.append(made)
        return made

    def _in(self) -> list[str]:
        return self._calls.setdefault(threading.get_ident(), [])

    def _is_main(self) -> bool:
        return threading.get_ident() == self.host.main

    def _is_audio(self) -> bool:
        return threading.get_ident() == self._audio_ident or "exec" in self._in()

    def _must(self, true: bool, text: str) -> None:
        if not true:
            self.host.violation(text)

    def _host_struct(self) -> Any:
        def get_extension(_: int, name: bytes) -> int | None:
            self._must(self.stage != "creating", "get_extension of the host before init")
            return extensions.get(name)

        def restart(_: int) -> None:
            self.restarts += 1

        def process(_: int) -> None:
            self.process_requests += 1

        def callback(_: int) -> None:
            self.callbacks += 1

        def rescan(_: int, flags: int) -> None:
            self._must(self._is_main(), "params.rescan off the main thread")
            known = flags in (RESCAN_VALUES, RESCAN_TEXT)
            self._must(known, f"params.rescan of {flags}: nothing else changes in this plugin")
            self.rescans += flags == RESCAN_VALUES

        def clear(_: int, identity: int, flags: int) -> None:
            self._must(self._is_main(), "params.clear off the main thread")

        def request_flush(_: int) -> None:
            self._must(not self._is_audio(), "request_flush on the audio thread")
            self.flushes += 1

        def latency_changed(_: int) -> None:
            self._must(self._is_main() and "activate" in self._in(), "latency.changed outside of activate")
            self.latency_changes += 1

        def mark_dirty(_: int) -> None:
            self._must(self._is_main(), "mark_dirty off the main thread")

        def request_exec(_: int, count: int) -> bool:
            self._must(self._in()[-1:] == ["process"], "request_exec outside of process")
            self._must(0 < count <= 64, f"request_exec of {count} tasks")
            return self._execute(count)

        def log(_: int, severity: int, text: bytes) -> None:
            self._must(0 <= severity <= 4, f"a log entry of severity {severity}")
            self.logged.append(text.decode())

        def is_main(_: int) -> bool:
            return self._is_main()

        def is_audio(_: int) -> bool:
            return self._is_audio()

        made = {
            b"clap.params": HostParams(
                self._callback(FlagsFunction, rescan),
                self._callback(HostParams._fields_[1][1], clear),
                self._callback(Nothing, request_flush),
            ),
            b"clap.latency": HostOne(self._callback(Nothing, latency_changed)),
            b"clap.state": HostOne(self._callback(Nothing, mark_dirty)),
            b"clap.log": HostLog(self._callback(HostLog._fields_[0][1], log)),
            b"clap.thread-check": HostThreads(self._callback(Yes, is_main), self._callback(Yes, is_audio)),
        }
        if self.host.pool:
            made[b"clap.thread-pool"] = HostPool(self._callback(HostPool._fields_[0][1], request_exec, False))
        self._kept.append(made)
        extensions = {name: c.addressof(each) for name, each in made.items()}
        return HostStruct(
            Version(1, 2, 2),
            None,
            b"strict host",
            b"",
            b"",
            b"1",
            self._callback(Extension, get_extension),
            self._callback(Nothing, restart),
            self._callback(Nothing, process),
            self._callback(Nothing, callback),
        )

    def _execute(self, count: int) -> bool:
        def task(k: int) -> None:
            self._in().append("exec")
            self.ext["clap.thread-pool"].exec(self.address, k)
            self._in().pop()

        pool = self.host.pool
        if pool == "refuses":
            return False
        self.lent_tasks += count
        order = range(count)
        if pool == "threads":
            assert self.host._workers
            for each in [self.host._workers.submit(task, k) for k in order]:
                each.result()
        else:
            for k in order if pool == "forward" else reversed(order):
                task(k)
        return True

    def _list_of_input(self) -> Any:
        def size(_: int) -> int:
            self._must(bool(self._in()), "events were asked for outside of a call")
            return len(self._events)

        def get(_: int, k: int) -> int | None:
            self._must(bool(self._in()), "an event was asked for outside of a call")
            if k >= len(self._events):
                self.host.violation(f"event {k} of {len(self._events)} was asked for")
                return None
            return c.addressof(self._events[k])

        return InputEvents(None, self._callback(SizeFunction, size, 0), self._callback(GetFunction, get))

    def _list_of_output(self) -> Any:
        def try_push(_: int, address: int) -> bool:
            self._must(bool(self._in()), "an event was pushed outside of a call")
            self._pushed(address)
            return True

        return OutputEvents(None, self._callback(PushFunction, try_push, False))

    def _pushed(self, address: int) -> None:
        header = Header.from_address(address)
        self._must(header.space == 0, "an event of an unknown space")
        self._must(header.time >= self._last_time, "events that are not in order")
        self._must(header.time < max(1, self._frames), f"an event at {header.time} of {self._frames} frames")
        self._last_time = header.time
        if header.type == NOTE_END:
            self._must(header.size == c.sizeof(Note), "a note end of a wrong size")
            self._end(Note.from_address(address))
        elif header.type == PARAM_VALUE:
            self._must(header.size == c.sizeof(ParamValue), "a value of a wrong size")
            event = ParamValue.from_address(address)
            low, high = self._ranges.get(event.param_id, (math.nan, math.nan))
            self._must(low <= event.value <= high, f"value {event.value} of parameter {event.param_id}")
            self.told.append((event.param_id, event.value))
        else:
            self.host.violation(f"an event of type {header.type} was pushed")

    def _end(self, event: Any) -> None:
        where = (event.channel, event.key)
        self._must(event.port == 0, f"a note end of port {event.port}")
        notes = self._open.get(where, [])
        if event.note_id in notes:
            notes.remove(event.note_id)
        else:
            self.host.violation(f"the end of note {event.note_id} {where} that is not open")
        self.ended.append((event.header.time, event.note_id, event.channel, event.key))

    # -- calls --

    def _called(self, name: str, function: Callable[..., Any], *given: Any) -> Any:
        self._in().append(name)
        try:
            return function(self.address, *given)
        finally:
            self._in().pop()

    def _on_main(self, name: str, function: Callable[..., Any], *given: Any) -> Any:
        if not self._is_main():
            raise RuntimeError(f"{name} is for the main thread")
        return self._called(name, function, *given)

    def _on_audio(self, name: str, function: Callable[..., Any], *given: Any) -> Future[Any]:
        return self._audio.submit(self._called, name, function, *given)

    def _stand(self, *stages: str) -> None:
        if self.stage not in stages:
            raise RuntimeError(f"the instance is {self.stage}, not {' or '.join(stages)}")

    def _extension(self, name: str) -> Any:
        address = self._on_main("get_extension", self.plugin.get_extension, name.encode())
        return KINDS[name].from_address(address) if address else None

    def activate(self, rate_hz: float, most_frames: int = 4096) -> bool:
        self._stand("inactive")
        if not self._on_main("activate", self.plugin.activate, rate_hz, 1, most_frames):
            return False
        self.stage = "active"
        self._most_frames = most_frames
        self._open.clear()
        return True

    def deactivate(self) -> None:
        self._stand("active")
        self._on_main("deactivate", self.plugin.deactivate)
        self.stage = "inactive"

    def start(self) -> None:
        self._stand("active")
        if not self._on_audio("start", self.plugin.start_processing).result():
            self.host.violation("start_processing refused")
        self.stage = "processing"

    def stop(self) -> None:
        self._stand("processing")
        self._on_audio("stop", self.plugin.stop_processing).result()
        self.stage = "active"

    def _watched(self, name: str, function: Any, *given: Any) -> Any:
        """A call of the audio thread by realtime.c, with its lists."""
        fast, realtime = self._fast, self.host.realtime
        assert fast and realtime
        fast.fill(self._events)
        made = getattr(realtime.library, name)(function, *(Pointer(each) for each in given))
        for address in fast.addresses():
            self._pushed(address)
        self._must(fast.input.beyond == 0, "an event behind the last was asked for")
        self._must(fast.output.refused == 0, "more events were pushed than anyone reads")
        return made

    def reset(self) -> None:
        self._stand("active", "processing")
        if self._fast:
            self._events = ()
            self._audio.submit(self._watched, "rt_reset", self.plugin.reset, self.address).result()
        else:
            self._on_audio("reset", self.plugin.reset).result()
        self._open.clear()

    def process(self, events: Sequence[Any], frames: int, kind: Any = np.float64) -> np.ndarray:
        """A block; (frames, 2)."""
        return self.process_later(events, frames, kind).result()

    def process_later(self, events: Sequence[Any], frames: int, kind: Any = np.float64) -> Future[np.ndarray]:
        """The same, on the audio thread while the caller goes on."""
        self._stand("processing")
        if frames > self._most_frames:
            raise RuntimeError("a block longer than was said")
        if self.ordered and any(a.header.time > b.header.time for a, b in pairwise(events)):
            raise RuntimeError("events out of order")
        if any(each.header.time >= max(frames, 1) for each in events):
            raise RuntimeError("an event behind the block")
        return self._audio.submit(self._block, list(events), frames, kind)

    def process_many(self, events: Sequence[Any], frames: int, count: int) -> Future[np.ndarray]:
        """So many blocks without a pause between them, which takes `realtime`; the events are the first one's."""
        self._stand("processing")
        assert self._fast
        return self._audio.submit(self._block, list(events), frames, np.float64, count)

    def _block(self, events: list[Any], frames: int, kind: Any, count: int = 1) -> np.ndarray:
        length = count * frames
        room = np.full((2, length + 2 * GUARD), _GUARD_VALUE, kind)
        room[:, GUARD : GUARD + length] = np.nan
        width = room.itemsize
        starts = [room.ctypes.data + side * room.strides[0] + GUARD * width for side in range(2)]
        channels = (Pointer * 2)(*starts)
        wide = kind == np.float64
        address = c.addressof(channels)
        buffer = AudioBuffer(None if wide else address, address if wide else None, 2, 0, 0)
        block = Process(
            self._steady,
            frames,
            None if self.transport is None else c.addressof(self.transport),
            None,
            c.addressof(buffer),
            0,
            1,
            c.addressof(self._fast.input if self._fast else self._input),
            c.addressof(self._fast.output if self._fast else self._output),
        )
        self._events, self._frames, self._last_time = events, frames, 0
        self._note_starts(events)
        given = self.address, c.addressof(block)
        if not self._fast:
            self.status = self._called("process", self.plugin.process, given[1])
        elif count == 1:
            self.status = self._watched("rt_process", self.plugin.process, *given)
        else:
            more = c.addressof(self._fast.input), count
            self.status = self._watched("rt_many", self.plugin.process, *given, *more)
        self._note_ends()
        self._events = ()
        self._steady += length
        self._must(self.status in (CONTINUE, CONTINUE_IF_NOT_QUIET, TAIL, SLEEP), f"process gave {self.status}")
        out = room[:, GUARD : GUARD + length]
        guards = np.concatenate((room[:, :GUARD], room[:, GUARD + length :]), axis=1)
        self._must(bool((guards == _GUARD_VALUE).all()), "written outside of the buffer")
        self._must(bool(np.isfinite(out).all()), "frames that are not written, or no numbers")
        for side in range(2):
            if buffer.constant_mask >> side & 1:
                self._must(frames == 0 or bool((out[side] == out[side, 0]).all()), "constant_mask of what is not constant")
        return out.T.copy()

    def _note_starts(self, events: list[Any]) -> None:
        for event in events:
            known = event.header.space == 0 and event.header.size >= c.sizeof(event)
            if known and event.header.type == NOTE_ON and self._playable(event):
                self._open.setdefault((max(0, event.channel), event.key), []).append(event.note_id)

    @staticmethod
    def _playable(event: Any) -> bool:
        return 0 <= event.key < 128 and event.port in (-1, 0) and -1 <= event.channel < 16

    def _note_ends(self) -> None:
        """A second note of a key ends the first, which the plugin has to tell."""
        for where, notes in self._open.items():
            self._must(len(notes) <= 1, f"notes {notes} of {where} at once")

    def flush(self, events: Sequence[Any]) -> None:
        """Values outside of a block."""
        params = self.ext["clap.params"]
        self._events, self._frames, self._last_time = list(events), 0, 0
        given = c.addressof(self._input), c.addressof(self._output)
        if self._fast and self.stage != "inactive":
            lists = c.addressof(self._fast.input), c.addressof(self._fast.output)
            self._audio.submit(self._watched, "rt_flush", params.flush, self.address, *lists).result()
        elif self.stage == "inactive":
            self._on_main("flush", params.flush, *given)
        else:
            self._on_audio("flush", params.flush, *given).result()
        self._events = ()

    def save(self) -> bytes:
        kept = bytearray()

        def write(_: int, data: int, size: int) -> int:
            taken = self.host.random.randint(1, max(1, min(size, 100_000)))
            kept.extend(c.string_at(data, min(size, taken)))
            return min(size, taken)

        stream = Stream(None, self._callback(StreamFunction, write, -1))
        if not self._on_main("save", self.ext["clap.state"].save, c.addressof(stream)):
            self.host.violation("the state could not be saved")
        return bytes(kept)

    def load(self, data: bytes) -> bool:
        at = 0

        def read(_: int, to: int, size: int) -> int:
            nonlocal at
            given = data[at : at + self.host.random.randint(1, max(1, min(size, 100_000)))]
            c.memmove(to, given, len(given))
            at += len(given)
            return len(given)

        stream = Stream(None, self._callback(StreamFunction, read, -1))
        before = self.rescans
        taken = self._on_main("load", self.ext["clap.state"].load, c.addressof(stream))
        self._must(self.rescans == before + (1 if taken else 0), "values are to be read again after a load, and only then")
        return bool(taken)

    # -- what it says of itself --

    def read_params(self) -> list[Any]:
        """Everything of the parameters, checked."""
        params = self.ext["clap.params"]
        out = []
        for k in range(self._on_main("count", params.count)):
            info = ParamInfo()
            if not self._on_main("get_info", params.get_info, k, c.addressof(info)):
                self.host.violation(f"no information on parameter {k}")
                continue
            self._must(info.minimum <= info.initial <= info.maximum, f"{info.name}: its default is outside of its range")
            self._must(info.minimum < info.maximum, f"{info.name}: its range is empty")
            self._must(info.id != INVALID_ID and bool(info.name), f"parameter {k} without an id or a name")
            both = info.flags & READONLY and info.flags & AUTOMATABLE
            self._must(not both, f"{info.name}: automated, and cannot be set")
            if info.flags & BYPASS:
                fits = info.flags & STEPPED and (info.minimum, info.maximum) == (0.0, 1.0)
                self._must(bool(fits), "a bypass that is not 0 or 1")
            out.append(info)
            self._ranges[info.id] = info.minimum, info.maximum
        self._must(len({info.id for info in out}) == len(out), "two parameters of one id")
        self._must(sum(bool(info.flags & BYPASS) for info in out) <= 1, "two bypasses")
        return out

    def value(self, identity: int) -> float:
        value = c.c_double(math.nan)
        if not self._on_main("get_value", self.ext["clap.params"].get_value, identity, c.addressof(value)):
            self.host.violation(f"no value of parameter {identity}")
        low, high = self._ranges[identity]
        self._must(low <= value.value <= high, f"parameter {identity} is {value.value}, outside of its range")
        return value.value

    def values(self) -> dict[int, float]:
        return {info.id: self.value(info.id) for info in self.params}

    def text(self, identity: int, value: float, room: int = 256) -> str:
        buffer = c.create_string_buffer(b"\xff" * (room + 8), room + 8)
        to_text = self.ext["clap.params"].value_to_text
        if not self._on_main("value_to_text", to_text, identity, value, c.addressof(buffer), room):
            raise ValueError(f"no text for {value}")
        self._must(buffer.raw[room:] == b"\xff" * 8, "a text beyond its room")
        return buffer.value.decode()

    def number(self, identity: int, text: str) -> float:
        value = c.c_double(math.nan)
        to_value = self.ext["clap.params"].text_to_value
        if not self._on_main("text_to_value", to_value, identity, text.encode(), c.addressof(value)):
            raise ValueError(f"no value: {text!r}")
        return value.value

    @property
    def latency(self) -> int:
        return self._on_main("latency", self.ext["clap.latency"].get)

    def on_main_thread(self) -> None:
        """What the plugin has asked to be called for."""
        self._on_main("on_main_thread", self.plugin.on_main_thread, self.address)

    def close(self) -> None:
        if self.stage == "closed":
            return
        if self.stage == "processing":
            self.stop()
        if self.stage == "active":
            self.deactivate()
        self._on_main("destroy", self.plugin.destroy)
        self.stage = "closed"
        self._audio.shutdown()

    def __enter__(self) -> Instance:
        return self

    def __exit__(self, kind: Any, *_: Any) -> None:
        if kind is None:
            self.close()
