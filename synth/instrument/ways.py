"""The ways to a preset's articulations, in words: which key, controller or velocity plays which."""

from __future__ import annotations

from collections.abc import Sequence

from synth.instrument.articulations import Articulation, articulation_names
from synth.instrument.preset import Preset, playable_notes
from synth.units import midi_to_note


def switch_keys(preset: Preset) -> dict[int, str]:
    """Keys that switch to an articulation, and its name, in the order of the keys."""
    keyed = {each.key: name for name, each in preset.articulations.items() if each.key is not None}
    return dict(sorted(keyed.items()))


def ways(preset: Preset) -> list[str]:
    """A line for every articulation, and for what wheel and legato do beside them; none where there is only the pluck."""
    rows = []
    if preset.articulations:
        for name in articulation_names(preset.articulations):
            table = preset.articulations.get(name, Articulation())
            rows.append((name, "" if table.key is None else midi_to_note(table.key), _others(table), _what(table)))
    if preset.hand.vibrato_cents > 0.0:
        rows.append(("vibrato", "", "controller 1", f"{preset.hand.vibrato_cents:g} cents at {preset.hand.vibrato_hz:g} Hz"))
    if preset.hand.meend_semitones > 0.0:
        how = f"pulls the string by up to {preset.hand.meend_semitones:g} semitones"
        rows.append(("meend", "", "legato (controller 68)", how))
    widths = [max((len(row[column]) for row in rows), default=0) for column in range(3)]
    lines = []
    for row in rows:
        columns = [text.ljust(width) for text, width in zip(row, widths, strict=False) if width]
        lines.append("  ".join([*columns, row[3]]).rstrip())
    return lines


def _others(table: Articulation) -> str:
    """The ways to an articulation beside its key."""
    found = []
    if table.controller is not None:
        found.append(f"controller {table.controller.number} at {table.controller.low}-{table.controller.high}")
    if table.velocity is not None:
        found.append("velocity {}-{}".format(*table.velocity))
    return ", ".join(found)


def _what(table: Articulation) -> str:
    """What is heard of an articulation, in a few words."""
    found = []
    if table.stroke == "throw":
        found.append("hit")
    if table.harmonic:
        found.append("harmonics")
    elif table.touch is not None:
        found.append("damped by a touch")
    if table.strum_ms > 0.0:
        found.append(f"strummed, {table.strum_ms:g} ms a string")
    if table.slide_ms > 0.0:
        found.append(f"legato slides, {table.slide_ms:g} ms a fret")
    return ", ".join(found)


def keys_that_switch(presets: Sequence[Preset]) -> dict[int, str]:
    """Keys that are notes of none of the presets, and the articulation that they switch to in one."""
    found = {key: name for preset in presets for key, name in switch_keys(preset).items()}
    notes = {note for preset in presets for note in playable_notes(preset)}
    return {key: name for key, name in found.items() if key not in notes}
