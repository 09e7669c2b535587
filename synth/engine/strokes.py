"""Strokes of the right hand, as a string's articulation has them: drawn aside and let go, or hit by what flies at it.

Letting go takes the time in which the string slides off: the finger's force fades as half a cosine (`SLIP`), which takes
from the partials above the inverse of that time (Chadefaux et al., JASA 133(4), 2013, 2444, on the harp).

What is thrown (`HIT`) is a mass behind the finger's spring, in free flight but for the string's force. Over a frame it
moves evenly, at the speed that it would have half way through under the force at the frame's start.
"""

from __future__ import annotations

import math

from numba import njit

from synth.engine.chance import ROUGH, key_of, spread, uneven
from synth.engine.core import (
    bank_of,
    hand_of,
    model_of,
    scratch_of,
    settings_of,
    state_of,
    string_of,
    stroke_of,
    voice_of,
)
from synth.engine.expression import pluck_place
from synth.engine.hold import begin_phase, grip_anew, last, take_hold
from synth.engine.knocks import begin_knock
from synth.engine.layout import (
    CORE,
    DRAW,
    HIT,
    PLUCK_AMOUNT,
    PLUCK_POSITION,
    PLUCK_WIDTH,
    SLIP,
    THROWN,
    TOUCHED,
    VARIATION,
)
from synth.engine.stroke import NEAREST, between, drawn_by, draws_at, finger_distance, finger_width, met, pluck_force
from synth.engine.touches import lie
from synth.solver.laws import EXACT_HOLD
from synth.solver.stepwise import LEAST_STIFFNESS

#: what is thrown has left the string by then [s]
MOST_HIT_S = 0.03
#: a finger that rubs takes another way after so long [s]
RUB_S = 5e-5
#: share of the time of drawing over which creeping comes to an end before the string slides
STANDING = 0.1
#: what varies, by number
_PLACE, _LEVEL, _WIDTH, _DRAW_TIME, _SLIP_TIME, _RUB = range(6)
#: …and from where on what the string passes over as it is drawn, and as it slides off, is numbered
_DRAWN_OVER, _SLID_OVER = 1 << 20, 1 << 21

_finger_distance, _finger_width = njit(**CORE)(finger_distance), njit(**CORE)(finger_width)
_pluck_force, _drawn_by = njit(**CORE)(pluck_force), njit(**CORE)(drawn_by)
_between, _draws_at, _met = njit(**CORE)(between), njit(**CORE)(draws_at), njit(**CORE)(met)


@njit(**CORE)
def begin_stroke(core: int, s: int, velocity: float) -> None:
    """The stroke of the string's articulation begins."""
    bank, state = bank_of(core), state_of(core)
    voice, hand, stroke, fixed = voice_of(core, s), hand_of(core, s), stroke_of(core, s), bank.strings[s]
    part, way, model = bank.parts[fixed.part], bank.articulations[voice.articulation], bank.models[hand.model]
    parameters = state.parameters[fixed.part]
    strength = velocity / 127.0
    stroke.strokes += 1
    key, varied = key_of(settings_of(core).seed, fixed.dice, stroke.strokes), parameters[VARIATION]
    place = way.place_ratio * max(NEAREST, parameters[PLUCK_POSITION] + fixed.pluck_shift)
    position = pluck_place(place, voice.timbre) + strength * way.place_shift
    if part.place_spread > 0.0:
        position += varied * part.place_spread * spread(key, _PLACE) / fixed.open_length
    level, knock, wider, draw_s = way.amount, way.knock, 1.0, fixed.draw_s
    slip_s = _between(
        fixed.slip_s if way.slip_s < 0.0 else way.slip_s,
        fixed.hard_slip_s if way.hard_slip_s < 0.0 else way.hard_slip_s,
        strength,
    )
    if way.draw_s > 0.0:
        draw_s = way.draw_s
    if part.level_spread > 0.0:
        louder = math.exp(varied * part.level_spread * spread(key, _LEVEL))
        level *= louder
        knock *= louder
    if part.width_spread > 0.0:
        wider = math.exp(varied * part.width_spread * spread(key, _WIDTH))
    if part.time_spread > 0.0:
        draw_s *= math.exp(varied * part.time_spread * spread(key, _DRAW_TIME))
        slip_s *= math.exp(varied * part.time_spread * spread(key, _SLIP_TIME))
    distance = _finger_distance(position, fixed.open_length, model.length)
    soft = 1e-3 * parameters[PLUCK_WIDTH] * way.width_ratio * wider
    width = _finger_width(soft, way.hard_width_ratio, strength, distance, way.by_ratios != 0)
    resistance = part.finger_loss * fixed.impedance
    if part.knock > 0.0:
        begin_knock(core, s, _pluck_force(part.knock * knock, strength, part.velocity_exponent), part.knock_delay_s)
    if way.stroke == THROWN:
        take_hold(core, s, distance, width, way.stiffness, resistance, MOST_HIT_S)
        stroke.finger_to = 0.0
        stroke.thrown = -level * way.speed * strength**part.velocity_exponent
        begin_phase(core, s, HIT)
        return
    stroke.slip_s = min(slip_s, LONGEST_SLIP_S)
    stroke.roughness = way.roughness
    stroke.yielding = _draws_at(distance, model.length, model.tension) / part.finger_stiffness
    take_hold(core, s, distance, width, part.finger_stiffness, resistance, min(draw_s, LONGEST_DRAW_S))
    force = _pluck_force(fixed.pluck_force * parameters[PLUCK_AMOUNT] * level, strength, part.velocity_exponent)
    drawn = _drawn_by(force, distance, model.length, model.tension)
    stroke.finger_to = drawn
    begin_phase(core, s, DRAW)
    if fixed.second >= 0:
        stroke.finger_to = part.pluck_first * drawn
        stroke_of(core, fixed.second).finger_to = part.pluck_second * drawn
        stroke_of(core, fixed.second).yielding = stroke.yielding


