"""Strings that collide: a synthesizer engine for the tanpura, the fretted bass and their kin.

The public names are loaded when they are first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from typing import Any

from synth import kernel_cache

__all__ = ["EVENT", "Engine", "Preset", "list_presets", "load_preset", "simulate"]

kernel_cache.use()


def __getattr__(name: str) -> Any:
    if name == "Engine":
        from synth.engine.engine import Engine

        return Engine
    if name == "EVENT":
        from synth.engine.events import EVENT

        return EVENT
    if name in ("Preset", "list_presets", "load_preset"):
        from synth import preset

        return getattr(preset, name)
    if name == "simulate":
        from synth.simulation import simulate

        return simulate
    raise AttributeError(f"module 'synth' has no attribute {name!r}")
