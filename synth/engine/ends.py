"""The moving end of a string: what it is to the model that sounds, and how the bridge moves under it."""

from __future__ import annotations

import math

from numba import njit

from synth.engine.core import (
    bank_of,
    expression_of,
    hand_of,
    is_held,
    model_address,
    model_of,
    motion_of,
    scratch_of,
    settings_of,
    shared_of,
    string_of,
)
from synth.engine.hand_damping import damping
from synth.engine.layout import CORE, DRAW, PLAIN, PRESS, TOUCHED
from synth.solver.coupling import (
    APART_MODES,
    DUE,
    ENGAGED,
    FELT_MODES,
    HEARD_MODES,
    KICK_REACH,
    LARGEST_LEVERAGE,
    LARGEST_SHAPE,
    LENGTH,
    RAISED,
    RATIO,
    REACH_OF,
    RELIEF,
    TENSION,
    along,
    coupling_at,
    end_at,
)
from synth.solver.lanes import PAD, padded
from synth.solver.laws import EXACT_HOLD
from synth.solver.line_certificates import outlives_bend
from synth.solver.line_tables import (
    ALL_DUE,
    TABLES_DUE,
    fill_apart,
    set_apart_modes,
)
from synth.solver.quick_coefficients import quick_coefficients
from synth.solver.responses import complete_rows
from synth.solver.stringmodel import string_model
from synth.solver.vectors import dot


@njit(**CORE)
def on_bridge(core: int, s: int) -> bool:
    """Whether string s shares a bridge with others."""
    return shared_of(core).end_at[s] != 0


@njit(**CORE)
def bridge_under(core: int, s: int) -> tuple[float, float]:
    """Where the bridge is under a string [m], and how fast it has moved in the last frame [m/s]."""
    i = bank_of(core).strings[s].instrument
    coupling = coupling_at(shared_of(core).coupling_at[i])
    line = s - bank_of(core).instruments[i].first_string
    return along(coupling, line, coupling.bridge.beta), along(coupling, line, coupling.bridge.speed)


@njit(**CORE)
def add_end_speed(core: int, s: int, speed: float) -> None:
    """Add c · speed to the modal velocities of a string, c the moments of x/L of the model that it has now."""
    string = string_of(core, s)
    model = bank_of(core).models[hand_of(core, s).model]
    for j in range(model.own):
        string.v[j] += _moment(model.length, j) * speed


@njit(**CORE)
def momentum_of(core: int, s: int) -> float:
    """What hand and losses take of it pulls at the bridge: μ Σ c v of a string [N s]."""
    string, model = string_of(core, s), bank_of(core).models[hand_of(core, s).model]
    total = 0.0
    if motion_of(core, s).flying:
        pull = end_at(shared_of(core).end_at[s]).pull
        return dot(pull[: model.pressed_modes], string.v[: model.pressed_modes])
    for j in range(model.own):
        total += _moment(model.length, j) * string.v[j]
    return model.mu * total


@njit(inline="always")
def _moment(length: float, j: int) -> float:
    """`modes.ramp_moments` of mode j, from 0 on."""
    moment = math.sqrt(2.0 * length) / math.pi
    return (moment if j % 2 == 0 else -moment) / (j + 1.0)


@njit(**CORE)
def refresh_end(core: int, thread: int, s: int, model_too: bool) -> bool:
    """What its end is to a string whose finger, or (model_too) whose coefficients have become others; whether its
    certificate still holds, with a reserve. What a finger needs is filled as the string is looked at."""
    shared, scratch = shared_of(core), scratch_of(thread)
    motion = motion_of(core, s)
    end = end_at(shared.end_at[s])
    bank = bank_of(core)
    i = bank.strings[s].instrument
    coupling, line = shared.coupling_at[i], s - bank.instruments[i].first_string
    coupling_at(coupling).lines.model[line] = model_address(core, s)
    certain = False
    if model_too:
        certain = _refresh_apart(core, s)
        fill_apart(shared.end_at[s], scratch.modes.q, scratch.modes.v, scratch.rows.spare)
        end.counts[DUE] = ALL_DUE if motion.altered else TABLES_DUE
    return certain


@njit(**CORE)
def may_go_by_frames(core: int, s: int) -> bool:
    """Whether a string that a finger stops, draws or lies on may be looked at a frame at a time, where it touches nothing:
    not where its two directions rub on contacts or these are soft, nor at `fine` or better. A string that slips off a
    finger, or is struck, goes through its own steps."""
    strings, hand = bank_of(core).strings, hand_of(core, s)
    follows = hand.phase == PRESS or hand.phase == DRAW or hand.phase == TOUCHED
    if not follows or settings_of(core).economy == 0 or bank_of(core).models[hand.model].layered:
        return False
    second = strings[s].second
    return strings[s].friction == 0.0 and (second < 0 or strings[second].friction == 0.0)


@njit(**CORE)
def _refresh_apart(core: int, s: int) -> bool:
    """Numbers of a string's end, and its flight over a frame as far as it is heard; whether its certificate still holds."""
    shared, bank = shared_of(core), bank_of(core)
    hand, expression = hand_of(core, s), expression_of(core, s)
    plain, model = string_model(shared.model_at[hand.model, PLAIN]), model_of(core, s)
    end, fixed = end_at(shared.end_at[s]), bank.models[hand.model]
    bend_ratio = 2.0 ** (expression.bend / 12.0)
    certain = end.counts[REACH_OF] == hand.model + 1 and end.numbers[RAISED] == expression.height
    certain = certain and end.counts[ENGAGED] == 0 and not is_held(hand)
    certain = certain and outlives_bend(shared.end_at[s], bend_ratio / end.numbers[RATIO])
    end.numbers[RATIO], end.numbers[RAISED] = bend_ratio, expression.height
    if end.counts[REACH_OF] != hand.model + 1:
        for j in range(end.kick.size):
            c = _moment(fixed.length, j) if j < fixed.own else 0.0
            end.kick[j] = -c
            end.pull[j] = fixed.mu * c
        end.numbers[LENGTH] = fixed.length
        # by whole vectors: what is behind the last one rests
        audible = fixed.n if fixed.n <= fixed.audible else max(1, fixed.audible // PAD) * PAD
        end.counts[HEARD_MODES] = audible
        end.counts[FELT_MODES] = min(audible, padded(fixed.driven)) if settings_of(core).economy else audible
        for k in range(fixed.contacts):
            end.leverage[k] = bank.leverage[fixed.leverage + k]
        end.numbers[LARGEST_LEVERAGE], end.numbers[LARGEST_SHAPE] = fixed.largest_leverage, fixed.largest_shape
        end.counts[REACH_OF] = hand.model + 1
    set_apart_modes(shared.end_at[s])
    end.numbers[TENSION] = fixed.tension * bend_ratio * bend_ratio / fixed.length
    end.numbers[RELIEF] = 1.0 / (bend_ratio * bend_ratio) - 1.0
    # no frequency falls by more than the bend: stiffness stays
    end.numbers[KICK_REACH] = fixed.kick_reach * max(1.0, 1.0 / bend_ratio)
    bent = 1.0 if expression.bend != 0.0 else 0.0
    for j in range(plain.modes):
        end.sigma[j] = damping(plain.sigma[j], expression.hand, bent * model.omega[j] * plain.dt)
    n = end.counts[APART_MODES]
    quick_coefficients(EXACT_HOLD, model.omega[:n], end.sigma[:n], plain.mu, 1.0 / settings_of(core).rate_hz, end.flight)
    complete_rows(end.flight, padded(n))
    return certain
