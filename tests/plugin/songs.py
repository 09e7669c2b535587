"""What is played to plugins, and what the engine makes of it in Python."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from synth.engine.engine import Engine
from synth.instrument.preset import Preset
from synth.midi.events import EVENT, PARAMETER, make_events
from synth.midi.stream import MidiStream
from tests.engine.kit import FREE, NECK, play

#: of the bank that the tests of plugins play: nothing to touch, and a fretted neck
PRESETS = (FREE, NECK)
RATES_HZ = (44100.0, 48000.0)

#: controllers that the engine reads, on any channel
LEVELS = (7, 10, 11, 64, 74)


@dataclass
class Song:
    """MIDI messages (frame, bytes) and changes (frame, number of the parameter, value), each in order."""

    frames: int
    messages: list[tuple[int, bytes]] = field(default_factory=list)
    changes: list[tuple[int, int, float]] = field(default_factory=list)


def random_song(rng: np.random.Generator, frames: int, *, count: int = 120) -> Song:
    """Notes, controllers, bends, pressures, programs of three channels, no two at one frame."""
    song = Song(frames)
    for frame in np.sort(rng.choice(frames, count, replace=False)):
        channel, key = int(rng.choice([0, 1, 9])), int(rng.integers(40, 57))
        value, kind = int(rng.integers(1, 128)), rng.random()
        if kind < 0.5:
            data = bytes([0x90 | channel, key, value])
        elif kind < 0.65:
            data = bytes([0x80 | channel, key, value])
        elif kind < 0.8:
            data = bytes([0xB0 | channel, int(rng.choice(LEVELS)), value])
        elif kind < 0.88:
            data = bytes([0xE0 | channel, value, int(rng.integers(128))])
        elif kind < 0.92:
            data = bytes([0xD0 | channel, value])
        elif kind < 0.94:
            data = bytes.fromhex(f"f07f7f080200 01 {key:02x} {key:02x} {value:02x} 00 f7")  # one key tuned, by MTS
        elif kind < 0.97:
            data = bytes([0xA0 | channel, key, value])
        else:
            data = bytes([0xC0 | channel, int(rng.integers(2))])
        song.messages.append((int(frame), data))
    return song


def events_of(messages: Iterable[tuple[int, bytes]]) -> list[tuple[int, int, int, int, int, float]]:
    """Rows of `make_events` of MIDI messages, as the program reads them from a port."""
    rows: list[tuple[int, int, int, int, int, float]] = []

    def sink(kind: int, channel: int, a: int, b: int, value: float, frame: int) -> bool:
        rows.append((frame, kind, channel, a, b, value))
        return True

    stream = MidiStream(sink)
    for frame, data in messages:
        stream.feed(data, frame)
    return rows


def engine_of(presets: Sequence[Preset], rate_hz: float) -> Engine:
    """The engine that a bank of these presets holds: each is a program of every channel."""
    program_map = None
    if len(presets) > 1:
        program_map = np.full((16, 128), -1, np.int64)
        program_map[:, : len(presets)] = np.arange(len(presets))
    made = Engine(presets, program_map)
    made.prepare(rate_hz, 4096)
    return made


def truth(presets: Sequence[Preset], rate_hz: float, song: Song, *, more: Iterable[tuple] = ()) -> np.ndarray:
    """(frames, 2) of a song; more: rows of events beside it."""
    made = engine_of(presets, rate_hz)
    live = made.parameters
    rows = [*events_of(song.messages), *more]
    rows += [(frame, PARAMETER, live[k].part, live[k].index, 0, value) for frame, k, value in song.changes]
    events = make_events(rows) if rows else np.zeros(0, EVENT)
    return play(made, events, song.frames, 1024)
