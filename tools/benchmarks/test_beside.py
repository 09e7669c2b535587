"""Ours beside what a user might run instead: FluidSynth, and a Karplus–Strong loop. In one run, in turn.

tools/bench --only beside
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from benchmarks import coupled_scenes, karplus_strong, scenes
from benchmarks.conftest import Race, nothing
from benchmarks.coupled_scenes import LIVE_BLOCK
from benchmarks.fluidsynth import FluidSynth, NotInstalled
from benchmarks.test_targets import real_time, row
from synth.midi.events import NOTE_OFF, NOTE_ON

pytestmark = pytest.mark.page

#: seconds that a note of the Karplus–Strong loop lasts after its key is up
_RELEASE_S = 0.1


class Music(NamedTuple):
    """What is played: words for it, its player at a quality, and the program of General MIDI (from 0) nearest to it."""

    what: str
    player: Any
    program: int


MUSIC = {
    "tanpura-light": Music("tanpura C3, 3 s", lambda quality: scenes.note("tanpura-light", 48, 100, quality, 3.0), 104),
    "fretted-bass": Music("fretted-bass E1, 3 s", lambda quality: scenes.note("fretted-bass", 28, 100, quality, 3.0), 33),
    "steel-guitar": Music(
        "steel-guitar, strummed chords", lambda quality: coupled_scenes.strummed("steel-guitar", quality=quality), 25
    ),
    "sitar": Music("sitar, twelve notes", lambda quality: coupled_scenes.twelve("sitar", quality), 104),
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "steel-guitar" else pytest.mark.full) for name in MUSIC]
)
def test_beside(race: Race, name: str, short: bool) -> None:
    """The same events in blocks of 64 frames by the engine at every quality, and by what else plays them."""
    music = MUSIC[name]
    players = {quality: music.player(quality) for quality in scenes.QUALITIES}
    ours = players["standard"]
    against = {
        quality: ((lambda each=each: each.play(LIVE_BLOCK)), nothing)
        for quality, each in players.items()
        if quality != "standard"
    }
    against["Karplus–Strong loop"] = ((lambda: plucked(ours)), nothing)
    sampler = None
    try:
        sampler = FluidSynth(music.program, scenes.RATE_HZ)
        assert np.abs(sampler.play(ours.events, ours.seconds, scenes.RATE_HZ, LIVE_BLOCK)).max() > 1e-3
        against["FluidSynth"] = (
            (lambda: sampler.play(ours.events, ours.seconds, scenes.RATE_HZ, LIVE_BLOCK)),
            sampler.reset,
        )
    except NotInstalled:
        pass
    try:
        race(lambda: ours.play(LIVE_BLOCK), against=against, rounds=3 if short else 5)
    finally:
        if sampler is not None:
            sampler.close()
    rows = [row(f"beside/{name}/standard", f"{music.what}, standard", "× real time", *real_time(ours.seconds, race.seconds))]
    for other, spent in race.others.items():
        rows.append(row(f"beside/{name}/{other}", f"… {other}", "× real time", *real_time(ours.seconds, spent)))
    race.note("targets", rows=rows, **scenes.vectors_of(ours.engine))


def plucked(player: scenes.Player) -> np.ndarray:
    """(frames,) of a player's notes, a Karplus–Strong string each, from key to key up."""
    out, events = np.zeros(player.frames), player.events
    for number, event in enumerate(events):
        if event["kind"] != NOTE_ON:
            continue
        off = (events["kind"] == NOTE_OFF) & (events["a"] == event["a"]) & (np.arange(events.size) > number)
        end = int(events["frame"][off][0] + _RELEASE_S * scenes.RATE_HZ) if off.any() else out.size
        frequency_hz = 440.0 * 2.0 ** ((int(event["a"]) - 69) / 12.0)
        karplus_strong.pluck(frequency_hz, out[int(event["frame"]) : end], scenes.RATE_HZ, int(event["b"]))
    return out
