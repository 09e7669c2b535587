"""What the engine plays here: one note, a demo song, 64 tanpura strings."""

from __future__ import annotations

import inspect
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import REPOSITORY
from synth.engine.engine import Engine
from synth.instrument.preset import Preset, load_preset, parse_preset, playable_range
from synth.instrument.qualities import FLOAT32, FLOAT64
from synth.midi.events import EVENT, NOTE_ON, make_events
from synth.midi.song import read_song
from synth.native.denormals import enable_ftz, restore
from synth.solver.lanes import LANES
from synth.solver.stringmodel import FREE
from synth.units import midi_to_note

RATE_HZ = 44_100
#: frames that an offline render hands over at a time
BLOCK = 1024
#: the scene of many strings: lowest and highest note [MIDI], time between two plucks [s], velocity
LOWEST, HIGHEST, APART_S, VELOCITY = 36, 48, 0.02, 100
MANY = 64
SONGS = {"drone": "tanpura-light", "bassline": "fretted-bass"}
QUALITIES = ("draft", "standard", "fine")
#: an engine without this argument, by its name or among its options, has one thread
HAS_THREADS = bool({"threads", "options"} & set(inspect.signature(Engine).parameters))


@dataclass
class Player:
    """A prepared engine and what it is to play: `play` from the start, block by block."""

    engine: Engine
    events: np.ndarray
    seconds: float
    #: by length of a block: the events of each block
    _due: dict[int, list[np.ndarray]] = field(default_factory=dict, init=False, repr=False)

    @property
    def frames(self) -> int:
        return round(self.seconds * RATE_HZ)

    def play(self, block: int = BLOCK) -> None:
        """From silence to the end; nothing is kept of the sound."""
        self.engine.reset()
        for _ in self.blocks(block):
            pass

    def blocks(self, block: int, clock: Callable[[], float] = time.perf_counter):
        """The seconds that each block takes, wall-clock time unless said; the last may be shorter."""
        out = np.zeros((block, 2))
        for number, due in enumerate(self.due(block)):
            some = out[: min(block, self.frames - number * block)]
            started = clock()
            self.engine.process(due, some)
            yield clock() - started

    def due(self, block: int) -> list[np.ndarray]:
        """The events of each block, their frames counted from its beginning; found once, so no round's time contains the
        search."""
        if block not in self._due:
            begins = np.arange(0, self.frames, block)
            within = self.events[self.events["frame"] < self.frames].copy()
            each = np.split(within, np.searchsorted(within["frame"], begins[1:]))
            for events, begin in zip(each, begins, strict=True):
                events["frame"] -= begin
            self._due[block] = each
        return self._due[block]


def engine_of(
    presets: list[Preset], quality: str, notes: list[set[int]] | None = None, threads: int = 1, **more: Any
) -> Engine:
    """A prepared engine; `threads` are for one that has them."""
    if HAS_THREADS:
        more["threads"] = threads
    engine = Engine(presets, quality=quality, only_notes=notes, **more)
    engine.prepare(RATE_HZ, BLOCK)
    return engine


def vectors_of(engine: Engine) -> dict[str, Any]:
    """precision and lanes of what it computes its strings' modes with."""
    single = engine.has_single
    return {"precision": FLOAT32 if single else FLOAT64, "lanes": 2 * LANES if single else LANES}


def note(preset: str, midi: int, velocity: int, quality: str, seconds: float, **more: Any) -> Player:
    """One note of a preset, held."""
    engine = engine_of([load_preset(preset)], quality, [{midi}], **more)
    return Player(engine, make_events([(0, NOTE_ON, 0, midi, velocity)]), seconds)


def three_notes(preset: str) -> tuple[int, int, int]:
    """Lowest, middle and highest note [MIDI]; the middle one is a note that some string plays."""
    loaded = load_preset(preset)
    low, high = playable_range(loaded)
    ranges = [table.notes for table in loaded.string]
    played = [n for n in range(low, high + 1) if any(a <= n <= b for a, b in ranges)] or [low, high]
    return low, min(played, key=lambda n: abs(n - (low + high) / 2)), high


