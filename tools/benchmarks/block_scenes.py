"""What makes single blocks dear: frets taken over with the legato pedal, notes before the last ones died, bent chords."""

from __future__ import annotations

import math
import random

from benchmarks import scenes
from synth.instrument.preset import load_preset
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, make_events

PRESET = "fretted-bass"
OPEN = (28, 33, 38, 43)


def _player(rows: list[tuple], notes: set[int], seconds: float) -> scenes.Player:
    rows = [(round(at * scenes.RATE_HZ), *row) for at, *row in rows]
    engine = scenes.engine_of([load_preset(PRESET)], "standard", [notes])
    return scenes.Player(engine, make_events(sorted(rows, key=lambda row: row[0])), seconds)


def legato(count: int = 80, apart_s: float = 0.06) -> scenes.Player:
    """One string's frets, up and down at random, each taken over from the one before."""
    rng, rows, last = random.Random(1), [(0.0, CONTROL, 0, 68, 127)], -1
    lowest = OPEN[2]
    for number in range(count):
        note = lowest + int(12 * rng.random())
        note += note == last
        at = 0.01 + number * apart_s
        rows.append((at, NOTE_ON, 0, note, 90))
        if last >= 0:
            rows.append((at + 2e-4, NOTE_OFF, 0, last, 0))
        last = note
    return _player(rows, set(range(lowest, lowest + 13)), 0.5 + count * apart_s)


def dense(count: int = 80, apart_s: float = 0.05) -> scenes.Player:
    """All strings in turn, each plucked anew before it has died, on frets and at velocities at random."""
    rng, rows = random.Random(2), []
    for number in range(count):
        note, velocity = OPEN[number % len(OPEN)] + int(5 * rng.random()), 60 + int(60 * rng.random())
        at = 0.01 + number * apart_s
        rows += [(at, NOTE_ON, 0, note, velocity), (at + 1.5 * apart_s, NOTE_OFF, 0, note, 0)]
    return _player(rows, {note + fret for note in OPEN for fret in range(5)}, 0.5 + count * apart_s)


def bends(seconds: float = 2.0) -> scenes.Player:
    """All open strings, bent up and down together twice a second without a stop."""
    rows: list[tuple] = [(0.0, NOTE_ON, 0, note, 100) for note in OPEN]
    rows += [(0.3 + 0.005 * k, BEND, 0, round(6000 * math.sin(0.02 * math.pi * k))) for k in range(round(seconds / 0.005))]
    return _player(rows, set(OPEN), 1.0 + seconds)


SCENES = {"dense legato": legato, "dense notes": dense, "bends": bends}
