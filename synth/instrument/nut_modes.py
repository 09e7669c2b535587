"""From a preset's `[[nut]]` to the resonances of a string's end, single modes and fields of them alike."""

from __future__ import annotations

from functools import lru_cache

from synth.instrument.preset import NutMode
from synth.physics.string import NutResonance


@lru_cache(maxsize=64)  # every string of a preset ends on the same
def nut_resonances(modes: tuple[NutMode, ...]) -> tuple[NutResonance, ...]:
    """The resonances; those of a field move the two directions of a string independently."""
    return tuple(single for mode in modes for single in _singles(mode))


def _singles(mode: NutMode) -> tuple[NutResonance, ...]:
    field = mode.field()
    if field is None:
        return (NutResonance(mode.frequency_hz, mode.q, mode.mass_kg),)
    return tuple(
        NutResonance(
            each.frequency_hz,
            each.q,
            mode.mass_kg / each.shape[0] ** 2,
            across_mass_kg=mode.mass_kg / each.shape[1] ** 2,
        )
        for each in field
    )
