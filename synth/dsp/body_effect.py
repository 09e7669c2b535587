"""The body as an effect: the direct sound, and the resonances' response added to it."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from synth.dsp.body import body_coefficients, body_filter
from synth.dsp.effect import Effect, openers, still
from synth.native.arrays import allocate, f8
from synth.native.views import frames_at
from synth.units import db_to_gain

#: frames that are worked on at a time
_PIECE = 32


class Made(NamedTuple):
    direct: float
    coefficients: Annotated[np.ndarray, f8("3, resonances")]
    dry: Annotated[np.ndarray, f8("PIECE")]  # a piece of the input; carries nothing from call to call


class State(NamedTuple):
    ringing: Annotated[np.ndarray, f8("3, resonances")]  # see `body_state`


_made, _state = openers(Made, State)


def _make(body: Any, rate_hz: float) -> Made:
    """body : the preset's table, `direct_db` and at least one `resonance`."""
    peaks = body.resonance
    return allocate(
        Made,
        {"resonances": len(peaks), "PIECE": _PIECE},
        direct=db_to_gain(body.direct_db),
        coefficients=body_coefficients(
            [peak.frequency_hz for peak in peaks], [peak.q for peak in peaks], [peak.gain_db for peak in peaks], rate_hz
        ),
    )


def _at_rest(made: Made, channels: int) -> State:
    if channels != 1:
        raise ValueError(f"a body has one channel, got {channels}; it belongs to a part")
    return allocate(State, {"resonances": made.coefficients.shape[1]})


def _process(effect: int, x: int, frames: int, channels: int) -> None:
    made = _made(effect)
    whole = frames_at(x, frames, channels).reshape(frames)
    for begin in range(0, frames, _PIECE):
        wet = whole[begin : min(begin + _PIECE, frames)]
        dry = made.dry[: wet.size]
        for i in range(wet.size):
            dry[i] = wet[i]
            wet[i] = made.direct * wet[i]
        body_filter(made.coefficients, _state(effect).ringing, dry, wet)


def _silent(effect: int) -> int:
    """Whether no resonance's last two outputs (nor the last input) are worth going on with."""
    return still(_state(effect).ringing)


BODY = Effect("body", _make, _at_rest, _process, _silent)
