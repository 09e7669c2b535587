"""The kinds of effect that presets may name, `[[effect]] kind = "…"`, and their tables.

A module adds one with `register`; one that is installed is found by its entry point in the group `jawari.effects`, whose
name is the kind (`extensions`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from synth.extensions import Extensions
from synth.instrument.table import Table, kind_of

if TYPE_CHECKING:  # who only reads presets does not load Numba
    from synth.dsp.effect import Effect

EFFECTS: Extensions[Effect] = Extensions("jawari.effects", "an effect")


class EffectTable(Table):
    """A table [[effect]]: its kind, and in a class of its own what that kind needs."""

    kind: str


def register(effect: Effect) -> Effect:
    """Let presets name an effect. Raises ValueError for a kind that is taken or no name, TypeError for settings that are no
    EffectTable."""
    if not (isinstance(effect.settings, type) and issubclass(effect.settings, EffectTable)):
        raise TypeError(f"settings of the effect {effect.kind} must be a subclass of EffectTable, got {effect.settings!r}")
    return EFFECTS.join(effect.kind, effect)


def effect_of(kind: str) -> Effect:
    """The effect of a kind. Raises ValueError for one that nobody has registered."""
    return EFFECTS.get(kind)


def settings_of(table: Any) -> type[Table]:
    """The class of what stands in an [[effect]] of the file. Raises ValueError where its kind is missing or unknown."""
    found = effect_of(kind_of(table, "effect")).settings
    assert found is not None
    return found


def as_effect(value: Any) -> Any:
    """An [[effect]] of the file as its kind's class; what is no table stays as it is."""
    return settings_of(value).model_validate(value) if isinstance(value, dict) else value
