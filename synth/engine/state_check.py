"""Whether an engine can go on from a State: every number of it that the core counts, indexes or computes with.

The core trusts its arrays. A State that comes from outside is looked at here first: each index leads to where there is
something, each choice is one there is, what belongs together goes together, and all else is finite. What a State within
these limits may still do is blow up, and for that there is a guard (`advance`, `mix`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from synth.engine import layout
from synth.engine.bank import Strings
from synth.engine.expression import MOST_BEND
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
from synth.engine.strings import LEAST_STIFFNESS, PRESS_S
from synth.engine.voices.channels import RPN_NONE
from synth.engine.voices.retuning import MOST_RETUNING
from synth.instrument.excitations import MOST_HOLD_S
from synth.midi.zones import CHANNELS, LOWER, MOST_MEMBERS, UPPER, master_of
from synth.solver.certificates import FOR_EVER
from synth.solver.lanes import BLOCK
from synth.solver.laws import EXACT_HOLD
from synth.solver.stringmodel import CERTAIN, CLOCK, FREE, MOVING, N_COUNTS, RESPONSE

#: counts and frames of a state: 2⁵², 3000 years at 48 kHz, and as much again to go on before a double cannot count them
MOST_COUNT = 1 << 52
#: what is sound, force or coefficient stays below this
MOST = 1e3 * BLOWN_UP
#: loudest channel: volume 127 over 100, squared
_LOUDEST = 1.27**2
_ROUNDING = 1e-9
HIGH = "must be positive"


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


def check_state(
    bank: Bank,
    settings: Settings,
    effects_problem: Callable[[State], str | None],
    strings: Strings,
    arrays: Mapping[str, np.ndarray],
    defaults: np.ndarray,
) -> None:
    """Raises ValueError, naming the number, unless the core can go on from `arrays`, of the engine's own shapes.

    effects_problem: what keeps the effects from going on, in words (`effect_chains.Chains.problem`).
    strings: the engine's own, for their sizes; `pending` holds the events that wait and no more.
    defaults: (parts, N_PARAMETERS) live parameters as the presets have them, which may lie outside their ranges.
    """
    state = State(**{name: arrays[name] for name in State._fields})
    for name, array in arrays.items():
        if array.dtype.kind == "f":
            _Check(name, array).within("", -MOST, MOST)
        elif array.dtype.names:
            for field in array.dtype.names:
                if name != "pending" and array.dtype[field].kind == "f":
                    _Check(name, array).within(field, -MOST, MOST)
    _check_time(state)
    _check_channels(state)
    _check_sounding(bank, settings, state)
    _check_strings(bank, settings, strings, state, arrays)
    _check_parts(settings, state, defaults)
    _check_events(state)
    _Check("ring", state.ring).within("", -settings.ceiling, settings.ceiling)
    problem = effects_problem(state)
    require(problem is None, str(problem))


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


def _check_sounding(bank: Bank, settings: Settings, state: State) -> None:
    me, strings, models = state.sounding, bank.strings, bank.models
    check = _Check("sounding", me)
    for field in ("awake", "altered", "held", "sustained", "stolen", "flying"):
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
        ("pending_velocity", 0.0, 127.0),
    ):
        check.within(field, low, high)
    own = [set(bank.positions["model"][bank.positions["string"] == s].tolist()) for s in range(strings.size)]
    pressing = awake & (me["phase"] == PRESS)
    for s in np.flatnonzero(awake):
        require(int(me["model"][s]) in own[s], f"sounding.model[{s}] is {me['model'][s]}, which is of another string")
    for s in np.flatnonzero(pressing):
        target = int(me["pending_model"][s])
        require(target in own[s], f"sounding.pending_model[{s}] is {target}, which is of another string")
    fingered = awake & (me["phase"] != NO_FINGER)
    longest = np.where(bank.parts["excited"][strings["part"]] != 0, MOST_HOLD_S, np.maximum(strings["draw_s"], PRESS_S))
    draws = longest * settings.rate_hz
    check.within("finger_steps", 1, np.maximum(2, np.rint(draws)) * strings["factor"], fingered)
    check.within("finger_step", 0, me["finger_steps"] - 1, fingered)
    require(~(fingered & (me["flying"] == 1)), "sounding.flying of a string under a finger")


def _check_strings(bank: Bank, settings: Settings, strings: Strings, state: State, arrays: Mapping[str, np.ndarray]) -> None:
    me, models = state.sounding, bank.models
    awake, fresh = me["awake"] == 1, me["stale"] == 0
    states = {name.removeprefix("string."): array for name, array in arrays.items()}
    mine = [strings.states.item(s, states) for s in range(bank.strings.size)]
    counts = np.array([item.counts for item in mine]).reshape(-1, N_COUNTS)
    check = _Check("string.counts", counts)
    most = np.array([item.q.size for item in mine], np.int64)
    limits = np.zeros((2, *counts.shape))
    limits[:, :, MOVING] = np.where(awake, 1, 0), np.where(awake, models["n"][me["model"]], most)
    limits[1, :, [CLOCK, CERTAIN, FREE]] = np.array([MOST_COUNT, 1, 1])[:, None]
    check.within("", *limits)
    # an output at the output rate needs a bus there, and an engine whose strings fly
    exact = np.array([strings.models[model].law == EXACT_HOLD for model in me["model"]], bool)
    can_fly = (bank.strings["direct_bus"] >= 0) & bool(settings.economy) & exact
    flies = awake & ((me["flying"] == 1) | (me["fade_to"] > me["fade_at"]))
    require(can_fly | ~flies, "sounding.flying or .fade_to of a string that cannot fly")
    free = counts[:, FREE] == 1
    require(free | ~(awake & (me["flying"] == 1) & fresh), "sounding.flying of a string not free")
    for s in np.flatnonzero(awake & (me["altered"] == 1) & fresh).tolist():
        own = {name.removeprefix("own."): array for name, array in arrays.items()}
        mine_own, contacts = strings.coefficients.item(s, own), int(models["contacts"][me["model"][s]])
        require(
            mine_own.omega[: models["n"][me["model"][s]]] > 0.0, f"own.omega of string {s}, which is damped or bent, {HIGH}"
        )
        matrix = mine_own.matrix[: contacts**2].reshape(contacts, contacts)
        lags = mine_own.lags[: contacts**2 * RESPONSE].reshape(contacts, contacts, RESPONSE)
        for name, diagonal in (("matrix", matrix.diagonal()), ("lags", lags[:, :, BLOCK].diagonal())):
            require(diagonal > 0.0, f"own.{name} of string {s}, which is damped or bent, {HIGH} on its diagonal")
    for s in np.flatnonzero(awake & (me["phase"] != NO_FINGER)).tolist():
        require(mine[s].finger[0]["stiffness"] >= LEAST_STIFFNESS, f"string.finger.stiffness of string {s} {HIGH}")
        require(mine[s].grip_own[0, BLOCK] >= 0.0, f"string.grip_own of string {s} must not be negative")
    _Check("string.looked", states["looked"]).within("", 0, 1)
    _Check("string.until", states["until"]).within("", 0, FOR_EVER)
    _Check("string.renewed", states["renewed"]).within("", -1, MOST_COUNT)
    finger = _Check("string.finger", states["finger"])
    for field, high in (("on", 1), ("stiffness", MOST), ("resistance", MOST)):
        finger.within(field, 0, high)


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
