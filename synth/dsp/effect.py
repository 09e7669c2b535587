"""What an effect is: a filter on the sound of a part (mono) or on the mix (stereo).

    made     its constants, from settings and the output rate: a NamedTuple of numbers and of arrays declared by `arrays`
             (plugins hold them in memory that cannot be written: room for sums belongs into the state)
    at rest  its state: a NamedTuple of arrays of float64 and int64, which is all that it remembers
    process  a span of frames in place
    silent   whether, once nothing comes in, nothing worth going on with would come out

`process` and `silent` are plain functions that Numba compiles for C, and that are called by address: an effect recompiles
nothing but itself. Both take the address of a table of the constants and then the state (`openers`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from synth.jit.entries import entry
from synth.native.views import opener, words

#: outputs that are still to come count as nothing below this (−240 dBFS)
STILL_BELOW = 1e-12


def _none(made: Any) -> int:
    return 0


@dataclass(frozen=True)
class Effect:
    """An effect of which there may be many.

    kind      the name that presets have for it
    settings  class of its table in a preset, see `instrument.effects`; None: presets do not name it
    made      (settings, rate_hz) → constants. Raises ValueError for what cannot be
    at_rest   (constants, channels) → state of an effect that has heard silence only
    process   (effect, x, frames, channels): overwrite `frames_at(x, frames, channels)`, a multiple of 32 frames. However
              the stream is cut into spans, each sample is the same to the bit. Allocates nothing, waits for nothing
    silent    (effect) → 1, or 0 while it rings. Then its state is set back to rest, and until something comes in
              it is not called
    latency   (constants) → frames by which what comes out is late

    Processed on the thread that calls `Engine.process`.
    """

    kind: str
    made: Callable[[Any, float], Any]
    at_rest: Callable[[Any, int], Any]
    process: Callable[[int, int, int, int], None]
    silent: Callable[[int], int]
    settings: type | None = None
    latency: Callable[[Any], int] = _none


def check_state(effect: Effect, state: Any) -> None:
    """Raises TypeError for a state at rest that cannot be kept: other than arrays of float64 and int64."""
    for name, value in state._asdict().items():
        if not isinstance(value, np.ndarray) or value.dtype not in (np.float64, np.int64):
            raise TypeError(f"{effect.kind}: {name} of its state must be an array of float64 or int64, got {value!r:.40}")


def openers(made: Any, state: Any) -> tuple[Any, Any]:
    """What opens constants and state behind the address that `process` and `silent` get."""
    return opener(made), opener(state, words(made))


def compiled(effect: Effect) -> tuple[Any, Any]:
    """`process` and `silent` of an effect as C functions, kept for as long as their addresses are in use."""
    return entry(effect.process, 4), entry(effect.silent, 1, answers=True)


@njit(cache=True, nogil=True)
def still(x) -> int:
    """1 where every number of an array of two axes counts as nothing, else 0: what `silent` says of outputs to come."""
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            if abs(x[i, j]) >= STILL_BELOW:
                return 0
    return 1
