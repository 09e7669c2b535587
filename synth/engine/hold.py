"""A finger takes hold of a string: where, how firmly, for how long."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.core import bank_of, hand_of, motion_of, settings_of, shared_of, string_of, stroke_of, voice_of
from synth.engine.ends import bridge_under, on_bridge
from synth.engine.layout import CORE
from synth.instrument.excitations import MOST_HOLD_S
from synth.solver.coupling import FINGER_LEVERAGE, end_at
from synth.solver.stepwise import LEAST_STIFFNESS
from synth.solver.stringmodel import CERTAIN, FREE, MOVING
from synth.solver.vectors import dot

#: level of a string under a finger, until it is measured: about to sound, it is the last to be stolen
LOUD = 1e9


@njit(**CORE)
def take_hold(
    core: int, s: int, distance: float, width: float, stiffness: float, resistance: float, seconds: float
) -> float:
    """A finger takes hold of the string where it now is, for so many seconds; returns its displacement there [m].

    distance from the saddle and width [m]; stiffness [N/m] and resistance [N s/m] of what is between the string and the
    finger's path. A string that moves in two directions is held in both, in the second one where it is.
    """
    second = bank_of(core).strings[s].second
    if second >= 0:
        there = _take_hold(core, second, distance, width, stiffness, resistance, min(seconds, MOST_HOLD_S))
        stroke_of(core, second).finger_to = there
    return _take_hold(core, s, distance, width, stiffness, resistance, min(seconds, MOST_HOLD_S))


@njit(**CORE)
def _take_hold(
    core: int, s: int, distance: float, width: float, stiffness: float, resistance: float, seconds: float
) -> float:
    """`take_hold` of one direction."""
    bank, string = bank_of(core), string_of(core, s)
    voice, hand, stroke = voice_of(core, s), hand_of(core, s), stroke_of(core, s)
    model = bank.models[hand.model]
    n = model.n
    string.counts[MOVING] = n
    string.counts[FREE] = 0
    string.counts[CERTAIN] = 0
    x = model.length - distance
    scale = math.sqrt(2.0 / model.length)
    weights, finger = string.grip.weights, string.finger[0]
    for j in range(n):
        k = (j + 1) * math.pi / model.length
        kappa = 0.25 * k * width
        taper = math.sin(kappa) / kappa if kappa > 1e-9 else 1.0
        weights[j] = scale * math.sin(k * x) * taper * taper if j < model.own else 0.0
    for j in range(n, weights.size):
        weights[j] = 0.0
    finger.stiffness = max(LEAST_STIFFNESS, stiffness)
    finger.resistance = resistance
    _begin(core, s, seconds)
    here = dot(weights[:n], string.q[:n])
    if on_bridge(core, s):
        leverage = x / model.length
        end_at(shared_of(core).end_at[s]).numbers[FINGER_LEVERAGE] = leverage
        here += leverage * bridge_under(core, s)[0]
    stroke.finger_from = here
    finger.here = here
    finger.push = 0.0
    voice.level = LOUD
    grip_anew(core, s)
    return here


@njit(**CORE)
def grip_anew(core: int, s: int) -> None:
    """The finger's coupling is to be worked out before the next step."""
    motion = motion_of(core, s)
    if motion.stale == 0:  # else that is part of it
        motion.stale = 2


@njit(**CORE)
def _begin(core: int, s: int, seconds: float) -> None:
    """In whole output frames, so that it ends at the same instant at every internal rate."""
    stroke = stroke_of(core, s)
    stroke.finger_step = 0
    stroke.finger_steps = max(2, round(seconds * settings_of(core).rate_hz)) * bank_of(core).strings[s].factor


@njit(**CORE)
def last(core: int, s: int, seconds: float) -> None:
    """What the hand does to the string goes on for so many seconds from now, in all of its directions."""
    _begin(core, s, seconds)
    second = bank_of(core).strings[s].second
    if second >= 0:
        _begin(core, second, seconds)


@njit(**CORE)
def begin_phase(core: int, s: int, phase: int) -> None:
    """What the hand does to the string now, in all of its directions."""
    second = bank_of(core).strings[s].second
    hand_of(core, s).phase = phase
    if second >= 0:
        hand_of(core, second).phase = phase
