"""What playing costs: notes of every preset at every quality, blocks of songs, and many strings at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchmarks import scenes
from benchmarks.conftest import Race, note_blocks
from synth.instrument.preset import list_presets
from synth.units import midi_to_note
from tests.engine.kit import go_on_from, what_sounds

BLOCKS = (64, 128, 256)


def _notes() -> list:
    found = []
    for preset in list_presets():
        for place, midi in zip(("lowest", "middle", "highest"), scenes.three_notes(preset.name), strict=True):
            for quality in scenes.QUALITIES:
                in_short = place == "middle" and quality == "standard"
                found.append(pytest.param(preset.name, midi, quality, marks=() if in_short else pytest.mark.full))
    return found


@pytest.mark.parametrize(("preset", "midi", "quality"), _notes())
def test_note(race: Race, preset: str, midi: int, quality: str) -> None:
    """The first second and a half of one held note."""
    player = scenes.note(preset, midi, 100, quality, 1.5)
    race(player.play, rounds=3)
    speed = [player.seconds / s for s in race.seconds]
    found = player.engine.compiled[0].strings[0]
    position = found.positions[0]
    race.note(
        "notes", preset=preset, note=midi_to_note(midi), quality=quality, times_real_time=float(np.median(speed)),
        best=max(speed), rate_hz=scenes.RATE_HZ * found.factor, modes=int(position.omega.size),
        contacts=int(position.eta.size), **scenes.vectors_of(player.engine),
    )  # fmt: skip


@pytest.mark.parametrize("block", BLOCKS)
@pytest.mark.parametrize("scene", [*(pytest.param(song, marks=pytest.mark.page) for song in scenes.SONGS), "64 strings"])
def test_blocks(benchmark: Any, scene: str, block: int, short: bool) -> None:
    """Wall-clock time of every block; then as many turns of a loop that does nothing, as long as a median block."""
    if scene in scenes.SONGS:
        player = scenes.song(scene)
        player.seconds = min(player.seconds, 8.0 if short else 60.0)
    else:
        player = scenes.crowd(scenes.MANY, scenes.first_full() + (0.5 if short else 2.0))
    note_blocks(benchmark, scene, player, block, short)


def _counts() -> list:
    return [pytest.param(n, marks=() if n in (1, 8, 64) else pytest.mark.full) for n in (1, 2, 4, 8, 16, 32, 64)]


@pytest.mark.parametrize("strings", _counts())
def test_strings(race: Race, strings: int) -> None:
    """Tanpura strings at standard, all plucked, from the last pluck on."""
    seconds = 0.5
    player = scenes.crowd(strings, scenes.first_full(strings) + seconds)
    engine, began = player.engine, round(scenes.first_full(strings) * scenes.RATE_HZ)
    engine.reset()
    engine.process(player.events, np.zeros((began, 2)))
    held = what_sounds(engine)
    out = np.zeros((scenes.BLOCK, 2))
    nothing = player.events[:0]
    blocks = round(seconds * scenes.RATE_HZ / scenes.BLOCK)

    def reset() -> None:
        go_on_from(engine, held)

    def play() -> None:
        for _ in range(blocks):
            engine.process(nothing, out)

    race(play, reset=reset, rounds=5)
    sound = blocks * scenes.BLOCK / scenes.RATE_HZ
    race.note(
        "strings", strings=strings, sounding=engine.report().strings_sounding,
        cpu_per_s=float(np.median(race.seconds)) / sound, best_cpu_per_s=min(race.seconds) / sound,
        **scenes.vectors_of(engine),
    )  # fmt: skip
