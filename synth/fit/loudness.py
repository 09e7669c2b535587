"""How a preset sounds in the phrase by which presets are made equally loud."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from synth.engine.engine import Engine
from synth.instrument.loudness_phrase import RATE_HZ, VELOCITY, loudness_phrase
from synth.instrument.preset import Preset


def phrase_sounds(preset: Preset, velocities: Sequence[int]) -> list[np.ndarray]:
    """(frames, 2) of the phrase at each velocity, at RATE_HZ, without a limiter."""
    engine: Engine | None = None
    sounds = []
    for velocity in velocities:
        events, frames = loudness_phrase(preset, velocity)
        if engine is None:
            engine = Engine([preset], limiter=False, only_notes=[set(events["a"].tolist())])
            engine.prepare(RATE_HZ)
        engine.reset()
        sound = np.zeros((frames, 2))
        engine.process(events, sound)
        sounds.append(sound)
    if engine is not None:
        engine.close()
    return sounds


def phrase_sound(preset: Preset, velocity: int = VELOCITY) -> np.ndarray:
    """The same at one velocity."""
    return phrase_sounds(preset, [velocity])[0]