#: longest that drawing and letting go take, with what varies [s]
LONGEST_DRAW_S, LONGEST_SLIP_S = 0.5, 0.05


@njit(**CORE)
def _force(core: int, s: int) -> float:
    """What the finger does to the string [N]: in the last step, which laws of velocities take as an impulse."""
    push = string_of(core, s).finger[0].push
    if model_of(core, s).law == EXACT_HOLD:
        return push
    return push * settings_of(core).rate_hz * bank_of(core).strings[s].factor


@njit(**CORE)
def slips(core: int, s: int) -> bool:
    """Whether a string that has been drawn aside slides off the finger from now on; else it is let go at once."""
    seconds, second = stroke_of(core, s).slip_s, bank_of(core).strings[s].second
    if seconds * settings_of(core).rate_hz < 1.0:
        return False
    for direction in range(2):
        line = s if direction == 0 else second
        if line >= 0:
            stroke, finger = stroke_of(core, line), string_of(core, line).finger[0]
            # a spring so soft that what the path pulls with is a force that is given
            stroke.finger_from = _force(core, line) / LEAST_STIFFNESS
            stroke.finger_to = 0.0
            finger.stiffness = LEAST_STIFFNESS
            finger.resistance = 0.0
            grip_anew(core, line)
    last(core, s, seconds)
    begin_phase(core, s, SLIP)
    return True


@njit(**CORE)
def has_bounced(core: int, s: int) -> bool:
    """Whether what was thrown at a string is about to pull at it: it has left."""
    hand = hand_of(core, s)
    return hand.phase == HIT and string_of(core, s).finger[0].push >= 0.0


@njit(**CORE)
def follow_stroke(core: int, thread: int, s: int, steps: int) -> None:
    """Scratch.path: where the finger is before these steps and after each of them."""
    hand = hand_of(core, s)
    if hand.phase == HIT and not bank_of(core).strings[s].of_first:
        _fly(core, thread, s, steps)
    elif hand.phase == TOUCHED:
        lie(core, thread, s, steps)
    elif hand.phase == DRAW or hand.phase == SLIP:
        _pluck(core, thread, s, steps)
    else:
        _go_evenly(core, thread, s, steps)


@njit(**CORE)
def _pluck(core: int, thread: int, s: int, steps: int) -> None:
    """A string in one of its directions is drawn, or slides off."""
    first = s - 1 if bank_of(core).strings[s].of_first else s
    hand, stroke, way = hand_of(core, s), stroke_of(core, s), bank_of(core).articulations[voice_of(core, first).articulation]
    if hand.phase == DRAW and way.arrival > 0.0:
        _meet(core, thread, s, way.arrival, steps)
    else:
        _go_evenly(core, thread, s, steps)
    if hand.phase == DRAW and stroke.roughness > 0.0:
        _rub(core, thread, s, steps)
    if way.rub > 0.0:
        _slide_over(core, thread, s, first, steps)


