"""Strings that collide: a synthesizer engine for the tanpura, the fretted bass and their kin.

The public names are loaded when they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from synth import kernel_cache

if TYPE_CHECKING:
    from synth.case import Case, CaseError, load_case
    from synth.engine.engine import Engine
    from synth.engine.events import EVENT
    from synth.host.memory import render
    from synth.host.messages import events_from_mido
    from synth.preset import Preset, PresetError, list_presets, load_preset
    from synth.result import Result, ResultError, load_result
    from synth.simulation import simulate

    __version__: str

__all__ = [
    "EVENT",
    "Case",
    "CaseError",
    "Engine",
    "Preset",
    "PresetError",
    "Result",
    "ResultError",
    "__version__",
    "events_from_mido",
    "list_presets",
    "load_case",
    "load_preset",
    "load_result",
    "render",
    "simulate",
]

_MODULES = {
    "EVENT": "synth.engine.events",
    "Case": "synth.case",
    "CaseError": "synth.case",
    "Engine": "synth.engine.engine",
    "Preset": "synth.preset",
    "PresetError": "synth.preset",
    "Result": "synth.result",
    "ResultError": "synth.result",
    "events_from_mido": "synth.host.messages",
    "list_presets": "synth.preset",
    "load_case": "synth.case",
    "load_preset": "synth.preset",
    "load_result": "synth.result",
    "render": "synth.host.memory",
    "simulate": "synth.simulation",
}

kernel_cache.use()


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("jawari")
        except PackageNotFoundError:
            return "unknown"
    if name not in _MODULES:
        raise AttributeError(f"module 'synth' has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__doc__", "__file__", "__name__", "__path__"])
