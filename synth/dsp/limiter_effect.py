"""The limiter as an effect: the last of the mix."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from synth.dsp.effect import Effect, openers, still
from synth.dsp.limiter import LOOKAHEAD, LimiterState, limit, limiter_problem, limiter_state, release_coefficient
from synth.native.arrays import f8, i8
from synth.native.views import frames_at


class Limiting(NamedTuple):
    """Settings: largest magnitude that may leave."""

    ceiling: float


class Made(NamedTuple):
    ceiling: float
    release: float


class State(NamedTuple):
    """`LimiterState`."""

    delay: Annotated[np.ndarray, f8("LOOKAHEAD, channels")]
    required: Annotated[np.ndarray, f8("2*WINDOW")]
    released: Annotated[np.ndarray, f8("2*WINDOW")]
    counters: Annotated[np.ndarray, i8("3")]
    levels: Annotated[np.ndarray, f8("2")]


_made, _state = openers(Made, State)


def _make(settings: Limiting, rate_hz: float) -> Made:
    return Made(settings.ceiling, release_coefficient(rate_hz))


def _at_rest(made: Made, channels: int) -> State:
    return State(*limiter_state(channels))


def _process(effect: int, x: int, frames: int, channels: int) -> None:
    made, state = _made(effect), _state(effect)
    limit(
        state.delay,
        state.required,
        state.released,
        state.counters,
        state.levels,
        made.ceiling,
        made.release,
        frames_at(x, frames, channels),
    )


def _silent(effect: int) -> int:
    state = _state(effect)
    return 0 if state.counters[2] != 0 else still(state.delay)


def _latency(made: Made) -> int:
    return LOOKAHEAD


def _problem(made: Made, state: State) -> str | None:
    return limiter_problem(LimiterState(*state), made.ceiling)


LIMITER = Effect("limiter", _make, _at_rest, _process, _silent, latency=_latency, problem=_problem)