@njit(**CORE)
def _meet(core: int, thread: int, s: int, arrival: float, steps: int) -> None:
    """From where to where it goes, as what flew at the string."""
    scratch, stroke = scratch_of(thread), stroke_of(core, s)
    far = stroke.finger_to - stroke.finger_from
    for t in range(steps + 1):
        scratch.path[t] = stroke.finger_from + far * _met((stroke.finger_step + t) / stroke.finger_steps, arrival)


@njit(**CORE)
def _slide_over(core: int, thread: int, s: int, first: int, steps: int) -> None:
    """What is rough about the edge over which it slides: a share of the force, that grows until the string is let go.

    While the string is drawn it creeps over as much of the edge, more slowly, and stands still before it slides: what it
    stands on is neither high nor low, so that the level of a pluck does not hang on it. It is the same in both directions.
    """
    bank, scratch = bank_of(core), scratch_of(thread)
    hand, stroke, way = hand_of(core, s), stroke_of(core, s), bank.articulations[voice_of(core, first).articulation]
    key = key_of(settings_of(core).seed, bank.strings[first].dice, stroke_of(core, first).strokes)
    slips_off = hand.phase == SLIP
    numbers = _SLID_OVER if slips_off else _DRAWN_OVER
    share = way.rub * ROUGH
    for t in range(steps + 1):
        crept = (stroke.finger_step + t) / stroke.finger_steps
        rough = share * uneven(key, numbers, way.grains * (crept if slips_off else 1.0 - crept), True)
        if slips_off:
            scratch.path[t] *= max(0.0, 1.0 + rough)
        else:
            rough *= crept * min(1.0, (1.0 - crept) / STANDING)
            scratch.path[t] += rough * stroke.yielding * (scratch.path[t] - stroke.finger_from)


@njit(**CORE)
def _go_evenly(core: int, thread: int, s: int, steps: int) -> None:
    """From where to where it goes, as half a cosine."""
    scratch = scratch_of(thread)
    stroke = stroke_of(core, s)
    first = stroke.finger_step
    turn = math.pi / stroke.finger_steps
    cosine, sine = math.cos(turn * first), math.sin(turn * first)
    further, aside = math.cos(turn), math.sin(turn)
    half = 0.5 * (stroke.finger_to - stroke.finger_from)
    for t in range(steps + 1):
        scratch.path[t] = stroke.finger_from + half * (1.0 - cosine)
        cosine, sine = cosine * further - sine * aside, sine * further + cosine * aside


@njit(**CORE)
def _rub(core: int, thread: int, s: int, steps: int) -> None:
    """What is unsteady about it, most of it half way."""
    scratch, fixed = scratch_of(thread), bank_of(core).strings[s]
    stroke = stroke_of(core, s)
    key = key_of(settings_of(core).seed, fixed.dice, stroke.strokes)
    per_step = 1.0 / (RUB_S * settings_of(core).rate_hz * fixed.factor)
    for t in range(steps + 1):
        rises = math.sin(math.pi * (stroke.finger_step + t) / stroke.finger_steps)
        scratch.path[t] += stroke.roughness * rises * rises * uneven(key, 64 * _RUB, (stroke.finger_step + t) * per_step)


@njit(**CORE)
def _fly(core: int, thread: int, s: int, steps: int) -> None:
    """A mass behind the finger's spring, `thrown` its speed; finger_to keeps the force at the last frame's start."""
    scratch, fixed = scratch_of(thread), bank_of(core).strings[s]
    voice, stroke, push = voice_of(core, s), stroke_of(core, s), _force(core, s)
    dt = 1.0 / (settings_of(core).rate_hz * fixed.factor)
    per_mass = dt * steps / bank_of(core).articulations[voice.articulation].mass
    if stroke.finger_step > 0:
        stroke.thrown -= 0.5 * (stroke.finger_to + push) * per_mass
    stroke.finger_to = push
    speed = stroke.thrown - 0.5 * push * per_mass
    for t in range(steps + 1):
        scratch.path[t] = stroke.finger_from + speed * dt * t
    stroke.finger_from += speed * dt * steps
