"""Fingers, palms and felts that lie on a string for a while: what they damp, they damp by where they lie."""

from __future__ import annotations

from numba import njit

from synth.engine.core import bank_of, state_of, string_of
from synth.engine.hold import begin_phase, take_hold
from synth.engine.layout import CORE, NO_FINGER, TOUCHED
from synth.instrument.excitations import MOST_HOLD_S

#: a touch begins with this share of its resistance, which doubles with every quantum: laid on in 4 ms
FIRST_SHARE = 1.0 / 64.0
#: time in which a touch with a spring brings the string to its rest line [s]
LAY_S = 0.008


@njit(**CORE)
def lay_on(core: int, s: int, number: int, node: float) -> None:
    """A touch of the bank begins on a string that sounds; at `node` of its length from the saddle, where that is above 0."""
    bank = bank_of(core)
    touch, me, fixed = bank.touches[number], state_of(core).sounding[s], bank.strings[s]
    length = bank.models[me.model].length
    place = node if node > 0.0 else touch.place
    me.target = touch.resistance * fixed.impedance
    seconds = touch.lift_s if touch.lift_s > 0.0 else MOST_HOLD_S
    take_hold(core, s, place * length, touch.width, touch.stiffness, FIRST_SHARE * me.target, seconds)
    me.finger_to = 0.0
    begin_phase(core, s, TOUCHED)
    if fixed.second >= 0:
        second = state_of(core).sounding[fixed.second]
        second.target = me.target
        second.finger_to = 0.0


@njit(**CORE)
def lift_touch(core: int, s: int) -> None:
    """What lies on a string is taken off."""
    if state_of(core).sounding[s].phase == TOUCHED:
        begin_phase(core, s, NO_FINGER)


@njit(**CORE)
def press_on(core: int, s: int) -> None:
    """What lies on a string takes its weight within some quanta."""
    second = bank_of(core).strings[s].second
    for direction in range(2):
        line = s if direction == 0 else second
        if line >= 0 and state_of(core).sounding[line].phase == TOUCHED:
            me, finger = state_of(core).sounding[line], string_of(core, line).finger[0]
            if finger.resistance < me.target:
                finger.resistance = min(2.0 * finger.resistance, me.target)
                if me.stale == 0:
                    me.stale = 2
