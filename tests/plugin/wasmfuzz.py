"""Random callers of the engine as WebAssembly: whatever jawari.h lets them do, in any order, with whatever events."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field

import numpy as np

from synth.midi.events import EVENT
from tests.plugin.wasmrun import WHY, Module

#: the limiter holds the mix below 1; what fades after a reset comes on top
LOUDEST = 2.0
MOST_ENGINES, MOST_FRAMES, MOST_EVENTS = 3, 1024, 200
_ODD = (math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324, -1.0, 0.0, 1.0, 440.0)
_WILD = (-(2**31), -1, 0, 16, 127, 128, 10**6, 2**31 - 1)
_OFTEN = {"block": 40, "midi": 12, "ask": 4, "reset": 2}
_GUARD = b"\xa5" * 64


@dataclass
class Report:
    """What was done, and what came of it."""

    events: int = 0
    blocks: int = 0
    peak: float = 0.0
    done: dict[str, int] = field(default_factory=dict)


class Fuzz:
    """A module with one bank, and engines of it. The same seed does the same. What is wrong raises AssertionError, or
    wasmtime's Trap."""

    def __init__(self, module: bytes, bank: bytes, rates_hz: tuple[float, ...], seed: int) -> None:
        self.random = random.Random(seed)
        self.report = Report()
        self.module = made = Module(module)
        self._rates = rates_hz
        self._bank = made.open_bank(bank)
        self._engines: list[int] = []
        self._waiting = np.zeros(0, EVENT)  # what a MIDI message has become
        self._events = made.room(EVENT.itemsize * 2 * MOST_EVENTS)
        self._sides = [made.room(8 * MOST_FRAMES + len(_GUARD)) for _ in range(2)]
        self._bytes = made.room(256)

    def run(self, events: int) -> Report:
        """Until there were so many events."""
        kinds = [name.removeprefix("do_") for name in dir(self) if name.startswith("do_")]
        weights = [_OFTEN.get(kind, 1) for kind in kinds]
        while self.report.events < events:
            if not self._engines:
                self.do_create(0)
            (kind,) = self.random.choices(kinds, weights)
            getattr(self, f"do_{kind}")(self.random.choice(self._engines))
            self.report.done[kind] = self.report.done.get(kind, 0) + 1
        for engine in self._engines:
            self.module.call("jawari_destroy", engine)
        self.module.call("jawari_close", self._bank)
        return self.report

    # -- events --

    def _number(self, most: int) -> int:
        if self.random.random() < 0.02:
            return self.random.choice(_WILD)
        return self.random.randint(0, most)

    def _event(self, frames: int) -> tuple[int, int, int, int, int, float]:
        rng = self.random
        kind = rng.choice((1, 1, 1, 1, 2, 2, 3, 4, 5, 6, 7, 8, 9)) if rng.random() < 0.98 else rng.choice((0, 10, *_WILD))
        frame = rng.randint(0, frames) if rng.random() < 0.95 else rng.choice((-1, -(2**63), 2**63 - 1, 2**32, frames))
        value = rng.choice(_ODD) if rng.random() < 0.1 else rng.uniform(0.0, 128.0) if rng.random() < 0.5 else rng.random()
        a = rng.randint(-9000, 9000) if kind == 4 else rng.randint(24, 60) if rng.random() < 0.7 else self._number(127)
        return frame, kind, self._number(15 if rng.random() < 0.3 else 2), a, self._number(127), value

    def do_midi(self, _: int) -> None:
        """Bytes as they may come from a wire, or not."""
        rng, made = self.random, self.module
        data = rng.randbytes(rng.randint(0, 64))
        if rng.random() < 0.8:
            head = rng.choice((0x80, 0x90, 0xA0, 0xB0, 0xC0, 0xD0, 0xE0)) | rng.randint(0, 15)
            data = bytes((head, rng.getrandbits(7), rng.getrandbits(7)))
        elif rng.random() < 0.8:
            body = bytes(rng.getrandbits(7) for _ in range(rng.randint(0, 60)))
            data = b"\xf0" + rng.choice((b"\x7f\x7f\x08\x02\x00", b"\x7e\x7f\x08", b"\x7d", b"")) + body + b"\xf7"
        room = rng.randint(0, MOST_EVENTS)
        made.write(self._bytes, data)
        made.write(self._events, _GUARD * ((MOST_EVENTS + 2) // 2))
        count = made.call("jawari_midi", self._bytes, len(data), rng.randint(-5, 1100), self._events, room)
        assert 0 <= count <= room, (data, count)
        behind = made.read(self._events + EVENT.itemsize * count, EVENT.itemsize)
        assert behind == _GUARD[: EVENT.itemsize], "events beyond their room"
        self._waiting = np.frombuffer(made.read(self._events, EVENT.itemsize * count), EVENT)

    # -- what is done --

    def do_block(self, engine: int) -> None:
        rng, made = self.random, self.module
        frames = rng.choice((0, 1, 31, 32, 64, 128, 256, MOST_FRAMES, rng.randint(0, MOST_FRAMES)))
        rows = [self._event(frames) for _ in range(rng.choice((0, 1, 2, 3, 10, 10, 30, MOST_EVENTS)))]
        if rng.random() < 0.7:
            rows.sort(key=lambda row: row[0])
        events = np.concatenate([np.array(rows, EVENT), self._waiting])
        self._waiting = self._waiting[:0]
        made.write(self._events, events.tobytes())
        kind, name = rng.choice(((np.float64, "jawari_process"), (np.float32, "jawari_process_float")))
        size = np.dtype(kind).itemsize * frames
        for side in self._sides:
            made.write(side, b"\xff" * size + _GUARD)
        made.call(name, engine, self._events, len(events), frames, *self._sides)
        for side in self._sides:
            data = made.read(side, size + len(_GUARD))
            assert data[size:] == _GUARD, "written behind the block"
            peak = float(np.abs(np.frombuffer(data[:size], kind)).max(initial=0.0))
            assert peak <= LOUDEST, f"a sample of {peak}"
            self.report.peak = max(self.report.peak, peak)
        self.report.blocks += 1
        self.report.events += len(events)

    def do_create(self, _: int) -> None:
        if len(self._engines) < MOST_ENGINES:
            self._engines.append(self.module.engine(self._bank, self.random.choice(self._rates)))

    def do_wrong_rate(self, _: int) -> None:
        made, rate_hz = self.module, self.random.choice((*_ODD, 22050.0, 44100.5))
        assert made.call("jawari_create", self._bank, rate_hz, 1, made.why) == 0 and len(made.text(made.why).split()) > 4

    def do_destroy(self, engine: int) -> None:
        self._engines.remove(engine)
        self.module.call("jawari_destroy", engine)

    def do_reset(self, engine: int) -> None:
        self.module.call("jawari_reset", engine)

    def do_follow(self, engine: int) -> None:
        """An engine that is silent goes on with what was set in another."""
        other = self.random.choice(self._engines)
        if other != engine and self.module.call("jawari_silent", engine):
            self.module.call("jawari_follow", engine, other)

    def do_ask(self, engine: int) -> None:
        ask, rng = self.module.call, self.random
        assert 0 <= ask("jawari_voices", engine) <= ask("jawari_strings", self._bank)
        assert ask("jawari_silent", engine) in (0, 1) and ask("jawari_waiting", engine) in (0, 1)
        assert -1 <= ask("jawari_program", engine, rng.randint(0, 15)) <= 127
        assert ask("jawari_sounding", engine, rng.randint(0, 15), rng.randint(0, 127)) in (0, 1)
        ask("jawari_pitch", engine, rng.randint(0, 127))
        at = ask("jawari_parameter_of", self._bank, rng.randrange(ask("jawari_parameters", self._bank)))
        part, index = np.frombuffer(self.module.read(at, 8), np.int32).tolist()
        low, high = np.frombuffer(self.module.read(at + 24, 16)).tolist()
        assert low <= ask("jawari_value", engine, part, index) <= high
        report = self.module.room(48)
        ask("jawari_report_of", engine, report)
        peak, *counts = np.frombuffer(self.module.read(report, 48), [("peak", "f8"), ("counts", "i8", 5)])[0]
        assert math.isfinite(peak) and (np.array(counts) >= 0).all()
        ask("jawari_free", report)


def damaged(data: bytes, rng: random.Random) -> bytes:
    """With some bytes changed, or cut off."""
    if rng.random() < 0.1:
        return data[: rng.randrange(len(data))]
    changed = bytearray(data)
    head = rng.random() < 0.5
    for _ in range(rng.choice((1, 1, 2, 20))):
        changed[rng.randrange(min(len(data), 512) if head else len(data))] ^= rng.randint(1, 255)
    return bytes(changed)


def tried(made: Module, bank: bytes, rate_hz: float) -> str:
    """What the engine says of a bank, packed or not; empty where it plays. Nothing stays in the module."""
    call, why = made.call, made.why
    at, whole, opened, engine = made.put(bank), 0, 0, 0
    made.write(why, bytes(WHY))
    size = call("jawari_unpacked_size", at, len(bank))
    if size > 0:
        whole = call("jawari_alloc", size)
        if whole and call("jawari_unpack", at, len(bank), whole, size, why) == 0:
            opened = call("jawari_open_bytes", whole, size, why)
    else:
        opened = call("jawari_open_bytes", at, len(bank), why)
    if opened:
        engine = call("jawari_create", opened, rate_hz, 1, why)
    if engine:
        sides = [made.room(8 * 256) for _ in range(2)]
        notes = made.put(np.array([(0, 1, 0, 48, 100, 0.0)], EVENT).tobytes())
        for _ in range(4):
            call("jawari_process", engine, notes, 1, 256, *sides)
        assert np.isfinite(np.frombuffer(made.read(sides[0], 8 * 256))).all()
        for place in (*sides, notes):
            call("jawari_free", place)
        call("jawari_destroy", engine)
    said = "" if engine else made.text(why) or "no memory"
    call("jawari_close", opened)
    for place in (at, whole):
        call("jawari_free", place)
    return said
