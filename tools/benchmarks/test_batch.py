"""Many notes at once against the bare engine: notes a second on one and more cores."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from benchmarks import scenes
from benchmarks.conftest import noted
from synth.host.alone import BLOCK
from synth.host.batch import render_notes
from synth.midi.events import NOTE_ON, make_events

pytestmark = pytest.mark.page

#: presets whose notes cost little and much, and their notes
PRESETS = {"jawari-harp": range(36, 84, 2), "fretted-bass": range(28, 52)}
VELOCITIES = (50, 70, 90, 110)
SECONDS = 3.0


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("preset", PRESETS)
def test_many_notes(benchmark: Any, preset: str, threads: int, short: bool, all_cores: Any) -> None:
    all_cores()
    notes = [(key, velocity, SECONDS) for key in PRESETS[preset] for velocity in VELOCITIES[:: 2 if short else 1]]
    found: dict[str, list[float]] = {"bare": [], "seconds": [], "whole": []}
    engine = scenes.engine_of([scenes.load_preset(preset)], "standard", [set(PRESETS[preset])], limiter=False)
    engine.prepare(scenes.RATE_HZ, BLOCK)
    out = np.zeros((BLOCK, 2))

    def bare() -> float:
        """The engine alone, reset before each note; nothing is kept of the sound."""
        began = time.perf_counter()
        for key, velocity, seconds in notes:
            engine.reset()
            due = make_events([(0, NOTE_ON, 0, key, velocity)])
            for at in range(0, round(seconds * scenes.RATE_HZ), BLOCK):
                engine.process(due, out[: round(seconds * scenes.RATE_HZ) - at])
                due = due[:0]
        return time.perf_counter() - began

    def batch(times: int) -> float:
        began = time.perf_counter()
        for each in render_notes(preset, notes * times, threads=threads):
            assert not each.error
        return time.perf_counter() - began

    def in_turn() -> None:
        found["bare"].append(bare())
        found["whole"].append(batch(1))
        found["seconds"].append(batch(2) - found["whole"][-1])  # what is prepared once is in both

    in_turn()
    for times in found.values():
        times.clear()
    benchmark.pedantic(in_turn, rounds=1 if short else 3, iterations=1)
    noted(benchmark, "batch", preset=preset, threads=threads, notes=len(notes), **found, **scenes.vectors_of(engine))
