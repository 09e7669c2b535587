"""Strings that share a bridge: notes, chords, bends and vibrato, sixty strings at once, a plain loop of the same physics.

tools/bench --only coupled
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from benchmarks import coupled_scenes, scenes
from benchmarks.conftest import Race, block_rounds, noted
from benchmarks.count import block_times
from benchmarks.coupled_scenes import BLOCK, GESTURES, LIVE_BLOCK, RINGING, SIXTY, SIXTY_STRINGS, STRUMMED, TWELVE
from benchmarks.test_targets import real_time, row
from synth.instrument.preset import list_presets

pytestmark = pytest.mark.page

#: what the engine and the plain loop play beside each other, in frames
_PLAIN_FRAMES = 1024


def _against_time(race: Race, player: scenes.Player, block: int, short: bool, key: str, what: str) -> None:
    """A row of the targets: × real time of what a player plays in blocks of so many frames."""
    race(lambda: player.play(block), rounds=3 if short else 5)
    rows = [row(key, what, "× real time", *real_time(player.seconds, race.seconds))]
    race.note("targets", rows=rows, **scenes.vectors_of(player.engine))


@pytest.mark.parametrize("preset", TWELVE)
def test_twelve_notes(race: Race, preset: str, short: bool) -> None:
    what = f"{preset}, twelve notes from low to high, as `synth plan {preset} --measure`"
    _against_time(race, coupled_scenes.twelve(preset), BLOCK, short, f"twelve/{preset}", what)


@pytest.mark.parametrize("preset", STRUMMED)
def test_strummed(race: Race, preset: str, short: bool) -> None:
    what = f"{preset}, six-string chords strummed without end"
    _against_time(race, coupled_scenes.strummed(preset), LIVE_BLOCK, short, f"strummed/{preset}", what)


@pytest.mark.parametrize("threads", [1, 2])
def test_sixty_strings(benchmark: Any, threads: int, short: bool, all_cores: Any) -> None:
    """Blocks of 64 frames, from the first stroke on: processor time of one thread, wall-clock time of two."""
    if threads > 1:
        all_cores()
    player = coupled_scenes.sixty(threads=threads)
    own = LIVE_BLOCK / scenes.RATE_HZ
    rounds = block_rounds(benchmark, player, LIVE_BLOCK, short, time.thread_time if threads == 1 else time.perf_counter)
    assert coupled_scenes.awake(player) == SIXTY_STRINGS
    found = block_times(rounds, own)
    key = "sixty" if threads == 1 else f"sixty/{threads}"
    what = f"{SIXTY_STRINGS} coupled strings on {len(SIXTY)} bridges, all but 13 tarafs struck, blocks of {LIVE_BLOCK}"
    reached = real_time(player.seconds, [sum(times) for times in rounds])
    rows = [
        row(key, what if threads == 1 else f"the same, {threads} threads, wall clock", "× real time", *reached),
        row(f"{key}/median", "their median block", "of its time", found["median"], None),
        row(f"{key}/worst", "their worst block", "of its time", found["worst"], None),
    ]
    noted(benchmark, "targets", rows=rows, **found, **scenes.vectors_of(player.engine))


def _presets() -> list:
    names = [each.name for each in list_presets()]
    return [pytest.param(name, marks=() if name in STRUMMED else pytest.mark.full) for name in names]


@pytest.mark.parametrize("preset", _presets())
def test_coupled_gestures(benchmark: Any, preset: str, short: bool) -> None:
    """Processor time of one note, plain, under a modulation wheel and under a bend wheel that moves, block by block in turn;
    each block counts with the least of its times."""
    players = coupled_scenes.gestures(preset)
    least: dict[str, np.ndarray] = {}

    def play() -> None:
        for gesture in GESTURES:
            players[gesture].engine.reset()
            times = np.array(list(players[gesture].blocks(LIVE_BLOCK, time.thread_time)))
            least[gesture] = np.minimum(least.get(gesture, np.inf), times)

    play()
    least.clear()
    benchmark.pedantic(play, rounds=2 if short else 3, iterations=1)
    seconds = {gesture: float(times.sum()) for gesture, times in least.items()}
    noted(
        benchmark, "gestures", preset=preset, coupled=players["plain"].engine.parts[0].coupled,
        times_real_time=players["plain"].seconds / seconds["plain"],
        **{gesture: seconds[gesture] / seconds["plain"] for gesture in GESTURES[1:]},
        **scenes.vectors_of(players["plain"].engine),
    )  # fmt: skip


@pytest.mark.parametrize("preset", RINGING)
def test_coupled_loop(race: Race, preset: str) -> None:
    """Open strings that ring, by the engine and by a plain Numba loop of the same physics from the same state on."""
    player = coupled_scenes.ringing(preset)
    plain = coupled_scenes.plain_of(player)
    none, out = player.events[:0], np.zeros((LIVE_BLOCK, 2))

    def ours() -> None:
        for _ in range(_PLAIN_FRAMES // LIVE_BLOCK):
            player.engine.process(none, out)

    race(ours, against={"plain": (lambda: plain.advance(_PLAIN_FRAMES), lambda: None)}, rounds=7)
    apart = coupled_scenes.difference(player, plain)
    sound, name = _PLAIN_FRAMES / scenes.RATE_HZ, f"ringing/{preset}"
    rows = [
        row(name, f"{preset}, open strings ringing, through the engine", "× real time", *real_time(sound, race.seconds)),
        row(f"{name}/plain loop", "the same in a plain Numba loop", "× real time", *real_time(sound, race.others["plain"])),
        row(f"{name}/apart", "difference of their displacements afterwards", "", apart, None),
    ]
    race.note("targets", rows=rows, **scenes.vectors_of(player.engine))
