"""One row of tools/fit-recordings: a note and a split."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fit_recordings.prediction import SPLITS, Effort, has, of_split, predict
from fit_recordings.strokes import sounded
from fit_recordings.takes import named, read
from synth.fit.pitch import find_series
from synth.fit.recording import FitRefused
from synth.instrument.preset import Preset, load_preset
from synth.units import midi_to_hz, midi_to_note, note_to_midi


def retuned(preset: Preset, opened: str) -> Preset:
    """The preset with other open strings, low to high and separated by commas. Raises ValueError."""
    names = [name.strip() for name in opened.split(",") if name.strip()]
    tables = [table for table in preset.string if not table.sympathetic]
    if len(names) != len(tables):
        raise ValueError(f"--open must name {len(tables)} notes, one for each string of {preset.name}, got {opened!r}")
    keys = sorted(note_to_midi(name) for name in names)
    tables.sort(key=lambda table: table.notes[0])
    return preset.model_copy(update={
        "string": tuple(t.model_copy(update={"notes": (key, key)}) for t, key in zip(tables, keys, strict=True))
    })  # fmt: skip


def splits(folder: Path, notes: list[str] | None) -> list[tuple[str, str]]:
    """[(note, split)] that a folder has the recordings for. Raises ValueError where it has none."""
    found = named(folder)
    wanted = {note_to_midi(note) for note in notes} if notes else set(found)
    if missing := sorted(wanted - set(found)):
        raise ValueError(f"{folder}: has no note {midi_to_note(missing[0])}; it has {', '.join(map(midi_to_note, found))}")
    out = []
    for key in sorted(wanted):
        dynamics = [dynamic for dynamic, _, _ in found[key]]
        out += [(midi_to_note(key), split) for split in SPLITS if has(dynamics, split)]
    if not out:
        needs = "; ".join(f"{name}: {', '.join(a)} and {' or '.join(b)}" for name, (a, b) in SPLITS.items())
        raise ValueError(f"{folder}: no note has the dynamics that are fitted and predicted ({needs}); record them")
    return out


def row(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """`said`: what `predict` found, as JSON. Parameters: folder, note, split, preset, opened, and those of `Effort`."""
    effort = dict(parameters)
    folder, note, split, preset, opened = (effort.pop(name) for name in ("folder", "note", "split", "preset", "opened"))
    key = note_to_midi(note)
    takes = read(key, of_split(named(Path(folder))[key], split))
    middle = takes[len(takes) // 2]
    series = find_series(middle.note, float(midi_to_hz(key)), moved_cents=30.0)
    hz = series.f0_hz * (1.0 + series.inharmonicity) ** 0.5
    shaped = load_preset(preset)
    shaped = retuned(shaped, opened) if opened else shaped
    try:
        found = predict(takes, sounded(shaped, key, hz), SPLITS[split][0], Effort(**effort))
    except FitRefused as refused:
        found = {"refused": str(refused)}
    return {"said": json.dumps({"note": note, "split": split} | found)}
