"""Songs for hosts that are programs of others, and what comes back from them."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import numpy as np

from synth.instrument.preset import Preset, playable_range

from .songs import Song

SCRIPTS = Path(__file__).resolve().parent / "hosts"


def song_of(preset: Preset, frames: int, rng: np.random.Generator, controllers: bool) -> Song:
    """Notes, pedal and more on channel 1; no two messages at one frame. Levels and pans pass through floats unchanged."""
    low, high = playable_range(preset)
    song = Song(frames)
    for frame in np.sort(rng.choice(np.arange(100, frames - 100), frames // 4000 + 8, replace=False)):
        key, value = int(rng.integers(low, high + 1)), int(rng.integers(1, 128))
        kind = rng.random() if controllers else 0.0
        if kind < 0.6:
            data = [0x90, key, value] if rng.random() < 0.75 else [0x80, key, value]
        elif kind < 0.8:
            data = [0xB0, int(rng.choice([7, 10, 11, 64, 74])), value]
        elif kind < 0.9:
            data = [0xE0, value, int(rng.integers(128))]
        else:
            data = [0xD0, value]
        song.messages.append((int(frame), bytes(data)))
    return song


def at_blocks(song: Song, block: int) -> Song:
    """The song as hosts hand it over that know no frames of controllers: the last of each comes at the start of a block."""
    first = {}
    for frame, data in song.messages:
        if data[0] >> 4 not in (8, 9):
            first[frame // block, data[0], data[1] if data[0] >> 4 == 11 else 0] = (frame // block * block, data)
    notes = [row for row in song.messages if row[1][0] >> 4 in (8, 9)]
    return Song(song.frames, sorted([*first.values(), *notes], key=lambda row: row[0]))


def same(heard: np.ndarray, expected: np.ndarray, lags: range) -> str:
    """Whether what was heard is what was expected, some frames later or earlier."""
    best = (expected.size + 1, 0)
    for lag in lags:
        a, b = (heard[lag:], expected) if lag >= 0 else (heard, expected[-lag:])
        count = min(len(a), len(b))
        best = min(best, (int(np.count_nonzero(a[:count] != b[:count])), lag))
        if best[0] == 0:
            break
    if not np.abs(heard).max() > 0:
        return "silence"
    if best[0]:
        return f"{best[0]} of {expected.size} samples differ"
    return "the same bits" + (f", {best[1]:+d} frames" if best[1] else "")


def play(python: str | Path, host: str, job: dict, env: dict[str, str]) -> tuple[dict, str]:
    """What a host said of itself, and what went wrong."""
    command = [str(python), str(SCRIPTS / f"host_{host}.py"), json.dumps(job)]
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60, check=False)
    if done.returncode:
        return {}, (done.stderr.strip().splitlines() or [f"ended with {done.returncode}"])[-1]
    return json.loads(done.stdout.strip().splitlines()[-1]), ""
