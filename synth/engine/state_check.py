"""Whether an engine can go on from a State: every number of it that the core counts, indexes or computes with.

The core trusts its arrays. A State that comes from outside is looked at here first: each index leads to where there is
something, each choice is one there is, what belongs together goes together, and all else is finite (`state_limits`). What a
State within these limits may still do is blow up, and for that there is a guard (`advance`, `mix`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from synth.engine.bank import Strings
from synth.engine.layout import Bank, Settings, State
from synth.engine.state_limits import Limit, StateWords, limits_of


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
    waiting = arrays["pending"].size
    check_limits(limits_of(bank, settings, strings, arrays, defaults, (waiting, waiting)), arrays)
    problem = effects_problem(State(**{name: arrays[name] for name in State._fields}))
    if problem is not None:
        raise ValueError(f"the state cannot be resumed: {problem}")


def check_limits(limits: Iterable[Limit], arrays: Mapping[str, np.ndarray]) -> None:
    """Raises ValueError, naming the number, unless all words of `arrays` are within these limits."""
    for limit in limits:
        _look(limit, arrays)


def _look(limit: Limit, arrays: Mapping[str, np.ndarray]) -> None:
    """Raises ValueError for the first word that is not within a limit."""
    values = _values(limit.words, arrays)
    low, high = (
        bound if counted is None else bound + _values(counted, arrays)
        for bound, counted in ((limit.low, limit.above), (limit.high, limit.below))
    )
    good = (values >= low) & (values <= high)
    if limit.multiple > 1:
        good &= values % limit.multiple == 0
    for where in limit.where:
        bits = _values(where.words, arrays).view(np.int64)
        good |= (bits < where.low) | (bits > where.high)
    if good.all():
        return
    k = int(np.flatnonzero(~good)[0])
    place = np.unravel_index(limit.words.places[k], arrays[limit.words.array].shape)
    bounds: list[Any] = [np.broadcast_to(bound, values.shape)[k] for bound in (low, high)]
    label = f"{limit.label}[{', '.join(map(str, place))}]"
    raise ValueError(
        f"the state cannot be resumed: {limit.said.format(label=label, low=bounds[0], high=bounds[1], value=values[k])}"
    )


def _values(words: StateWords, arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    array = arrays[words.array]
    return (array[words.field] if words.field else array).reshape(-1)[words.places]
