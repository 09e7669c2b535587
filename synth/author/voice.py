"""An engine that sounds: prepared for the notes it is asked for, a phrase or live events in, samples out."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from synth.author.phrases import Phrase, phrase
from synth.engine.engine import Engine
from synth.host import offline
from synth.host.audiofile import float_wav
from synth.instrument.articulations import NORMAL
from synth.instrument.place import find
from synth.instrument.preset import Preset, load_preset
from synth.midi.events import EVENT, NOTE_ON, make_events

#: frames of a block, and of the largest that an engine here is given
BLOCK, MOST_BLOCK = 512, 4096
#: no voice sounds for longer after its last event [s]
LONGEST_S = 120.0
#: what follows a string's end: the decimator's and the limiter's memory [frames]
FLUSH = 2 * BLOCK


def prepared_engine(preset: Preset, notes: Iterable[int] | None, rate_hz: float, quality: str) -> Engine:
    """An engine for these notes of a preset (None: all that it plays). Raises PresetError."""
    wanted = None if notes is None else [set(notes)]
    engine = Engine([preset], quality=quality, only_notes=wanted, every_fret=wanted is None)
    engine.prepare(rate_hz, MOST_BLOCK)
    return engine


def phrase_preset(preset: Preset, phrase: Phrase) -> Preset:
    """The preset with no more strings than a phrase needs: a single note takes one, which `find` knows beforehand, and no
    articulations that only a key or a controller would choose and that go through all its frets."""
    struck = phrase.events["a"][phrase.events["kind"] == NOTE_ON]
    if len(struck) != 1:
        return preset
    alone = find(preset, int(struck[0])).preset
    reached = {name: each for name, each in alone.articulations.items() if not each.roams or name == NORMAL or each.velocity}
    return alone.model_copy(update={"articulations": reached})


def warm_up(rate_hz: float, quality: str) -> None:
    """Let every kernel run once: strings alone, over a bridge and over frets."""
    for name, note in (("tanpura-light", 48), ("fretted-bass", 45)):
        preset = load_preset(name)
        voice = Voice(prepared_engine(preset, {note}, rate_hz, quality), phrase("note", preset, note, 100, rate_hz))
        voice.next()


class Voice:
    """A prepared engine from silence on; its latency is taken out."""

    def __init__(self, engine: Engine, phrase: Phrase | None = None) -> None:
        engine.reset()
        self.engine = engine
        self._events = phrase.events if phrase is not None else np.zeros(0, EVENT)
        self._given = 0
        self._at = 0
        self._last_event = int(self._events["frame"].max(initial=0))
        self._live: list[tuple[int, ...]] = []
        self._flush = FLUSH
        self._block = np.zeros((BLOCK, 2))
        self._skip = engine.latency_samples

    def send(self, kind: int, channel: int, a: int, b: int = 0) -> None:
        """An event at the beginning of the next block."""
        self._live.append((0, kind, channel, a, b))
        self._last_event = max(self._last_event, self._at)
        self._flush = FLUSH

    def next(self) -> np.ndarray:
        """The next block (BLOCK, 2), valid until the next call."""
        while self._skip:
            frames = min(self._skip, BLOCK)
            self._process(np.zeros((frames, 2)))
            self._skip -= frames
        self._process(self._block)
        return self._block

    def _process(self, out: np.ndarray) -> None:
        end = int(np.searchsorted(self._events["frame"], self._at + len(out)))
        due = self._events[self._given : end].copy()
        due["frame"] -= self._at
        if self._live:
            due = np.concatenate((make_events(self._live), due))
            self._live.clear()
        self.engine.process(due, out)
        self._given = end
        self._at += len(out)
        if self.engine.silent and end == len(self._events):
            self._flush -= len(out)

    @property
    def ended(self) -> bool:
        """Nothing sounds, and nothing will unless an event comes."""
        return self._flush <= 0 and not self._live

    @property
    def overdue(self) -> bool:
        """It sounds on and on without an event, and is to fade."""
        return self._at - self._last_event > LONGEST_S * self.engine.rate_hz


def phrase_wav(engine: Engine, phrase: Phrase, seconds: float) -> bytes:
    """A WAV file (float) of a phrase from silence, as long as asked, without the engine's latency: what `synth render` makes
    of these events."""
    rate_hz = round(engine.rate_hz)
    frames = round(seconds * rate_hz)
    engine.reset()
    sink = _Memory(frames)
    events = phrase.events[phrase.events["frame"] < frames]
    offline.render(engine, events, offline.Span(0, frames, 0, False), rate_hz, sink, block=BLOCK)
    return float_wav(sink.samples[: sink.frames], rate_hz)


class _Memory:
    """A sink that keeps what it is given."""

    def __init__(self, frames: int) -> None:
        self.samples = np.zeros((frames, 2))
        self.frames = 0

    def write(self, block: np.ndarray) -> Any:
        self.samples[self.frames : self.frames + len(block)] = block
        self.frames += len(block)
