"""What a plugin's drone is to play, worked out beside it: its strokes in a song of a host."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from synth.drone.cycle import Cycle, Drone
from synth.engine import layout
from synth.engine.engine import Engine
from synth.instrument.preset import load_preset
from synth.midi.events import EVENT, NOTE_OFF, NOTE_ON, PARAMETER
from synth.plugin import bankfile, library
from synth.plugin.droning import CYCLES, DroneSettings
from tests.engine.kit import play

RATE = 44100.0
SETTINGS = DroneSettings(130.8, cents=(1.0, -2.0, 0.0, 0.5), cycle=Cycle(1.3, human=1.0, seed=7), beats=4)
DRONE = SETTINGS.on(load_preset("tanpura-light"))
KEYS = DRONE.strings.keys
OFF, ON, WITH_HOST = range(3)
MODE, PACE, SECONDS, BEATS, VELOCITY, TONIC = range(6)


def plugin_file(native: Path, folder: Path, rates: Sequence[float]) -> Path:
    """A plugin with the drone, which all formats share."""
    path = folder / "tanpura-light-drone.clap"
    data = bankfile.bank([DRONE.strings.preset], rates, name="tanpura-light-drone", drone=DRONE)
    path.write_bytes(library.with_bank(native, data))
    return path


def truth(engine: Engine, events: np.ndarray, frames: int) -> np.ndarray:
    engine.reset()
    play(engine, np.zeros(0, EVENT), 2048, 1024)  # what a reset leaves to fade
    engine.reset()
    return play(engine, events, frames, 1024)


def of_drone(frames: int, cycle: Cycle = SETTINGS.cycle, start: int = 0) -> np.ndarray:
    return Drone(DRONE.strings, cycle, RATE, start=start).events(frames)


def rows(number: int, frame: int, before: int | None) -> list[tuple]:
    """A stroke of the score at a frame, as `synth.drone` has it; before: the one that is let go."""
    pluck, string = DRONE.strings.preset.pluck, number % len(KEYS)
    place = number // len(KEYS) % CYCLES + sum(DRONE.gaps[:string])
    varied = SETTINGS.cycle.variation(number % (CYCLES * len(KEYS)), place, min(DRONE.gaps))
    out = [] if before is None else [(frame, NOTE_OFF, 0, KEYS[before % len(KEYS)], 64, 0.0)]
    out.append((frame, PARAMETER, 0, layout.PLUCK_POSITION, 0, pluck.position + varied.farther))
    out.append((frame, PARAMETER, 0, layout.PLUCK_WIDTH, 0, pluck.width_mm * varied.wider))
    velocity = min(max(round(SETTINGS.cycle.velocity * varied.louder), 1), 127)
    return [*out, (frame, NOTE_ON, 0, KEYS[string], velocity, 0.0)]


def beat_of(number: int, beats: float = SETTINGS.beats) -> float:
    """Where in the song a stroke stands: the host is the grid, which does not wander."""
    string = number % len(KEYS)
    whole = number // len(KEYS)
    varied = SETTINGS.cycle.variation(
        number % (CYCLES * len(KEYS)), whole % CYCLES + sum(DRONE.gaps[:string]), min(DRONE.gaps)
    )
    return (whole + sum(DRONE.gaps[:string]) + varied.sway - varied.wander) * beats


class Song:
    """A host that plays: what it says of itself at each frame, and what the drone is to play then."""

    def __init__(self, *parts: tuple[int, bool, float | None, float | None]) -> None:
        self.parts = parts  # from this frame on: whether it plays, its beat there, its tempo

    def at(self, frame: int) -> tuple[bool, float | None, float | None]:
        begin, playing, beat, tempo = max((part for part in self.parts if part[0] <= frame), key=lambda part: part[0])
        if playing and beat is not None and tempo is not None and math.isfinite(tempo):
            beat += (frame - begin) * tempo / (60.0 * RATE)
        return playing, beat, tempo


def strokes(
    song_part: tuple[int, float, float], until: int, beats: float = SETTINGS.beats, number: int | None = None
) -> list[tuple[int, int]]:
    """(number, frame) of what is plucked while the host plays on from (frame, beat, tempo); number: of the first, if it is
    not the next in the grid."""
    begin, beat, tempo = song_part
    if number is None:
        number = math.floor(beat / beats) * len(KEYS)
        while number // len(KEYS) + sum(DRONE.gaps[: number % len(KEYS)]) < beat / beats - 1e-6:
            number += 1
    out = []
    while True:
        frame = max(begin + round((beat_of(number, beats) - beat) * 60.0 / tempo * RATE), begin)
        if frame >= until:
            return out
        out.append((number, frame))
        number += 1


def played(*numbered: list[tuple[int, int]]) -> list[tuple]:
    """Rows of strokes one after the other."""
    out: list[tuple] = []
    before = None
    for number, frame in (each for part in numbered for each in part):
        out += rows(number, frame, before)
        before = number
    return out
