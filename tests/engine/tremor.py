"""Effects for tests: one that remembers and counts, one that is late."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field

from synth.dsp.effect import Effect, openers
from synth.instrument.effects import EffectTable, register
from synth.native.arrays import f8, i8
from synth.native.views import frames_at


class Tremor(EffectTable):
    """Loud and soft in turn."""

    kind: Literal["tremor"]
    period_ms: float = Field(ge=1.0, le=1000.0)
    depth: float = Field(0.5, ge=0.0, le=1.0)
    late_frames: int = Field(0, ge=0, le=256)


class Made(NamedTuple):
    step: float
    depth: float
    late: int


class State(NamedTuple):
    line: Annotated[np.ndarray, f8("late + 1, channels")]
    frames: Annotated[np.ndarray, i8("1")]


_made, _state = openers(Made, State)


def _make(settings: Tremor, rate_hz: float) -> Made:
    return Made(2e3 * math.pi / (settings.period_ms * rate_hz), settings.depth, settings.late_frames)


def _at_rest(made: Made, channels: int) -> State:
    return State(np.zeros((made.late + 1, channels)), np.zeros(1, np.int64))


def _process(effect: int, x: int, frames: int, channels: int) -> None:
    made, state, samples = _made(effect), _state(effect), frames_at(x, frames, channels)
    for i in range(frames):
        gain = 1.0 - made.depth * 0.5 * (1.0 - math.cos(made.step * state.frames[0]))
        for c in range(channels):
            place = state.frames[0] % state.line.shape[0]
            state.line[place, c] = gain * samples[i, c]
            samples[i, c] = state.line[(place + 1) % state.line.shape[0], c]
        state.frames[0] += 1


def _silent(effect: int) -> int:
    line = _state(effect).line
    loudest = 0.0
    for i in range(line.shape[0]):
        for c in range(line.shape[1]):
            loudest = max(loudest, abs(line[i, c]))
    return 1 if loudest < 1e-12 else 0


def _latency(made: Made) -> int:
    return made.late


TREMOR = register(Effect("tremor", _make, _at_rest, _process, _silent, Tremor, _latency))


def shape(frames: np.ndarray, table: Tremor, rate_hz: float) -> np.ndarray:
    """Readable twin: the gain at so many frames after the first."""
    return 1.0 - 0.5 * table.depth * (1.0 - np.cos(2e3 * np.pi / (table.period_ms * rate_hz) * frames))
