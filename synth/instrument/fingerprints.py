"""What the motion of a preset's strings depends on, in few letters: by these a measured plan is known to be theirs.

Names, levels, tags, what is heard and what is done to the sound do not count, nor does the pitch, with which all goes in
proportion (`planfile.MeasuredString.at`). Numbers given at notes count as they are at the string's own note, and [setup] by
what it makes of the string and the obstacle under it (`neck`).
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

from synth.instrument.articulations import Articulation
from synth.instrument.neck import obstacle_under, strung
from synth.instrument.preset import Pluck, Preset, StringTable, at_note

#: of a string: what does not move it, and its pitch
_STRING = {"name", "notes", "cents", "choir", "sounds", "sympathetic", "gain_db", "pan", "place_mm", "angle_deg"}
#: of a pluck: what it rubs over, and what fingerprints are older than
_RUBBING = {"rub_percent", "edge_mm", "grain_mm"}
_LATER = {"arrival", "width_course"}
#: of a string: what fingerprints are older than
_LATER_STRING = {"unevenness_cents"}
#: of an articulation: what it rubs over and knocks at, which plans are measured without
UNSTEADY = frozenset({*_RUBBING, "knock_ratio"})
#: of an articulation: the ways to it, and what chords and legato do
WAYS = frozenset({"key", "controller", "velocity", "strum_ms", "slide_ms"})
#: the stroke of a plain pluck, as of an articulation that says nothing else
PLAIN = "plain"


def _resolved(data: Any, note: int) -> Any:
    """Data of the file with every number at notes as it is at this one."""
    if isinstance(data, dict):
        if data and all(isinstance(key, int) for key in data):
            return float(at_note(data, note))
        return {str(key): _resolved(value, note) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_resolved(each, note) for each in data]
    return float(data) if isinstance(data, int) and not isinstance(data, bool) else data


def _string(table: StringTable) -> dict[str, Any]:
    """What moves a string; of later additions what is not their default."""
    later = {name for name in _LATER_STRING if getattr(table, name) == type(table).model_fields[name].default}
    return table.model_dump(exclude=_STRING | later)


def _pluck(pluck: Pluck) -> dict[str, Any]:
    """A pluck without what it rubs over, which plans are measured without; of later additions what is not their default."""
    later = {name for name in _LATER if getattr(pluck, name) == type(pluck).model_fields[name].default}
    return pluck.model_dump(exclude=_RUBBING | later)


def _digest(data: Any) -> str:
    return hashlib.blake2b(json.dumps(data, sort_keys=True).encode(), digest_size=8).hexdigest()


def fingerprint(preset: Preset, table: StringTable, note: int) -> str:
    """Of one open string of a preset: 16 hexadecimal digits."""
    parts: dict[str, Any] = {
        "string": _string(strung(preset, table, note)),
        "nut": [mode.model_dump(exclude_defaults=True) for mode in preset.nut],
        "obstacle": obstacle_under(preset, table, note).model_dump(),
        "pluck": _pluck(preset.pluck),
        "polarisation": None if preset.polarisation is None else preset.polarisation.model_dump(exclude={"heard"}),
        "excitation": None if preset.excitation is None else preset.excitation.model_dump(),
        "coupled": preset.coupled,
    }
    return _digest(_resolved(parts, note))


def stroke_of(articulation: Articulation) -> str:
    """Of a way to begin a note, whatever chooses it."""
    said = articulation.model_dump(exclude=set(WAYS | UNSTEADY), exclude_defaults=True)
    return _digest(_resolved(said, 0)) if said else PLAIN


def strokes(preset: Preset) -> dict[str, Articulation]:
    """Every stroke of a preset by its fingerprint, the plain pluck among them."""
    return {PLAIN: Articulation(), **{stroke_of(each): each for each in preset.articulations.values()}}
