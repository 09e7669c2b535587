"""Strings that collide: a synthesizer engine for the tanpura, the fretted bass and their kin.

The public names are loaded when they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from synth._version import __version__
from synth.jit import kernel_cache

if TYPE_CHECKING:
    from synth.engine.engine import Engine
    from synth.host.batch import Note, RenderedNote, render_notes
    from synth.host.memory import render
    from synth.host.soundclip import Sound
    from synth.instrument.preset import Preset, PresetError, list_presets, load_preset
    from synth.midi.events import EVENT
    from synth.midi.messages import events_from_mido
    from synth.research.case import Case, CaseError, load_case
    from synth.research.coupled.coupled_result import CoupledResult
    from synth.research.result import Result, ResultError, load_result
    from synth.research.simulation import simulate

__all__ = [
    "EVENT",
    "Case",
    "CaseError",
    "CoupledResult",
    "Engine",
    "Note",
    "Preset",
    "PresetError",
    "RenderedNote",
    "Result",
    "ResultError",
    "Sound",
    "__version__",
    "events_from_mido",
    "list_presets",
    "load_case",
    "load_preset",
    "load_result",
    "render",
    "render_notes",
    "simulate",
]

_MODULES = {
    "EVENT": "synth.midi.events",
    "Case": "synth.research.case",
    "CaseError": "synth.research.case",
    "CoupledResult": "synth.research.coupled.coupled_result",
    "Engine": "synth.engine.engine",
    "Note": "synth.host.batch",
    "Preset": "synth.instrument.preset",
    "PresetError": "synth.instrument.preset",
    "RenderedNote": "synth.host.batch",
    "Result": "synth.research.result",
    "ResultError": "synth.research.result",
    "Sound": "synth.host.soundclip",
    "events_from_mido": "synth.midi.messages",
    "list_presets": "synth.instrument.preset",
    "load_case": "synth.research.case",
    "load_preset": "synth.instrument.preset",
    "load_result": "synth.research.result",
    "render": "synth.host.memory",
    "render_notes": "synth.host.batch",
    "simulate": "synth.research.simulation",
}

kernel_cache.use()


if not TYPE_CHECKING:  # a type checker would take any name for one of the package

    def __getattr__(name: str) -> Any:
        if name not in _MODULES:
            raise AttributeError(f"module 'synth' has no attribute {name!r}")
        return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__doc__", "__file__", "__name__", "__path__"])
