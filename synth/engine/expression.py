"""What a player does to a sounding string beside plucking it: bend, tuning, pressure.

Bends of channels and heights of parts are smoothed once for all strings (`process`); what is a string's own, its tuning
and the pressure on it, is smoothed here. All of it reaches the string at the borders of quanta.
"""

from __future__ import annotations

import math

from numba import njit

from synth.engine.board_tables import open_string
from synth.engine.core import bank_of, expression_of, hand_of, settings_of, shared_of, span_of, state_of, voice_of
from synth.engine.layout import CORE, FIRST_QUANTUM, HEIGHT, NO_FINGER, PARAMETER_RANGES, QUANTUM, TOUCHED

#: bends, pressures, tunings and obstacle heights follow their controls with this time constant [s]
CONTROL_S = 0.01
#: …and this is how a string that is pulled aside comes back under a stroke or another finger
LET_BACK_S = 0.003
#: no string is ever bent further than this [semitones]
MOST_BEND = 96.0
#: pluck position, as a share of the open length, of the brightest and of the darkest timbre
BRIGHT, DARK = 0.05, 0.5


@njit(**CORE)
def control_share(core: int) -> float:
    """Share of the way that a smoothed control goes in a quantum."""
    return 1.0 - math.exp(-QUANTUM / (CONTROL_S * settings_of(core).rate_hz))


@njit(**CORE)
def approach(now: float, target: float, share: float, close: float) -> float:
    """The next value of a smoothed control, which arrives when it is as close as that."""
    if now == target:
        return now
    now += share * (target - now)
    return target if abs(now - target) < close else now


@njit(**CORE)
def _pressed(core: int, s: int) -> float:
    """The pressure on a string, 0 … 1: of its channel, its zone and its key, as long as the key is held."""
    state = state_of(core)
    voice = voice_of(core, s)
    if not voice.held:
        return 0.0
    c = voice.channel
    master = state.channels[c].master
    total = state.channels[c].pressure + voice.key_pressure
    if master != c:
        total += state.channels[master].pressure
    return min(1.0, total)


@njit(**CORE)
def settle(core: int, s: int) -> None:
    """A silent string takes its tuning and pressure over at once."""
    voice, expression = voice_of(core, s), expression_of(core, s)
    expression.retuned = voice.retune_to
    expression.pressure = _pressed(core, s)


@njit(**CORE)
def follow(core: int, s: int) -> None:
    """A sounding string's tuning and pressure over one quantum."""
    voice, hand, expression = voice_of(core, s), hand_of(core, s), expression_of(core, s)
    pressed = _pressed(core, s)
    if expression.retuned != voice.retune_to or expression.pressure != pressed:
        share = control_share(core)
        expression.retuned = approach(expression.retuned, voice.retune_to, share, 1e-4)
        expression.pressure = approach(expression.pressure, pressed, share, 1e-4)
    if expression.pull != voice.pull_to:
        seconds = bank_of(core).parts[bank_of(core).strings[s].part].meend_s
        if hand.phase != NO_FINGER and hand.phase != TOUCHED:
            seconds = LET_BACK_S
        share = 1.0 - math.exp(-QUANTUM / (seconds * settings_of(core).rate_hz))
        expression.pull = approach(expression.pull, voice.pull_to, share, 1e-3)
    if expression.slide != 0.0:
        string = open_string(shared_of(core).board_at[hand.model])
        share = 1.0 - math.exp(-QUANTUM / (string.slide_s * settings_of(core).rate_hz))
        expression.slide = approach(expression.slide, 0.0, share, 1e-3)


@njit(**CORE)
def is_settled(core: int, s: int) -> bool:
    """Whether `follow` has nothing to follow."""
    voice, expression = voice_of(core, s), expression_of(core, s)
    tuned = expression.retuned == voice.retune_to and expression.pull == voice.pull_to and expression.slide == 0.0
    return tuned and expression.pressure == _pressed(core, s)


@njit(**CORE)
def vibrato_of(core: int, s: int, k: int) -> float:
    """Semitones by which the hand shakes a string in quantum k of the span: as far as the wheels of its channel and of its
    zone's master ask for, at instants that follow from the number of the quantum alone."""
    state, shared, span = state_of(core), shared_of(core), span_of(core)
    voice, part = voice_of(core, s), bank_of(core).parts[bank_of(core).strings[s].part]
    if part.vibrato == 0.0 or voice.idle:
        return 0.0
    c = voice.channel
    master = state.channels[c].master
    wheel = span.shakes[k, c]
    if master != c:
        wheel = min(1.0, wheel + span.shakes[k, master])
    if wheel == 0.0:
        return 0.0
    turns = (shared.task[FIRST_QUANTUM] + k) * (QUANTUM * part.vibrato_hz / settings_of(core).rate_hz)
    angle = 2.0 * math.pi * (turns - math.floor(turns))
    way = 0.5 * (1.0 - math.cos(angle)) if part.vibrato_up else math.sin(angle)
    return part.vibrato * wheel * way


@njit(**CORE)
def bend_of(core: int, s: int, k: int, of_channel: float, of_master: float) -> float:
    """Semitones of a string in quantum k of the span: bends of its channel and its zone's master, tuning, a finger's slide,
    its pull across the fret, its vibrato, pressure. No hand bends one that no key plays, or that has not been played."""
    state = state_of(core)
    voice, expression = voice_of(core, s), expression_of(core, s)
    if bank_of(core).strings[s].positions == 0 or voice.idle:
        return expression.retuned
    bend = of_channel
    if state.channels[voice.channel].master != voice.channel:
        bend += of_master
    part = bank_of(core).parts[bank_of(core).strings[s].part]
    bend += expression.retuned + expression.slide + expression.pressure * part.pressure_bend
    bend += expression.pull + vibrato_of(core, s, k)
    return max(-MOST_BEND, min(MOST_BEND, bend))


@njit(**CORE)
def height_of(core: int, s: int, of_part: float) -> float:
    """How far the obstacle is raised under a string [m]: with its part and by pressure, within the parameter's range."""
    expression = expression_of(core, s)
    low, high = PARAMETER_RANGES[HEIGHT]
    height = of_part + expression.pressure * bank_of(core).strings[s].pressure_height
    return max(1e-6 * low, min(1e-6 * high, height))


@njit(**CORE)
def pluck_place(position: float, timbre: float) -> float:
    """Where a note of some timbre is plucked, as a share of the open length, in ratios between bridge and middle."""
    if timbre == 0.0:
        return position
    end = min(position, BRIGHT) if timbre > 0.0 else max(position, DARK)
    return position * (end / position) ** abs(timbre)
