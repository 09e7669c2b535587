"""Whether an engine can go on from a State: every number of it that the core counts, indexes or computes with.

The core trusts its arrays. A State that comes from outside is looked at here first: each index leads to where there is
something, each choice is one there is, what belongs together goes together, and all else is finite. What a State within
these limits may still do is blow up, and for that there is a guard (`advance`, `mix`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from synth.dsp.limiter import LimiterState, limiter_problem
from synth.engine import layout
from synth.engine.expression import MOST_BEND, MOST_RETUNING
from synth.engine.layout import (
    BLOWN_UP,
    FADE,
    NO_FINGER,
    PARAMETER_RANGES,
    PRESS,
    QUANTUM,
    Bank,
    Settings,
    State,
)
from synth.engine.notes import RPN_NONE
from synth.engine.strings import PRESS_S
from synth.engine.zones import CHANNELS, LOWER, MOST_MEMBERS, UPPER, master_of
from synth.solver.kernels import FOR_EVER
from synth.solver.laws import EXACT_HOLD

#: counts and frames of a state: 2⁵², 3000 years at 48 kHz, and as much again to go on before a double cannot count them
MOST_COUNT = 1 << 52
#: what is sound, force or coefficient stays below this
MOST = 1e3 * BLOWN_UP
#: loudest channel: volume 127 over 100, squared
_LOUDEST = 1.27**2
_ROUNDING = 1e-9


class _Check:
    """Refuses the first thing that is not as it must be."""

    def __init__(self, name: str, rows: Any) -> None:
        self._name, self._rows = name, rows

    def within(self, field: str, low: Any, high: Any, where: Any = True) -> None:
        """Every value of a field (of those `where` says), bounds included; no value is NaN."""
        values = self._rows[field] if field else self._rows
        good = (values >= low) & (values <= high)
        if where is not True:
            good |= ~where
        if not good.all():
            place = tuple(np.argwhere(~good)[0])
            bounds = [np.broadcast_to(bound, values.shape)[place] for bound in (low, high)]
            label = f"{self._name}.{field}" if field else self._name
            raise ValueError(
                f"the state cannot be gone on from: {label}[{', '.join(map(str, place))}] must lie between {bounds[0]} and "
                f"{bounds[1]}, got {values[place]}"
            )


def require(holds: Any, what: str) -> None:
    """Refuse the state unless all of `holds` are true."""
    if not np.all(holds):
        raise ValueError(f"the state cannot be gone on from: {what}")


def check_state(bank: Bank, settings: Settings, like: State, state: State, defaults: np.ndarray) -> None:
    """Raises ValueError, naming the number, unless the core can go on from `state`.

    like: a State of the engine's own, for the shapes; state.pending holds the events that wait and no more.
    defaults: (parts, N_PARAMETERS) live parameters as the presets have them, which may lie outside their ranges.
    """
    for name, array in state._asdict().items():
        if array.dtype.kind == "f":
            _Check(name, array).within("", -MOST, MOST)
        elif array.dtype.names:
            for field in array.dtype.names:
                if name != "pending" and array.dtype[field].kind == "f":
                    _Check(name, array).within(field, -MOST, MOST)
        require(name == "pending" or array.shape == like._asdict()[name].shape, f"{name} has the shape {array.shape}")
    _check_time(state)
    _check_channels(state)
    _check_strings(bank, settings, state)
    _check_parts(settings, state, defaults)
    _check_events(state)
    if settings.limiter:
        _Check("ring", state.ring).within("", -settings.ceiling, settings.ceiling)
    limiter = LimiterState(state.delay, state.required, state.released, state.limiter_counters, state.limiter_levels)
    problem = limiter_problem(limiter, settings.ceiling)
    require(problem is None, f"limiter: {problem}")


def _check_time(state: State) -> None:
    counters = _Check("counters", state.counters)
    counters.within("", 0, MOST_COUNT)
    now, produced = int(state.counters[layout.NOW]), int(state.counters[layout.PRODUCED])
    require(produced % QUANTUM == 0, f"counters: {produced} frames are computed, which are no whole quanta of {QUANTUM}")
    require(
        now - QUANTUM <= produced <= now,
        f"counters: {produced} frames are computed, {now} given out; there must be fewer than {QUANTUM} between",
    )
    _Check("meters", state.meters).within("", 0.0, MOST)
    _Check("unplayed", state.unplayed).within("", 0, MOST_COUNT)
    _Check("quiet", state.quiet).within("", 0, MOST_COUNT)


def _check_channels(state: State) -> None:
    check = _Check("channels", state.channels)
    widest = MOST_BEND + 1.0
    for field, low, high in (
        ("program", 0, 127),
        ("volume", 0.0, _LOUDEST * (1.0 + _ROUNDING)),
        ("expression", 0.0, 1.0),
        ("pan", -1.0, 1.0),
        ("sustain", 0, 1),
        ("legato", 0, 1),
        ("rpn", 0, RPN_NONE),
        ("bend_raw", -1.0, 1.0),
        ("bend_range", 0.0, widest),
        ("bend", -widest, widest),
        ("pressure", 0.0, 1.0),
        ("timbre", 0, 127),
        ("master", 0, CHANNELS - 1),
    ):
        check.within(field, low, high)
    _Check("zones", state.zones).within("", 0, MOST_MEMBERS)
    lower, upper = int(state.zones[LOWER]), int(state.zones[UPPER])
    require(
        state.channels["master"] == [master_of(c, lower, upper) for c in range(CHANNELS)],
        f"channels.master are not those of zones of {lower} and {upper} members",
    )
    _Check("tuning", state.tuning).within("", -MOST_RETUNING, MOST_RETUNING)


def _check_strings(bank: Bank, settings: Settings, state: State) -> None:
    me, strings, models = state.sounding, bank.strings, bank.models
    check = _Check("sounding", me)
    for field in ("awake", "free", "certain", "altered", "held", "sustained", "stolen", "flying"):
        check.within(field, 0, 1)
    awake = me["awake"] == 1
    for field, low, high in (
        ("model", 0, models.size - 1),
        ("pending_model", 0, models.size - 1),
        ("note", 0, 127),
        ("channel", 0, CHANNELS - 1),
        ("fade_at", 0, me["fade_to"]),
        ("fade_to", 0, FADE),
        # of a span that has been mixed nothing is left
        ("direct_from", 0, 0),
        ("direct_to", 0, 0),
        ("row_from", 0, 0),
        ("row_to", 0, 0),
        ("reached", 0, QUANTUM),
        ("mode_steps", 0, MOST_COUNT),
        ("unsolved", 0, MOST_COUNT),
        ("silenced", 0, MOST_COUNT),
        ("stale", 0, 2),
        ("plucked_at", 0, state.counters[layout.N_NOTES]),
        ("phase", 0, np.where(awake, layout.DRAW, NO_FINGER)),
        ("n", np.where(awake, 1, 0), strings["cap"]),
        ("hand", 0.0, MOST),
        ("bend", -MOST_BEND, MOST_BEND),
        (
            "height",
            1e-6 * PARAMETER_RANGES[layout.HEIGHT][0] - _ROUNDING,
            1e-6 * PARAMETER_RANGES[layout.HEIGHT][1] + _ROUNDING,
        ),
        ("retuned", -MOST_RETUNING, MOST_RETUNING),
        ("retune_to", -MOST_RETUNING, MOST_RETUNING),
        ("pressure", 0.0, 1.0),
        ("key_pressure", 0.0, 1.0),
        ("timbre", -1.0, 1.0),
        ("lift", 0.0, MOST),
        ("level", 0.0, MOST),
        ("finger_k", 0.0, MOST),
        ("finger_r", 0.0, MOST),
        ("pending_velocity", 0.0, 127.0),
    ):
        check.within(field, low, high)
    check.within("n", 0, models["n"][me["model"]], awake)
    own = [set(bank.positions["model"][bank.positions["string"] == s].tolist()) for s in range(strings.size)]
    pressing = awake & (me["phase"] == PRESS)
    for s in np.flatnonzero(awake):
        require(int(me["model"][s]) in own[s], f"sounding.model[{s}] is {me['model'][s]}, which is of another string")
    for s in np.flatnonzero(pressing):
        target = int(me["pending_model"][s])
        require(target in own[s], f"sounding.pending_model[{s}] is {target}, which is of another string")
    fingered = awake & (me["phase"] != NO_FINGER)
    draws = np.maximum(strings["draw_s"], PRESS_S) * settings.rate_hz
    check.within("finger_steps", 1, np.maximum(2, np.rint(draws)) * strings["factor"], fingered)
    check.within("finger_step", 0, me["finger_steps"] - 1, fingered)
    # an output at the output rate needs a bus there, and an engine whose strings fly
    can_fly = (strings["direct_bus"] >= 0) & bool(settings.economy) & (settings.law == EXACT_HOLD)
    flies = awake & ((me["flying"] == 1) | (me["fade_to"] > me["fade_at"]))
    require(can_fly | ~flies, "sounding.flying or .fade_to of a string that cannot fly")
    require((me["free"] == 1) | ~(awake & (me["flying"] == 1) & (me["stale"] == 0)), "sounding.flying of a string not free")
    require(~(fingered & (me["flying"] == 1)), "sounding.flying of a string under a finger")
    for s in np.flatnonzero(awake & (me["bend"] != 0.0) & (me["stale"] == 0)):
        bent = state.omega[strings["off"][s] : strings["off"][s] + models["cap"][me["model"][s]]]
        require(bent > 0.0, f"omega of string {s}, which is bent, must be positive")
    _Check("looked", state.looked).within("", 0, 1)
    _Check("until", state.until).within("", 0, FOR_EVER)
    _Check("renewed", state.renewed).within("", -1, MOST_COUNT)
    _Check("clock", state.clock).within("", 0, MOST_COUNT)
    _Check("moving", state.moving).within("", 0, strings["cap"])


def _check_parts(settings: Settings, state: State, defaults: np.ndarray) -> None:
    check = _Check("part_state", state.part_state)
    loudest = 2.0 * _LOUDEST * PARAMETER_RANGES[layout.GAIN][1] * settings.gain
    for field, low, high in (
        ("left", -loudest, loudest),
        ("right", -loudest, loudest),
        ("hand", 0.0, 127.0),
        (
            "height",
            1e-6 * PARAMETER_RANGES[layout.HEIGHT][0] - _ROUNDING,
            1e-6 * PARAMETER_RANGES[layout.HEIGHT][1] + _ROUNDING,
        ),
        ("still", 0, 1),
        ("channel", 0, CHANNELS - 1),
        ("silenced", 0, MOST_COUNT),
    ):
        check.within(field, low, high)
    low, high = np.array(PARAMETER_RANGES).T
    _Check("parameters", state.parameters).within("", low, high, state.parameters != defaults)


def _check_events(state: State) -> None:
    waiting = int(state.counters[layout.PENDING])
    require(waiting == state.pending.size, f"counters: {waiting} events wait, {state.pending.size} are there")
    check = _Check("pending", state.pending)
    check.within("frame", state.counters[layout.PRODUCED], state.counters[layout.NOW])
    require(np.diff(state.pending["frame"]) >= 0, "pending events are not in order")
