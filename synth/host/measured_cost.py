"""What a preset costs here and now: it is played and timed."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from synth.engine.engine import Engine
from synth.engine.engine_settings import EngineSettings
from synth.instrument.preset import Preset, playable_notes
from synth.midi.events import NOTE_ON, make_events

#: frames of a block, seconds that are played, between two strokes, and how hard they are
BLOCK, PLAYED_S, EVERY_S, VELOCITY = 128, 4.0, 0.25, 100
#: strokes, of which each is another open string or note from low to high
STROKES = 12


@dataclass(frozen=True)
class Cost:
    """real_time_factor: seconds of sound per second of one core; worst_block: largest share of its time that a block of
    `BLOCK` frames took, median_block; strings that sounded at most."""

    real_time_factor: float
    median_block: float
    worst_block: float
    strings: int


def measure_cost(
    preset: Preset,
    *,
    rate_hz: float,
    settings: EngineSettings,
) -> Cost:
    """Time a preset whose notes are struck one after the other, held, on this machine; processor time of one thread.

    Raises PresetError where it cannot be played.
    """
    notes = playable_notes(preset)
    struck = sorted({notes[i * (len(notes) - 1) // max(1, STROKES - 1)] for i in range(STROKES)})
    engine = Engine(
        [preset],
        settings=settings.of_engine(limiter=False),
        only_notes=[set(struck)],
        every_fret=False,
        warn=lambda text: None,
    )
    engine.prepare(rate_hz, BLOCK)
    blocks = []
    for played in (False, True):  # what a first call waits for is no cost of the sound
        engine.reset()
        out = np.zeros((BLOCK, 2))
        frames = round(PLAYED_S * rate_hz) // BLOCK * BLOCK if played else 8 * BLOCK
        due = [(round(k * EVERY_S * rate_hz), struck[k % len(struck)]) for k in range(int(PLAYED_S / EVERY_S))]
        for at in range(0, frames, BLOCK):
            events = make_events(
                [(frame - at, NOTE_ON, 0, note, VELOCITY) for frame, note in due if at <= frame < at + BLOCK]
            )
            begun = time.thread_time()
            engine.process(events, out)
            if played:
                blocks.append((time.thread_time() - begun) * rate_hz / BLOCK)
    taken = np.array(blocks)
    most = engine.report().most_strings
    return Cost(float(1.0 / taken.mean()), float(np.median(taken)), float(taken.max()), most)
