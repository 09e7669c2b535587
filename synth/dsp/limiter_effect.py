"""The limiter as an effect: the last of the mix."""

from __future__ import annotations

from typing import NamedTuple

from synth.dsp.effect import Effect, openers, still
from synth.dsp.limiter import LOOKAHEAD, LimiterState, limit, limiter_state, release_coefficient
from synth.native.views import frames_at


class Limiting(NamedTuple):
    """Settings: largest magnitude that may leave."""

    ceiling: float


class LimiterConstants(NamedTuple):
    ceiling: float
    release: float


_made, _state = openers(LimiterConstants, LimiterState)


def _make(settings: Limiting, rate_hz: float) -> LimiterConstants:
    return LimiterConstants(settings.ceiling, release_coefficient(rate_hz))


def _at_rest(made: LimiterConstants, channels: int) -> LimiterState:
    return limiter_state(channels)


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


def _latency(made: LimiterConstants) -> int:
    return LOOKAHEAD


LIMITER = Effect("limiter", _make, _at_rest, _process, _silent, latency=_latency)