def song(name: str, quality: str = "standard") -> Player:
    """A demo song with the preset of `tools/demo`, and two seconds after its end."""
    found = read_song(REPOSITORY / "presets" / "demos" / f"{name}.mid", RATE_HZ)
    keys = set().union(*found.keys.values())
    engine = engine_of([load_preset(SONGS[name])], quality, [keys])
    return Player(engine, found.events, found.length_s + 2.0)


def many_strings(count: int = MANY) -> Preset:
    """The tanpura with `count` strings, each with a pitch of its own between LOWEST and HIGHEST, and the tanpura's plan."""
    preset = parse_preset(many_strings_text(REPOSITORY / "presets", count), f"{count} tanpura strings")
    return preset.with_measured(load_preset("tanpura-light").measured)


def many_strings_text(presets: Path, count: int = MANY) -> str:
    """The file of `many_strings`, from the tanpura of a folder. Strings of a note are its Sa; those in between are off by
    some cents. Raises ValueError where the tanpura has other strings than the scene is made of."""
    text = (presets / "tanpura-light.toml").read_text(encoding="utf-8")
    before, *tables = text.split("[[string]]\n")
    behind = tables[-1].partition("\n\n")[2]
    if len(tables) != 4 or 'name = "Sa 1"' not in tables[1]:
        raise ValueError("presets/tanpura-light.toml has other strings than the scene is made of")
    same = [line for line in tables[1].splitlines() if line and not line.startswith(("name", "notes"))]
    strings = []
    for i in range(count):
        pitch = LOWEST + (HIGHEST - LOWEST) * i / max(1, count - 1)
        whole = round(pitch)
        own = [f'notes = "{midi_to_note(whole)}"', f"cents = {100.0 * (pitch - whole):.2f}"]
        strings.append("\n".join(["[[string]]", *own, *same, ""]))
    behind = behind.replace("polyphony = 4", f"polyphony = {max(4, count)}")
    return "\n".join([before, *strings, behind])


def crowd(count: int = MANY, seconds: float = 4.0, quality: str = "standard", threads: int = 1) -> Player:
    """`count` strings, each plucked once, one after the other; `first_full` s later all sound."""
    preset = many_strings(count)
    engine = engine_of([preset], quality, None, threads)
    rows = plucks(preset)
    return Player(engine, make_events(rows) if rows else np.zeros(0, EVENT), seconds)


def plucks(preset: Preset) -> list[tuple[int, int, int, int, int]]:
    """Each string once, one after the other, as `make_events` takes them."""
    first = [table.notes[0] for table in preset.string]
    return [(round(i * APART_S * RATE_HZ), NOTE_ON, 0, note, VELOCITY) for i, note in enumerate(first)]


def first_full(count: int = MANY) -> float:
    """When the last string of `crowd` has been let go [s]."""
    return count * APART_S + 0.1


def touching(engine: Engine) -> np.ndarray:
    """(strings,) which of them are awake, not certified free, and at a contact no more than a picometre above it."""
    sounding, strings = engine._sounding, engine._strings
    on = np.zeros(sounding.voices.size, bool)
    for s, state in enumerate(strings.states.items):
        if not sounding.voices["awake"][s] or state.counts[FREE]:
            continue
        model = strings.models[sounding.hands["model"][s]]
        n, c = model.modes, model.contacts.size
        on[s] = np.any(model.contacts.shapes[:, :n] @ state.q[:n] <= state.eta[:c] + 1e-12)
    return on


def stalls(seconds: float, many: int) -> np.ndarray:
    """Wall-clock times of `many` loops that do nothing but take about `seconds`: what the machine itself adds."""
    turns = 64
    flush = enable_ftz()
    try:
        while _spin_s(turns) < seconds:
            turns *= 2
        turns = max(1, math.floor(turns * seconds / _spin_s(turns)))
        return np.array([_spin_s(turns) for _ in range(many)])
    finally:
        restore(flush)


def _spin_s(turns: int) -> float:
    from benchmarks.peak import peak_loop

    loop = peak_loop(LANES)
    started = time.perf_counter()
    loop(turns)
    return time.perf_counter() - started
