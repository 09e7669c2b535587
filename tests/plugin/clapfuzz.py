"""Random hosts: they do in any order whatever a host may do, and say whatever one may or may not say."""

from __future__ import annotations

import math
import random
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.patience import patience_s
from tests.plugin import clapabi as abi
from tests.plugin.claphost import Host, Instance
from tests.plugin.claplists import Realtime

#: the limiter holds the mix below 1; what fades after a reset comes on top
LOUDEST = 2.0
MOST_INSTANCES = 3
_ODD = (math.nan, math.inf, -math.inf, 1e300, -1.0, 0.0, 1.0)


@dataclass
class Report:
    """What was done, and what came of it."""

    actions: int = 0
    events: int = 0
    blocks: int = 0
    frames: int = 0
    instances: int = 0
    loads: int = 0
    refused: int = 0
    ended: int = 0
    peak: float = 0.0
    done: dict[str, int] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    violations: list[str] = field(default_factory=list)


class Fuzz:
    """Actions on a few instances of one plugin at once. The same seed does the same."""

    def __init__(
        self, path: Path, seed: int, rates: tuple[float, ...], realtime: Realtime | None = None, pool: str | None = None
    ) -> None:
        self.random = random.Random(seed)
        self.host = Host(path, pool=pool, seed=seed, realtime=realtime)
        self.rates = rates
        self.realtime = realtime
        self.report = Report()
        self.instances: list[Instance] = []
        self.states: list[bytes] = []

    def run(self, actions: int, events: int | None = None) -> Report:
        """So many actions; more until there were so many events."""
        kinds = [name.removeprefix("do_") for name in dir(self) if name.startswith("do_")]
        often = {"block": 200, "run": 40, "transport": 20, "flush": 10, "reset": 4, "create": 2}
        weights = [often.get(kind, 3) for kind in kinds]
        report = self.report
        while report.actions < actions or (events is not None and report.events < events):
            if not self.instances:
                self.do_create(None)
            kind = self.random.choices(kinds, weights)[0]
            getattr(self, f"do_{kind}")(self.random.choice(self.instances))
            report.actions += 1
            report.done[kind] = report.done.get(kind, 0) + 1
        for each in self.instances:
            report.ended += len(each.ended)
        if self.realtime:
            report.counts = self.realtime.counts() if self.realtime.counting else {}
        try:
            self.host.close()
        except AssertionError:
            pass
        report.violations = self.host.violations
        return report

    # -- events --

    def _address(self) -> dict[str, int]:
        chance = self.random.random()
        if chance < 0.02:
            return {
                "key": self.random.randint(-300, 300),
                "channel": self.random.randint(-20, 40),
                "port": self.random.choice((-1, 0, 5)),
            }
        if chance < 0.1:
            return {"key": self.random.choice((-1, 48)), "channel": self.random.choice((-1, 0)), "port": -1}
        return {"key": self.random.randint(26, 57), "channel": self.random.randint(0, 3)}

    def _event(self, instance: Instance, time: int) -> Any:
        pick, rng = self.random.random(), self.random
        number = rng.choice(_ODD) if rng.random() < 0.02 else rng.random()
        note_id = rng.choice((-1, rng.randint(0, 20)))
        if pick < 0.3:
            return abi.note_on(time, velocity=number, note_id=note_id, **self._address())
        if pick < 0.5:
            return abi.note_off(time, velocity=number, note_id=note_id, **self._address())
        if pick < 0.52:
            return abi.choke(time, note_id=note_id, **self._address())
        if pick < 0.65:
            return abi.expression(time, rng.randint(0, 6), 3.0 * number - 1.0, note_id=note_id, **self._address())
        if pick < 0.8:
            info = rng.choice(instance.params)
            value = (
                number if abs(number) > 1e6 or number != number else info.minimum + number * (info.maximum - info.minimum)
            )
            return abi.param(time, info.id if rng.random() < 0.99 else rng.getrandbits(32), value)
        if pick < 0.97:
            return abi.midi(
                time, rng.choice((0x80, 0x90, 0xA0, 0xB0, 0xB0, 0xC0, 0xD0, 0xE0)) | rng.randint(0, 3), *self._data()
            )
        if pick < 0.98:
            return abi.midi(time, *(rng.getrandbits(8) for _ in range(3)))
        if pick < 0.982:
            return self._transport(time)
        if pick < 0.99:
            key = rng.randint(26, 57)
            return abi.sysex(time, bytes((0xF0, 0x7F, 0x7F, 8, 2, 0, 1, key, key, rng.getrandbits(7), 0, 0xF7)))
        return abi.sysex(time, rng.randbytes(rng.randint(0, 64)))

    def _transport(self, time: int) -> Any:
        """Where a host may be, or one that has gone mad."""
        rng = self.random
        tempo = rng.choice((None, *_ODD, 1e-9, 1e9, rng.uniform(20.0, 300.0), 120.0, 120.0))
        beat = rng.choice((None, 0.0, rng.uniform(-9.0, 9.0), rng.uniform(-1e9, 1e9), 2.0**31, rng.uniform(0.0, 500.0)))
        return abi.transport(time, rng.random() < 0.7, beat, tempo)

    def _data(self) -> tuple[int, int]:
        return self.random.getrandbits(7), self.random.getrandbits(7)

    def _events(self, instance: Instance, frames: int, most: int) -> list[Any]:
        count = self.random.randint(0, most)
        times = sorted(self.random.randint(0, max(0, frames - 1)) for _ in range(count))
        self.report.events += count
        return [self._event(instance, time) for time in times]

    # -- actions --

    def _ready(self, instance: Instance) -> bool:
        if instance.stage == "inactive" and not instance.activate(self.random.choice(self.rates)):
            self.host.violation("a rate of the bank was refused")
            return False
        if instance.stage == "active":
            instance.start()
        return True

    def _heard(self, sound: np.ndarray) -> None:
        self.report.blocks += 1
        self.report.frames += len(sound)
        peak = float(np.abs(sound).max(initial=0.0))
        self.report.peak = max(self.report.peak, peak)
        if not peak <= LOUDEST:
            self.host.violation(f"a sample of {peak}")

    def do_create(self, _: Instance | None) -> None:
        if len(self.instances) < MOST_INSTANCES:
            self.instances.append(self.host.instance())
            self.report.instances += 1

    def do_destroy(self, instance: Instance) -> None:
        self.report.ended += len(instance.ended)
        self.instances.remove(instance)
        instance.close()

    def do_block(self, instance: Instance) -> None:
        if self._ready(instance):
            frames = self.random.choice((0, 1, 16, 32, 64, 64, 100, 128, 256, 256, 512, self.random.randint(1, 4096)))
            events = self._events(instance, frames, 120)
            kind = self.random.choice((np.float32, np.float64))
            self._heard(instance.process(events, frames, kind))

    def do_run(self, instance: Instance) -> None:
        """Some blocks while the main thread does something else."""
        if self._ready(instance):
            later = [instance.process_later(self._events(instance, 64, 10), 64) for _ in range(self.random.randint(1, 10))]
            for _ in range(self.random.randint(0, 2)):
                self.random.choice((self.do_save, self.do_load, self.do_ask))(instance)
            for each in later:
                self._heard(each.result())

    def do_flood(self, instance: Instance) -> None:
        if self.random.random() < 0.1 and self._ready(instance):
            self._heard(instance.process(self._events(instance, 64, 12_000), 64))

    def do_transport(self, instance: Instance) -> None:
        """Of the blocks that follow; some hosts have none."""
        instance.transport = self._transport(0) if self.random.random() < 0.9 else None

    def do_flush(self, instance: Instance) -> None:
        instance.flush(self._events(instance, 1, 8))

    def do_reset(self, instance: Instance) -> None:
        if instance.stage != "inactive":
            instance.reset()

    def do_stop(self, instance: Instance) -> None:
        if instance.stage == "processing":
            instance.stop()

    def do_deactivate(self, instance: Instance) -> None:
        self.do_stop(instance)
        if instance.stage == "active":
            instance.deactivate()

    def do_wrong_rate(self, instance: Instance) -> None:
        self.do_deactivate(instance)
        if instance.activate(self.random.choice((1.0, 22050.0, 44100.5, *_ODD))):
            self.host.violation("a rate was taken that the bank does not have")

    def do_save(self, instance: Instance) -> None:
        if len(self.states) > 10:
            self.states.pop(self.random.randrange(len(self.states)))
        self.states.append(instance.save())

    def do_load(self, instance: Instance) -> None:
        if not self.states:
            return
        data = bytearray(self.random.choice(self.states))
        right = self.random.random() < 0.7
        if not right and self.random.random() < 0.5:
            data = data[: self.random.randrange(len(data))]
        elif not right:
            data[self.random.randrange(len(data))] ^= 1 << self.random.randrange(8)
        taken = instance.load(bytes(data))
        self.report.loads += taken
        self.report.refused += not taken
        if taken != right:
            self.host.violation(f"a state that was {'right' if right else 'wrong'} was {'taken' if taken else 'refused'}")

    def do_rest(self, instance: Instance) -> None:
        """Blocks without anything, as long as another setup is being made; nothing where there is no Python."""
        turned = any(not info.flags & (abi.READONLY | abi.AUTOMATABLE) for info in instance.params)
        if not turned or not self._ready(instance):
            return
        begun = time.monotonic()
        while any("being made" in instance.text(info.id, instance.value(info.id)) for info in instance.params):
            self._heard(instance.process([], 64))
            if time.monotonic() - begun > patience_s():
                self.host.violation("a setup that does not come")
                return
        for _ in range(self.random.randint(0, 30)):
            self._heard(instance.process([], 64))

    def do_ask(self, instance: Instance) -> None:
        for info in instance.read_params():
            if not info.flags & abi.AUTOMATABLE:  # its text says what is done about it just now
                continue
            text = instance.text(info.id, instance.value(info.id))
            if instance.text(info.id, instance.number(info.id, text)) != text:
                self.host.violation(f"{text!r} is not what it stands for")
        if instance.latency <= 0:
            self.host.violation("a latency that cannot be")
