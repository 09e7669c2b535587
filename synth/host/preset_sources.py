"""What the literature has of how presets sound: keys of `research.citations.ARTICLES`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from synth.research.citations import sources_of

if TYPE_CHECKING:
    from synth.instrument.preset import Preset


def sources_of_presets(scheme: str, presets: Iterable[Preset]) -> list[str]:
    """Keys of ARTICLES that notes of presets rest on, computed by a scheme."""
    played = list(presets)
    return sources_of(scheme, any(preset.coupled for preset in played), any(map(_slips, played)))


def _slips(preset: Preset) -> bool:
    """Whether strings are plucked, and slide off the finger in a while."""
    if preset.excitation is not None and preset.excitation.kind != "pluck":
        return False
    times: list[Any] = [preset.pluck.slip_ms, preset.pluck.hardest_slip_ms]
    return any(max(each.values()) > 0.0 if isinstance(each, Mapping) else each > 0.0 for each in times)
