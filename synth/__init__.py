"""Strings that collide: a synthesizer engine for the tanpura, the fretted bass and their kin.

The public names are loaded when they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from synth._version import __version__
from synth.jit import kernel_cache

if TYPE_CHECKING:
    from synth.engine.engine import Engine, EngineReport
    from synth.engine.engine_settings import EngineSettings
    from synth.engine.parameters import Parameter
    from synth.fit.estimate import Fit, fit_recording
    from synth.fit.recording import FitRefused
    from synth.host.batch import Note, RenderedNote, render_notes
    from synth.host.citing import cite
    from synth.host.memory import render
    from synth.host.render import RenderReport
    from synth.host.soundclip import Sound
    from synth.instrument.preset import Preset, PresetError, list_presets, load_preset
    from synth.midi.events import EVENT, NOTE_OFF, NOTE_ON, make_events
    from synth.midi.messages import events_from_mido
    from synth.physics.string import String
    from synth.research.case import Case, CaseError, case_names, load_case
    from synth.research.coupled.coupled_result import CoupledResult, load_coupled_result
    from synth.research.result import Result, ResultError, load_result
    from synth.research.simulation import simulate
    from synth.study.studyfile import StudyError
    from synth.study.sweeping import read_arrays, read_rows, read_table, sweep

__all__ = [
    "EVENT",
    "NOTE_OFF",
    "NOTE_ON",
    "Case",
    "CaseError",
    "CoupledResult",
    "Engine",
    "EngineReport",
    "EngineSettings",
    "Fit",
    "FitRefused",
    "Note",
    "Parameter",
    "Preset",
    "PresetError",
    "RenderReport",
    "RenderedNote",
    "Result",
    "ResultError",
    "Sound",
    "String",
    "StudyError",
    "__version__",
    "case_names",
    "cite",
    "events_from_mido",
    "fit_recording",
    "list_presets",
    "load_case",
    "load_coupled_result",
    "load_preset",
    "load_result",
    "make_events",
    "read_arrays",
    "read_rows",
    "read_table",
    "render",
    "render_notes",
    "simulate",
    "sweep",
]

_MODULES = {
    "EVENT": "synth.midi.events",
    "NOTE_OFF": "synth.midi.events",
    "NOTE_ON": "synth.midi.events",
    "Case": "synth.research.case",
    "CaseError": "synth.research.case",
    "CoupledResult": "synth.research.coupled.coupled_result",
    "Engine": "synth.engine.engine",
    "EngineReport": "synth.engine.engine",
    "EngineSettings": "synth.engine.engine_settings",
    "Fit": "synth.fit.estimate",
    "FitRefused": "synth.fit.recording",
    "Note": "synth.host.batch",
    "Parameter": "synth.engine.parameters",
    "Preset": "synth.instrument.preset",
    "PresetError": "synth.instrument.preset",
    "RenderReport": "synth.host.render",
    "RenderedNote": "synth.host.batch",
    "Result": "synth.research.result",
    "ResultError": "synth.research.result",
    "Sound": "synth.host.soundclip",
    "String": "synth.physics.string",
    "StudyError": "synth.study.studyfile",
    "case_names": "synth.research.case",
    "cite": "synth.host.citing",
    "events_from_mido": "synth.midi.messages",
    "fit_recording": "synth.fit.estimate",
    "list_presets": "synth.instrument.preset",
    "load_case": "synth.research.case",
    "load_coupled_result": "synth.research.coupled.coupled_result",
    "load_preset": "synth.instrument.preset",
    "load_result": "synth.research.result",
    "make_events": "synth.midi.events",
    "read_arrays": "synth.study.sweeping",
    "read_rows": "synth.study.sweeping",
    "read_table": "synth.study.sweeping",
    "render": "synth.host.memory",
    "render_notes": "synth.host.batch",
    "simulate": "synth.research.simulation",
    "sweep": "synth.study.sweeping",
}

kernel_cache.use()


if not TYPE_CHECKING:  # a type checker would take any name for one of the package

    def __getattr__(name: str) -> Any:
        if name not in _MODULES:
            raise AttributeError(f"module 'synth' has no attribute {name!r}")
        return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__doc__", "__file__", "__name__", "__path__"])
