"""Chains of effects: one on every part, mono, and one on the mix, stereo. Effects are called by address."""

from __future__ import annotations

from numba import njit

from synth.engine.core import effects_of, stream_of
from synth.engine.layout import CORE
from synth.native.views import address_of, call_back, query


@njit(**CORE)
def run_chain(core: int, chain: int, x, channels: int) -> None:
    """Take the samples x (frames · channels, contiguous) through a chain's effects, in place."""
    effects = effects_of(core)
    for i in range(effects.chains[chain, 0], effects.chains[chain, 1]):
        call_back(effects.placed[i].process, effects.placed[i].table, address_of(x), x.size // channels, channels)


@njit(**CORE)
def chain_is_silent(core: int, chain: int) -> bool:
    """Whether nothing of a chain rings any more."""
    effects = effects_of(core)
    for i in range(effects.chains[chain, 0], effects.chains[chain, 1]):
        if query(effects.placed[i].silent, effects.placed[i].table) == 0:
            return False
    return True


@njit(**CORE)
def reset_chain(core: int, chain: int) -> None:
    """The effects of a chain forget all they have heard."""
    effects, stream = effects_of(core), stream_of(core)
    for i in range(effects.chains[chain, 0], effects.chains[chain, 1]):
        placed = effects.placed[i]
        for k in range(placed.number, placed.end_number):
            stream.effect_numbers[k] = effects.numbers[k]
        for k in range(placed.count, placed.end_count):
            stream.effect_counts[k] = effects.counts[k]
