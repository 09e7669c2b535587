"""A preset that the program has made, written as a file that it reads."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from synth.files.targets import write_text
from synth.instrument.preset import Preset
from synth.units import midi_to_note


def preset_text(preset: Preset) -> str:
    """TOML of a preset; `parse_preset` gives an equal one."""
    import tomlkit

    return tomlkit.dumps(_plain(preset.model_dump(exclude_unset=True, exclude_none=True)))


def write_preset(preset: Preset, path: str | Path) -> None:
    """Raises OSError."""
    write_text(Path(path), preset_text(preset))


def _plain(value: Any, key: str = "") -> Any:
    if key == "notes":
        low, high = (midi_to_note(note) for note in value)
        return low if low == high else f"{low} - {high}"
    if isinstance(value, Mapping):
        named = {midi_to_note(k) if isinstance(k, int) else k: v for k, v in value.items()}
        return {k: _plain(v, k) for k, v in named.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return value
