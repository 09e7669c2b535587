"""A plugin to be played by the strict host, and the same score for it and for the engine in Python."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from synth.engine import layout
from synth.engine.engine import Engine
from synth.instrument.preset import Preset
from synth.midi.events import (
    BEND,
    CONTROL,
    EVENT,
    KEY_PRESSURE,
    NOTE_OFF,
    NOTE_ON,
    PARAMETER,
    PRESSURE,
    PROGRAM,
    TUNING,
    make_events,
)
from synth.midi.sysex import of_tuning
from synth.plugin import bankfile, library
from synth.plugin.description import describe
from tests.engine.kit import BRIDGE, FREE, NECK, random_events
from tests.plugin import clapabi as abi
from tests.plugin.claphost import Instance

#: programs 0, 1, 2: 6 + 3 + 4 strings
PARTS = (FREE, BRIDGE, NECK)
RATES = (44100.0, 48000.0)
#: as a host may call for them; every length, too long and too short ones among them
MIXED = (1, 2, 31, 32, 33, 64, 100, 128, 255, 256, 480, 512, 1000, 1024, 3000, 4096)
_STATUS = {NOTE_OFF: 0x80, NOTE_ON: 0x90, KEY_PRESSURE: 0xA0, CONTROL: 0xB0, PROGRAM: 0xC0, PRESSURE: 0xD0, BEND: 0xE0}


def plugin_file(native: Path, folder: Path, parts: Sequence[Preset] = PARTS, rates: Sequence[float] = RATES) -> Path:
    """A plugin of these presets."""
    path = folder / "jawari-test.clap"
    path.write_bytes(library.with_bank(native, bankfile.bank(parts, rates)))
    return path


def reference(rate_hz: float = RATES[0], parts: Sequence[Preset] = PARTS) -> Engine:
    """The engine that the plugin is."""
    programs = np.full((16, 128), -1, np.int64)
    programs[:, : len(parts)] = np.arange(len(parts))
    made = Engine(parts, programs)
    made.prepare(rate_hz, 4096)
    made.reserve(1 << 14)
    return made


def parameter_id(instance: Instance, part: int, index: int, parts: Sequence[Preset] = PARTS) -> int:
    """What the host knows a live parameter by: they come in the order of the description."""
    rows = describe(parts).parameters
    k = next(k for k, row in enumerate(rows) if (row.part, row.index) == (part, index))
    return instance.params[k].id


def wild(seed: int, count: int, frames: int, parts: Sequence[Preset] = PARTS) -> np.ndarray:
    """What can be played on three channels: all kinds of events, MPE and tunings among them."""
    rng = np.random.default_rng(seed)
    out = random_events(rng, count, frames, 3, (28, 55))
    there = {(row.part, row.index) for row in describe(parts).parameters}
    kept = []
    for row in out:
        if row["kind"] == PARAMETER and (int(row["channel"]), int(row["a"])) not in there:
            continue
        if row["kind"] == NOTE_ON and row["b"] == 0:
            row["kind"] = NOTE_OFF
        kept.append(tuple(row))
        frame = int(row["frame"])
        if rng.random() < 0.05:
            kept.append((frame, PRESSURE, int(rng.integers(3)), 0, int(rng.integers(128)), 0.0))
            kept.append((frame, KEY_PRESSURE, int(rng.integers(3)), int(rng.integers(28, 56)), int(rng.integers(128)), 0.0))
        if rng.random() < 0.05:
            key = int(rng.integers(28, 56))
            kept.append((frame, TUNING, 0, key, int(rng.integers(2)), key + float(rng.uniform(-1, 1))))
        if rng.random() < 0.01:  # an MPE zone begins or ends
            kept += [(frame, CONTROL, 0, a, b, 0.0) for a, b in ((101, 0), (100, 6), (6, int(rng.integers(0, 4))))]
    return make_events(kept)


def to_host(row: np.void, instance: Instance, notes_as: str, parts: Sequence[Preset] = PARTS) -> Any:
    """An event as the host sends it; notes as "clap" or "midi"."""
    frame, kind, channel, a, b = (int(row[name]) for name in ("frame", "kind", "channel", "a", "b"))
    if kind == PARAMETER:
        return abi.param(frame, parameter_id(instance, channel, a, parts), float(row["value"]))
    if kind == TUNING:
        return abi.sysex(frame, b"\xf0" + of_tuning(a, float(row["value"]), bool(b)) + b"\xf7")
    if kind == NOTE_ON and notes_as == "clap":
        return abi.note_on(frame, a, b / 127.0, channel)
    if kind == NOTE_OFF and notes_as == "clap":
        return abi.note_off(frame, a, channel)
    if kind == BEND:
        a, b = (a + 8192) & 127, (a + 8192) >> 7
    if kind == PRESSURE:
        a, b = b, 0
    return abi.midi(frame, _STATUS[kind] | channel, a, b)


def blocks_of(rows: np.ndarray, frames: int, sizes: Iterable[int]) -> Iterator[tuple[int, int, np.ndarray]]:
    """(first frame, frames, its events) of every block."""
    rows = rows[np.argsort(rows["frame"], kind="stable")]
    begin = 0
    for size in cycle(list(sizes)):
        if begin >= frames:
            return
        size = min(size, frames - begin)
        here = rows[(rows["frame"] >= begin) & (rows["frame"] < begin + size)].copy()
        here["frame"] -= begin
        yield begin, size, here
        begin += size


def hear(
    instance: Instance,
    rows: np.ndarray | Iterable[tuple],
    frames: int,
    sizes: Iterable[int] = (256,),
    kind: Any = np.float64,
    notes_as: str = "clap",
    parts: Sequence[Preset] = PARTS,
) -> np.ndarray:
    """(frames, 2) from the plugin."""
    events = rows if isinstance(rows, np.ndarray) else make_events(list(rows))
    out = np.zeros((frames, 2), kind)
    for begin, size, here in blocks_of(events, frames, sizes):
        given = [to_host(row, instance, notes_as, parts) for row in here]
        out[begin : begin + size] = instance.process(given, size, kind)
    return out


def truth(made: Engine, rows: np.ndarray | Iterable[tuple], frames: int, size: int = 1000) -> np.ndarray:
    """(frames, 2) from the engine."""
    events = rows if isinstance(rows, np.ndarray) else make_events(list(rows))
    out = np.zeros((frames, 2))
    for begin, count, here in blocks_of(events, frames, (size,)):
        made.process(here.astype(EVENT), out[begin : begin + count])
    return out


def loudest(sound: np.ndarray) -> float:
    """The largest magnitude."""
    return float(np.abs(sound).max(initial=0.0))


GAIN, POSITION, HEIGHT = layout.GAIN, layout.PLUCK_POSITION, layout.HEIGHT
