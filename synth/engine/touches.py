"""Fingers, palms and felts that lie on a string for a while: what they damp, they damp by where they lie."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.chance import ROUGH, key_of, uneven
from synth.engine.core import bank_of, hand_of, scratch_of, settings_of, string_of, stroke_of
from synth.engine.hold import begin_phase, grip_anew, take_hold
from synth.engine.layout import CORE, NO_FINGER, TOUCHED
from synth.instrument.excitations import MOST_HOLD_S

#: a touch begins with this share of its resistance, which doubles with every quantum: laid on in 4 ms
FIRST_SHARE = 1.0 / 64.0
#: from where on what it rubs over is numbered among the chances of the last stroke
_RUBBED = 1 << 23


@njit(**CORE)
def lay_on(core: int, s: int, number: int, node: float) -> None:
    """A touch of the bank begins on a string that sounds; at `node` of its length from the saddle, where that is above 0."""
    bank = bank_of(core)
    touch, hand, stroke, fixed = bank.touches[number], hand_of(core, s), stroke_of(core, s), bank.strings[s]
    length = bank.models[hand.model].length
    place = node if node > 0.0 else touch.place
    stroke.touch = number
    stroke.target = touch.resistance * fixed.impedance
    seconds = touch.lift_s if touch.lift_s > 0.0 else MOST_HOLD_S
    take_hold(core, s, place * length, touch.width, touch.stiffness, FIRST_SHARE * stroke.target, seconds)
    stroke.finger_to = 0.0
    begin_phase(core, s, TOUCHED)
    if fixed.second >= 0:
        second = stroke_of(core, fixed.second)
        second.target = stroke.target
        second.finger_to = 0.0


@njit(**CORE)
def lift_touch(core: int, s: int) -> None:
    """What lies on a string is taken off."""
    if hand_of(core, s).phase == TOUCHED:
        begin_phase(core, s, NO_FINGER)


@njit(**CORE)
def press_on(core: int, s: int) -> None:
    """What lies on a string takes its weight within some quanta."""
    second = bank_of(core).strings[s].second
    for direction in range(2):
        line = s if direction == 0 else second
        if line >= 0 and hand_of(core, line).phase == TOUCHED:
            stroke, finger = stroke_of(core, line), string_of(core, line).finger[0]
            if finger.resistance < stroke.target:
                finger.resistance = min(2.0 * finger.resistance, stroke.target)
                grip_anew(core, line)


@njit(inline="always")
def lies_still(core: int, s: int, steps: int) -> bool:
    """Whether what lies on a string has settled and stays as it is for so many steps."""
    stroke, fixed = stroke_of(core, s), bank_of(core).strings[s]
    touch = bank_of(core).touches[stroke_of(core, s - 1 if fixed.of_first else s).touch]
    settling = touch.settle_s * settings_of(core).rate_hz * fixed.factor
    there = stroke.finger_step >= settling and string_of(core, s).finger[0].resistance >= stroke.target
    return there and stroke.finger_step + steps + settling <= stroke.finger_steps


@njit(**CORE)
def lie(core: int, thread: int, s: int, steps: int) -> None:
    """Scratch.path of what lies on a string: from where the string was touched to its rest line, and how it comes there."""
    scratch, fixed = scratch_of(thread), bank_of(core).strings[s]
    stroke = stroke_of(core, s)
    touch = bank_of(core).touches[stroke_of(core, s - 1 if fixed.of_first else s).touch]
    turn = math.pi / (touch.settle_s * settings_of(core).rate_hz * fixed.factor)
    for t in range(steps + 1):
        angle = turn * (stroke.finger_step + t)
        scratch.path[t] = 0.5 * (1.0 + math.cos(angle)) * stroke.finger_from if angle < math.pi else 0.0
    if not fixed.of_first and (touch.speed > 0.0 or touch.roughness > 0.0):
        _come_and_go(core, thread, s, steps)


@njit(**CORE)
def _come_and_go(core: int, thread: int, s: int, steps: int) -> None:
    """It comes down, and rubs along the string as it settles and before it leaves."""
    scratch, fixed = scratch_of(thread), bank_of(core).strings[s]
    stroke = stroke_of(core, s)
    touch = bank_of(core).touches[stroke.touch]
    key = key_of(settings_of(core).seed, fixed.dice, stroke.strokes)
    per_second = settings_of(core).rate_hz * fixed.factor
    settling, per_step = touch.settle_s * per_second, 1.0 / (touch.grain_s * per_second)
    if stroke.finger_step >= settling and (
        touch.lift_s <= 0.0 or stroke.finger_step + steps + settling <= stroke.finger_steps
    ):
        return
    rough, far = ROUGH * touch.roughness, touch.speed * touch.settle_s
    for t in range(steps + 1):
        now = stroke.finger_step + t
        left = max(0.0, 1.0 - now / settling)
        scratch.path[t] -= far * (1.0 - left) * left * left
        if touch.lift_s > 0.0:
            left = max(left, 1.0 - (stroke.finger_steps - now) / settling)
        if left > 0.0:
            scratch.path[t] += rough * left * left * uneven(key, _RUBBED, now * per_step)
