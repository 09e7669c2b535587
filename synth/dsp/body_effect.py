"""The body as an effect: the direct sound, and the resonances' response added to it, to each side its share."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from synth import panning
from synth.dsp.body import body_coefficients, body_filter
from synth.dsp.effect import Effect, openers, still
from synth.native.arrays import allocate, f8
from synth.native.views import frames_at
from synth.units import db_to_gain

#: frames that are worked on at a time
_PIECE = 32


class BodyConstants(NamedTuple):
    direct: float
    coefficients: Annotated[np.ndarray, f8("sides, 3, resonances")]


class BodyState(NamedTuple):
    ringing: Annotated[np.ndarray, f8("rows, resonances")]  # see `body_state`, of each side three rows
    dry: Annotated[np.ndarray, f8("PIECE")]  # a piece of a channel; carries nothing from call to call
    wet: Annotated[np.ndarray, f8("PIECE")]  # the same


_made, _state = openers(BodyConstants, BodyState)


def _make(body: Any, rate_hz: float) -> BodyConstants:
    """body : the preset's table, `direct_db` and `peaks`, at least one."""
    peaks = [peak for peak in body.peaks if not peak.of_field or peak.frequency_hz < 0.45 * rate_hz]
    whole = body_coefficients(
        [peak.frequency_hz for peak in peaks], [peak.q for peak in peaks], [peak.gain_db for peak in peaks], rate_hz
    )
    whole[0] *= [peak.sign for peak in peaks]
    sides = np.stack([whole] * (2 if body.wide else 1))
    if body.wide:  # of constant power, as channels are panned; the filter is linear in its first row
        sides[:, 0] *= np.sqrt(2.0) * panning.shares([peak.pan for peak in peaks])
    sizes = {"sides": len(sides), "resonances": len(peaks)}
    return allocate(BodyConstants, sizes, direct=db_to_gain(body.direct_db), coefficients=sides)


def _at_rest(made: BodyConstants, channels: int) -> BodyState:
    sides, rows, resonances = made.coefficients.shape
    if channels < sides:
        raise ValueError(f"this body has left and right, got a signal with {channels} channel; use it in a part")
    return allocate(BodyState, {"rows": channels * rows, "resonances": resonances, "PIECE": _PIECE})


def _process(effect: int, x: int, frames: int, channels: int) -> None:
    made, state = _made(effect), _state(effect)
    whole, sides = frames_at(x, frames, channels), made.coefficients.shape[0]
    for side in range(channels):
        ringing = state.ringing[3 * side : 3 * side + 3]
        for begin in range(0, frames, _PIECE):
            size = min(_PIECE, frames - begin)
            dry, wet = state.dry[:size], state.wet[:size]
            for i in range(size):
                dry[i] = whole[begin + i, side]
                wet[i] = made.direct * dry[i]
            body_filter(made.coefficients[min(side, sides - 1)], ringing, dry, wet)
            for i in range(size):
                whole[begin + i, side] = wet[i]


def _silent(effect: int) -> int:
    """Whether no resonance's last two outputs (nor the last input) are worth going on with."""
    return still(_state(effect).ringing)


BODY = Effect("body", _make, _at_rest, _process, _silent)
