"""A delay of whole frames: what keeps a part in time with those whose effects are late."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from synth.dsp.effect import Effect, openers, still
from synth.native.arrays import allocate, f8, i8
from synth.native.views import frames_at


class Delaying(NamedTuple):
    """Settings: by how much, at least 1."""

    frames: int


class DelayConstants(NamedTuple):
    frames: int


class DelayState(NamedTuple):
    line: Annotated[np.ndarray, f8("frames, channels")]
    place: Annotated[np.ndarray, i8("1")]


_made, _state = openers(DelayConstants, DelayState)


def _make(settings: Delaying, rate_hz: float) -> DelayConstants:
    return DelayConstants(settings.frames)


def _at_rest(made: DelayConstants, channels: int) -> DelayState:
    return allocate(DelayState, {"frames": made.frames, "channels": channels})


def _process(effect: int, x: int, frames: int, channels: int) -> None:
    state, samples = _state(effect), frames_at(x, frames, channels)
    place = state.place[0]
    for i in range(frames):
        for c in range(channels):
            leaving = state.line[place, c]
            state.line[place, c] = samples[i, c]
            samples[i, c] = leaving
        place = place + 1 if place + 1 < state.line.shape[0] else 0
    state.place[0] = place


def _silent(effect: int) -> int:
    return still(_state(effect).line)


def _latency(made: DelayConstants) -> int:
    return made.frames


DELAY = Effect("delay", _make, _at_rest, _process, _silent, latency=_latency)
