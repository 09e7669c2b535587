"""What hands do to a string: waking it, plucking, stopping at another fret, damping, letting go."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from synth.engine.coefficients import rest_state, set_rest
from synth.engine.core import (
    bank_of,
    expression_of,
    hand_of,
    motion_of,
    progress_of,
    scratch_of,
    settings_of,
    shared_of,
    state_of,
    string_of,
    stroke_of,
    voice_of,
)
from synth.engine.ends import add_end_speed, bridge_under, momentum_of, on_bridge
from synth.engine.expression import bend_of, height_of, settle
from synth.engine.free_flight import touch_down
from synth.engine.hold import LOUD, begin_phase, last
from synth.engine.hold import take_hold as take_hold
from synth.engine.knocks import end_knock, knock_again
from synth.engine.layout import (
    BEGIN_HOLD,
    CORE,
    DRAW,
    HIT,
    NO_FINGER,
    PLAIN,
    PRESS,
    RELEASE,
    TOUCHED,
    UNTIL,
    WAIT,
)
from synth.engine.on_board import leave, may_slide, slide
from synth.engine.pressed_flight import stand
from synth.engine.projection import add_projections
from synth.engine.slurs import PRESS_S, is_on_the_way, sets_out
from synth.engine.strokes import begin_stroke, slips
from synth.engine.touches import lay_on, lift_touch
from synth.native.views import call_back
from synth.solver.coupling import RESTING, end_at
from synth.solver.line_certificates import look_everywhere
from synth.solver.stringmodel import MOVING, string_model
from synth.units import LN_1000

#: T60 of what a string still sounds while the plucking finger lies on it [s]
FINGER_S = 0.04
#: longest that a stroke is put off [s]
MOST_WAIT_S = 5.0


@njit(**CORE)
def wake(core: int, thread: int, s: int, model_index: int) -> None:
    """A silent string begins at rest on the given model, over the obstacle as high as it now is."""
    bank, state, scratch, string = bank_of(core), state_of(core), scratch_of(thread), string_of(core, s)
    voice, hand, expression, motion = voice_of(core, s), hand_of(core, s), expression_of(core, s), motion_of(core, s)
    fixed = bank.strings[s]
    n = bank.models[model_index].n
    voice.awake = 1
    hand.model = model_index
    expression.slide = 0.0
    leave(core, model_index)
    _forget_forces(core, s)
    string.counts[MOVING] = n
    expression.hand = 0.0
    voice.stolen = 0
    motion.flying = 0
    motion.fade_at = motion.fade_to = 0
    hand.phase = NO_FINGER
    hand.glide_to = -1
    expression.pull = voice.pull_to = 0.0
    settle(core, s)
    master = state.channels[voice.channel].master
    expression.rise = 0.0
    expression.bend = bend_of(core, s, int(np.int64(0)), state.channels[voice.channel].bend, state.channels[master].bend)
    expression.height = height_of(core, s, state.part_state[fixed.part].height)
    set_rest(core, thread, s)
    motion.base = motion.rest
    rest_state(core, thread, s, scratch.modes.q)
    if on_bridge(core, s):
        look_everywhere(shared_of(core).end_at[s])
        end_at(shared_of(core).end_at[s]).counts[RESTING] = 1
    for j in range(string.q.size):
        string.q[j] = scratch.modes.q[j] if j < n else 0.0
        string.v[j] = 0.0
    motion.stale = 1


@njit(**CORE)
def _wake(core: int, thread: int, s: int, model_index: int) -> None:
    """A silent string that shares no bridge begins on the given model, in all of its directions."""
    fixed = bank_of(core).strings[s]
    wake(core, thread, s, model_index)
    if fixed.second >= 0:
        across = voice_of(core, fixed.second)
        across.channel = voice_of(core, s).channel
        wake(core, thread, fixed.second, model_index + fixed.second_models)
        expression_of(core, fixed.second).bend = expression_of(core, s).bend
        across.idle = 1
        progress_of(core, fixed.second).reached = progress_of(core, s).reached


@njit(**CORE)
def _land(core: int, thread: int, s: int) -> None:
    """A string that a hand is about to touch flies no more, in any of its directions."""
    second = bank_of(core).strings[s].second
    for direction in range(2):
        line = s if direction == 0 else second
        if line >= 0 and on_bridge(core, line):
            stand(core, thread, line)
        elif line >= 0 and motion_of(core, line).flying:
            touch_down(core, thread, line)


@njit(**CORE)
def _join(core: int, thread: int, s: int, model_index: int) -> None:
    """A string that nobody plays begins on the given model; those that share its bridge wake with it, open."""
    bank, shared = bank_of(core), shared_of(core)
    voice, hand = voice_of(core, s), hand_of(core, s)
    if voice.awake == 0:
        instrument = bank.instruments[bank.strings[s].instrument]
        for other in range(instrument.first_string, instrument.end_string):
            idle = voice_of(core, other)
            if other != s:
                idle.channel = voice.channel
            model = bank.strings[other].open_model
            if other == s:
                model = model_index
            elif other == bank.strings[s].second:
                model = model_index + bank.strings[s].second_models
            idle.idle = 0 if other == s else 1  # by which it is bent
            wake(core, thread, other, model)
            if bank.strings[other].of_first:
                expression_of(core, other).bend = expression_of(core, other - 1).bend
            progress_of(core, other).reached = shared.task[UNTIL]
    voice.idle = 0
    voice.stolen = 0
    _lift_hand(core, s)
    settle(core, s)
    if hand.model != model_index:
        change_model(core, thread, s, model_index)


@njit(**CORE)
def _forget_forces(core: int, s: int) -> None:
    """A law of its own is not told the forces of another model's contacts; the kernels' laws only begin to look there."""
    model = string_model(shared_of(core).model_at[hand_of(core, s).model, PLAIN])
    if model.step != 0 or model.contacts.layers.shape[1] != 0:
        string_of(core, s).force[:] = 0.0


@njit(**CORE)
def sleep(core: int, s: int) -> None:
    """The string is silent: it costs nothing until it is touched."""
    voice, string = voice_of(core, s), string_of(core, s)
    voice.awake = 0
    voice.idle = 0
    expression_of(core, s).pull = voice.pull_to = 0.0
    voice.level = 0.0
    voice.stolen = 0
    end_knock(core, s)
    hand_of(core, s).phase = NO_FINGER
    string.q[:] = 0.0
    string.v[:] = 0.0


@njit(**CORE)
def excite(core: int, thread: int, s: int, velocity: float, sounding: bool) -> None:
    """The right hand takes hold of the string, moves it and lets it go. One that sounds it damps."""
    shared, part = shared_of(core), bank_of(core).strings[s].part
    if shared.excitation[part, BEGIN_HOLD] != 0:
        call_back(shared.excitation[part, BEGIN_HOLD], core, thread, s, int(velocity))
        begin_phase(core, s, DRAW)
    else:
        begin_stroke(core, s, velocity)
    if sounding:
        damp(core, s, FINGER_S)


@njit(**CORE)
def press(core: int, s: int, target: int, velocity: float) -> None:
    """The left hand brings a sounding string down to a higher fret; the change of model and the pluck come after."""
    bank = bank_of(core)
    hand, stroke = hand_of(core, s), stroke_of(core, s)
    old, new = bank.models[hand.model], bank.models[target]
    hand.pending_model = target
    hand.pending_velocity = velocity
    fixed = bank.strings[s]
    part = bank.parts[fixed.part]
    stiffness = part.finger_stiffness * 20.0  # the fret is behind this finger
    take_hold(core, s, new.length, 0.004, stiffness, part.finger_loss * fixed.impedance, PRESS_S)
    stroke.finger_to = new.rest_height - old.rest_height * new.length / old.length
    begin_phase(core, s, PRESS)
    if fixed.second >= 0:
        hand_of(core, fixed.second).pending_model = target + fixed.second_models


@njit(**CORE)
def change_model(core: int, thread: int, s: int, target: int) -> None:
    """Carry the motion of a sounding string over to another speaking length, in all of its directions."""
    fixed = bank_of(core).strings[s]
    _change_model(core, thread, s, target)
    if fixed.second >= 0:
        _change_model(core, thread, fixed.second, target + fixed.second_models)


@njit(**CORE)
def _change_model(core: int, thread: int, s: int, target: int) -> None:
    """Carry the motion of a string in one direction over to another speaking length.

    Both models end at the saddle. With ξ counted from there, φ_j = √(2/L)(−1)^(j+1) sin(jπξ/L), and the new coordinates
    are the projections of the displacement (in the new rest line's frame, absolute positions kept) and of the velocity.
    Projection is on sines that vanish at the new fret: by Bessel's inequality neither kinetic nor elastic energy grows,
    but for the work of a hand that lets a stopped string go, which is the string's own. Lumped modes begin at rest.
    """
    bank, scratch, string = bank_of(core), scratch_of(thread), string_of(core, s)
    voice, hand, expression, motion = voice_of(core, s), hand_of(core, s), expression_of(core, s), motion_of(core, s)
    end_speed = bridge_under(core, s)[1] if on_bridge(core, s) else 0.0
    if end_speed != 0.0:  # what is carried over is the whole velocity
        add_end_speed(core, s, end_speed)
    old, new = bank.models[hand.model], bank.models[target]
    n_old, n_new = old.own, new.own
    l_old, l_new = old.length, new.length
    while n_old > 0 and string.q[n_old - 1] == 0.0 and string.v[n_old - 1] == 0.0:  # at rest: nothing of it is carried over
        n_old -= 1
    q, v = string.q[:n_old], string.v[:n_old]
    scale = 2.0 / math.sqrt(l_old * l_new)
    a, ends, signs = scratch.modes.moved[0, :n_new], scratch.modes.moved[1, :n_new], scratch.modes.moved[2, :n_new]
    factors, q_sum, v_sum = scratch.modes.amplitude[:n_old], scratch.modes.q[:n_new], scratch.modes.v[:n_new]
    for i in range(n_new):
        a[i] = (i + 1) * math.pi / l_new
        signs[i] = 1.0 if i % 2 == 0 else -1.0
        q_sum[i] = v_sum[i] = 0.0
    if l_new < l_old:
        at_fret = 0.0
        for j in range(n_old):
            sign = 1.0 if j % 2 == 0 else -1.0
            factors[j] = sign * math.sin((j + 1) * math.pi * l_new / l_old)
            at_fret += math.sqrt(2.0 / l_old) * factors[j] * q[j]
        # where both sines are the same one, the sign (−1)^(i+1) of the closed form is in the new φ_i
        add_projections(a, a, factors, signs, l_new, l_old, q, v, q_sum, v_sum)
        for i in range(n_new):
            # ∫₀^ℓ (ξ/ℓ) sin(aξ) dξ = (−1)^(i+1)/a, and φ_i carries the same sign
            q_sum[i] = scale * q_sum[i] - math.sqrt(2.0 / l_new) * at_fret / a[i]
            v_sum[i] = scale * v_sum[i]
        if new.rest_height != 0.0:
            # from here on the string is at the fret; where a hand has not brought it there, nobody hears that it jumps
            there = old.rest_height * l_new / l_old + at_fret
            motion.base += new.line_output * (1.0 - there / new.rest_height)
    else:
        # the string was stopped at height `lift` above the new rest line
        lift = old.rest_height - new.rest_height * l_old / l_new
        for i in range(n_new):
            ends[i] = signs[i] * math.sin(a[i] * l_old)
        for j in range(n_old):
            factors[j] = -(j + 1) * math.pi / l_old
        add_projections(a, ends, factors, signs, l_new, l_old, q, v, q_sum, v_sum)
        for i in range(n_new):
            # triangle with its corner of height `lift` at ξ = l_old
            corner = 0.0
            if l_new > l_old:
                corner = lift * ends[i] * l_new / (a[i] * a[i] * l_old * (l_new - l_old))
            q_sum[i] = scale * q_sum[i] + math.sqrt(2.0 / l_new) * corner
            v_sum[i] = scale * v_sum[i]
    for j in range(string.q.size):
        string.q[j] = scratch.modes.q[j] if j < n_new else 0.0
        string.v[j] = scratch.modes.v[j] if j < n_new else 0.0
    hand.model = target
    expression.bend -= expression.slide + expression.pull
    expression.slide = expression.pull = voice.pull_to = 0.0
    leave(core, target)
    if end_speed != 0.0:
        add_end_speed(core, s, -end_speed)
    _forget_forces(core, s)
    if on_bridge(core, s):  # the projection moves all modes
        look_everywhere(shared_of(core).end_at[s])
        end_at(shared_of(core).end_at[s]).counts[RESTING] = 0
    string.counts[MOVING] = new.n
    hand.phase = NO_FINGER
    motion.stale = 1


@njit(**CORE)
def pluck(core: int, thread: int, s: int, target: int, velocity: float, legato: bool) -> None:
    """A note begins on string s at a model (position): wake or re-pluck, change fret where needed."""
    bank = bank_of(core)
    voice, hand = voice_of(core, s), hand_of(core, s)
    lift_touch(core, s)
    hand.glide_to = -1
    sounding = voice.awake != 0 and voice.idle == 0
    if voice.awake != 0:
        _land(core, thread, s)
    if not sounding and on_bridge(core, s):
        _join(core, thread, s, target)
    elif not sounding:
        _wake(core, thread, s, target)
    if bank.parts[bank.strings[s].part].others_s > 0.0 and on_bridge(core, s):
        _uncover_others(core, s)
    if hand.wait > 0:
        _wait(core, s, target, velocity, legato)
        return
    if sounding:
        _lift_hand(core, s)
    if sounding and legato and hand.model == target:  # the finger was about to leave it
        begin_phase(core, s, NO_FINGER)
        _touch_again(core, s)
        return
    if hand.model != target:
        if legato and may_slide(core, s, target):
            slide(core, s, target)
            _touch_again(core, s)
            return
        if legato and sets_out(core, s, target):
            return
        if bank.models[target].length < bank.models[hand.model].length:
            press(core, s, target, 0.0 if legato else velocity)
            return
        change_model(core, thread, s, target)
        if legato:
            _touch_again(core, s)
            return
    excite(core, thread, s, velocity, sounding)


@njit(**CORE)
def _touch_again(core: int, s: int) -> None:
    """What lies on a string until its next stroke lies there when the left hand has stopped it elsewhere, too."""
    bank, voice = bank_of(core), voice_of(core, s)
    way = bank.articulations[voice.articulation]
    if way.touch >= 0 and not way.harmonic and bank.touches[way.touch].lift_s == 0.0 and not _has_excitation(core, s):
        lay_on(core, s, way.touch, 0.0)


@njit(**CORE)
def _wait(core: int, s: int, target: int, velocity: float, legato: bool) -> None:
    """The stroke comes later, by HAND.wait frames; until then the string goes on as it is."""
    bank, voice, hand, stroke = bank_of(core), voice_of(core, s), hand_of(core, s), stroke_of(core, s)
    hand.pending_model = target
    hand.pending_velocity = velocity
    hand.pending_legato = 1 if legato else 0
    if (hand.phase == DRAW or hand.phase == HIT) and stroke.finger_step == 0:
        stroke.strokes -= 1  # it had begun at this very frame, and begins again
    last(core, s, min(MOST_WAIT_S, hand.wait / settings_of(core).rate_hz))
    hand.wait = 0
    voice.level = LOUD
    begin_phase(core, s, WAIT)
    if bank.strings[s].second >= 0:
        hand_of(core, bank.strings[s].second).pending_model = target + bank.strings[s].second_models


@njit(**CORE)
def _glide(core: int, thread: int, s: int) -> None:
    """The finger leaves a fret on its way for the next one."""
    bank, hand = bank_of(core), hand_of(core, s)
    if bank.models[hand.pending_model].length < bank.models[hand.model].length:
        press(core, s, hand.pending_model, 0.0)
        return
    change_model(core, thread, s, hand.pending_model)
    if not is_on_the_way(core, s):
        _touch_again(core, s)
        let_go(core, thread, s)


@njit(**CORE)
def damp(core: int, s: int, seconds: float) -> None:
    """The hand lies on the string: every mode decays by 60 dB in `seconds` at the latest."""
    _lay_hand(core, s, LN_1000 / seconds)


@njit(**CORE)
def _lift_hand(core: int, s: int) -> None:
    _lay_hand(core, s, 0.0)


@njit(**CORE)
def _lay_hand(core: int, s: int, hand: float) -> None:
    """Extra σ of a string that sounds, in all of its directions."""
    second = bank_of(core).strings[s].second
    for direction in range(2):
        line = s if direction == 0 else second
        if line >= 0:
            voice, expression, motion = voice_of(core, line), expression_of(core, line), motion_of(core, line)
            if voice.awake and hand != expression.hand:
                if on_bridge(core, line):  # which does not feel a hand at once: it is soft
                    motion.base += 2.0 * (hand - expression.hand) * momentum_of(core, line)
                expression.hand = hand
                motion.stale = 1


@njit(**CORE)
def _cover_others(core: int, s: int, seconds: float) -> None:
    """A hand lies down on all strings of an instrument that nobody plays, where no key holds another one."""
    bank = bank_of(core)
    instrument = bank.instruments[bank.strings[s].instrument]
    for other in range(instrument.first_string, instrument.end_string):
        voice, hand = voice_of(core, other), hand_of(core, other)
        if other != s and (voice.held or voice.sustained or NO_FINGER < hand.phase < TOUCHED):
            return
    for other in range(instrument.first_string, instrument.end_string):
        if voice_of(core, other).idle and not bank.strings[other].of_first:
            damp(core, other, seconds)


@njit(**CORE)
def _uncover_others(core: int, s: int) -> None:
    """The hand leaves the strings that nobody plays as the next stroke comes."""
    bank = bank_of(core)
    instrument = bank.instruments[bank.strings[s].instrument]
    for other in range(instrument.first_string, instrument.end_string):
        if voice_of(core, other).idle and not bank.strings[other].of_first:
            _lift_hand(core, other)


@njit(**CORE)
def let_go(core: int, thread: int, s: int) -> None:
    """Note-off has reached the string: the hand damps it unless a finger is still at work or the preset rings on."""
    bank, state = bank_of(core), state_of(core)
    voice, hand, number = voice_of(core, s), hand_of(core, s), bank.strings[s].part
    part = bank.parts[number]
    if voice.held or voice.sustained or NO_FINGER < hand.phase < TOUCHED or part.ring_on:
        return
    damp(core, s, bank.strings[s].release_s * state.parameters[number, RELEASE])
    if part.others_s > 0.0 and on_bridge(core, s):
        _cover_others(core, s, part.others_s * state.parameters[number, RELEASE])
    if part.knock > 0.0 and part.knock_release > 0.0 and voice.awake and not voice.idle:
        knock_again(core, s, part.knock_release)
    if not voice.awake or voice.idle or (part.release_touch < 0 and not part.lifts):
        return
    _land(core, thread, s)
    stopped_at = _leave_fret(core, thread, s) if part.lifts else 0.0
    if part.release_touch >= 0:
        lay_on(core, s, part.release_touch, stopped_at)


@njit(**CORE)
def _leave_fret(core: int, thread: int, s: int) -> float:
    """The finger that stopped a string at a fret lets it rise, and it is the open one; where the fret is, as a share of its
    length from the saddle. 0: it was open, or lies over a board."""
    bank, hand, opened = bank_of(core), hand_of(core, s), bank_of(core).strings[s].open_model
    if hand.model == opened or shared_of(core).board_at[hand.model] != 0:
        return 0.0
    share = bank.models[hand.model].length / bank.models[opened].length
    lies_on = hand.phase == TOUCHED
    change_model(core, thread, s, opened)
    if lies_on:
        _touch_again(core, s)
    return share


@njit(**CORE)
def finger_done(core: int, thread: int, s: int) -> None:
    """The hand has done what it was at: the string slides off the finger, is let go or touched, or stopped at its new fret
    and plucked."""
    voice, hand = voice_of(core, s), hand_of(core, s)
    phase = hand.phase
    if phase == WAIT:
        begin_phase(core, s, NO_FINGER)
        if hand.glide_to >= 0:
            _glide(core, thread, s)
            return
        pluck(core, thread, s, hand.pending_model, hand.pending_velocity, hand.pending_legato != 0)
        return
    if phase == DRAW and slips(core, s):
        return
    begin_phase(core, s, NO_FINGER)
    if phase == PRESS:
        change_model(core, thread, s, hand.pending_model)
        if hand.pending_velocity > 0.0:
            excite(core, thread, s, hand.pending_velocity, True)
            return
        if is_on_the_way(core, s):
            return
        _touch_again(core, s)
    elif phase == TOUCHED:  # lifted; who let go of the key has let go of the string
        return
    else:
        _lift_hand(core, s)
        way = bank_of(core).articulations[voice.articulation]
        too_low = way.harmonic and voice.node <= 0.0  # for a harmonic: a note like others
        if way.touch >= 0 and not too_low and not _has_excitation(core, s):
            lay_on(core, s, way.touch, voice.node)
            if voice.held or voice.sustained:
                return
    let_go(core, thread, s)


@njit(**CORE)
def _has_excitation(core: int, s: int) -> bool:
    """Whether its part's notes begin in a way of their own."""
    return shared_of(core).excitation[bank_of(core).strings[s].part, BEGIN_HOLD] != 0
