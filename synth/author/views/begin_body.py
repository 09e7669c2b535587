"""A body to begin with, for strings that end in nothing that moves: estimates, to be shaped or replaced by what was
measured.

begin(preset) -> {edits: [{path, value}], said} or {edits: null, said: why not}. In one edit they give the preset the modes
of `ESTIMATES`, what is heard of them at the level at which the hardest stroke peaks near −6 dBFS (played to find it),
places on the bridge where every string is a table of its own, and a line in its remarks that these are estimates; and take
out what has no meaning beside them: the filter of `body.resonance`, levels of single strings.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from synth.dsp.measures import peak
from synth.engine.engine import Engine
from synth.host.string_tape import QUALITY, RATE_HZ
from synth.instrument.compile import string_notes
from synth.instrument.preset import Preset, PresetError, validate_preset
from synth.midi.events import NOTE_ON, make_events
from synth.units import gain_to_db

#: frequency_hz, q, mass_kg and shape of modes as instruments with a top of wood have them, air, top and back first; of none
ESTIMATES = (
    (105.0, 20.0, 1.4, (1.0, 0.02)),
    (195.0, 20.0, 0.8, (1.0, 0.05)),
    (260.0, 28.0, 1.0, (0.9, 0.2)),
    (380.0, 30.0, 0.8, (1.0, 0.15)),
    (540.0, 38.0, 0.6, (1.0, 0.1)),
    (770.0, 40.0, 0.5, (1.0, 0.15)),
    (1100.0, 38.0, 0.4, (1.0, 0.25)),
    (1700.0, 32.0, 0.35, (1.0, 0.2)),
    (2700.0, 25.0, 0.3, (1.0, 0.3)),
)
REMARK = "The body's modes are estimates to begin with: measured on no instrument."
#: between neighbours on the bridge [mm]
SPACING_MM = 10.0
#: what the hardest stroke peaks at [dBFS], how long it is played to find that [s], and most strings that can share a body
PEAK_DBFS, PLAYED_S, MOST_STRINGS = -6.0, 0.5, 32


def begin(preset: Preset, *, quality: str = QUALITY, rate_hz: float = RATE_HZ) -> dict[str, Any]:
    """The edits that begin a body; see the module's docstring."""
    count = sum(len(string_notes(table)) for table in preset.string)
    if preset.coupled:
        return {"edits": None, "said": "The strings already share a body."}
    if count > MOST_STRINGS:
        why = f"All {count} strings would move with every note, too heavy to play; use at most {MOST_STRINGS} strings."
        return {"edits": None, "said": why}
    edits: list[dict[str, Any]] = [
        {"path": f"string.{number}.gain_db", "value": None}
        for number, table in enumerate(preset.string)
        if "gain_db" in table.model_fields_set
    ]
    if len(preset.string) == count:
        for number, table in enumerate(preset.string):
            if "place_mm" not in table.model_fields_set:
                edits.append({"path": f"string.{number}.place_mm", "value": SPACING_MM * (number - 0.5 * (count - 1))})
    modes = [{"frequency_hz": hz, "q": q, "mass_kg": mass, "shape": list(shape)} for hz, q, mass, shape in ESTIMATES]
    if preset.polarisation is not None and preset.polarisation.heard is not None:  # what is heard is the body
        edits.append({"path": "polarisation.heard", "value": None})
    # a body's modes have sides of their own
    edits += [{"path": f"string.{i}.pan", "value": None} for i, table in enumerate(preset.string) if table.pan != 0.0]
    for name, default in (("resonance", ()), ("direct_db", 0.0)):
        if getattr(preset.body, name) != default:
            edits.append({"path": f"body.{name}", "value": None})
    edits += [{"path": f"body.mode.{number}", "value": mode} for number, mode in enumerate(modes)]
    edits.append({"path": "output.kind", "value": "body"})
    remarks = preset.remarks if REMARK in preset.remarks else f"{preset.remarks}\n{REMARK}".lstrip("\n")
    edits.append({"path": "remarks", "value": remarks})
    gain_db = _gain_db(preset, modes, quality, rate_hz)
    edits.append({"path": "output.gain_db", "value": gain_db})
    return {"edits": edits, "said": f"A body of {len(modes)} modes: estimates, not measured on an instrument."}


def _gain_db(preset: Preset, modes: list[dict[str, Any]], quality: str, rate_hz: float) -> float:
    """Level at which the hardest strokes on the lowest and the highest string peak near `PEAK_DBFS`. Raises PresetError
    where the preset cannot have a body."""
    data = preset.model_dump(exclude_unset=True)
    data["string"] = [
        {key: value for key, value in table.items() if key not in ("gain_db", "pan")} for table in data["string"]
    ]
    if preset.polarisation is not None:
        data["polarisation"] = {key: value for key, value in data["polarisation"].items() if key != "heard"}
    data |= {"output": {"kind": "body"}, "body": {"mode": modes}, "effect": ()}
    try:
        trial = validate_preset(data, preset.name)
    except PresetError as error:
        raise PresetError(f"{preset.name}: cannot have a body: {str(error).splitlines()[-1].strip()}") from None
    notes = sorted({note for table in preset.string for note in (table.notes[0], table.notes[1])})
    loudest = 0.0
    engine = Engine([trial], quality=quality, limiter=False, only_notes=[{notes[0], notes[-1]}], every_fret=False)
    engine.prepare(rate_hz)
    for note in {notes[0], notes[-1]}:
        engine.reset()
        out = np.zeros((round(PLAYED_S * rate_hz), 2))
        engine.process(make_events([(0, NOTE_ON, 0, note, 127)]), out)
        loudest = max(loudest, peak(out))
    return round(PEAK_DBFS - gain_to_db(loudest), 1)
