"""Pushes of the hand on the body that strings share: Hann pulses and what is unsteady about them, on the body's modes."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.chance import ROUGH, key_of, uneven
from synth.engine.core import bank_of, knock_of, settings_of, shared_of, stroke_of
from synth.engine.layout import CORE
from synth.solver.coupling import coupling_at

#: from where on what is unsteady about a push is numbered among the chances of its stroke
_UNSTEADY = 1 << 22


@njit(**CORE)
def begin_knock(core: int, s: int, force: float, delay_s: float) -> None:
    """The hand that plays a string begins to push on the body, if there is one; `force` at most [N]."""
    knock_of(core, s).force = force
    _begin(core, s, force, delay_s)


@njit(**CORE)
def knock_again(core: int, s: int, share: float) -> None:
    """As a note ends, the hand pushes with a share of the stroke's force, unless that push is not over."""
    knock = knock_of(core, s)
    if knock.steps == 0:
        _begin(core, s, share * knock.force, 0.0)


@njit(**CORE)
def _begin(core: int, s: int, force: float, delay_s: float) -> None:
    if shared_of(core).end_at[s] == 0:
        return
    rate_hz, part = settings_of(core).rate_hz, bank_of(core).parts[bank_of(core).strings[s].part]
    knock = knock_of(core, s)
    knock.push = force
    knock.step = -round(delay_s * rate_hz)
    knock.steps = max(2, round(part.knock_s * rate_hz))


@njit(**CORE)
def end_knock(core: int, s: int) -> None:
    """A push that is not over ends."""
    knock = knock_of(core, s)
    knock.step = knock.steps = 0


@njit(**CORE)
def knock_on(core: int, i: int, frames: int) -> None:
    """Coupling.body.ahead.knock: what all hands do to the body of an instrument in its next frames."""
    bank = bank_of(core)
    instrument, coupling = bank.instruments[i], coupling_at(shared_of(core).coupling_at[i])
    coupling.body.ahead.knocked[0] = 0
    if bank.parts[bank.strings[instrument.first_string].part].knock == 0.0:
        return
    for s in range(instrument.first_string, instrument.end_string):
        knock = knock_of(core, s)
        if knock.steps == 0:
            continue
        if coupling.body.ahead.knocked[0] == 0:
            coupling.body.ahead.knocked[0] = 1
            coupling.body.ahead.knock[:frames] = 0.0
        _push(core, s, frames, coupling.body.ahead.knock)
        knock.step += frames
        if knock.step >= knock.steps:
            end_knock(core, s)


@njit(**CORE)
def _push(core: int, s: int, frames: int, into) -> None:
    """Add the next frames of one push."""
    fixed, stroke, knock = bank_of(core).strings[s], stroke_of(core, s), knock_of(core, s)
    part, settings = bank_of(core).parts[fixed.part], settings_of(core)
    key = key_of(settings.seed, fixed.dice, stroke.strokes)
    per_frame = 1.0 / (part.knock_grain_s * settings.rate_hz)
    turn = 2.0 * math.pi / knock.steps
    for t in range(frames):
        now = knock.step + t
        if 0 <= now < knock.steps:
            unsteady = part.knock_noise * ROUGH * uneven(key, _UNSTEADY, now * per_frame)
            into[t] += 0.5 * knock.push * (1.0 - math.cos(turn * now)) * (1.0 + unsteady)
